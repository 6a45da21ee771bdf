"""A live run that a person steers: robot, cloth, target, who moves it, and what is remembered. No widgets here."""

import copy
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, check_array, choose, setting
from clothlab.analysis import nearest_material
from clothlab.arm import Arm, check_command
from clothlab.autoencoder import decode, encode
from clothlab.cloth import CLOTHS, Cloth, get_cloth
from clothlab.control import recorded_plans
from clothlab.dpmpb import observe
from clothlab.env import ClothEnv, Observation, Scene, SimulationError
from clothlab.estimation import BiasEstimator
from clothlab.lab.recorder import Recorder
from clothlab.trials import OperatorPolicy, Policy, RandomPolicy
from clothlab.vision import HEIGHT, WIDTH, chamfer_distance, check_mask

YARDSTICK_EVERY = 20  # of the recorded images, one in so many serves as a yardstick for drawn ones
RECORDED_TARGETS = 7  # how many recorded images the gallery has
DRIVERS = ("control", "hand", "random", "operator")


@dataclass(frozen=True)
class Setup(Checked):
    """What a session starts with on each arm: the sets of weights and trials, a cloth and a target."""

    weights: str = setting()
    trials: str = setting()
    cloth: str = setting()
    target: str = setting()


SETUPS = {
    "torque": Setup("torque-0", "train", "damp0.05-mass0.10", "target-2"),
    "muscle": Setup("muscle-0", "muscle-train", "soft-1", "muscle"),
}


@dataclass(frozen=True, eq=False)
class Moment:
    """What one control step of a session saw and did."""

    step: int  # number since the last reset
    image: np.ndarray  # cloth mask [H, W], bool
    reconstruction: np.ndarray  # what the autoencoder makes of it [H, W], 0 to 1
    distance: float  # ‖z_ref - z‖ [s.d. of z]
    command: np.ndarray  # [D_u], in the arm's units
    theta: np.ndarray  # joint angles [2] [rad]
    p: np.ndarray  # parametric bias in use [D_p]
    seconds: float  # what the step took to compute [s]
    solved: bool  # whether the controller solved for this command, or went on with its last plan


class Hand(Policy):
    """Sends what a person's sliders say, within the range of the arm."""

    name = "hand"

    def __init__(self, arm: Arm, u: np.ndarray):
        self.arm, self.u = arm, u

    def __call__(self, observation: Observation) -> np.ndarray:
        return np.clip(self.u, self.arm.command_lower, self.arm.command_upper)


def mask_from_file(content: bytes) -> np.ndarray:
    """Read a target `[H, W]` from a picture file: bright is cloth.

    Raises:
        ValueError: not a picture, another size, or no cloth in it.
    """
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE) if content else None
    if picture is None:
        raise ValueError("this file is not a picture: use PNG or JPEG")
    if picture.shape != (HEIGHT, WIDTH):
        raise ValueError(f"a target has {WIDTH}×{HEIGHT} pixels, this picture {picture.shape[1]}×{picture.shape[0]}")
    return check_mask(picture > 127)


