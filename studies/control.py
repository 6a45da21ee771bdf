"""Which commands produce the target image?

Control with the right p against random commands, a cloth that hangs still, and an image
without cloth (paper, "Simulation Experiment": the figure on control). Distances are in
standard deviations of z, the smallest in each period of 8 steps; the arm swings up in
the first period, which is left out.
"""

from typing import Any

import numpy as np

from clothlab import data
from clothlab.analysis import best_per_period, empty_distance, target_distance
from clothlab.method.control import ControlSettings
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import HEAVY, LIGHT, median_best, new_trial, random_trial, trained


def _run_one(
    target: str, cloth: str, model: int, weights: str = "torque", steps: int = 250
) -> dict[str, Any]:
    """Distance at each step `[T]` [s.d. of z] under control and under random commands;
    250 steps as in the paper.
    """
    return _distances(target, cloth, model, weights, steps, ControlSettings())


def _run_periodic(
    target: str, cloth: str, model: int, steps: int = 250
) -> dict[str, Any]:
    """The same where a plan goes on with the command of a period ago."""
    return _distances(
        target, cloth, model, "torque", steps, ControlSettings(warm_start="periodic")
    )


def _distances(
    target: str,
    cloth: str,
    model: int,
    weights: str,
    steps: int,
    settings: ControlSettings,
) -> dict[str, Any]:
    learned, mask = trained(f"{weights}-{model}"), data.load_target(target)
    control = new_trial(
        learned.controller(mask, cloth, settings), learned.arm, cloth, steps, model
    )
    random = random_trial(learned.arm.name, cloth, steps, seed=7000 + model)
    controlled, at_random = (
        target_distance(learned.autoencoder, trial, mask) for trial in (control, random)
    )
    return {
        "still": float(controlled[0]),  # every run begins with the cloth hanging still
        "empty": empty_distance(learned.autoencoder, mask),
        "control": controlled.round(4),
        "random": at_random.round(4),
    }


def _rows(tables: Tables, name: str = "control", warm_start: str = "") -> list[Row]:
    """Best distance of a period under control over that under random commands."""
    found = []
    for (target, cloth), runs in tables[name].groupby(["target", "cloth"], sort=False):
        control, random = median_best(runs["control"]), median_best(runs["random"])
        spread = np.std(
            [np.median(best_per_period(each)) / random for each in runs["control"]]
        )
        still, empty = runs[["still", "empty"]].iloc[0]
        found.append(
            Row(
                f"{name}/{target}/{cloth}",
                f"{target}, {cloth}{warm_start}: best distance a period, median, over that of random commands",
                control / random,
                spread=float(spread),
                paper="Control better",
                below=1,
                at_most=0.5 if warm_start else 0.4,
                note=f"{control:.2f} / {random:.2f}; hanging still {still:.2f}, empty image {empty:.2f}",
            )
        )
    return found


def _periodic_rows(tables: Tables) -> list[Row]:
    return [
        row
        for row in _rows(tables, "control_periodic", ", periodic warm start")
        if "target-1" in row.key
    ]


_CASES = over(target=("target-1", "target-2"), cloth=(LIGHT, HEAVY), model=range(5))
EXPERIMENTS = (
    Experiment(
        "control",
        _run_one,
        _CASES,
        seconds=13,
        paper={"weights": "torque-paper"},
        rows=_rows,
    ),
    Experiment(
        "control_periodic", _run_periodic, _CASES, seconds=13, rows=_periodic_rows
    ),
)
