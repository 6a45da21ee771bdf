"""A live run that a person steers: robot, cloth, target, driver and recording.

No widgets here.
"""

import secrets
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab import data
from clothlab._validation import check_array, choose
from clothlab.analysis import nearest_material, spread
from clothlab.lab.drivers import DRIVERS, Drivers, Period
from clothlab.lab.recorder import Recorder
from clothlab.lab.targets import (
    Aim,
    aim_at,
    recorded_targets,
    reference_images,
    usual_reconstruction_distance,
)
from clothlab.method.autoencoder import decode, encode
from clothlab.method.cloth_task import observe
from clothlab.method.estimation import NewtonEstimator, NewtonSettings
from clothlab.simulation.cloth import CLOTHS, Cloth, get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from clothlab.trials import recorded_plans


class _Setup(NamedTuple):
    """What comes with an arm, by names of the data."""

    weights: str
    trials: str  # that the weights learned from
    cloth: str
    target: str


SETUPS = {
    "torque": _Setup(
        weights="torque-0", trials="train", cloth="damp0.05-mass0.10", target="target-2"
    ),
    "muscle": _Setup(
        weights="muscle-0", trials="muscle-train", cloth="soft-1", target="muscle"
    ),
}
# When a cloth is called unfamiliar: its p is so far from every trained one, in units of
# their spread, so many steps after its estimate began. Measured with the torque arm,
# after 30 s: 1 of 75 runs with trained cloths and with cloths between these, 34 of 45
# with cloths beyond them. The muscle arm has no such cloths, and 3 of 15 false alarms.
_FAR = 0.5
_SETTLED = 50


@dataclass(frozen=True, eq=False)
class StepInfo:
    """What one control step of a session saw and did."""

    step: int  # number since the last reset
    seconds: float  # what it took to compute [s]

    # What was seen after it
    image: np.ndarray  # cloth mask [H, W], bool
    reconstruction: np.ndarray  # what the autoencoder makes of it [H, W], 0 to 1
    distance: float  # ‖z_ref - z‖ [s.d. of z]
    theta: np.ndarray  # joint angles [2] [rad]
    p: np.ndarray  # parametric bias in use [D_p]
    estimating: bool  # whether it follows what is observed

    # The command, and what its driver said of it: see `Choice`
    command: np.ndarray  # [D_u], in the arm's units
    solved: bool  # whether a controller solved for it, or went on with its last plan
    predicted: float | None  # distance at the end of the controller's period
    basis: str  # what the plan rests on, "recordings" or so many "attempts"; or empty

    # The controller's period
    period_ended: bool  # whether this was its last command
    period: Period | None  # then, the distance predicted at its beginning and achieved