class LiveSession:
    """One robot with one cloth, step by step. Between two steps all can be changed; a refusal changes nothing.

    Args:
        arm: name of an arm, which brings its own cloth, target and p.
        recordings: folder for recorded trials; by default `data/trials/mine`, which `load_trials("mine")` reads.
        picture_size: of the scene's picture, height and width [pixel].

    Raises:
        KeyError: unknown arm, or weights that are missing; the message lists the choices.

    Attributes:
        driver: who chooses the commands, one of `DRIVERS`.
        estimating: whether p follows what is observed.
        hand: the command `[D_u]` that the driver "hand" sends.
        tension: f_const [N] that everyone has to send, or None.
        believed: what the autoencoder makes of `target` `[H, W]`, 0 to 1.
        misunderstanding: chamfer distance [pixel] between the two; infinite where no cloth is left.
        usual_distance: the same of recorded images, 99th percentile [pixel]: beyond it, an image is unlike any cloth.
        gallery: images to aim at, `{name: mask [H, W]}`: the stored targets, and recorded ones from large to small.
        seed: of the random numbers since the last reset.
    """

    def __init__(
        self, arm: str = "torque", *, recordings: Path | None = None, picture_size: tuple[int, int] = (288, 384)
    ):
        self._scene = Scene(picture_size=picture_size)
        self.driver, self.estimating, self.seed = "control", False, 0
        self.recorder = Recorder(recordings or artifacts.data_folder() / artifacts.OWN_TRIALS)
        self.set_arm(arm)

    def set_arm(self, name: str) -> None:
        """Change the arm, and with it weights, cloth, target and p."""
        self._refuse_while_recording("the arm")
        before = vars(self).copy()
        try:
            self._equip(choose("arm", name, SETUPS))
        except BaseException:
            vars(self).update(before)
            raise
        if "env" in before:
            before["env"].close()

    def _equip(self, setup: Setup) -> None:
        self.trained, trials = artifacts.load(setup.weights), artifacts.load_trials(setup.trials)
        self.arm, autoencoder = self.trained.arm, self.trained.autoencoder
        images = np.concatenate([trial.images[::YARDSTICK_EVERY] for trial in trials])
        images = images[images.any(axis=(1, 2))]  # those with a cloth in view
        distances = map(_misunderstanding, images, decode(autoencoder, encode(autoencoder, images)))
        self.usual_distance = float(np.percentile(list(distances), 99))
        recorded = images[images.sum(axis=(1, 2)).argsort()[::-1]][:: -(-len(images) // RECORDED_TARGETS)]
        targets, self._plans = artifacts.load_targets(), recorded_plans(trials)
        self.gallery = targets | {f"recorded {k + 1}": image for k, image in enumerate(recorded)}
        self.target = choose("target", setup.target, targets)
        self._p = choose("material", setup.cloth, self.trained.biases).copy()
        self.hand, self.env = self.arm.home_command, ClothEnv(self.arm, setup.cloth, scene=self._scene)
        self.set_tension(None)
        self.set_target(self.target)
        self._begin()

    def set_cloth(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still; p stays, so that the estimation has something to find.

        Raises:
            SimulationError: this cloth cannot be simulated.
        """
        self._refuse_while_recording("the cloth")
        cloth, before = get_cloth(cloth), self.env.cloth
        try:
            self.env.hold(cloth)
        except SimulationError as error:
            raise SimulationError(
                f"the cloth {cloth.label} is too light or too stiff to be simulated: {before.label} stays in the hand"
            ) from error
        self._begin()

    def set_material(self, damping: float, mass: float) -> None:
        """Change C_damp [N s/m] and C_mass [kg] of the cloth in the hand, which starts again from rest.

        Raises:
            ValueError, SimulationError: values that no cloth has, or with which it cannot be simulated.
        """
        own = replace(self.env.cloth, name="own", damping=damping, mass=mass, foam="")
        own = replace(own, name=f"damp{own.damping:.3f}-mass{own.mass:.3f}")
        known = (cloth for cloth in CLOTHS.values() if replace(own, name=cloth.name) == cloth)
        self.set_cloth(next(known, own))

    def reset(self) -> None:
        """Let the cloth hang still at the arm's home; controller and estimator forget what they saw."""
        self._refuse_while_recording("the run")
        self.env.start()
        self._begin()

    def _begin(self) -> None:
        """Go on from a cloth that was just made to hang still."""
        self.observation = self.env.observe()
        self._still = encode(self.trained.autoencoder, self.observation["image"])
        self.step_number, self.seed = 0, int(np.random.default_rng().integers(2**32))
        for policy in self._policies.values():
            policy.reset(self.seed)
        self._estimator = BiasEstimator(self.trained.model, self._p)

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.copy()

    def set_p(self, p: ArrayLike) -> None:
        """Use this p from the next step on; the estimation goes on from it.

        Raises:
            ValueError: p of another size or not finite.
        """
        p = check_array("p", p, self._p.shape, np.float32)
        self._estimator = BiasEstimator(self.trained.model, p)
        self._use(p)

    @property
    def nearest(self) -> str:
        """The trained material whose p is nearest."""
        return nearest_material(self._p, self.trained.biases)

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next step on; `believed` is what the network makes of it.

        Raises:
            ValueError: another shape, or no cloth in it.
        """
        mask = check_mask(mask)
        z = encode(self.trained.autoencoder, mask)
        believed = decode(self.trained.autoencoder, z)
        for policy in self._policies.values():
            policy.set_target(mask)
        self.target, self._z_ref, self.believed = mask.copy(), z, believed
        self.misunderstanding = _misunderstanding(mask, believed)

    def set_driver(self, driver: str) -> None:
        """Change who chooses the commands.

        Raises:
            KeyError: unknown driver; the message lists the choices.
        """
        policy = choose("driver", driver, self._policies)
        if driver == "control" != self.driver:
            policy.reset()  # it was not asked for a while: its plan and memory are of then
        self.driver = driver

    def set_hand(self, u: ArrayLike) -> None:
        """Command `[D_u]` for the driver "hand".

        Raises:
            ValueError: another shape, not finite or out of range.
        """
        self.hand = self._policies["hand"].u = check_command(self.arm, u)

    def set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command of a muscle arm [N] for every driver, or leave it free with None.

        Raises:
            ValueError: outside the arm's range, or an arm without a stiffness command.
        """
        arm = self.arm if f_const is None else self.arm.with_stiffness(f_const)
        control = self.trained.controller(self.target, self._p, plans=self._plans, arm=arm)
        policies = (control, Hand(arm, self.hand), RandomPolicy(arm), OperatorPolicy(arm))
        for policy in policies:
            policy.reset(self.seed)
        self._policies: dict[str, Any] = dict(zip(DRIVERS, policies, strict=True))
        self.tension = f_const

    def step(self, *, solve: bool = True) -> Moment:
        """Choose a command, send it, and look. A step that fails has not happened.

        Args:
            solve: False lets the controller go on with its last plan, for when the time for a solve has run out.

        Raises:
            SimulationError: the physics diverged.
            OSError: a recording cannot be written any more; it is stopped, and the step has happened.
        """
        start = time.perf_counter()
        seen, policy = self.observation, self._policies[self.driver]
        solved = self.driver == "control" and (solve or not policy.trace)  # the first plan must come from a solve
        u = (policy.coast if self.driver == "control" and not solved else policy)(seen)
        before = copy.copy(self.env.data)
        try:
            self.env.advance(u)
            observation = self.env.observe()
        except BaseException:  # an interrupt, too: half a step could not be replayed
            self.env.data = before
            raise
        self.observation = observation
        self.step_number += 1
        if self.recording:
            about = {"cloth": self.env.cloth, "arm": self.arm.name, "policy": self.driver, "seed": self.seed}
            self.recorder.add(seen, u, about)
        if self.estimating:
            self._use(self._estimator.update(observe(self.trained.autoencoder, seen), u))
        z = encode(self.trained.autoencoder, observation["image"])
        return Moment(
            step=self.step_number,
            image=observation["image"].astype(bool),
            reconstruction=decode(self.trained.autoencoder, z),
            distance=float(np.linalg.norm(self._z_ref - z)),
            command=u,
            theta=self.arm.angles(self.env.data),
            p=self.p,
            seconds=time.perf_counter() - start,
            solved=solved,
        )

    @property
    def still_distance(self) -> float:
        """Distance to the target of the cloth that hangs still [s.d. of z]: what is worse is worse than nothing."""
        return float(np.linalg.norm(self._z_ref - self._still))

    def picture(self) -> np.ndarray:
        """The scene now, `[h, w, 3]` uint8."""
        return self.env.picture()

    @property
    def recording(self) -> bool:
        """Whether steps are being recorded."""
        return self.recorder.running

    def record(self) -> None:
        """Let the cloth hang still, and record from there, so that the trial can be replayed.

        Raises:
            ValueError, FileExistsError, OSError: as `Recorder.start`.
        """
        self.recorder.start()
        try:
            self.env.start()
            self._begin()
        except BaseException:
            self.recorder.discard()
            raise

    def close(self) -> None:
        """Release the OpenGL contexts, and let go of a recording, which waits to be saved."""
        self.env.close()
        self.recorder.close()

    def _use(self, p: np.ndarray) -> None:
        for policy in self._policies.values():
            policy.set_bias(p)
        self._p = p

    def _refuse_while_recording(self, what: str) -> None:
        if self.recording:
            raise ValueError(f"{what} cannot change during a recording: save or discard it first")


def _misunderstanding(mask: np.ndarray, reconstruction: np.ndarray) -> float:
    """Chamfer distance [pixel] between a mask and its reconstruction; infinite where no cloth is left."""
    believed = reconstruction > 0.5
    return chamfer_distance(mask, believed) if believed.any() else np.inf
