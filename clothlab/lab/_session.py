"""A live run that a person steers: robot, cloth, target, driver and recording.

No widgets here.
"""

import copy
import secrets
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import check_array, choose
from clothlab.analysis import nearest_material
from clothlab.lab._drivers import DRIVERS, Drivers, Period
from clothlab.lab._recorder import Recorder
from clothlab.lab._targets import (
    reconstruction_distance,
    recorded_targets,
    reference_images,
    usual_reconstruction_distance,
)
from clothlab.lab._tracker import BiasTracker
from clothlab.masks import check_mask, iou
from clothlab.method.autoencoder import decode, encode, known_target
from clothlab.method.cloth_task import observe
from clothlab.simulation.arm import check_command
from clothlab.simulation.cloth import CLOTHS, Cloth, get_cloth
from clothlab.simulation.env import ClothEnv, Scene, SimulationError
from clothlab.trials import recorded_plans


class _Setup(NamedTuple):
    weights: str
    trials: str  # that the weights learned from
    known: str  # others, for the calibration of the estimate
    cloth: str
    target: str


SETUPS = {
    "torque": _Setup(
        "torque-0", "train", "evaluation", "damp0.05-mass0.10", "target-2"
    ),
    "muscle": _Setup(
        "muscle-0", "muscle-train", "muscle-evaluation", "soft-1", "muscle"
    ),
}


@dataclass(frozen=True, eq=False)
class StepInfo:
    """What one control step of a session saw and did."""

    step: int  # number since the last reset
    image: np.ndarray  # cloth mask [H, W], bool
    reconstruction: np.ndarray  # what the autoencoder makes of it [H, W], 0 to 1
    distance: float  # ‖z_ref - z‖ [s.d. of z]
    # Distance that the controller predicts for the end of its period
    predicted: float | None
    command: np.ndarray  # [D_u], in the arm's units
    theta: np.ndarray  # joint angles [2] [rad]
    p: np.ndarray  # parametric bias in use [D_p]
    seconds: float  # what the step took to compute [s]
    # Whether the controller solved for this command, or went on with its last plan
    solved: bool
    period_ended: bool  # whether it was the last command of the controller's period
    # Then, the distance predicted at its beginning and the achieved one
    period: Period | None
    # What the plan rests on: "recordings", or so many "attempts"; empty for other
    # drivers
    basis: str
    # z that the control predicts for the end of its period [D_z]
    foreseen: np.ndarray | None
    began: np.ndarray | None  # and what it predicted when the period began


