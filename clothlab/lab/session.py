"""A live run that a person steers: robot, cloth, target, who moves it, and what is remembered. No widgets here."""

import copy
import secrets
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, check_array, choose, setting
from clothlab.analysis import nearest_material
from clothlab.lab.drivers import DRIVERS, Drivers, Period
from clothlab.lab.recorder import Recorder
from clothlab.lab.targets import (
    reconstruction_distance,
    recorded_targets,
    reference_images,
    usual_reconstruction_distance,
)
from clothlab.lab.tracker import BiasTracker
from clothlab.learning.autoencoder import decode, encode
from clothlab.learning.control import recorded_plans
from clothlab.learning.dpmpb import observe
from clothlab.simulation.arm import check_command
from clothlab.simulation.cloth import CLOTHS, Cloth, get_cloth
from clothlab.simulation.env import ClothEnv, Scene, SimulationError
from clothlab.simulation.vision import check_mask


@dataclass(frozen=True)
class Setup(Checked):
    """What a session starts with on each arm: weights, trials that they learned from and others, cloth and target."""

    weights: str = setting()
    trials: str = setting()
    known: str = setting()
    cloth: str = setting()
    target: str = setting()


SETUPS = {
    "torque": Setup("torque-0", "train", "evaluation", "damp0.05-mass0.10", "target-2"),
    "muscle": Setup("muscle-0", "muscle-train", "muscle-evaluation", "soft-1", "muscle"),
}


@dataclass(frozen=True, eq=False)
class StepInfo:
    """What one control step of a session saw and did."""

    step: int  # number since the last reset
    image: np.ndarray  # cloth mask [H, W], bool
    reconstruction: np.ndarray  # what the autoencoder makes of it [H, W], 0 to 1
    distance: float  # ‖z_ref - z‖ [s.d. of z]
    predicted: float | None  # distance that the controller predicts for the end of its period
    command: np.ndarray  # [D_u], in the arm's units
    theta: np.ndarray  # joint angles [2] [rad]
    p: np.ndarray  # parametric bias in use [D_p]
    seconds: float  # what the step took to compute [s]
    solved: bool  # whether the controller solved for this command, or went on with its last plan
    period_ended: bool  # whether it was the last command of the controller's period
    period: Period | None  # then, the distance predicted at its beginning and the achieved one


