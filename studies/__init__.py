"""Experiments, on which Part II and the results stand.

Each is a function from one case to one row, a grid of cases, and so a table. `make
results` runs them at full size, notebooks read the stored tables or run a few cases,
tests run tiny ones.

    import studies

    table = studies.load("control")  # the stored, full-size table
    small = studies.run("control", model=0, steps=24)  # a few cases, now

    # A stored row beside the same one, made here
    task = {"target": "target-1", "cloth": "damp0.03-mass0.05"}
    both = studies.recompute("control", **task, model=0)

To add one, write a module like `control.py` and name it here.

Three tables of trained rivals, `rivals`, `another_robot_rivals` and `drone_prediction`,
are read by `load` like the others, and were made by the code of commit 97b3ae0d;
`rivals.beside_p` puts them side by side.
"""

from dataclasses import replace
from typing import Any

import pandas as pd

from clothlab._validation import choose
from clothlab.data import Folder, load_table as load, save_table as save
from studies import (
    another_robot,
    autoencoder_quality,
    calibration_test,
    capstone,
    control,
    drone,
    estimation,
    estimation_race,
    held_out,
    identifiability,
    iterative_control,
    joint_estimation_control,
    naming,
    oracle,
    other_reading,
    plan_starts,
    rivals,
    self_organisation,
    simulator_descent,
    stiffness,
    table_setting,
    transfer,
    what_p_buys,
)
from studies._grid import PAPER, Experiment

_MODULES = (
    autoencoder_quality,
    held_out,
    self_organisation,
    other_reading,
    estimation,
    estimation_race,
    naming,
    control,
    plan_starts,
    simulator_descent,
    joint_estimation_control,
    stiffness,
    iterative_control,
    oracle,
    transfer,
    what_p_buys,
    rivals,
    identifiability,
    calibration_test,
    capstone,
    table_setting,
    another_robot,
    drone,
)
EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for module in _MODULES
    for experiment in module.EXPERIMENTS
}


def get(name: str) -> Experiment:
    """An experiment by its name.

    With `-paper` behind it, it is about the paper's amount of recordings.
    """
    experiment = choose("experiment", name.removesuffix(PAPER), EXPERIMENTS)
    return replace(experiment, name=name)


def run(
    name: str, /, *, workers: int = 1, progress: bool = False, **sizes: Any
) -> pd.DataFrame:
    """Run an experiment: one row for each case.

    Args:
        name: of the experiment.
        workers: processes.
        progress: show a progress bar.
        sizes: which cases, such as `model=0`; all else is at full size.
    """
    experiment = get(name)
    if name.endswith(PAPER):
        sizes = dict(experiment.paper) | sizes
    cases = experiment.cases(**sizes)
    return experiment.run(cases, workers=workers, progress=progress)


def recompute(name: str, /, *, data: Folder = None, **which: Any) -> pd.DataFrame:
    """Make one stored row anew: a table of two rows, "stored" and "here".

    It is chosen such as by `cloth="hard-1", model=0`. On the machine where the table
    was made, or one like it, all numbers are the same to the last digit of single
    precision. Other graphics or another processor change the last digits; a closed loop
    then makes more of that with every step.
    """
    if name.startswith("worlds-"):
        own = name.removeprefix("worlds-")
        raise ValueError(
            f"{name}: a world's recordings and weights are not in the repository; run "
            "`make worlds`, set CLOTHLAB_DATA to build/worlds/NUMBER/data, and "
            f"recompute {own!r} there"
        )
    return get(name).recompute(data=data, **which)


__all__ = ["EXPERIMENTS", "PAPER", "Experiment", "load", "recompute", "run", "save"]
