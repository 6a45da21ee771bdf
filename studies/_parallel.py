"""Calls side by side, each on one core, in this machine or on many.

Where the variable CLOTHLAB_KEPT names a folder, what they return is kept there, so that
an interrupted study goes on at its next row.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import joblib
import torch
from threadpoolctl import threadpool_limits
from tqdm.auto import tqdm

KEPT = "CLOTHLAB_KEPT"


def kept() -> joblib.Memory:
    """Keeps what functions return in the folder, if there is one."""
    return joblib.Memory(os.environ.get(KEPT) or None, verbose=0)


def side_by_side(
    function: Callable[..., Any],
    calls: Sequence[Mapping[str, Any]],
    name: str,
    *,
    workers: int = 1,
    progress: bool = False,
) -> Iterator[Any]:
    """Call a function with each of some arguments, and yield what it returns, in order.

    A `joblib.parallel_config` around the loop chooses another backend than processes,
    such as Dask.

    Args:
        function: what to call.
        calls: its arguments, by name.
        name: is shown beside the progress.
        workers: processes.
        progress: whether a bar shows it.
    """
    jobs = (joblib.delayed(_on_one_core)(function, call) for call in calls)
    results = joblib.Parallel(n_jobs=workers, return_as="generator")(jobs)
    return iter(tqdm(results, total=len(calls), desc=name, disable=not progress))


def _on_one_core(function: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:
    with one_thread():
        return function(**arguments)


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one core inside.

    Matrices here are too small to gain from a second, and results repeat bit for bit.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)