class LiveSession:
    """One robot with one cloth, step by step. Between two steps all can be changed; a refusal changes nothing.

    Args:
        arm: name of an arm, which brings its own cloth, target and p.
        recordings: folder for recorded trials; by default `artifacts.own_trials()`, which `load_trials("mine")` reads.
        picture_size: of the scene's picture, height and width [pixel].

    Attributes:
        driver: who chooses the commands, one of `DRIVERS`.
        exploring: whether the driver "iterative" tries new plans; else it repeats the best known one.
        estimating: whether p follows what is observed.
        hand: the command `[D_u]` that the driver "manual" sends.
        command: the last one that was sent `[D_u]`, by whoever drives; before the first, where the arm is at home.
        tension: f_const [N] that everyone has to send, or None.
        reconstruction: what the autoencoder makes of `target` `[H, W]`, 0 to 1.
        reconstruction_distance: chamfer distance [pixel] between the two; infinite where no cloth is left.
        usual_distance: the same of recorded images, 99th percentile [pixel]: beyond it, an image is unlike any cloth.
        gallery: images to aim at, `{name: mask [H, W]}`: the stored targets, and recorded ones from large to small.
        finder: who estimates p, and estimate_report.
        seed: of the random numbers since the last reset.
    """

    def __init__(
        self, arm: str = "torque", *, recordings: Path | None = None, picture_size: tuple[int, int] = (288, 384)
    ):
        self._scene = Scene(picture_size=picture_size)
        self.driver, self.exploring, self.estimating, self.seed = "control", True, False, 0
        self.recorder = Recorder(recordings or artifacts.own_trials())
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
        self._known = setup.known
        self.arm, self._plans = self.trained.arm, recorded_plans(trials)
        self._runs = [self.trained.sequences(trial) for trial in trials]
        images, targets = reference_images(trials), artifacts.load_targets()
        self.usual_distance = usual_reconstruction_distance(self.trained.autoencoder, images)
        self.gallery = targets | recorded_targets(images)
        self.target = choose("target", setup.target, targets)
        self._p = choose("material", setup.cloth, self.trained.biases).copy()
        self.hand, self.env = self.arm.home_command, ClothEnv(self.arm, setup.cloth, scene=self._scene)
        self.set_tension(None)
        self.set_target(self.target)
        self._begin()

    def set_cloth(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still; p stays, so that the estimation has something to find."""
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
        """Change C_damp [N s/m] and C_mass [kg] of the cloth in the hand, which starts again from rest."""
        self.set_cloth(_changed(self.env.cloth, damping, mass))

    def reset(self) -> None:
        """Let the cloth hang still at the arm's home; controllers and estimator forget what they saw and learned."""
        self._refuse_while_recording("the run")
        self.env.start()
        self._begin()

    def _begin(self) -> None:
        """Go on from a cloth that was just made to hang still."""
        self.observation = self.env.observe()
        self._still = encode(self.trained.autoencoder, self.observation["image"])
        self.command, self.step_number, self.seed = self.arm.home_command, 0, secrets.randbits(32)
        self._drivers.reset(self.seed)
        self.tracker = BiasTracker(self.trained, self._known, self._p)

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.copy()

    def set_p(self, p: ArrayLike) -> None:
        """Use this p from the next step on; the estimation goes on from it."""
        p = check_array("p", p, self._p.shape, np.float32)
        self.tracker = BiasTracker(self.trained, self._known, p)
        self._use(p)

    @property
    def nearest(self) -> str:
        """The trained material whose p is nearest."""
        return nearest_material(self._p, self.trained.biases)

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next step on; `reconstruction` is what the network makes of it.

        Practice does so from its next period on, and keeps what it learned.
        """
        mask = check_mask(mask)
        z = encode(self.trained.autoencoder, mask)
        reconstruction = decode(self.trained.autoencoder, z)
        self._drivers.set_target(mask)
        self.target, self._z_ref, self.reconstruction = mask.copy(), z, reconstruction
        self.reconstruction_distance = reconstruction_distance(mask, reconstruction)

    def set_driver(self, driver: str) -> None:
        """Change who chooses the commands. What practice learned waits for its next turn."""
        driver = choose("driver", driver, {name: name for name in DRIVERS})
        if driver != self.driver:
            self._drivers.resume()
        self.driver = driver

    def set_hand(self, u: ArrayLike) -> None:
        """Command `[D_u]` for the driver "manual"."""
        self.hand = check_command(self.arm, u)
        self._drivers.set_hand(self.hand)

    def set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command of a muscle arm [N] for every driver, or leave it free with None.

        Such an arm is another one: practice begins anew.
        """
        arm = self.arm if f_const is None else self.arm.with_stiffness(f_const)
        about = (self.trained, arm, self.target, self._p, self.hand)
        self._drivers = Drivers(*about, plans=self._plans, runs=self._runs)
        self._drivers.reset(self.seed)
        self.tension = f_const

    def step(self, *, solve: bool = True) -> StepInfo:
        """Choose a command, send it, and look. A step that fails has not happened.

        Args:
            solve: False lets the controller go on with its last plan, for when the time for a solve has run out.
        """
        start, seen = time.perf_counter(), self.observation
        chosen = self._drivers.choose(self.driver, seen, solve=solve, exploring=self.exploring)
        u = chosen.command
        before = copy.copy(self.env.data)
        try:
            self.env.advance(u)
            observation = self.env.observe()
        except BaseException:  # an interrupt, too: half a step could not be replayed
            self.env.data = before
            raise
        self.observation, self.step_number, self.command = observation, self.step_number + 1, u
        if self.recording:
            about = {"cloth": self.env.cloth, "arm": self.arm.name, "policy": self.driver, "seed": self.seed}
            self.recorder.add(seen, u, about)
        if self.estimating:
            s = observe(self.trained.autoencoder, seen)
            self._use(self.tracker.update(s, u, at_rest=self.step_number == 1))
        z = encode(self.trained.autoencoder, observation["image"])
        distance = float(np.linalg.norm(self._z_ref - z))
        return StepInfo(
            step=self.step_number,
            image=observation["image"].astype(bool),
            reconstruction=decode(self.trained.autoencoder, z),
            distance=distance,
            theta=self.arm.angles(self.env.data),
            p=self.p,
            seconds=time.perf_counter() - start,
            period=self._drivers.account.add(self.driver, chosen, distance),
            **chosen._asdict(),
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
        """Let the cloth hang still, and record from there, so that the trial can be replayed."""
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
        self._drivers.set_bias(p)
        self._p = p

    def _refuse_while_recording(self, what: str) -> None:
        if self.recording:
            raise ValueError(f"{what} cannot change during a recording: save or discard it first")


def _changed(cloth: Cloth, damping: float, mass: float) -> Cloth:
    """One of the known cloths where these are its values, else a cloth of one's own."""
    own = replace(cloth, name="own", damping=damping, mass=mass, foam="")
    own = replace(own, name=f"damp{own.damping:.3f}-mass{own.mass:.3f}")
    return next((known for known in CLOTHS.values() if replace(own, name=known.name) == known), own)
