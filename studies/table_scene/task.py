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
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.data import Run
from clothlab.method.gauss_newton import NewtonEstimator
from clothlab.method.policy import Policy
from clothlab.simulation.arm import SHOULDER_POSITION
from clothlab.simulation.env import SimulationError
from clothlab.trials import to_run
from studies.table_scene.perception import NotVisibleError, find_cloth_centre
from studies.table_scene.scene import Basket
from studies.table_scene.servoing import AHEAD_LOW, CLEAR, RobotDriver, grasp
from studies.table_scene.table_env import ClothPose, GraspError, Placement, TableEnv
from studies.table_scene.throwing import (
    ExcitationPolicy,
    ThrowPolicy,
    ThrowSettings,
    laid_by_hand,
    see_cloth_pose,
    was_spread,
)

ARM, FOAM = "muscle-hand", "hard-1"  # of the robot, and in its hand
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
    """Let a policy swing and throw the cloth, for so many control steps or until it is
    `done`.
    """
    for _ in range(steps):
        driver.send(policy(driver.env.observe()))
        if done():
            break


def _see_spread(driver: RobotDriver) -> ClothPose:
    """Look how the cloth lies; a `_NotSpreadError` says in which way it is not spread."""
    seen = see_cloth_pose(driver.env, height=driver.height, watch=driver.watch)
    driver.command_angles(driver.env.furniture.start_posture)
    if seen is None:
        raise _NotSpreadError("no cloth in view")
    if seen.fault:
        raise _NotSpreadError(seen.fault)
    return seen


def fetch_basket(driver: RobotDriver) -> None:
    """Drive back to where the side table is in view, and take the basket by its handle."""
    driver.look_towards(driver.env.furniture.side_place[0])
    grasp(driver, "basket")


def _carry_basket(driver: RobotDriver, centre: np.ndarray) -> None:
    """Lift the basket and drive until it is above the cloth's centre `[3]` [m], or as
    far as the robot can.
    """
    furniture = driver.env.furniture
    above = furniture.height + Basket.handle_height + CLEAR - SHOULDER_POSITION[2]
    driver.move_straight([AHEAD_LOW, above])
    driver.drive(centre[0] - AHEAD_LOW)
    driver.move_straight([centre[0] - driver.env.base, above])


def _put_basket(driver: RobotDriver, centre: np.ndarray) -> None:
    """Lower the basket by visual feedback onto the cloth's centre `[3]` [m], let go,
    and go up.
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
        """Whether the basket stands as it should, and dragged the cloth by less than 2
        cm.
        """
        return (
            self.placement is not None
            and self.placement.success
            and (self.dragged or 0.0) < 0.02
        )

    @property
    def success(self) -> bool:
        """Whether the table is set."""
        return self.spread and self.placed


def set_table(
    driver: RobotDriver,
    spreader: _Spreader,
    progress: Callable[[str], None] = lambda phase: None,
) -> Outcome:
    """Run the phases one after another, tell `progress` the name of each, and stop at
    the first that fails.
    """
    phase, failed, cause = "", "", ""
    seen: ClothPose | None = None
    pose: ClothPose | None = None

    def begin(name: str) -> None:
        nonlocal phase
        phase = name
        progress(name)

    try:
        begin("fetch cloth")
        grasp(driver, "cloth")
        begin("go to table")
        go_to_table(driver)
        begin("spread cloth")
        spreader(driver)
        begin("look")
        try:
            seen = _see_spread(driver)
        finally:
            pose = driver.env.cloth_pose()
        centre = find_cloth_centre(driver.capture(), driver.env.furniture.height)
        begin("fetch basket")
        fetch_basket(driver)
        begin("carry basket")
        _carry_basket(driver, centre)
        begin("put basket")
        _put_basket(driver, centre)
    except _FAILURES as error:
        failed, cause = phase, str(error)
    placement, dragged = None, None
    if pose is not None and phase in ("carry basket", "put basket"):
        placement = driver.env.placement()
        dragged = float(
            np.linalg.norm((driver.env.cloth_pose().centre - pose.centre)[:2])
        )
    return Outcome(
        failed,
        cause,
        phase != "fetch cloth",
        seen,
        pose,
        placement,
        dragged,
        driver.steps,
    )


def run_task(spreader: _Spreader, seed: int) -> Outcome:
    """Set the table in a scene of its own; the seed draws the places of rack and
    basket, and the camera's noise.
    """
    with closing(TableEnv(ARM, FOAM)) as env:
        env.start(seed=seed)
        return set_table(
            RobotDriver(env, noise=NOISE, samples=1, rng=np.random.default_rng(seed)),
            spreader,
        )


@cache
def successful_throws(learned: ClothCheckpoint) -> tuple[Run, ...]:
    """Recorded throws that spread a foam, and their repetitions, with the same
    commands, as the model sees them.
    """
    trials = data.load_trials(THROWS)
    good = {
        (trial.cloth.name, trial.commands.tobytes())
        for trial in trials
        if was_spread(trial)
    }
    chosen = [
        trial
        for trial in trials
        if (trial.cloth.name, trial.commands.tobytes()) in good
    ]
    return tuple(to_run(learned.autoencoder, trial) for trial in chosen)


@cache
def spread_target(foam: str = FOAM) -> np.ndarray:
    """Mask `[H, W]` of the foam as it should lie, laid by hand."""
    with closing(TableEnv(ARM, foam, start_in="hand")) as env:
        return laid_by_hand(env, TARGET_AHEAD)


def excite_and_throw(
    driver: RobotDriver, learned: ClothCheckpoint, settings: ThrowSettings | None = None
) -> tuple[np.ndarray, ThrowPolicy]:
    """Estimate p of the cloth in the hand `[D_p]`, then throw it with the nearest
    trained p; estimate and policy.
    """
    arm, model, autoencoder, biases = (
        driver.env.arm,
        learned.model,
        learned.autoencoder,
        learned.biases,
    )
    estimator = NewtonEstimator(model, np.zeros(model.bias_size))
    estimating = EstimatingPolicy(ExcitationPolicy(arm), estimator, autoencoder)
    throw(driver, estimating, EXCITATION)
    p, runs = estimating.trace[-1], successful_throws(learned)
    known = biases[nearest_material(p, biases)]
    policy = ThrowPolicy(
        model, autoencoder, arm, spread_target(), known, runs, biases, settings
    )
    throw(driver, policy, done=lambda: policy.done)
    return p, policy
