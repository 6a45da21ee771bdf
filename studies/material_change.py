"""Does estimation help when the material changes in the middle of a run?

Iterative learning control begins with a recorded cloth, whose material becomes another
one while it moves. What varies is whether p is estimated on the way, and from which
material to which it changes.
"""

from collections.abc import Iterable
from contextlib import closing
from typing import Any

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from clothlab import data
from clothlab.analysis import best_per_period, difference_interval, target_distance
from clothlab.masks import Observation
from clothlab.method._wrapping import Wrapper
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.control import ControlSettings
from clothlab.method.gauss_newton import NewtonEstimator, NewtonSettings
from clothlab.method.policy import Policy
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies._grid import Case, Experiment, Tables, grid
from studies._rows import Row
from studies._runs import HEAVY, LIGHT, NEW, find_cloth, recorded_runs, trained
from studies.transfer import TARGETS

_BEFORE = 12  # [period] with the first material
_AFTER = 20  # [period] with the second one
_OLD = slice(-5, None)  # periods before the change by which the old distance is judged
_GOOD_AGAIN = 1.5  # times the old distance
# [step] of the estimation, from development cloths: a longer one sees the old material
# for longer
_WINDOW = 30
# Cloths at the light and at the heavy end of what was recorded
_ENDS = {"torque": (LIGHT, HEAVY), "muscle": ("soft-1", "hard-3")}


class _Change(Wrapper):
    """Another material in the hand from a step on: the cloth moves on as it does."""

    def __init__(self, policy: Policy, env: ClothEnv, cloth: Cloth, at: int):
        self._env = env
        self._cloth = cloth
        self._at = at
        super().__init__(policy)

    def reset(self, seed: int = 0) -> None:
        super().reset(seed)
        self._t = 0

    def __call__(self, observation: Observation) -> np.ndarray:
        if self._t == self._at:
            with closing(ClothEnv(self._env.arm, self._cloth)) as other:
                self._env.model = other.model  # of the same layout
        self._t += 1
        return super().__call__(observation)


def _run_one(
    estimated: bool,
    arm: str,
    target: str,
    first: str,
    second: str,
    model: int,
    repeat: int,
    before: int = _BEFORE,
    after: int = _AFTER,
) -> dict[str, Any]:
    """Best distance of each period whose end is seen `[P]`, and how long recovery took.

    Args:
        estimated: whether p is estimated on the way, or stays that of `first`.
        arm, target: of the task, by name.
        first, second: cloths whose materials are in the hand.
        model: seed of the training.
        repeat: number of the run.
        before, after: periods with each material.
    """
    learned = trained(f"{arm}-{model}")
    mask = data.load_target(target)

    # Iterative learning control with the p of the first material
    p = learned.biases[first]
    policy: Policy = learned.iterative_controller(mask, p, recorded_runs(learned))
    if estimated:
        estimator = NewtonEstimator(learned.model, p, NewtonSettings(window=_WINDOW))
        policy = EstimatingPolicy(policy, estimator, learned.autoencoder)

    # A run in which the second material comes
    change_at = before * ControlSettings.period
    steps = (before + after) * ControlSettings.period
    seed = 52_000 + 100 * model + repeat
    with closing(ClothEnv(arm, first)) as env:
        change = _Change(policy, env, find_cloth(second), change_at)
        trial = rollout(env, change, steps, seed=seed)

    best = best_per_period(target_distance(learned.autoencoder, trial, mask))
    return {"best": best.round(4), "recovery": recovery(best, before)}


def recovery(best: np.ndarray, before: int = _BEFORE) -> int:
    """Periods after a change until the old distance times 1.5 is reached again.

    It is reached where the median of three periods in a row is below: one of them may
    be near by luck. A period holds its end, so that `best[before]` is of the first
    throw with the new material. Where it is never reached, all
    periods and one more count.
    """
    new = best[before:]
    medians = np.median(sliding_window_view(new, 3), axis=1)
    near = np.flatnonzero(medians <= _GOOD_AGAIN * np.median(best[:before][_OLD]))
    return int(near[0]) + 1 if len(near) else len(new) + 1


def _cases(
    model: Iterable[int] = range(5), repeat: Iterable[int] = range(4), **same: Any
) -> list[Case]:
    """With and without estimation, from both ends of the recorded scale.

    The material becomes that of a new cloth in the other half of the scale. Changes
    take turns over trainings and repeats, as targets do.
    """
    cases = []
    for arm, targets in TARGETS.items():
        changes = _changes(arm)
        for turn in grid(model=model, repeat=repeat):
            number = 4 * turn["model"] + turn["repeat"]
            first, second = changes[number % len(changes)]
            target = targets[number // len(changes) % len(targets)]
            cases += grid(
                estimated=(True, False),
                arm=arm,
                target=target,
                first=first,
                second=second,
                **turn,
                **same,
            )
    return cases


def _changes(arm: str) -> list[tuple[str, str]]:
    """Pairs of a recorded cloth and a new one in the other half of the scale."""
    light, heavy = _ENDS[arm]
    by_mass = sorted(NEW[arm], key=lambda cloth: cloth.point_mass)
    changes = []
    for lighter, heavier in zip(by_mass[:4], by_mass[4:], strict=True):
        changes.append((light, heavier.name))
        changes.append((heavy, lighter.name))
    return changes


def _rows(tables: Tables) -> list[Row]:
    """Periods until control is good again, with estimation over without."""
    rows = []
    for arm, runs in tables["material_change"].groupby("arm", sort=False):
        recoveries = runs.pivot_table("recovery", ["model", "repeat"], "estimated")
        ratio, low, high = _ratio(recoveries)
        row = Row(
            f"material_change/{arm}",
            f"{arm} arm, material changed in mid-run: periods until the old distance "
            "× 1.5, estimated over kept p",
            ratio,
            interval=(low, high),
            at_most=0.5,
        )
        rows.append(row)
    return rows


def _ratio(both: pd.DataFrame) -> tuple[float, float, float]:
    """Mean of one column over that of the other, by way of their logarithms.

    With the ends of its 95 % interval.
    """
    gaps = np.log(both[True] / both[False]).unstack().to_numpy()
    mean, low, high = difference_interval(gaps)
    return float(np.exp(mean)), float(np.exp(low)), float(np.exp(high))


_ABOUT = """
Does estimation help when the material changes in the middle of a run?

Iterative learning control with a recorded cloth; then its mass, and its drag or
stiffness, become those of a cloth that was never recorded, while it moves. p stays the
old one, or is estimated on the way.
"""
EXPERIMENTS = (
    Experiment(
        "material_change",
        _run_one,
        _cases,
        seconds=120,
        slow=True,
        rows=_rows,
        about=_ABOUT,
    ),
)
