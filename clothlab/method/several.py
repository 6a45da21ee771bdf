"""Several trainings side by side, each from a seed of its own.

Trainings that differ in their seed alone say how much a result rests on chance. Their
matrices are too small to gain from a second core, so each has one to itself.
"""

import multiprocessing
import os
import pickle
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm.auto import tqdm

from clothlab._validation import check_number, check_seed, settings_or_default
from clothlab.method._inputs import check_runs
from clothlab.method._watch import TrainingTrace
from clothlab.method.data import Run
from clothlab.method.model import PredictiveModel
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.method.training_options import TrainingOptions

_Trained = tuple[PredictiveModel, dict[str, np.ndarray], TrainingTrace]


def train_several(
    runs: Sequence[Run],
    seeds: Iterable[int],
    settings: ModelTraining | None = None,
    *,
    workers: int | None = None,
    progress: bool = True,
    options: TrainingOptions | None = None,
    **others: Any,
) -> list[_Trained]:
    """Train once from each seed: what `train_dpmpb` returns, in the order of the seeds.

    Each has a process and one thread, and gives the very numbers of a training alone
    in one thread. In a program the call stands below `if __name__ == "__main__":`,
    since every process imports that.

    Args:
        runs: recordings of one robot.
        seeds: of each training.
        settings: of all of them.
        workers: processes; by default as many as there are cores.
        progress: show how many are done.
        options: of each; a `checkpoint` gets the seed into its name.
        others: of `train_dpmpb`, such as `model` and `known`.
    """
    seeds = [check_seed(seed) for seed in seeds]
    if not seeds:
        return []
    runs = check_runs(runs)
    options = settings_or_default(options, TrainingOptions)
    cores = os.cpu_count() or 1
    workers = cores if workers is None else workers
    workers = check_number("workers", workers, int, at_least=1)
    _check_can_be_sent(others.get("model"), options.callback)

    # Fresh processes, which share nothing with this one
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(seeds)), mp_context=spawn)
    try:
        jobs = []
        for seed in seeds:
            own = {"seed": seed, "options": _of_seed(options, seed), **others}
            jobs.append(pool.submit(_train_one, runs, settings, own))
        bar = tqdm(jobs, "trainings", disable=not progress)
        return [job.result() for job in bar]
    finally:
        pool.shutdown(cancel_futures=True)


def _train_one(
    runs: Sequence[Run], settings: ModelTraining | None, others: dict[str, Any]
) -> _Trained:
    torch.set_num_threads(1)
    return train_dpmpb(runs, settings, progress=False, **others)


def _of_seed(options: TrainingOptions, seed: int) -> TrainingOptions:
    """The same options, with a file of this seed's own."""
    if options.checkpoint is None:
        return options
    path = Path(options.checkpoint)
    return replace(options, checkpoint=path.with_stem(f"{path.stem}-{seed}"))


def _check_can_be_sent(*functions: Any) -> None:
    """A ValueError for a network or a callback that another process can't import."""
    no_file = getattr(sys.modules["__main__"], "__file__", None) is None
    for function in functions:
        here = getattr(function, "__module__", "") == "__main__"
        try:
            pickle.dumps(function)
        except (pickle.PicklingError, AttributeError, TypeError):
            here = True
            no_file = True
        if here and no_file:
            raise ValueError(
                f"other processes can't import {function!r:.80}: write it into a file "
                "of its own, at the file's top level, and import it from there"
            )
