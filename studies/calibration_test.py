"""Do the regions of estimated p hold the right p as often as they say?

And are unknown cloths noticed? What varies is the cloth that is held: a trained one,
one between these, one beyond them, or one of another size.
"""

from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from clothlab.analysis import inside, nearest_material
from clothlab.method.estimation import NewtonEstimator
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.trials import Trial
from studies._grid import Case, Experiment, over, shared
from studies._runs import random_trial, trained
from studies.estimation import BETWEEN
from studies.uncertainty import Calibration, calibrate

_ARM = "torque"
_DEVELOPMENT_RUNS = 4  # with each of the nine cloths
_TEST_RUNS = 4  # with each of the nine cloths
_STRANGE_RUNS = 2  # with each other cloth
# C_damp [N s/m] and C_mass [kg] beyond the trained values, on every side that can be
# simulated: with half of the lowest of both, the simulation diverges.
_BEYOND_MATERIALS = (
    (0.015, 0.05),
    (0.015, 0.3),
    (0.05, 0.3),
    (0.12, 0.05),
    (0.12, 0.15),
    (0.12, 0.3),
)


def _sheet(damping: float, mass: float) -> Cloth:
    """A cloth whose name says its constants."""
    name = f"damp{damping:.3f}-mass{mass:.3f}"
    return Cloth(name, damping=damping, mass=mass)


_BEYOND_SHEETS = [_sheet(damping, mass) for damping, mass in _BEYOND_MATERIALS]
_BEYOND = {sheet.name: sheet for sheet in _BEYOND_SHEETS}
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
_ALL = CLOTHS | BETWEEN | _BEYOND | _SIZES


def _kind_of(cloth: str) -> str:
    """Which of `_KINDS` a cloth is of."""
    return next(kind for kind, cloths in _KINDS.items() if cloth in cloths)


@cache
def _development_trials() -> list[Trial]:
    """Runs with each of the nine cloths, from which a calibration is learned."""
    trials = []
    for repeat in range(_DEVELOPMENT_RUNS):
        for number, cloth in enumerate(CLOTHS):
            seed = 46_000 + 30 * repeat + number
            trials.append(random_trial(_ARM, cloth, Calibration.looks[-1], seed=seed))
    return trials


@shared
def _calibration(model: int) -> Calibration:
    learned = trained(f"{_ARM}-{model}")
    runs = [learned.to_run(trial) for trial in _development_trials()]
    return calibrate(learned.model, learned.biases, runs)


def _calibrate_one(model: int) -> dict[str, Any]:
    """What development runs say of one training: the fields of a `Calibration`."""
    return dict(vars(_calibration(model)))


def _run_one(
    cloth: str, model: int, repeat: int, steps: int = Calibration.looks[-1]
) -> dict[str, Any]:
    """Estimate p of one cloth, and say what is known after each of `Calibration.looks`.

    Args:
        cloth: name of one of `_ALL`.
        model: seed of the training.
        repeat: number of the run; each has other random commands.
        steps: control steps.

    Returns: the `kind` of the cloth and the trained cloth that is `nearest` in the end;
        after each of N lengths the `estimate` `[N, D_p]`, its covariance by the
        curvature of the loss alone (`bare`) and calibrated `[N, D_p, D_p]`, and whether
        the run is out of distribution by its prediction errors, or by the place of its
        p (`outside_hull`) `[N]`.
    """
    # What is sensed of the cloth under random commands
    learned = trained(f"{_ARM}-{model}")
    calibration = _calibration(model)
    seed = 56_000 + 200 * model + 30 * repeat + [*_ALL].index(cloth)
    run = learned.to_run(random_trial(_ARM, _ALL[cloth], steps, seed))

    # Estimate online, and look at what is known after each of the lengths
    newton = NewtonEstimator(learned.model)
    estimates = []
    bare = []
    reports = []
    for t, (s, u) in enumerate(zip(run.s, run.u, strict=True), start=1):
        newton.update(s, u)
        if t not in Calibration.looks:
            continue
        linearisation = newton.linearisation()
        report = calibration.report(linearisation, newton.p)
        if linearisation is None or report is None:
            continue
        estimates.append(newton.p)
        bare.append(linearisation.covariance())
        reports.append(report)

    return {
        "kind": _kind_of(cloth),
        "nearest": nearest_material(newton.p, learned.biases),
        "estimate": np.array(estimates).round(4),
        "bare": np.array(bare).round(7),
        "covariance": np.array([each.covariance for each in reports]).round(7),
        "out_of_distribution": np.array([each.out_of_distribution for each in reports]),
        "outside_hull": np.array([each.outside_hull for each in reports]),
    }


def coverage(table: pd.DataFrame, column: str = "covariance") -> np.ndarray:
    """Share of runs with trained cloths whose 90 % region holds the right p, `[N]`.

    The regions are those by a column of covariances, after each of N lengths.
    """
    held = []
    for _, run in table[table.kind == "trained"].iterrows():
        right = trained(f"{_ARM}-{run.model}").biases[run.cloth]
        regions = zip(run.estimate, run[column], strict=True)
        held.append([inside(right, p, covariance) for p, covariance in regions])
    return np.mean(held, axis=0)


def _cases(**sizes: Any) -> list[Case]:
    """Every cloth with every training: more runs with each trained one than others."""
    cases = []
    every = over(cloth=_ALL, model=range(5), repeat=range(_TEST_RUNS))
    for case in every(**sizes):
        if case["cloth"] in CLOTHS or case["repeat"] < _STRANGE_RUNS:
            cases.append(case)
    return cases


EXPERIMENTS = (
    Experiment("calibration", _calibrate_one, over(model=range(5)), slow=True),
    Experiment("calibration_test", _run_one, _cases, slow=True),
)
