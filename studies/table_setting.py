"""Can a robot set a table, and does throwing the cloth beat laying it down slowly?

Three methods spread the cloth in the same episodes, with the same places of rack and
basket: the throw that the model chooses, a slow hand, and the best recorded throw with
this very cloth. Besides: which foam is in the hand after one motion of four seconds,
and how far away the table may be until slow laying stops working, and throwing.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from clothlab._validation import choose
from clothlab.analysis import difference_interval, nearest_material, rate_interval
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.autoencoder import encode
from clothlab.method.estimation import estimate_bias
from clothlab.policies import ReplayPolicy
from clothlab.trials import rollout
from studies._grid import Case, Experiment, Tables, grid, over
from studies._rows import Row
from studies._runs import trained
from studies.table_scene.scene import Furniture
from studies.table_scene.servoing import RobotDriver, lay_slowly
from studies.table_scene.table_env import TableEnv
from studies.table_scene.task import (
    ARM,
    EXCITATION,
    excite_and_throw,
    run_task,
    spread_target,
    successful_throws,
    throw,
)
from studies.table_scene.throwing import ExcitationPolicy, OperatorThrow, ThrowSettings

FIRST_SEED = 500_000
MARGINS = tuple(round(0.09 + 0.005 * k, 3) for k in range(25))  # [m] of slow laying
_FOAMS = ("soft-1", "soft-2", "hard-1", "hard-3")
# [m] of the table's edge ahead of the shoulder
_PLACES = (0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.50)
_BORDER_THROWS = 200  # of an operator who knows nothing of where the table is
_CHOOSING, _JUDGING = (
    3,
    20,
    # Starts by which the best margin and the best throw are chosen, and others that
    # judge them
)

_Notes = dict[str, Any]  # columns that only some methods fill


def _dynamic(learned: ClothCheckpoint, driver: RobotDriver) -> _Notes:
    """Estimate p, then throw as the model says."""
    p, policy = excite_and_throw(driver, learned)
    return {
        "foam": nearest_material(p, learned.biases),
        "bias": p.round(4),
        "expected": np.array([each.expected for each in policy.attempts]).round(4),
        "before_release": np.array(
            [each.before_release for each in policy.attempts]
        ).round(4),
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
    """Commands `[T, D_u]` of the recorded throw after which a foam lay nearest to the
    target, mean of its trials.
    """
    steps, z_ref = ThrowSettings.steps, encode(learned.autoencoder, spread_target(foam))
    runs = [run for run in successful_throws(learned) if run.material == foam]
    distances = dict[bytes, list[float]]()
    for run in runs:
        distances.setdefault(run.u.tobytes(), []).append(
            float(np.linalg.norm(run.s[steps, : len(z_ref)] - z_ref))
        )
    nearest = min(distances, key=lambda u: np.mean(distances[u]))
    return next(run.u[:steps] for run in runs if run.u.tobytes() == nearest).astype(
        np.float64
    )


def _run_one(method: str, model: int, seed: int) -> dict[str, Any]:
    """Set the table once, with the cloth spread by one of the methods; rack and basket
    stand where the seed says.
    """
    spread, learned, notes = (
        choose("method", method, _METHODS),
        trained(f"table-{model}"),
        _Notes(),
    )
    outcome = run_task(lambda driver: notes.update(spread(learned, driver)), seed)
    pose, stands = outcome.pose, outcome.placement
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
        "tilt": round(stands.tilt, 2) if stands else None,  # of the basket [degree]
        "off_centre": round(stands.off_centre, 4) if stands else None,  # [m]
        "dragged": round(outcome.dragged, 4)
        if outcome.dragged is not None
        else None,  # the cloth [m]
        # Of a throw: the foam whose p is nearest to the estimate, and distances when
        # each attempt began [s.d. of z].
        **({"foam": "", "bias": [], "expected": [], "before_release": []} | notes),
        "steps": outcome.steps,
    }


def _cases(
    method: str | Iterable[str] = tuple(_METHODS),
    model: int | Iterable[int] = range(5),
    episodes: int = 50,
) -> list[Case]:
    """The same episodes for every method; the trainings take turns."""
    trainings = grid(model=model)
    turns = [
        trainings[k % len(trainings)] | {"seed": FIRST_SEED + k}
        for k in range(episodes)
    ]
    return [each | turn for turn in turns for each in grid(method=method)]


def _run_material(foam: str, model: int, repeat: int) -> dict[str, Any]:
    """Excite a foam in the hand, whose hold and rest before are drawn, and estimate its
    p: `nearest` trained p.
    """
    learned = trained(f"table-{model}")
    with closing(TableEnv(ARM, foam, start_in="hand")) as env:
        trial = rollout(
            env, ExcitationPolicy(env.arm), EXCITATION, seed=FIRST_SEED + repeat
        )
    p, _ = estimate_bias(learned.model, learned.to_run(trial), method="newton")
    return {"nearest": nearest_material(p, learned.biases), "bias": p.round(4)}


def _run_border(foam: str, near: float) -> dict[str, Any]:
    """Slow laying and an operator's throws on a table whose edge is `near` [m], each
    the best of many.

    Neither has a model or a camera. A few starts choose the best of them, and others
    judge it.

    Returns: `slow`: from which of the first starts each margin spread the cloth
        `[margins, _CHOOSING]`; `thrown`: whether each throw did, from the very first
        start `[_BORDER_THROWS]`; `best_slow` and `best_thrown`: from which of the other
        starts the best of them did `[_JUDGING]`.
    """
    with closing(
        TableEnv(ARM, foam, start_in="hand", furniture=Furniture(near=near))
    ) as env:

        def spreads(attempt: Callable[[], None], start: int) -> bool:
            env.start(seed=FIRST_SEED + start)
            attempt()
            u = env.arm.home_command
            u[env.arm.closed_command] = 0.0
            for _ in range(8):
                env.advance(u)
            return env.cloth_pose().spread

        def throws(number: int) -> None:
            operator = OperatorThrow(env.arm)
            operator.reset(FIRST_SEED + number)
            for _ in range(ThrowSettings.steps):
                env.advance(operator({}))

        def lays(margin: float) -> None:
            lay_slowly(RobotDriver(env, samples=1), margin=margin)

        def from_starts(attempt: Callable[[], None], starts: range) -> np.ndarray:
            return np.array([spreads(attempt, start) for start in starts])

        choosing, judging = range(_CHOOSING), range(_CHOOSING, _CHOOSING + _JUDGING)
        slow = np.array(
            [from_starts(partial(lays, margin), choosing) for margin in MARGINS]
        )
        best_slow = from_starts(partial(lays, MARGINS[middle_of_best(slow)]), judging)
        thrown = np.array(
            [spreads(partial(throws, number), 0) for number in range(_BORDER_THROWS)]
        )
        best_thrown = np.zeros(_JUDGING, bool)
        if thrown.any():
            worked = np.flatnonzero(thrown).tolist()
            again = np.array(
                [from_starts(partial(throws, number), choosing) for number in worked]
            )
            best_thrown = from_starts(
                partial(throws, worked[middle_of_best(again)]), judging
            )
    return {
        "slow": slow,
        "thrown": thrown,
        "best_slow": best_slow,
        "best_thrown": best_thrown,
    }


def middle_of_best(worked: np.ndarray) -> int:
    """Which one worked most often `[N, starts]`; of several, the middle one: its
    neighbours are good, too.
    """
    (best,) = np.nonzero(worked.sum(axis=1) == worked.sum(axis=1).max())
    return int(best[len(best) // 2])


def difference(
    runs: pd.DataFrame, first: str, second: str
) -> tuple[float, float, float]:
    """How much more often one method spreads the cloth than another: mean and 95 %
    interval.
    """
    held = runs.pivot_table(
        index=["model", "seed"], columns="method", values="spread", aggfunc="first"
    ).astype(float)
    by_model = (held[first] - held[second]).groupby("model").apply(np.array)
    return difference_interval(np.stack(by_model))


def _rows(tables: Tables) -> list[Row]:
    """Of throws each part of the task; how often the cloth is spread slowly; and the
    foam in the hand.
    """
    runs, materials = tables["table_setting"], tables["table_setting_material"]
    dynamic, slow = (runs[runs["method"] == name] for name in ("dynamic", "slow"))
    success = dynamic["spread"] & dynamic["placed"]
    mean, low, high = (100 * each for each in difference(runs, "dynamic", "slow"))
    over_slow = "cloth spread: by a throw minus slowly"
    right = materials["nearest"] == materials["foam"]
    foam = f"p after the first swing: nearest of {materials['foam'].nunique()} foams is the right one"
    once: dict[str, Any] = {"paper": "in one run", "above": 50}
    return [
        _rate(
            "table_setting/grasped",
            "cloth grasped",
            dynamic["grasped"],
            at_least=96,
            **once,
        ),
        _rate(
            "table_setting/spread",
            "cloth spread by a throw",
            dynamic["spread"],
            at_least=80,
            **once,
        ),
        _rate(
            "table_setting/success",
            "table set, the whole run",
            success,
            at_least=70,
            **once,
        ),
        _rate("table_setting/spread/slow", "cloth spread, slow", slow["spread"]),
        Row("table_setting/difference", over_slow, mean, " %", interval=(low, high)),
        _rate("table_setting/material", foam, right, at_least=75),
    ]


def _rate(key: str, label: str, held: pd.Series, **about: Any) -> Row:
    rate, low, high = (100 * each for each in rate_interval(held))
    return Row(
        key, f"{label}, of {len(held)}", rate, " %", interval=(low, high), **about
    )


_MATERIALS = over(foam=_FOAMS, model=range(5), repeat=range(5))
EXPERIMENTS = (
    Experiment("table_setting", _run_one, _cases, seconds=30, slow=True, rows=_rows),
    Experiment("table_setting_material", _run_material, _MATERIALS, seconds=3),
    Experiment(
        "table_setting_border",
        _run_border,
        over(foam=_FOAMS, near=_PLACES),
        seconds=200,
        slow=True,
    ),
)
