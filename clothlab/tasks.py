"""Work as a graph of tasks whose results lie in a folder: each is done once, and again when what it stands on changes.

`do` does one task, in whatever process and on whatever machine; `clothlab.cluster` says where. What a task made is
known by the code, the versions of the packages that it calculates with, its arguments, and the hashes of what it was
made from.
"""

import hashlib
import heapq
import json
import os
import platform
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from threadpoolctl import threadpool_limits

from clothlab import artifacts
from clothlab._validation import check_name
from clothlab.experiments import _kept, _record

DATA = "data"  # the folder of a store that is laid out as the repository's `data/`
RUNNING, DEATHS = "running", 4  # the folder of a store for tasks that have begun; workers that one of them may cost
COMPUTED, KEPT, FAILED, LEFT_OUT = "computed", "taken from the store", "failed", "left out"
STATES = (COMPUTED, KEPT, FAILED, LEFT_OUT)
CODE = _kept.code()[:16]  # of the package as it is loaded: a process that lives on while files change is told apart


@dataclass(frozen=True)
class Task:
    """One piece of work.

    Attributes:
        name: its own, with a number at its end where there are others of the kind.
        function: does it, and writes files into `data_folder()`, which is the store's while it runs.
        arguments: of the function; as cattrs writes them, they are part of what the result is known by.
        after: names of the tasks from whose files it is made.
        files: what it writes, by name or by pattern, from the store's data folder.
    """

    name: str
    function: Callable[..., None]
    arguments: tuple[Any, ...] = ()
    after: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Name without the number: tasks of a kind cost about the same."""
        return kind(self.name)


@dataclass(frozen=True)
class Outcome:
    """What came of a task.

    Attributes:
        name: of the task.
        state: one of `STATES`.
        made: hash of its files, by which those that are made from them know them.
        seconds: that it took when it was computed [s].
        cpu_seconds: of them on a core [s].
        size: of its files [byte].
        why: of a failure, its first line; of what is left out, which task it needs.
    """

    name: str
    state: str
    made: str = ""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    size: int = 0
    why: str = ""


def kind(name: str) -> str:
    """Name of a task without the number at its end."""
    return re.sub(r"-\d+$", "", name)


def in_order(tasks: Iterable[Task]) -> list[Task]:
    """The tasks, each after those from which it is made.

    Raises:
        ValueError: two of a name, one that is made from a task that is not there, or a circle.
    """
    by_name: dict[str, Task] = {}
    for task in tasks:
        if check_name("task", task.name) in by_name:
            raise ValueError(f"two tasks are called {task.name!r}")
        by_name[task.name] = task
    for task in by_name.values():
        for needed in task.after:
            if needed not in by_name:
                raise ValueError(f"{task.name!r} is made from {needed!r}, which is no task")
    try:
        order = TopologicalSorter({name: task.after for name, task in by_name.items()}).static_order()
        return [by_name[name] for name in order]
    except CycleError as error:
        raise ValueError(f"tasks wait for each other in a circle: {' → '.join(error.args[1])}") from None


def versions() -> dict[str, str]:
    """What a result depends on beside its arguments: the hash of the package's code, and versions of others."""
    packages = {name: version(name) for name in ("numpy", "torch", "mujoco", "scipy", "scikit-learn")}
    return {"clothlab": CODE, "Python": platform.python_version(), **packages}


def do(task: Task, store: Path, run: str, *before: Outcome) -> Outcome:
    """Do a task, or find that it has been done.

    Args:
        task: which.
        store: folder of all results; made where there is none.
        run: a name of this run, by which it is known later what this run computed.
        before: what came of the tasks in `task.after`.

    Returns:
        What came of it: also of a failure, so that whoever waits for it can be told.
    """
    missing = [each.name for each in before if each.state in (FAILED, LEFT_OUT)]
    if missing:
        return Outcome(task.name, LEFT_OUT, why=f"needs {missing[0]}")
    store, files = Path(store), [f"{DATA}/{name}" for name in task.files]
    (store / DATA).mkdir(parents=True, exist_ok=True)
    made_with = {
        "function": f"{task.function.__module__}.{task.function.__qualname__}",
        "arguments": _record.converter.unstructure(task.arguments),
        "versions": versions(),
        "made_from": {each.name: each.made for each in before},
    }
    try:
        answer = _kept.once(task.name, made_with, lambda: _make(task, store, run, files), folder=store, files=files)
        made = _kept.hashes(store, files)
    except Exception as error:  # of whatever kind: the others go on
        return Outcome(task.name, FAILED, why=first_line(error))
    return Outcome(
        name=task.name,
        state=COMPUTED if answer["run"] == run else KEPT,
        made=hashlib.sha256(json.dumps(made).encode()).hexdigest(),
        seconds=answer["seconds"],
        cpu_seconds=answer["cpu_seconds"],
        size=sum((store / name).stat().st_size for name in made),
    )


