"""Setting the table, phase by phase (paper, "Integrated Table Setting Experiment").

The robot decides by what it senses. The true outcome of cloth and basket is measured
besides.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import cache

import numpy as np

from clothlab import data
from clothlab.analysis import nearest_material
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.data import Run
from clothlab.method.estimation import NewtonEstimator
from clothlab.method.rollout import Policy
from clothlab.simulation.arm import SHOULDER_POSITION
from clothlab.simulation.env import SimulationError
from clothlab.trials import Trial, to_run
from clothlab.weights import ClothCheckpoint
from studies.table_scene.gripping import GraspError
from studies.table_scene.perception import NotVisibleError, find_cloth_centre
from studies.table_scene.scene import Basket
from studies.table_scene.servoing import AHEAD_LOW, CLEAR, RobotDriver, grasp
from studies.table_scene.table_env import ClothPose, Placement, TableEnv
from studies.table_scene.throwing import (
    ExcitationPolicy,
    ThrowPolicy,
    ThrowSettings,
    laid_by_hand,
    see_cloth_pose,
    was_spread,
)

ARM = "muscle-hand"  # of the robot
FOAM = "hard-1"  # in its hand
THROWS = "table-throws"  # the recorded throws
# [m] of a cloth that is spread: so near that the basket can be put on its middle
TARGET_AHEAD = 0.66
EXCITATION = 20  # control steps of the motion from which p is estimated
NOISE = 0.002  # [m] of the depth image at 1 m
PHASES = (
    "fetch cloth",
    "go to table",
    "spread cloth",
    "look",
    "fetch basket",
    "carry basket",
    "put basket",
)

# Spreads the cloth in the hand, or lets it fall
_Spreader = Callable[[RobotDriver], object]


class _NotSpreadError(RuntimeError):
    """The cloth does not lie as it should, as far as the robot sees."""


_FAILURES = (NotVisibleError, GraspError, SimulationError, _NotSpreadError)


def go_to_table(driver: RobotDriver) -> None:
    """Lift the cloth, drive in front of the table, and wait until it hangs still."""
    env = driver.env
    driver.move_straight(env.arm.hand(np.array(env.furniture.start_posture)))
    driver.drive(0.0)
    for _ in range(12):
        driver.send(env.arm.home_command)


def throw(
    driver: RobotDriver,
    policy: Policy,
    steps: int = 120,
    done: Callable[[], bool] = lambda: False,
) -> None:
    """Let a policy swing and throw the cloth for so many steps, or until it is `done`.

    `done` is asked after each step.
    """
    for _ in range(steps):
        driver.send(policy(driver.env.observe()))
        if done():
            break


def _see_spread(driver: RobotDriver) -> ClothPose:
    """Look how the cloth lies; a `_NotSpreadError` says why it is not spread."""
    seen = see_cloth_pose(driver.env, height=driver.height, watch=driver.watch)
    driver.command_angles(driver.env.furniture.start_posture)
    if seen is None:
        raise _NotSpreadError("no cloth in view")
    if seen.fault:
        raise _NotSpreadError(seen.fault)
    return seen


def fetch_basket(driver: RobotDriver) -> None:
    """Drive back until the side table is in view; take the basket by its handle."""
    driver.look_towards(driver.env.furniture.side_place[0])
    grasp(driver, "basket")


def _carry_basket(driver: RobotDriver, centre: np.ndarray) -> None:
    """Lift the basket and drive until it is above the cloth's centre `[3]` [m].

    Or as far as the robot can.
    """
    furniture = driver.env.furniture
    above = furniture.height + Basket.handle_height + CLEAR - SHOULDER_POSITION[2]
    driver.move_straight([AHEAD_LOW, above])
    driver.drive(centre[0] - AHEAD_LOW)
    driver.move_straight([centre[0] - driver.env.base, above])


def _put_basket(driver: RobotDriver, centre: np.ndarray) -> None:
    """Lower the basket by visual feedback onto the cloth's centre `[3]` [m].

    Then let go, and go up.
    """
    up = np.array([0.0, 0.0, 1.0])
    driver.servo(lambda cloud, bar: centre + Basket.handle_height * up, up)
    driver.env.release()
    driver.move_straight(np.add(driver.proprioceptive_place, [0.0, 0.15]))
    for _ in range(5):
        driver.step()


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of a task."""

    # The phase in which the robot noticed a failure; empty where it noticed none
    failed: str
    cause: str  # why, in words
    grasped: bool  # whether the cloth was
    seen: ClothPose | None  # how the cloth seemed to lie, if it seemed to be spread
    # How it really lay then; None where the robot did not get so far
    pose: ClothPose | None
    # How the basket stands in the end; None where it was never fetched
    placement: Placement | None
    dragged: float | None  # how far the cloth moved meanwhile [m]; None likewise
    steps: int  # control steps

    @property
    def spread(self) -> bool:
        """Whether the cloth really lay spread."""
        return self.pose is not None and self.pose.spread

    @property
    def placed(self) -> bool:
        """Whether the basket stands as it should.

        Putting it there may drag the cloth by less than 2 cm.
        """
        stands = self.placement is not None and self.placement.success
        return stands and (self.dragged or 0.0) < 0.02

    @property
    def success(self) -> bool:
        """Whether the table is set."""
        return self.spread and self.placed


