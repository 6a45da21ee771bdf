"""Jobs side by side, each on one core, in this machine or on many.

Results are kept, so that an interrupted run goes on.
"""

import hashlib
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import joblib
import torch
from threadpoolctl import threadpool_limits
from tqdm.auto import tqdm

import clothlab
from clothlab import _store


@dataclass(frozen=True)
class Job:
    """A call."""

    function: Callable[..., Any]
    arguments: Mapping[str, Any]  # by name
    # How the names of the files of `data/` begin that it reads, such as `trials/train/`
    inputs: tuple[str, ...] = ()


def run_jobs(
    name: str,
    jobs: Sequence[Job],
    *,
    workers: int = 1,
    progress: bool = False,
    keep: Path | None = None,
) -> Iterator[Any]:
    """Call each job, and yield what they return, in their order.

    A `joblib.parallel_config` around the loop chooses another backend than processes,
    such as Dask.

    Args:
        name: of these jobs: results are kept under it, and progress is shown.
        jobs: what to call.
        workers: processes.
        progress: whether a bar shows it.
        keep: a folder for results: a job whose code, arguments and inputs are the same
            is not done again.
    """
    call = joblib.delayed(cached(_call, keep, ignore=["function"]))
    calls = (
        call(job.function, name, dict(job.arguments), version(*job.inputs))
        for job in jobs
    )
    results = joblib.Parallel(n_jobs=workers, return_as="generator")(calls)
    return iter(tqdm(results, total=len(jobs), desc=name, disable=not progress))


def cached(
    function: Callable[..., Any], keep: Path | None, ignore: list[str]
) -> Callable[..., Any]:
    """The function, whose results are kept in a folder, if there is one.

    They are found again by all arguments that are not ignored.
    """
    if keep is None:
        return function
    return joblib.Memory(keep, verbose=0).cache(function, ignore=ignore)


def _call(
    function: Callable[..., Any], name: str, arguments: dict[str, Any], version: str
) -> Any:
    if not version.startswith(code_version()):
        raise RuntimeError(
            f"{platform.node()} has other versions of clothlab, or of what it needs: "
            "install the same"
        )
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


def version(*inputs: str) -> str:
    """Hash of the code, and of the files of `data/` that are inputs.

    Inputs are how the names of files begin. Their checksums stand for them.
    """
    recorded = _store.data_folder() / _store.CHECKSUMS
    lines = []
    if inputs and recorded.exists():
        lines = recorded.read_text().splitlines()
    used = "\n".join(line for line in lines if line[66:].startswith(inputs))
    return f"{code_version()}-{hashlib.sha256(used.encode()).hexdigest()}"


@cache
def code_version() -> str:
    """Hash of the package, of these studies, and of what versions they compute with."""
    digest = hashlib.sha256()
    for folder in (Path(clothlab.__file__).parent, Path(__file__).parent):
        for path in sorted(folder.rglob("*")):
            if path.suffix in {".py", ".xml"}:
                digest.update(path.read_bytes())
    for package in ("mujoco", "numpy", "scikit-learn", "scipy", "torch"):
        digest.update(metadata.version(package).encode())
    return digest.hexdigest()
