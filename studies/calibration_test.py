"""Do the regions of estimated p hold the right p as often as they say, and are unknown
cloths noticed?

Gauss-Newton estimates p from 0. What its regions and alarms stand on
(`clothlab.calibration`) is learned from development runs with the nine cloths, which
all trainings share; each run of the test has commands of its own.
"""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from clothlab.analysis import nearest_material
from clothlab.calibration import LENGTHS, Calibration, calibrate, inside
from clothlab.method.gauss_newton import NewtonEstimator, linearise
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.trials import Trial
from studies._grid import Case, Experiment, Tables, over, shared
from studies._rows import Row
from studies._runs import random_trial, trained
from studies.estimation import BETWEEN

_ARM = "torque"
# Beyond the trained values on every side that can be simulated: with half of the lowest
# of both, it diverges.
_BEYOND = {
    f"damp{damping:.3f}-mass{mass:.3f}": Cloth(
        f"damp{damping:.3f}-mass{mass:.3f}", damping=damping, mass=mass
    )
    for damping, mass in (
        (0.015, 0.05),
        (0.015, 0.3),
        (0.05, 0.3),
        (0.12, 0.05),
        (0.12, 0.15),
        (0.12, 0.3),
    )
}
_SIZES = {
    "short": Cloth("short", length=0.35),
    "long": Cloth("long", length=0.70),
    "narrow": Cloth("narrow", width=0.20),
}
_KINDS = {
    "trained": CLOTHS,
    "between": BETWEEN,
    "beyond": _BEYOND,
    "another size": _SIZES,
}
_ALL = {name: cloth for cloths in _KINDS.values() for name, cloth in cloths.items()}


@cache
def _development_trials() -> list[Trial]:
    """Four runs with each of the nine cloths."""
    return [
        random_trial(_ARM, cloth, LENGTHS[-1], seed=46_000 + 30 * repeat + number)
        for repeat, (number, cloth) in product(range(4), enumerate(CLOTHS))
    ]


@shared
def _calibration(model: int) -> Calibration:
    learned = trained(f"{_ARM}-{model}")
    runs = [learned.to_run(trial) for trial in _development_trials()]
    return calibrate(learned.model, learned.biases, runs)


def _calibrate_one(model: int) -> dict[str, Any]:
    """What the development runs say about one training: the fields of a `Calibration`."""
    return dict(vars(_calibration(model)))


def _run_one(
    cloth: str, model: int, repeat: int, steps: int = LENGTHS[-1]
) -> dict[str, Any]:
    """Estimate p of one cloth: the nearest material in the end, and what is known after
    each of `LENGTHS`.

    That is the estimate `[N, D_p]`, its covariance by the curvature of the loss alone
    (`bare`) and calibrated `[N, D_p, D_p]`, and whether it is out of distribution by
    the prediction error, or outside the trained p `[N]`.
    """
    learned, calibration = trained(f"{_ARM}-{model}"), _calibration(model)
    seed = 56_000 + 200 * model + 30 * repeat + [*_ALL].index(cloth)
    run = learned.to_run(random_trial(_ARM, _ALL[cloth], steps, seed))
    newton, looks = NewtonEstimator(learned.model), []
    for t, step in enumerate(zip(run.s, run.u, strict=True), start=1):
        newton.update(*step)
        fit = linearise(newton)
        report = calibration.report(fit, newton.p) if t in LENGTHS else None
        if fit and report:
            looks.append((newton.p, fit.covariance(), *report))
    estimate, bare, covariance, _, out_of_distribution, outside = (
        np.array(each) for each in zip(*looks, strict=True)
    )
    return {
        "kind": next(kind for kind, cloths in _KINDS.items() if cloth in cloths),
        "nearest": nearest_material(newton.p, learned.biases),
        "estimate": estimate.round(4),
        "bare": bare.round(7),
        "covariance": covariance.round(7),
        "out_of_distribution": out_of_distribution,
        "outside_hull": outside,
    }


def coverage(table: pd.DataFrame, column: str = "covariance") -> np.ndarray:
    """Share of runs with trained cloths whose 90 % region, by a column of covariances,
    holds the right p `[N]`.
    """
    held = []
    for _, run in table[table.kind == "trained"].iterrows():
        right = trained(f"{_ARM}-{run.model}").biases[run.cloth]
        held.append(
            [
                inside(right, *region)
                for region in zip(run.estimate, run[column], strict=True)
            ]
        )
    return np.mean(held, axis=0)


def _cases(**sizes: Any) -> list[Case]:
    """Every cloth with every training: four runs with each trained cloth, two with each
    other one.
    """
    every = over(cloth=_ALL, model=range(5), repeat=range(4))(**sizes)
    return [case for case in every if case["cloth"] in CLOTHS or case["repeat"] < 2]


def _rows(tables: Tables) -> list[Row]:
    """Accuracy, coverage of the regions, and alarms by kind of cloth."""
    table, end = tables["calibration_test"], f"{LENGTHS[-1] * CONTROL_PERIOD:g} s"
    known = table[table.kind == "trained"]
    held, bare = (
        100 * coverage(table, column)[-1] for column in ("covariance", "bare")
    )
    last = table.assign(
        error=table.out_of_distribution.str[-1], outside=table.outside_hull.str[-1]
    )
    error = 100 * last.groupby("kind", sort=False)["error"].mean()
    either = 100 * (last.error | last.outside)[last.kind == "beyond"].mean()
    others = ", ".join(
        f"{kind} {share:.0f} %" for kind, share in error.drop("beyond").items()
    )
    return [
        Row(
            "calibration_test/nearest",
            f"p by Gauss-Newton, {end}: nearest trained p is the right one",
            100 * float((known.nearest == known.cloth).mean()),
            " %",
            at_least=97,
        ),
        Row(
            "calibration_test/coverage",
            f"90 % regions hold the right p after {end}",
            held,
            " %",
            at_least=85,
            at_most=95,
            note=f"{bare:.0f} % by curvature alone",
        ),
        Row(
            "calibration_test/beyond",
            "cloths beyond the trained range: out of distribution by the error of prediction",
            error["beyond"],
            " %",
            note=f"{either:.0f} % by that or by the place of p; by the error {others}",
        ),
    ]


EXPERIMENTS = (
    Experiment(
        "calibration", _calibrate_one, over(model=range(5)), seconds=240, slow=True
    ),
    Experiment("calibration_test", _run_one, _cases, seconds=8, slow=True, rows=_rows),
)