@dataclass(eq=False)
class _Progress:
    """What is known of a task while it runs."""

    tell: Callable[[str], None]  # is told each phase
    phase: str = ""
    seen: ClothPose | None = None
    pose: ClothPose | None = None

    def begin(self, phase: str) -> None:
        self.phase = phase
        self.tell(phase)


def set_table(
    driver: RobotDriver,
    spreader: _Spreader,
    progress: Callable[[str], None] = lambda phase: None,
) -> Outcome:
    """Run the phases one after another, and stop at the first that fails.

    `progress` is told the name of each as it begins.
    """
    task = _Progress(progress)
    failed = ""
    cause = ""
    try:
        centre = _lay_cloth(driver, spreader, task)
        _set_basket(driver, centre, task)
    except _FAILURES as error:
        failed = task.phase
        cause = str(error)

    # The truth, where the robot got so far that there is one
    placement = None
    dragged = None
    if task.pose is not None and task.phase in ("carry basket", "put basket"):
        placement = driver.env.placement()
        moved = driver.env.cloth_pose().centre - task.pose.centre
        dragged = float(np.linalg.norm(moved[:2]))
    return Outcome(
        failed=failed,
        cause=cause,
        grasped=task.phase != "fetch cloth",
        seen=task.seen,
        pose=task.pose,
        placement=placement,
        dragged=dragged,
        steps=driver.steps,
    )


def _lay_cloth(driver: RobotDriver, spreader: _Spreader, task: _Progress) -> np.ndarray:
    """From the rack to the table, and look: the centre of the cloth there `[3]` [m]."""
    task.begin("fetch cloth")
    grasp(driver, "cloth")
    task.begin("go to table")
    go_to_table(driver)
    task.begin("spread cloth")
    spreader(driver)
    task.begin("look")
    try:
        task.seen = _see_spread(driver)
    finally:
        task.pose = driver.env.cloth_pose()
    return find_cloth_centre(driver.capture(), driver.env.furniture.height)


def _set_basket(driver: RobotDriver, centre: np.ndarray, task: _Progress) -> None:
    """From the side table onto the cloth's centre `[3]` [m]."""
    task.begin("fetch basket")
    fetch_basket(driver)
    task.begin("carry basket")
    _carry_basket(driver, centre)
    task.begin("put basket")
    _put_basket(driver, centre)


def run_task(spreader: _Spreader, seed: int) -> Outcome:
    """Set the table in a scene of its own.

    The seed draws the places of rack and basket, and the camera's noise.
    """
    with closing(TableEnv(ARM, FOAM)) as env:
        env.start(seed=seed)
        rng = np.random.default_rng(seed)
        driver = RobotDriver(env, noise=NOISE, samples=1, rng=rng)
        return set_table(driver, spreader)


@cache
def successful_throws(learned: ClothCheckpoint) -> tuple[Run, ...]:
    """Recorded throws that spread a foam, as the model sees them.

    With their repetitions, which have the same commands and may have failed.
    """

    def throw_of(trial: Trial) -> tuple[str, bytes]:
        return trial.cloth.name, trial.commands.tobytes()

    trials = data.load_trials(THROWS)
    good = {throw_of(trial) for trial in trials if was_spread(trial)}
    chosen = [trial for trial in trials if throw_of(trial) in good]
    return tuple(to_run(learned.autoencoder, trial) for trial in chosen)


@cache
def spread_target(foam: str = FOAM) -> np.ndarray:
    """Mask `[H, W]` of the foam as it should lie, laid by hand."""
    with closing(TableEnv(ARM, foam, start_in="hand")) as env:
        return laid_by_hand(env, TARGET_AHEAD)


def excite(driver: RobotDriver, learned: ClothCheckpoint) -> np.ndarray:
    """Swing the cloth in the hand to feel which it is: the estimate of p `[D_p]`."""
    estimator = NewtonEstimator(learned.model, np.zeros(learned.model.bias_size))
    excitation = ExcitationPolicy(driver.env.arm)
    estimating = EstimatingPolicy(excitation, estimator, learned.autoencoder)
    throw(driver, estimating, EXCITATION)
    return estimating.trace[-1]


def throw_policy(
    env: TableEnv,
    learned: ClothCheckpoint,
    target: np.ndarray,
    p: np.ndarray,
    settings: ThrowSettings = ThrowSettings(),
) -> ThrowPolicy:
    """Throws a cloth like recorded ones, so that it comes to lie as a mask shows.

    Args:
        env: the scene with the table; the arm rests at the home that it has there.
        learned: the model, and its trained p.
        target: mask `[H, W]`.
        p: of the cloth in the hand `[D_p]`.
        settings: how a throw is planned.
    """
    return ThrowPolicy(
        learned.model,
        learned.autoencoder,
        env.arm,
        target,
        p,
        successful_throws(learned),
        learned.biases,
        settings,
    )


def excite_and_throw(
    driver: RobotDriver,
    learned: ClothCheckpoint,
    settings: ThrowSettings = ThrowSettings(),
) -> tuple[np.ndarray, ThrowPolicy]:
    """Estimate p of the cloth in the hand, then throw it with the nearest trained p.

    Returned are the estimate `[D_p]` and the policy that threw.
    """
    p = excite(driver, learned)

    # Throw as that material flew
    nearest = nearest_material(p, learned.biases)
    known = learned.biases[nearest]
    policy = throw_policy(driver.env, learned, spread_target(), known, settings)
    throw(driver, policy, done=lambda: policy.done)
    return p, policy