class LiveSession:
    """One robot with one cloth, step by step. Between two steps all can be changed; a
    refusal changes nothing.

    Args:
        arm: name of an arm, which brings its own cloth, target and p.
        recordings: folder for recorded trials; by default `artifacts.own_trials()`,
            which `load_trials("mine")` reads.
        picture_size: of the scene's picture, height and width [pixel].
    """

    def __init__(
        self,
        arm: str = "torque",
        *,
        recordings: Path | None = None,
        picture_size: tuple[int, int] = (288, 384),
    ):
        self._scene = Scene(picture_size=picture_size)
        self.driver = "control"  # one of `DRIVERS`
        # Whether the driver "iterative" tries new plans; else it repeats the best known
        # one
        self.exploring = True
        self.estimating = False  # whether p follows what is observed
        self.seed = 0  # of the random numbers since the last reset
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

    def _equip(self, setup: _Setup) -> None:
        self.trained, trials = (
            artifacts.load(setup.weights),
            artifacts.load_trials(setup.trials),
        )
        self._known = setup.known
        self.arm, self._plans = self.trained.arm, recorded_plans(trials)
        self._runs = [self.trained.to_run(trial) for trial in trials]
        self._images, targets = reference_images(trials), artifacts.load_targets()
        # Beyond this chamfer distance to its reconstruction [pixel], an image is unlike
        # any recorded one.
        self.usual_distance = usual_reconstruction_distance(
            self.trained.autoencoder, self._images
        )
        # Images to aim at, `{name: mask [H, W]}`: the stored targets, and recorded ones
        # from large to small.
        self.gallery = targets | recorded_targets(self._images)
        self.target = choose("target", setup.target, targets)
        self._p = choose("material", setup.cloth, self.trained.biases).copy()
        self.hand = self.arm.home_command  # the command of the driver "manual" `[D_u]`
        self.env = ClothEnv(self.arm, setup.cloth, scene=self._scene)
        self.set_tension(None)
        self.set_target(self.target)
        self._begin()

    def set_cloth(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still; p stays, so that the
        estimation has something to find.
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
        """Change C_damp [N s/m] and C_mass [kg] of the cloth in the hand, which starts
        again from rest.
        """
        self.set_cloth(_changed(self.env.cloth, damping, mass))

    def reset(self) -> None:
        """Let the cloth hang still at the arm's home; controllers and estimator forget
        what they saw and learned.
        """
        self._refuse_while_recording("the run")
        self.env.start()
        self._begin()

    def _begin(self) -> None:
        """Go on from a cloth that was just made to hang still."""
        self.observation = self.env.observe()
        self._still = encode(self.trained.autoencoder, self.observation["image"])
        self.command = self.arm.home_command  # the last one that was sent `[D_u]`
        self.step_number, self.seed = 0, secrets.randbits(32)
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
        """Aim at another image `[H, W]` from the next step on; iterative learning does
        from its next period on.

        At a recorded image in its place, if that is more like it than what the
        autoencoder makes of it: `known_target`.
        """
        mask, autoencoder = check_mask(mask), self.trained.autoencoder
        aim = known_target(autoencoder, mask, self._images)
        reconstruction = decode(autoencoder, encode(autoencoder, mask))
        self._drivers.set_target(aim)
        self.target, self._z_ref, self.reconstruction = (
            mask.copy(),
            encode(autoencoder, aim),
            reconstruction,
        )
        self.reconstruction_distance = reconstruction_distance(mask, reconstruction)
        # IoU of the recorded image that is most like it
        self.overlap = float(iou(self._images, mask).max())

    def set_driver(self, driver: str) -> None:
        """Change who chooses the commands.

        What iterative learning learned waits for its next turn.
        """
        driver = choose("driver", driver, {name: name for name in DRIVERS})
        if driver != self.driver:
            self._drivers.resume()
        self.driver = driver

    def set_hand(self, u: ArrayLike) -> None:
        """Command `[D_u]` for the driver "manual"."""
        self.hand = check_command(self.arm, u)

    def set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command of a muscle arm [N] for every driver, or free it
        with None; learning restarts.
        """
        arm = self.arm if f_const is None else self.arm.with_stiffness(f_const)
        self._drivers = Drivers(
            self.trained, arm, self.target, self._p, plans=self._plans, runs=self._runs
        )
        self._drivers.reset(self.seed)
        self.tension = f_const

    def step(self, *, solve: bool = True) -> StepInfo:
        """Choose a command, send it, and look; without `solve`, a controller goes on
        with its last plan.
        """
        start, seen = time.perf_counter(), self.observation
        chosen = self._drivers.choose(
            self.driver, seen, hand=self.hand, solve=solve, exploring=self.exploring
        )
        u = chosen.command
        before = copy.copy(self.env.data)
        try:
            self.env.advance(u)
            observation = self.env.observe()
        except (
            BaseException
        ):  # after a failure or an interrupt, the step has not happened
            self.env.data = before
            raise
        self.observation, self.step_number, self.command = (
            observation,
            self.step_number + 1,
            u,
        )
        if self.recorder.running:
            about = {
                "cloth": self.env.cloth,
                "arm": self.arm,
                "policy": self.driver,
                "seed": self.seed,
            }
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
            period=self._drivers.close_period(self.driver, chosen, distance),
            began=self._drivers.began,
            **chosen._asdict(),
        )

    @property
    def still_distance(self) -> float:
        """Distance to the target of the cloth that hangs still [s.d. of z]."""
        return float(np.linalg.norm(self._z_ref - self._still))

    def record(self) -> None:
        """Let the cloth hang still, and record from there, so that the trial can be
        replayed.
        """
        self.recorder.start()
        try:
            self.env.start()
            self._begin()
        except BaseException:
            self.recorder.discard()
            raise

    def close(self) -> None:
        """Release the OpenGL contexts, and let go of a recording, which waits to be
        saved.
        """
        self.env.close()
        self.recorder.close()

    def _use(self, p: np.ndarray) -> None:
        self._drivers.set_bias(p)
        self._p = p

    def _refuse_while_recording(self, what: str) -> None:
        if self.recorder.running:
            raise ValueError(
                f"{what} cannot change during a recording: save or discard it first"
            )


def _changed(cloth: Cloth, damping: float, mass: float) -> Cloth:
    """One of the known cloths where these are its values, else a cloth of one's own."""
    own = replace(cloth, name="own", damping=damping, mass=mass, foam="")
    own = replace(own, name=f"damp{own.damping:.3f}-mass{own.mass:.3f}")
    return next(
        (known for known in CLOTHS.values() if replace(own, name=known.name) == known),
        own,
    )
