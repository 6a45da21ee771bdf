"""Does estimation help when the material changes in the middle of a run?

Iterative learning control with a recorded cloth; then its mass, and its drag or
stiffness, become those of a cloth that was never recorded, while it moves. p stays the
old one, or is estimated on the way.
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
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.control import ControlSettings
from clothlab.method.gauss_newton import NewtonEstimator, NewtonSettings
from clothlab.method.policy import Policy, Wrapper
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies._grid import Case, Experiment, Tables, grid
from studies._rows import Row
from studies._runs import HEAVY, LIGHT, NEW, find_cloth, recorded_runs, trained
from studies.transfer import TARGETS

_BEFORE, _AFTER = 12, 20  # [period] with each material
_OLD = slice(-5, None)  # periods before the change by which the old distance is judged
# [step] of the estimation, from development cloths: a longer one sees the old material
# for longer
_WINDOW = 30


class _Change(Wrapper):
    """Another material in the hand from a step on, where the cloth is and as it moves."""

    def __init__(self, policy: Policy, env: ClothEnv, cloth: Cloth, at: int):
        self._env, self._cloth, self._at = env, cloth, at
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
    """Best distance of each period but the first `[P]`, and p at the end of each step
    of the estimation `[T, D_p]`.
    """
    learned, mask = trained(f"{arm}-{model}"), data.load_target(target)
    p = learned.biases[first]
    policy: Policy = learned.iterative_controller(mask, p, recorded_runs(learned))
    if estimated:
        estimator = NewtonEstimator(learned.model, p, NewtonSettings(window=_WINDOW))
        policy = EstimatingPolicy(policy, estimator, learned.autoencoder)
    period = ControlSettings.period
    with closing(ClothEnv(arm, first)) as env:
        change = _Change(policy, env, find_cloth(second), before * period)
        trial = rollout(
            env, change, (before + after) * period, seed=52_000 + 100 * model + repeat
        )
    best = best_per_period(target_distance(learned.autoencoder, trial, mask))
    return {"best": best.round(4), "recovery": recovery(best, before)}


def recovery(best: np.ndarray, before: int = _BEFORE) -> int:
    """Periods after a change until the old distance times 1.5 is reached again; all of
    them and one more if never.

    It is reached where the median of three periods in a row is below: one of them may
    be near by luck. The first period of all is not in `best`; and the last plan with
    the old material is seen at its end, in the next.
    """
    old, new = best[:before], best[before:]
    near = np.flatnonzero(
        np.median(sliding_window_view(new, 3), axis=1) <= 1.5 * np.median(old[_OLD])
    )
    return int(near[0]) + 1 if len(near) else len(new) + 1


def _cases(
    model: Iterable[int] = range(5), repeat: Iterable[int] = range(4), **same: Any
) -> list[Case]:
    """From both ends of the recorded scale to the new cloths in the other half, which
    take turns, as targets do.
    """
    found = []
    for arm, (light, heavy) in {
        "torque": (LIGHT, HEAVY),
        "muscle": ("soft-1", "hard-3"),
    }.items():
        new = [
            cloth.name for cloth in sorted(NEW[arm], key=lambda cloth: cloth.point_mass)
        ]
        changes = [
            change
            for pair in zip(new[4:], new[:4], strict=True)
            for change in zip((light, heavy), pair, strict=True)
        ]
        for turn in grid(model=model, repeat=repeat):
            k, targets = 4 * turn["model"] + turn["repeat"], TARGETS[arm]
            first, second = changes[k % len(changes)]
            axes = {
                "target": targets[k // len(changes) % len(targets)],
                "first": first,
                "second": second,
            }
            found += grid(estimated=(True, False), arm=arm, **axes, **turn, **same)
    return found


def _rows(tables: Tables) -> list[Row]:
    """Periods until control is good again, with estimation over without."""
    found, search = (
        [],
        tables["oracle_transfer"]
        .query("not overlap")
        .set_index(["target", "cloth"])["best"]
        .map(np.min),
    )
    for arm, runs in tables["material_change"].groupby("arm", sort=False):
        aims = [1.5 * np.median(best[:_BEFORE][_OLD]) for best in runs["best"]]
        possible = np.mean(
            search[zip(runs["target"], runs["second"], strict=True)].to_numpy() <= aims
        )
        later = runs.assign(after=runs["best"].map(lambda best: best[_BEFORE:].mean()))
        distance = _ratio(later.pivot_table("after", ["model", "repeat"], "estimated"))
        both = runs.pivot_table("recovery", ["model", "repeat"], "estimated")
        ratio, low, high = _ratio(both)
        note = f"{both[True].mean():.1f} in place of {both[False].mean():.1f} periods; the oracle with the second cloth "
        note += f"gets there in {possible:.0%}; mean distance after the change "
        note += "{:.2f} times that of the kept p, {:.2f} to {:.2f}".format(*distance)
        label = f"{arm} arm, material changed in mid-run: periods until the old distance × 1.5, estimated over kept p"
        found.append(
            Row(
                f"material_change/{arm}",
                label,
                ratio,
                interval=(low, high),
                at_most=0.5,
                note=note,
            )
        )
    return found


def _ratio(both: pd.DataFrame) -> tuple[float, float, float]:
    """Mean of one column over that of the other, by way of their logarithms."""
    gaps = np.log(both[True] / both[False]).unstack().to_numpy()
    mean, low, high = (float(np.exp(each)) for each in difference_interval(gaps))
    return mean, low, high


EXPERIMENTS = (
    Experiment("material_change", _run_one, _cases, seconds=120, slow=True, rows=_rows),
)
