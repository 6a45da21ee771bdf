"""Fill the tables of `docs/scaling.md`: what tasks cost, how they scale, and what a thousand seeds would cost.

`--store build/reproduce` takes costs from a finished run, and the plan that follows from them; `--measure 2` runs the
small plan with one worker and with two, with two seeds and with four.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import torch

from clothlab import cluster
from clothlab._files import write_bytes
from clothlab.experiments import PAPER
from clothlab.reproduce import STORE, Plan, graph, small_plan
from clothlab.tasks import DATA, Task, expected, kind, makespan, measured, urgency

PAGE = Path(__file__).resolve().parents[1] / "docs" / "scaling.md"
SEEDS = 1000  # of the plan on paper
CORES = (1, 2, 16, 128, 1024)
TASK = "CPU s each"


def between(text: str, name: str, content: str) -> str:
    """The text with this content between its marks, `<!-- NAME -->` and `<!-- /NAME -->`.

    Raises:
        ValueError: no such marks.
    """
    before, mark, rest = text.partition(f"<!-- {name} -->")
    _, end, after = rest.partition(f"<!-- /{name} -->")
    if not mark or not end:
        raise ValueError(f"no place for {name!r}: <!-- {name} --> and <!-- /{name} -->")
    return f"{before}{mark}\n{content}\n{end}{after}"


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table in Markdown, whose first column is of words."""
    lines = [head, ["---", *["--:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def sizes(tasks: Sequence[Task], store: Path) -> dict[str, int]:
    """Size of what each task wrote [byte]."""
    return {
        task.name: sum(path.stat().st_size for name in task.files for path in (store / DATA).glob(name))
        for task in tasks
    }


def here() -> str:
    """When and on what kind of machine."""
    return f"{date.today()}, {os.cpu_count()} cores, {torch.backends.cpu.get_cpu_capability()}"


def costs(plan: Plan, store: Path) -> str:
    """What the tasks of a finished run took, by their kinds.

    Raises:
        ValueError: a store in which some were never done.
    """
    tasks, found, large = _finished(plan, store)
    rows, total = [], [0.0, 0.0, 0.0]
    for name in dict.fromkeys(task.kind for task in tasks):
        names = [task.name for task in tasks if task.kind == name]
        cpu, wall = (sum(found[each][what] for each in names) for what in ("cpu_seconds", "seconds"))
        size = sum(large[each] for each in names) / 1e6
        total = [a + b for a, b in zip(total, (cpu, wall, size), strict=True)]
        rows.append([name, len(names), f"{cpu / len(names):.1f}", f"{cpu:.0f}", f"{wall:.0f}", f"{size:.2f}"])
    rows.append(["**all**", len(tasks), "", *(f"{each:.0f}" for each in total[:2]), f"{total[2]:.1f}"])
    head = ("task", "how many", TASK, "CPU s of all", "wall s of all", "MB")
    return f"Size `{plan.name}`, {plan.seeds} seeds, {here()}.\n\n{table(head, rows)}\n\n{wholes(plan, found)}"


def wholes(plan: Plan, found: Mapping[str, Mapping[str, float]]) -> str:
    """What that means for whole runs, where nothing else runs: with all seeds, with one, and from fewer recordings."""
    rows = []
    for words, part in (
        (f"{plan.seeds} seeds", plan),
        ("1 seed", replace(plan, seeds=1)),
        ("1 seed, `--paper-only`", replace(plan, seeds=1, amounts=(PAPER,))),
    ):
        tasks = graph(part)
        seconds = {task.name: found[task.name]["cpu_seconds"] for task in tasks}
        urgent = urgency(tasks, seconds)
        ends = [*(makespan(tasks, seconds, cores, urgent) for cores in (1, 2)), max(urgent.values())]
        rows.append([words, len(tasks), *(f"{each / 60:.1f}" for each in ends)])
    head = ("from nothing to tables", "tasks", "minutes on 1 core", "on 2 cores", "longest chain")
    return f"From these costs, with nothing else running:\n\n{table(head, rows)}"


def on_paper(plan: Plan, store: Path, seeds: int = SEEDS) -> str:
    """Cores, hours and storage of many seeds, from what the tasks of a finished run took."""
    _, found, large = _finished(plan, store)
    many = graph(replace(plan, seeds=seeds))
    growth = seeds / plan.seeds
    seconds = _grown(many, {name: each["cpu_seconds"] for name, each in found.items()}, growth)
    storage = sum(_grown(many, {name: float(size) for name, size in large.items()}, growth).values()) / 1e9
    urgent, work = urgency(many, seconds), sum(seconds.values())
    rows = []
    for cores in CORES:
        hours = makespan(many, seconds, cores, urgent) / 3600
        rows.append([cores, f"{hours:.2f}", f"{100 * work / 3600 / (hours * cores):.0f} %"])
    longest = max(urgent.values()) / 3600
    words = (
        f"From size `{plan.name}`, {plan.seeds} seeds: {len(many)} tasks, {work / 3600:.1f} core-hours, "
        f"{storage:.2f} GB in the store. However many cores there are, it takes {longest:.2f} hours: the longest chain "
        "of tasks."
    )
    return f"{words}\n\n{table(('cores', 'hours', 'busy'), rows)}"


def _grown(tasks: Sequence[Task], known: Mapping[str, float], growth: float) -> dict[str, float]:
    """What tasks cost: as those of their kinds, and so much more where records of all seeds are put together."""
    found = expected(tasks, known)
    return {name: value * (growth if kind(name).startswith("merge-") else 1) for name, value in found.items()}


def _finished(plan: Plan, store: Path) -> tuple[list[Task], dict[str, dict], dict[str, int]]:
    tasks = graph(plan)
    found = measured(store, [task.name for task in tasks])
    missing = [task.name for task in tasks if task.name not in found]
    if missing:
        raise ValueError(
            f"{len(missing)} tasks were never done in {store}, such as {missing[0]}: `make reproduce` first"
        )
    return tasks, found, sizes(tasks, store)


def scaling(seeds: int) -> str:
    """Time of the small plan: one worker, two (strong scaling), two with twice the seeds (weak scaling)."""
    rows, first = [], 0.0
    for workers, number in ((1, seeds), (2, seeds), (2, 2 * seeds)):
        plan, load = small_plan(number), os.getloadavg()[0]
        with tempfile.TemporaryDirectory() as folder, cluster.local(workers) as client:
            start, store = time.perf_counter(), Path(folder) / "store"
            cluster.run(graph(plan), store, client)
            wall = time.perf_counter() - start
            cpu = sum(each["cpu_seconds"] for each in _finished(plan, store)[1].values())
        first = first or wall
        rows.append([workers, number, *(f"{each:.0f}" for each in (wall, cpu)), f"{100 * cpu / wall / workers:.0f} %"])
        rows[-1] += [f"{first / wall:.2f}" if number == seeds else "", f"{load:.1f}"]
    head = ("workers", "seeds", "time [s]", "CPU of tasks [s]", "CPU per worker and time", "speed-up", "load before")
    return f"Size `small`, {here()}.\n\n{table(head, rows)}"


def main() -> None:
    """Fill what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", type=Path, help=f"of a finished run, such as {STORE}")
    parser.add_argument("--small", action="store_true", help="it was a small one")
    parser.add_argument("--seeds", type=int, help="of that run: 5, or of a small one 2")
    parser.add_argument("--measure", type=int, metavar="SEEDS", help="run the small plan three times")
    arguments = parser.parse_args()
    text = PAGE.read_text()
    if arguments.store:
        plan = small_plan(arguments.seeds or 2) if arguments.small else Plan(seeds=arguments.seeds or Plan.seeds)
        text = between(text, "costs", costs(plan, arguments.store))
        text = between(text, "plan", on_paper(plan, arguments.store))
    if arguments.measure:
        text = between(text, "scaling", scaling(arguments.measure))
    write_bytes(PAGE, text.encode())


if __name__ == "__main__":
    main()
