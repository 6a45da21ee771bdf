"""Where do the settings of iterative learning control come from?

Weights, prior and caution were chosen by eye on development targets. Here each is moved
alone, down and up, on cloths that no other table has and on development targets: what
it is worth to have chosen well, and what another choice would have cost.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import best_per_period, crossed_interval, target_distance
from clothlab.method.gauss_newton import estimate_bias
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.simulation.cloth import Cloth
from clothlab.trials import Trial
from studies._grid import Case, Experiment, Tables, grid
from studies._rows import Row
from studies._runs import new_trial, random_trial, recorded_runs, trained

AS_CHOSEN = "as chosen"  # in place of a setting: none is moved
# Values of each setting besides the chosen one, a third of it and three times as much;
# the weight of p in the first throw's score also without it and at a hundred times
MOVED = {
    "difference": (0.0, 0.03, 0.3, 10.0),
    "prior_error": (0.18, 1.65),
    "caution": (0.33, 3.0),
    "aim": (0.03, 0.3),
}
# C_damp [N s/m], C_mass [kg]; no training and no other table has them
_CLOTHS = {
    cloth.name: cloth
    for cloth in (
        Cloth("development-slow", damping=0.065, mass=0.06),
        Cloth("development-middle", damping=0.052, mass=0.09),
        Cloth("development-fast", damping=0.034, mass=0.135),
    )
}
_TARGETS = (
    "development/torque_damp0.03-mass0.15_0",
    "development/torque_damp0.07-mass0.05_0",
)
_WEIGHTS = "torque-paper"  # the paper's amount of recordings
_EXCITED = 200  # [step] of random commands from which p is estimated
_FIRST = 2  # periods until the first throw: the arm swings up in the first
_LATE = 3  # last periods of a run, of which the median counts


@cache
def _excited(cloth: str, model: int) -> Trial:
    seed = 61_000 + 100 * model + [*_CLOTHS].index(cloth)
    return random_trial("torque", _CLOTHS[cloth], _EXCITED, seed)


def _run_one(
    setting: str, value: float, cloth: str, target: str, model: int, periods: int = 8
) -> dict[str, Any]:
    """One run of iterative learning control with one setting moved.

    Args:
        setting: of `IterativeLearningSettings`, or `AS_CHOSEN`.
        value: of it.
        cloth: a development cloth, by name.
        target: a development target, by name.
        model: seed of the training.
        periods: of the run.
    """
    # The cloth's p, as a robot would know it
    learned = trained(f"{_WEIGHTS}-{model}")
    mask = data.load_target(target)
    excited = _excited(cloth, model)
    p, _ = estimate_bias(learned.model, learned.to_run(excited), method="newton")

    # The controller, with the setting moved
    settings = IterativeLearningSettings()
    if setting != AS_CHOSEN:
        moved: dict[str, Any] = {setting: value}
        settings = replace(settings, **moved)
    runs = recorded_runs(learned)
    policy = learned.iterative_controller(mask, p, runs, settings)
    trial = new_trial(policy, "torque", _CLOTHS[cloth], 8 * periods + 1, model)

    # How near each period came, and what random commands reach
    distance = target_distance(learned.autoencoder, trial, mask)
    random = target_distance(learned.autoencoder, excited, mask)
    return {
        "best": best_per_period(distance).round(4),  # [P] [s.d. of z]
        "random": float(np.median(best_per_period(random))),
    }


def _cases(model: Any = (0, 1), **same: Any) -> list[Case]:
    """Each setting moved alone; the weight of p acts on the first throw only."""
    moved = [(AS_CHOSEN, 0.0)]
    for setting, values in MOVED.items():
        moved += [(setting, value) for value in values]
    cases = []
    for setting, value in moved:
        short = {"periods": _FIRST} if setting == "difference" else {}
        one = {"setting": setting, "value": value}
        axes = {"cloth": _CLOTHS, "target": _TARGETS, "model": model}
        cases += grid(**(one | axes | short | same))
    return cases


def effects(table: pd.DataFrame) -> pd.DataFrame:
    """What a moved setting adds to the distance over random commands'.

    A row for each moved setting: the mean, and its 95 % interval over cloth-target
    pairs and trainings. It is of the "first" throw for the weight of p, which acts on
    nothing else, and of the "late" periods for the others, which act on what is learned
    from throws.
    """
    scores = table.assign(
        first=table["best"].map(lambda best: min(best[:_FIRST])) / table["random"],
        late=table["best"].map(lambda best: np.median(best[-_LATE:])) / table["random"],
    )
    rows = []
    for (setting, value), runs in scores.groupby(["setting", "value"], sort=False):
        if setting == AS_CHOSEN:
            continue
        when = "first" if (runs["periods"] == _FIRST).all() else "late"
        chosen = scores[scores["setting"] == AS_CHOSEN]
        gaps = _by_unit(runs, when) - _by_unit(chosen, when)
        rows.append((setting, value, when, *crossed_interval(gaps.to_numpy())))
    names = ["setting", "value", "when", "mean", "low", "high"]
    return pd.DataFrame(rows, columns=names)


def _by_unit(scores: pd.DataFrame, when: str) -> pd.DataFrame:
    """Scores of each cloth and target, in a column for each training."""
    return scores.pivot(index=["cloth", "target"], columns="model", values=when)


def _rows(tables: Tables) -> list[Row]:
    """What a moved setting would have gained at most."""
    rows = []
    for when, runs in effects(tables["tuning"]).groupby("when"):
        best = runs.loc[runs["mean"].idxmin()]
        title = {"first": "first throw", "late": "last periods"}[str(when)]
        row = Row(
            f"tuning/{when}",
            f"settings of iterative learning control, {title}: distance over random "
            f"commands', best of {len(runs)} moved ones ({best['setting']} "
            f"{best['value']:g}) minus as chosen",
            best["mean"],
            interval=(best["low"], best["high"]),
            of_paper=True,
        )
        rows.append(row)
    return rows


_ABOUT = """
Where do the settings of iterative learning control come from?

They were chosen by eye on development targets. Each is moved alone, on three cloths
that no other table has and two development targets, with the paper's amount of
recordings.
"""
EXPERIMENTS = (
    Experiment(
        "tuning", _run_one, _cases, seconds=8, slow=True, rows=_rows, about=_ABOUT
    ),
)
