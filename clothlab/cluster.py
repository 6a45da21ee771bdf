"""Tasks on one machine or on many: Dask's scheduler hands them to workers, and those of a dead worker to others.

There is one way to run them, `run`, with a client of Dask's: of a cluster in this machine (`local`), or of a scheduler
whose address is given (`connect`). All workers see one folder, the store, and run the same versions on one thread each;
that is checked before the first task, and again of each worker that joins later.
"""

import os
import secrets
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tqdm.auto import tqdm

from clothlab._files import write_bytes
from clothlab._validation import check_number
from clothlab.tasks import (
    DATA,
    FAILED,
    LEFT_OUT,
    Outcome,
    Task,
    do,
    expected,
    first_line,
    in_order,
    makespan,
    measured,
    urgency,
    versions,
)

try:
    import dask
    import distributed
except ImportError as error:
    raise ImportError("this needs the package distributed: pip install 'clothlab[cluster]'") from error

TOKEN = ".store"  # a file by whose content workers show that they see the store
FORGIVING = 10**6  # deaths of workers; which task they died of, `tasks.do` knows
PATIENCE = 60.0  # for the first worker [s]
SETTINGS = {  # of Dask
    "distributed.admin.large-graph-warning-threshold": "1GB",
    "distributed.comm.timeouts.connect": "60s",  # a machine that is busy answers late
    "distributed.comm.timeouts.tcp": "120s",
}


class Unfit(RuntimeError):
    """Workers that cannot take part; the message has a line for each."""


class Check(distributed.WorkerPlugin):
    """Keeps out workers whose versions, threads or store are not the client's.

    Args:
        store: the folder.
        token: what its file `TOKEN` says.
        wanted: versions, as `versions` gives them.
    """

    name = "clothlab-check"

    def __init__(self, store: Path, token: str, wanted: Mapping[str, str]):
        self.store, self.token, self.wanted = store, token, dict(wanted)

    def setup(self, worker: distributed.Worker) -> None:
        """Send a worker that joins and is unfit away; its log says why."""
        _is_sent_away(worker, self.faults(worker.state.nthreads))

    def faults(self, threads: int) -> list[str]:
        """What is wrong with the process that asks, and what would mend it."""
        found = self.other_versions()
        if threads != 1:
            found.append(f"it has {threads} threads: start it with --nthreads 1, and as many workers as cores")
        return found + self.stored()

    def other_versions(self) -> list[str]:
        """In which versions the process that asks differs."""
        here = versions()
        others = [f"{name} {here[name]} instead of {each}" for name, each in self.wanted.items() if here[name] != each]
        return [f"it runs {', '.join(others)}: install the same there, and start it again"] if others else []

    def stored(self) -> list[str]:
        """What is wrong with the folder that the process that asks sees."""
        try:
            seen = (self.store / TOKEN).read_text()
        except OSError as error:
            return [
                f"it cannot read the store {self.store} ({error.strerror}): the folder must be shared by all machines"
            ]
        if seen != self.token:
            return [f"it has another folder at {self.store}: the store must be shared by all machines"]
        if not os.access(self.store, os.W_OK):
            return [f"it may not write into the store {self.store}"]
        return []


def open_store(store: str | Path) -> Path:
    """The folder of results, made where there is none.

    Returns:
        Its absolute path, under which all workers have to see it.

    Raises:
        ValueError: a folder with other things in it.
    """
    store = Path(store).absolute()
    token = store / TOKEN
    if not token.exists():
        if store.exists() and (not store.is_dir() or any(store.iterdir())):
            raise ValueError(f"{store} is no store of results and not empty: name another folder")
        write_bytes(token, secrets.token_hex(16).encode())
    return store


