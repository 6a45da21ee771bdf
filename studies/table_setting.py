"""Can a robot set a table, and does throwing the cloth beat laying it down slowly?

Two experiments: the whole task, where the method that spreads the cloth varies; and how
far away the table may be until slow laying stops working, and throwing, where the foam
and the place of the table vary.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from typing import Any

import numpy as np

from clothlab._validation import choose
from clothlab.analysis import nearest_material
from clothlab.method.autoencoder import encode
from clothlab.policies import ReplayPolicy
from clothlab.weights import ClothCheckpoint
from studies._grid import Case, Experiment, grid, over
from studies._runs import trained
from studies.table_scene.scene import Furniture
from studies.table_scene.servoing import RobotDriver, lay_slowly
from studies.table_scene.table_env import TableEnv
from studies.table_scene.task import (
    ARM,
    excite_and_throw,
    run_task,
    spread_target,
    successful_throws,
    throw,
)
from studies.table_scene.throwing import OperatorThrow, ThrowSettings

FIRST_SEED = 500_000
MARGINS = tuple(round(0.09 + 0.005 * k, 3) for k in range(25))  # [m] of slow laying
_FOAMS = ("soft-1", "soft-2", "hard-1", "hard-3")
# [m] of the table's edge ahead of the shoulder
_PLACES = (0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.50)
_BORDER_THROWS = 200  # of an operator who knows nothing of where the table is
_CHOOSING = 3  # starts by which the best margin and the best throw are chosen
_JUDGING = 20  # other starts, which judge them
_SETTLING = 8  # [step] with the hand open until the cloth lies

_Notes = dict[str, Any]  # columns that only some methods fill


def _dynamic(learned: ClothCheckpoint, driver: RobotDriver) -> _Notes:
    """Estimate p, then throw as the model says."""
    p, policy = excite_and_throw(driver, learned)
    expected = [each.expected for each in policy.attempts]
    before_release = [each.before_release for each in policy.attempts]
    return {
        "foam": nearest_material(p, learned.biases),
        "bias": p.round(4),
        "expected": np.array(expected).round(4),
        "before_release": np.array(before_release).round(4),
    }


def _slow(learned: ClothCheckpoint, driver: RobotDriver) -> _Notes:
    lay_slowly(driver)
    return {}


def _best_recorded(learned: ClothCheckpoint, driver: RobotDriver) -> _Notes:
    commands = _commands_of_best(learned, driver.env.cloth.name)
    throw(driver, ReplayPolicy(commands), len(commands))
    return {}


_METHODS = {"dynamic": _dynamic, "slow": _slow, "best recorded": _best_recorded}


def _commands_of_best(learned: ClothCheckpoint, foam: str) -> np.ndarray:
    """Commands `[T, D_u]` of the recorded throw that spread a foam best.

    It is the one after which the foam lay nearest to the target, mean of its trials.
    """
    steps = ThrowSettings.steps
    z_ref = encode(learned.autoencoder, spread_target(foam))
    runs = [run for run in successful_throws(learned) if run.material == foam]

    # A throw was recorded several times: its commands say which one it is
    distances: dict[bytes, list[float]] = {}
    for run in runs:
        z = run.s[steps, : len(z_ref)]
        trials_of_throw = distances.setdefault(run.u.tobytes(), [])
        trials_of_throw.append(float(np.linalg.norm(z - z_ref)))
    nearest = min(distances, key=lambda u: np.mean(distances[u]))

    best = next(run for run in runs if run.u.tobytes() == nearest)
    return best.u[:steps].astype(np.float64)


def _run_one(method: str, model: int, seed: int) -> dict[str, Any]:
    """Set the table once, with the cloth spread by one of the methods.

    Rack and basket stand where the seed says.
    """
    spread = choose("method", method, _METHODS)
    learned = trained(f"table-{model}")
    notes: _Notes = {"foam": "", "bias": [], "expected": [], "before_release": []}

    def spread_and_note(driver: RobotDriver) -> None:
        notes.update(spread(learned, driver))

    outcome = run_task(spread_and_note, seed)

    # How the cloth lies, and how the basket stands, where they were ever seen
    pose = outcome.pose
    basket = outcome.placement
    dragged = outcome.dragged
    return {
        "failed": outcome.failed,  # the phase, empty where the robot noticed nothing
        "cause": outcome.cause,
        "grasped": outcome.grasped,
        "seen": outcome.seen is not None,  # as spread
        "spread": outcome.spread,
        "flat": round(pose.flat, 3) if pose else 0.0,
        "area": round(pose.area, 3) if pose else 0.0,
        "angle": round(pose.angle, 1) if pose else 0.0,  # [degree]
        "placed": outcome.placed,  # the basket
        "tilt": round(basket.tilt, 2) if basket else None,  # [degree]
        "off_centre": round(basket.off_centre, 4) if basket else None,  # [m]
        "dragged": None if dragged is None else round(dragged, 4),  # the cloth [m]
        # Of a throw: the foam whose p is nearest to the estimate, and distances when
        # each attempt began [s.d. of z].
        **notes,
        "steps": outcome.steps,
    }


def _cases(
    method: str | Iterable[str] = tuple(_METHODS),
    model: int | Iterable[int] = range(5),
    episodes: int = 50,
) -> list[Case]:
    """The same episodes for every method; the trainings take turns."""
    methods = grid(method=method)
    trainings = grid(model=model)
    cases = []
    for episode in range(episodes):
        training = trainings[episode % len(trainings)]
        for each in methods:
            cases.append(each | training | {"seed": FIRST_SEED + episode})
    return cases


def _run_border(foam: str, near: float) -> dict[str, Any]:
    """Slow laying and an operator's throws on a table whose edge is `near` [m].

    Neither has a model or a camera. A few starts choose the best of many, and others
    judge it.

    Returns: `slow`: from which of the first starts each margin spread the cloth
        `[margins, _CHOOSING]`; `thrown`: whether each throw did, from the very first
        start `[_BORDER_THROWS]`; `best_slow` and `best_thrown`: from which of the other
        starts the best of them did `[_JUDGING]`.
    """
    choosing = range(_CHOOSING)
    judging = range(_CHOOSING, _CHOOSING + _JUDGING)
    furniture = Furniture(near=near)
    with closing(TableEnv(ARM, foam, start_in="hand", furniture=furniture)) as env:
        # Slowly: every margin from some starts, the best one from others
        slow = np.array([_laid(env, margin, choosing) for margin in MARGINS])
        best_margin = MARGINS[middle_of_best(slow)]
        best_slow = _laid(env, best_margin, judging)

        # Thrown: every throw from one start, those that worked from some more
        numbers = range(_BORDER_THROWS)
        thrown = np.array([_thrown(env, number, range(1))[0] for number in numbers])
        best_thrown = np.zeros(_JUDGING, bool)
        if thrown.any():
            worked = np.flatnonzero(thrown).tolist()
            again = np.array([_thrown(env, number, choosing) for number in worked])
            best_throw = worked[middle_of_best(again)]
            best_thrown = _thrown(env, best_throw, judging)

    return {
        "slow": slow,
        "thrown": thrown,
        "best_slow": best_slow,
        "best_thrown": best_thrown,
    }


def _laid(env: TableEnv, margin: float, starts: range) -> np.ndarray:
    """From which starts slow laying with a margin [m] spreads the cloth."""

    def lay() -> None:
        lay_slowly(RobotDriver(env, samples=1), margin=margin)

    return np.array([_spreads(env, lay, start) for start in starts])


def _thrown(env: TableEnv, number: int, starts: range) -> np.ndarray:
    """From which starts an operator's throw of that number spreads the cloth."""

    def throw_it() -> None:
        operator = OperatorThrow(env.arm)
        operator.reset(FIRST_SEED + number)
        for _ in range(ThrowSettings.steps):
            env.advance(operator({}))

    return np.array([_spreads(env, throw_it, start) for start in starts])


def _spreads(env: TableEnv, attempt: Callable[[], None], start: int) -> bool:
    """Whether the cloth is spread when the hand has opened after an attempt."""
    env.start(seed=FIRST_SEED + start)
    attempt()
    u = env.arm.home_command
    u[env.arm.closed_command] = 0.0
    for _ in range(_SETTLING):
        env.advance(u)
    return env.cloth_pose().spread


def middle_of_best(worked: np.ndarray) -> int:
    """Which one worked most often `[N, starts]`; of several, the middle one.

    Its neighbours are good, too.
    """
    counts = worked.sum(axis=1)
    (best,) = np.nonzero(counts == counts.max())
    return int(best[len(best) // 2])


_BORDER_CASES = over(foam=_FOAMS, near=_PLACES)


EXPERIMENTS = (
    Experiment("table_setting", _run_one, _cases, slow=True),
    Experiment("table_setting_border", _run_border, _BORDER_CASES, slow=True),
)