class LiveSession:
    """One robot with one cloth, step by step.

    Between two steps all can be changed.

    Args:
        arm: name of an arm, which brings its own cloth, target and p.
        recordings: folder for recorded trials; by default the one that
            `load_trials("mine")` reads.
        picture_size: of the scene's picture, height and width [pixel].
    """

    env: ClothEnv

    def __init__(
        self,
        arm: str = "torque",
        *,
        recordings: Path | None = None,
        picture_size: tuple[int, int] = (288, 384),
    ):
        # What stays when the arm changes
        self._scene = Scene(picture_size=picture_size)
        self.driver = "control"  # one of `DRIVERS`
        # Whether the driver "iterative" tries new plans; else it repeats the best known
        # one
        self.exploring = True
        self.estimating = False  # whether p follows what is observed
        self.seed = 0  # of the random numbers since the last reset
        self.recorder = Recorder(recordings or data.own_trials())
        self.set_arm(arm)

    def set_arm(self, name: str) -> None:
        """Change the arm, and with it weights, cloth, target and p."""
        self._refuse_while_recording("the arm")
        setup = choose("arm", name, SETUPS)
        self.trained = data.load(setup.weights)
        self.arm = self.trained.arm

        # What drivers and targets are compared with: recordings of the training
        trials = data.load_trials(setup.trials)
        self.runs = [self.trained.to_run(trial) for trial in trials]
        self.plans = recorded_plans(trials)  # of the control [N, horizon, D_u]
        self.images = reference_images(trials)  # [N, H, W]
        self.usual_distance = usual_reconstruction_distance(
            self.trained.autoencoder, self.images
        )
        # To aim at, {name: mask [H, W]}
        self.gallery = data.load_targets() | recorded_targets(self.images)

        # Where it begins
        self._p = self.trained.biases[setup.cloth].copy()
        self.hand = self.arm.home_command  # the command of the driver "manual" [D_u]
        if hasattr(self, "env"):
            self.env.close()
        self.env = ClothEnv(self.arm, setup.cloth, scene=self._scene)
        self.aim = self.aim_at(self.gallery[setup.target])
        self.set_tension(None)
        self._begin()

    def set_cloth(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still.

        p stays, so that the estimation has something to find.
        """
        self._refuse_while_recording("the cloth")
        self.env.hold(get_cloth(cloth))
        self._begin()

    def set_material(self, damping: float, mass: float) -> None:
        """Change C_damp [N s/m] and C_mass [kg] of the cloth in the hand.

        It starts again from rest.
        """
        self.set_cloth(_changed(self.env.cloth, damping, mass))

    def reset(self, seed: int | None = None) -> None:
        """Let the cloth hang still at the arm's home.

        Controllers and estimator forget what they saw and learned. A `seed` repeats a
        run; without one, it is another run each time.
        """
        self._refuse_while_recording("the run")
        self.env.start()
        self._begin(seed)

    def _begin(self, seed: int | None = None) -> None:
        """Go on from a cloth that was just made to hang still."""
        self.observation = self.env.observe()
        self._still = encode(self.trained.autoencoder, self.observation["image"])
        self.command = self.arm.home_command  # the last one that was sent [D_u]
        self.step_number = 0
        self.seed = secrets.randbits(32) if seed is None else seed
        self._drivers.reset(self.seed)
        self._estimator: NewtonEstimator | None = None  # made when p is estimated

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.copy()

    def set_p(self, p: ArrayLike) -> None:
        """Use this p from the next step on; the estimation goes on from it."""
        self._use(check_array("p", p, self._p.shape, np.float32))
        self._estimator = None

    def _use(self, p: np.ndarray) -> None:
        self._drivers.set_bias(p)
        self._p = p

    @property
    def covariance(self) -> np.ndarray | None:
        """How far the estimate of p scatters, `[D_p, D_p]`.

        None while p is not estimated, and before that can be said.
        """
        if self._estimator is None:
            return None
        seen = self._estimator.linearisation()
        try:
            return None if seen is None else seen.covariance()
        except np.linalg.LinAlgError:
            return None

    @property
    def unfamiliar(self) -> bool:
        """Whether the estimate of p says that the cloth is unlike the trained ones."""
        if self._estimator is None or self._estimated < _SETTLED:
            return False
        if self.arm.has_stiffness:
            return False
        biases = self.trained.biases
        nearest = biases[nearest_material(self._p, biases)]
        return float(np.linalg.norm(self._p - nearest)) > _FAR * spread(biases)

    @property
    def target(self) -> np.ndarray:
        """The image that was chosen to aim at `[H, W]`, bool."""
        return self.aim.mask

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next step on.

        Iterative learning does from its next period on. At a recorded image in its
        place, if that is more like it than what the autoencoder makes of it:
        `known_target`.
        """
        aim = self.aim_at(mask)
        self._drivers.set_target(aim.known)
        self.aim = aim

    def aim_at(self, mask: ArrayLike) -> Aim:
        """What an image `[H, W]` is as a target."""
        return aim_at(mask, self.trained.autoencoder, self.images)

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
        self.hand = self.arm.check_command(u)

    def set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command of a muscle arm [N] for every driver.

        None frees it. Learning restarts.
        """
        arm = self.arm if f_const is None else self.arm.with_stiffness(f_const)
        self._drivers = Drivers(
            self.trained, arm, self.aim.known, self._p, plans=self.plans, runs=self.runs
        )
        self._drivers.reset(self.seed)
        self.tension = f_const

    def step(self, *, solve: bool = True) -> StepInfo:
        """Choose a command, send it, and look.

        Without `solve`, a controller goes on with its last plan.
        """
        # Choose and send
        start = time.perf_counter()
        before = self.observation
        choice = self._drivers.choose(
            self.driver, before, hand=self.hand, solve=solve, exploring=self.exploring
        )
        self.env.advance(choice.command)
        self.observation = self.env.observe()
        self.step_number += 1
        self.command = choice.command

        # Keep what was seen, and learn from it
        if self.recorder.running:
            self.recorder.add(before, choice.command, self.driver)
        if self.estimating:
            s = observe(self.trained.autoencoder, before)
            self._estimate(s, choice.command)
        else:
            self._estimator = None  # a window with a gap would say nothing

        # How near it came
        image = self.observation["image"]
        z = encode(self.trained.autoencoder, image)
        distance = float(np.linalg.norm(self.aim.z - z))
        return StepInfo(
            step=self.step_number,
            image=image.astype(bool),
            reconstruction=decode(self.trained.autoencoder, z),
            distance=distance,
            theta=self.arm.angles(self.env.data),
            p=self.p,
            estimating=self.estimating,
            seconds=time.perf_counter() - start,
            period=self._drivers.close_period(choice, distance),
            **choice._asdict(),
        )

    def _estimate(self, s: np.ndarray, u: np.ndarray) -> None:
        """Let p follow a step by Gauss-Newton: state `[D_s]`, then command `[D_u]`."""
        if self._estimator is None:
            settings = NewtonSettings(from_rest=self.step_number == 1)
            model = self.trained.model
            self._estimator = NewtonEstimator(model, self._p, settings)
            self._estimated = 0  # steps since then
        self._estimated += 1
        self._use(self._estimator.update(s, u))

    @property
    def still_distance(self) -> float:
        """Distance to the target of the cloth that hangs still [s.d. of z]."""
        return float(np.linalg.norm(self.aim.z - self._still))

    def record(self) -> None:
        """Let the cloth hang still, and record from there.

        The trial can be replayed then.
        """
        seed = secrets.randbits(32)
        self.recorder.start(self.env.cloth, self.arm, seed)
        self.env.start()
        self._begin(seed)

    def _refuse_while_recording(self, what: str) -> None:
        if self.recorder.running:
            raise ValueError(
                f"{what} cannot change during a recording: save or discard it first"
            )

    def close(self) -> None:
        """Release the OpenGL contexts."""
        self.env.close()


def _changed(cloth: Cloth, damping: float, mass: float) -> Cloth:
    """One of the known cloths where these are its values, else a cloth of one's own."""
    own = replace(cloth, name="own", damping=damping, mass=mass, foam="")
    own = replace(own, name=f"damp{own.damping:.3f}-mass{own.mass:.3f}")
    for known in CLOTHS.values():
        if replace(own, name=known.name) == known:
            return known
    return own