@contextmanager
def local(workers: int | None = None) -> Iterator[distributed.Client]:
    """A client of a cluster in this machine: processes with one thread each, as many as there are cores."""
    workers = check_number("workers", workers or os.cpu_count() or 1, int, at_least=1)
    options: dict[str, Any] = {"n_workers": workers, "threads_per_worker": 1, "processes": True, "memory_limit": 0}
    with (
        dask.config.set(SETTINGS),
        distributed.LocalCluster(dashboard_address="127.0.0.1:0", silence_logs=50, **options) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@contextmanager
def connect(address: str) -> Iterator[distributed.Client]:
    """A client of a scheduler, whose workers are on any machines.

    Raises:
        Unfit: no scheduler there, or one without workers.
    """
    with dask.config.set(SETTINGS):
        try:
            client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            raise Unfit(
                f"no scheduler answers at {address}: start one with `dask scheduler` ({first_line(error)})"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=PATIENCE)
            except TimeoutError:
                raise Unfit(
                    f"the scheduler at {address} has no workers: `dask worker {address} --nthreads 1`"
                ) from None
            yield client


@contextmanager
def checked(client: distributed.Client, store: Path) -> Iterator[Check]:
    """While inside, only workers that are fit do tasks; what judges them is given.

    Raises:
        Unfit: those that are there and are not.
    """
    check = Check(store, (store / TOKEN).read_text(), versions())
    threads = client.nthreads()
    answers = {
        each: client.submit(_faults, check, count, workers=[each], pure=False) for each, count in threads.items()
    }
    lines = []
    for address, answer in answers.items():
        try:
            lines += [f"{address}: {fault}" for fault in answer.result(timeout=4 * PATIENCE)]
        except Exception as error:  # such as a package without this module
            lines.append(f"{address}: it cannot run this version of clothlab: {first_line(error)}")
    if lines:
        raise Unfit("\n".join(lines))
    client.register_plugin(check)
    try:
        yield check
    finally:
        with suppress(Exception):  # a scheduler that is gone has no plugins
            client.unregister_worker_plugin(Check.name)


@contextmanager
def forgiving(client: distributed.Client) -> Iterator[None]:
    """While inside, the scheduler gives no task up: it would blame a worker's death on all that waited there, too."""
    before = client.run_on_scheduler(_forgive, FORGIVING)
    try:
        yield
    finally:
        with suppress(Exception):  # a scheduler that is gone blames nobody
            client.run_on_scheduler(_forgive, before)


def _forgive(deaths: int, dask_scheduler: distributed.Scheduler) -> int:
    before, dask_scheduler.allowed_failures = dask_scheduler.allowed_failures, deaths
    return before


def _faults(check: Check, threads: int) -> list[str]:
    return check.faults(threads)


def _is_sent_away(worker: distributed.Worker, faults: Sequence[str]) -> bool:
    if faults:  # Dask keeps a worker whose plugin raises, so it is closed, and its nanny does not start another
        worker.loop.add_callback(worker.close, nanny=True, reason=f"{worker.address}: {'; '.join(faults)}")
    return bool(faults)


def _do(check: Check, task: Task, store: Path, run: str, *before: Outcome) -> Outcome:
    worker = distributed.get_worker()
    if _is_sent_away(worker, check.faults(worker.state.nthreads)):  # one that has just joined, or that lost the store
        raise distributed.Reschedule
    return do(task, store, run, *before)


def run(
    tasks: Sequence[Task], store: str | Path, client: distributed.Client, *, progress: bool = False
) -> dict[str, Outcome]:
    """Do all tasks that are not done yet.

    Args:
        tasks: in any order.
        store: folder of all results.
        client: of Dask's, from `local` or `connect`.
        progress: show how many are done, and how long the others will take.

    Returns:
        What came of each, `{name: outcome}`. A failure leaves out what is made from it, and nothing else.

    Raises:
        Unfit: workers with other versions, or that do not see the store.
        ValueError: tasks that do not belong together, or trials in the store that none of them makes.
    """
    tasks, store = in_order(tasks), open_store(store)
    refuse_strays(tasks, store)
    with checked(client, store) as check, forgiving(client):
        known = {name: each["seconds"] for name, each in measured(store, [task.name for task in tasks]).items()}
        run_name, clock = uuid.uuid4().hex, _Clock(tasks, known, len(client.nthreads()))
        futures: dict[str, distributed.Future] = {}
        for task in tasks:
            before = [futures[name] for name in task.after]
            key, first = f"{task.name}-{run_name}", round(1000 * clock.urgent[task.name])
            futures[task.name] = client.submit(
                _do, check, task, store, run_name, *before, key=key, pure=False, priority=first
            )
        names = {future.key: name for name, future in futures.items()}
        found: dict[str, Any] = {}
        bar = tqdm(total=len(tasks), disable=not progress, unit="task", smoothing=0, bar_format=_BAR)
        with bar:
            options = {"loop": client.loop, "with_results": True, "raise_errors": False}
            for future, answer in distributed.as_completed(futures.values(), **options):
                name = names[future.key]
                found[name] = answer
                bar.set_postfix_str(f"{clock.left(name, answer)}; last {name}", refresh=False)
                bar.update()
    return _told(tasks, found)


_BAR = "{desc}{percentage:3.0f}% |{bar}| {n_fmt} of {total_fmt} tasks, {elapsed}{postfix}"


def _told(tasks: Sequence[Task], found: Mapping[str, Any]) -> dict[str, Outcome]:
    """Outcomes in the order of the tasks; an exception is Dask's own."""
    told: dict[str, Outcome] = {}
    for task in tasks:
        answer = found[task.name]
        if not isinstance(answer, Outcome):
            bad = [name for name in task.after if told[name].state in (FAILED, LEFT_OUT)]
            error = answer[1] if isinstance(answer, tuple) else answer
            why = f"needs {bad[0]}" if bad else first_line(error)
            answer = Outcome(task.name, LEFT_OUT if bad else FAILED, why=why)
        told[task.name] = answer
    return told


def refuse_strays(tasks: Sequence[Task], store: Path) -> None:
    """Trials are learned from set by set, so that none may lie there that no task makes.

    Raises:
        ValueError: such a trial; the message says what to do.
    """
    made = {path for task in tasks for name in task.files for path in (store / DATA).glob(name)}
    strays = [
        path for path in sorted((store / DATA / "trials").glob("*/*")) if path.suffix == ".npz" and path not in made
    ]
    if strays:
        raise ValueError(
            f"{len(strays)} trials in the store are of another plan, such as {strays[0]}: delete them, or name another "
            "store"
        )


class _Clock:
    """How long the tasks that are not done yet will take, from what others of their kinds took."""

    def __init__(self, tasks: Sequence[Task], known: Mapping[str, float], workers: int):
        self.waiting = {task.name: task for task in tasks}
        self.known, self.workers = dict(known), workers
        self.words, self.said = "", 0.0
        seconds = expected(tasks, self.known)
        self.urgent = urgency(tasks, seconds if any(seconds.values()) else dict.fromkeys(seconds, 1.0))

    def left(self, name: str, answer: Any) -> str:
        """Words for the time left, after a task is done."""
        del self.waiting[name]
        if isinstance(answer, Outcome) and answer.seconds:
            self.known[name] = answer.seconds
        if time.monotonic() - self.said > 1 or not self.waiting:  # of thousands, it takes a while
            rest = list(self.waiting.values())
            seconds = makespan(rest, expected(rest, self.known), self.workers, self.urgent)
            self.words = f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"
            self.said = time.monotonic()
        return self.words
