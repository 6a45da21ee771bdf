"""Which commands produce the target image?

Control with the right p, against random commands. What varies is the target, the cloth,
and with which plan each optimisation begins.
"""

from typing import Any

import pandas as pd

from clothlab import data
from clothlab.analysis import target_distance
from clothlab.method.autoencoder import encode
from clothlab.method.control import ControlSettings
from clothlab.method.iterative import nearest_plans
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import (
    HEAVY,
    LIGHT,
    RECORDINGS,
    empty_distance,
    median_best,
    new_trial,
    random_trial,
    trained,
)


def _run_one(
    target: str, cloth: str, model: int, weights: str = "torque", steps: int = 250
) -> dict[str, Any]:
    """Distance at each step `[T]` under control and under random commands.

    Args:
        target, cloth: of the task, by name.
        model: seed of the training.
        weights: name of the training.
        steps: control steps; the paper has 250.
    """
    return _distances(target, cloth, model, weights, steps, ControlSettings())


def _run_periodic(
    target: str, cloth: str, model: int, steps: int = 250
) -> dict[str, Any]:
    """The same where commands come again in the next period, one step earlier."""
    earlier = ControlSettings(warm_start="earlier")
    return _distances(target, cloth, model, "torque", steps, earlier)


def _distances(
    target: str,
    cloth: str,
    model: int,
    weights: str,
    steps: int,
    settings: ControlSettings,
) -> dict[str, Any]:
    """Distances to the target [s.d. of z].

    Those of runs, of a hanging cloth, of an empty image, and of the nearest recording.
    """
    learned = trained(f"{weights}-{model}")
    mask = data.load_target(target)

    # A run under control, and one with random commands
    controller = learned.controller(mask, cloth, settings)
    control = new_trial(controller, learned.arm, cloth, steps, model)
    random = random_trial(learned.arm.name, cloth, steps, seed=7000 + model)

    # How near this cloth came to the target in the paper's amount of recordings
    trials = data.load_trials(RECORDINGS[learned.arm.name])
    runs = [learned.to_run(trial) for trial in trials if trial.cloth.name == cloth]
    z_ref = encode(learned.autoencoder, mask)
    recorded = nearest_plans(runs, z_ref, count=1).distance[0]

    controlled = target_distance(learned.autoencoder, control, mask)
    at_random = target_distance(learned.autoencoder, random, mask)
    return {
        "still": float(controlled[0]),  # every run begins with the cloth hanging still
        "empty": empty_distance(learned.autoencoder, mask),
        "recorded": float(recorded),
        "control": controlled.round(4),
        "random": at_random.round(4),
    }


def _rows(tables: Tables) -> list[Row]:
    """Best distance of a period under control over that under random commands."""
    rows = []
    by_task = tables["control"].groupby(["target", "cloth"], sort=False)
    for (target, cloth), runs in by_task:
        row = _row(f"control/{target}/{cloth}", f"{target}, {cloth}", runs, 0.4)
        rows.append(row)
    return rows


def _periodic_rows(tables: Tables) -> list[Row]:
    """The same of target-1, with a periodic warm start."""
    rows = []
    table = tables["control_periodic"].query("target == 'target-1'")
    for cloth, runs in table.groupby("cloth", sort=False):
        key = f"control_periodic/target-1/{cloth}"
        rows.append(_row(key, f"target-1, {cloth}, periodic warm start", runs, 0.5))
    return rows


def _row(key: str, task: str, runs: pd.DataFrame, at_most: float) -> Row:
    """One task, all trainings."""
    control = median_best(runs["control"])
    random = median_best(runs["random"])
    return Row(
        key,
        f"{task}: best distance a period, median, over that of random commands",
        control / random,
        at_most=at_most,
    )


_ABOUT = """
Which commands produce the target image?

Control with the right p against random commands, a cloth that hangs still, and an image
without cloth (paper, "Simulation Experiment": the figure on control). Distances are in
standard deviations of z, the smallest in each period of 8 steps, of which the last is
the end of the throw.
"""
_CASES = over(target=("target-1", "target-2"), cloth=(LIGHT, HEAVY), model=range(5))
EXPERIMENTS = (
    Experiment(
        "control",
        _run_one,
        _CASES,
        seconds=13,
        paper={"weights": "torque-paper"},
        rows=_rows,
        about=_ABOUT,
    ),
    Experiment(
        "control_periodic",
        _run_periodic,
        _CASES,
        seconds=13,
        rows=_periodic_rows,
        about=_ABOUT,
    ),
)