def first_line(error: BaseException) -> str:
    """Kind of an error, and the first line of what it says."""
    return f"{type(error).__name__}: {str(error).strip()}".splitlines()[0].rstrip(": ")


def _make(task: Task, store: Path, run: str, files: list[str]) -> dict[str, Any]:
    for name in files:  # of an earlier making, perhaps with other names
        for path in store.glob(name):
            path.unlink(missing_ok=True)
    wall, cpu = time.perf_counter(), time.process_time()
    with _begun(store / RUNNING / task.name, run), _data_in(store / DATA), threadpool_limits(1):
        _record.alone(task.function, task.arguments)
    missing = [name for name, found in _kept.hashes(store, files).items() if found is None]
    if missing:
        raise RuntimeError(f"{task.name} did not write {missing[0]}")
    return {
        "run": run,
        "seconds": round(time.perf_counter() - wall, 3),
        "cpu_seconds": round(time.process_time() - cpu, 3),
        "machine": f"{platform.node()}, {torch.backends.cpu.get_cpu_capability()}",
    }


@contextmanager
def _begun(path: Path, run: str) -> Iterator[None]:
    """While inside, a file says that this run has begun a task: it stays behind if the process dies of it.

    Raises:
        RuntimeError: too many have.
    """
    path.parent.mkdir(exist_ok=True)
    with path.open("a+") as file:
        file.seek(0)
        deaths = file.read().splitlines().count(run)
        file.write(f"{run}\n")
    try:
        if deaths >= DEATHS:
            raise RuntimeError(f"{deaths} workers died of it, one after another")
        yield
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def _data_in(folder: Path) -> Iterator[None]:
    """While inside, this folder is the data folder, and nothing is remembered of another one."""
    _record.forget()
    before = os.environ.get("CLOTHLAB_DATA")
    os.environ["CLOTHLAB_DATA"] = str(folder)
    try:
        yield
    finally:
        _record.forget()
        if before is None:
            del os.environ["CLOTHLAB_DATA"]
        else:
            os.environ["CLOTHLAB_DATA"] = before


def measured(store: Path, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """What is known of tasks that were done once, `{name: {"seconds": [s], "cpu_seconds": [s], "machine": name}}`."""
    found = {}
    for name in names:
        try:
            found[name] = artifacts.load_results(name, data=store)["answer"]
        except (KeyError, ValueError, FileNotFoundError):  # never done, or damaged
            continue
    return found


def expected(tasks: Sequence[Task], seconds: Mapping[str, float]) -> dict[str, float]:
    """Time that each task will take [s]: what it took, or the mean of its kind, or of all."""
    found: dict[str, list[float]] = {}
    for name, value in seconds.items():
        for each in (kind(name), ""):
            found.setdefault(each, []).append(value)
    mean = {each: sum(values) / len(values) for each, values in found.items()}
    return {task.name: seconds.get(task.name, mean.get(task.kind, mean.get("", 0.0))) for task in tasks}


def urgency(tasks: Sequence[Task], seconds: Mapping[str, float]) -> dict[str, float]:
    """Time from the beginning of a task to the end of all that is made from it [s]: the largest begins first."""
    found = {task.name: seconds[task.name] for task in tasks}
    for task in reversed(in_order(tasks)):  # whoever is made from it has come before
        for name in task.after:
            found[name] = max(found[name], seconds[name] + found[task.name])
    return found


def makespan(tasks: Sequence[Task], seconds: Mapping[str, float], workers: int, urgent: Mapping[str, float]) -> float:
    """Time that so many workers need for tasks [s], each beginning the most urgent of those that can begin.

    Args:
        tasks: those to be done; what they are made from and is not among them is there.
        seconds: that each takes.
        workers: how many.
        urgent: as `urgency` gives it.
    """
    names = {task.name for task in tasks}
    waits = {task.name: sum(name in names for name in task.after) for task in tasks}
    frees: dict[str, list[str]] = {name: [] for name in names}
    for task in tasks:
        for name in task.after:
            if name in names:
                frees[name].append(task.name)
    ready = [(-urgent[name], name) for name, count in waits.items() if not count]
    heapq.heapify(ready)
    running: list[tuple[float, str]] = []
    now = 0.0
    while ready or running:
        while ready and len(running) < workers:
            _, name = heapq.heappop(ready)
            heapq.heappush(running, (now + seconds[name], name))
        now, done = heapq.heappop(running)
        for name in frees[done]:
            waits[name] -= 1
            if not waits[name]:
                heapq.heappush(ready, (-urgent[name], name))
    return now


def summary(outcomes: Iterable[Outcome]) -> str:
    """What was computed, taken from the store, failed and left out, with a line for each of the last two kinds."""
    outcomes = list(outcomes)
    counts = Counter(each.state for each in outcomes)
    lines = [", ".join(f"{counts[state]} {state}" for state in STATES)]
    lines += [f"  {each.state}: {each.name}: {each.why}" for each in outcomes if each.state in (FAILED, LEFT_OUT)]
    return "\n".join(lines)
