"""`make measured`: what a student needs of a server, into `docs/course/measured.md`.

Every notebook is run from top to bottom, one after the other, each in a kernel of its
own; then the live lab for 30 s of control, and the server that each student has.
`--small` takes CI's sizes, and then the page says so.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import nbformat
import psutil
from browser_lab import Lab
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell
from sampling import sampling

from clothlab._files import write_bytes
from course import solutions
from course.repository import number_of

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "course" / "measured.md"
SAMPLE = 0.1  # [s] between two looks at the memory
LIVE = 30  # [s] of control in the live lab
DRAWN = """
import asyncio

def drawn(number):
    panel._handle_custom_msg({"do": "drawn", "frame": number}, [])

panel.observe(  # what a page does; without one, the panel pauses
    lambda change: drawn(change["new"]["number"]), "frame"
)
drawn(panel.frame["number"])
await asyncio.sleep(%d)
panel.steps
"""
# The server that the page counts for
CORES = 8
MEMORY = 32  # [GB]
SYSTEM = 2  # [GB] of it for the operating system and the hub


@dataclass
class Usage:
    """What processes took."""

    memory: float = 0.0  # at most, of all together [MB]
    processor: float = 0.0  # [s]
    seconds: float = 0.0


def tree(process: psutil.Process) -> list[psutil.Process]:
    """A process and all that it started, as far as they live."""
    try:
        return [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


@contextmanager
def watched(find: "psutil.Process | None" = None) -> Iterator[Usage]:
    """Watch the kernels that this process starts meanwhile.

    Or another process, and all that it starts.
    """
    usage = Usage()
    spent: dict[int, float] = {}  # processor time of each process [s]

    def look() -> None:
        # This process itself does not count
        found = tree(find) if find else tree(psutil.Process())[1:]
        memory = 0.0
        for each in found:
            try:
                memory += each.memory_info().rss / 1e6
                times = each.cpu_times()
                spent[each.pid] = times.user + times.system
            except psutil.NoSuchProcess:
                continue
        usage.memory = max(usage.memory, memory)

    # From here until the caller's work is done
    start = time.perf_counter()
    try:
        with sampling(look, every=SAMPLE):
            yield usage
    finally:
        usage.seconds = time.perf_counter() - start
        usage.processor = sum(spent.values())


def run(path: Path, *, small: bool, live: bool = False) -> Usage:
    """Run a notebook from top to bottom.

    With `live` only up to its panel, which then has time to control.
    """
    notebook = solutions.solved(nbformat.read(path, as_version=4))
    if small:
        notebook = solutions.small(notebook)

    # Behind the cell that makes the panel, one that plays a page
    if live:
        sources = [cell.source for cell in notebook.cells]
        makes_panel = [each.startswith("panel = LivePanel(") for each in sources]
        last = makes_panel.index(True)
        notebook.cells = [*notebook.cells[: last + 1], new_code_cell(DRAWN % LIVE)]

    # In its own folder, as a student runs it
    folder = {"metadata": {"path": str(path.parent)}}
    with watched() as usage:
        NotebookClient(notebook, timeout=None, resources=folder).execute()
    if live:
        steps = int(notebook.cells[-1].outputs[0].data["text/plain"])
        assert steps > 2 * LIVE, f"the panel made {steps} steps in {LIVE} s"
    return usage


def server() -> Usage:
    """JupyterLab's own server, ten seconds after its start, which each student has."""
    with tempfile.TemporaryDirectory() as folder:
        lab = Lab(Path(folder))
        with watched(psutil.Process(lab.process.pid)) as usage:
            lab.wait()
            time.sleep(10)
        lab.close()
    return usage


def page(rows: dict[str, Usage], *, small: bool) -> str:
    """The table, and what follows for a server."""
    describe = ["git", "describe", "--always"]
    commit = subprocess.check_output(describe, cwd=ROOT, text=True).strip()
    sizes = "with CI's small sizes" if small else "at full size"
    measured = (
        f"Measured by `make measured` at commit {commit}, notebooks {sizes}, one after "
        f"the other, on {os.cpu_count()} cores that had other work as well, Python "
        f"{platform.python_version()}."
    )

    # Of each what it took
    table = [
        "| at work | memory at most [MB] | processor time [s] | time [s] |",
        "| --- | --- | --- | --- |",
    ]
    for name, usage in rows.items():
        figures = (usage.memory, usage.processor, usage.seconds)
        cells = " | ".join(f"{figure:.0f}" for figure in figures)
        table.append(f"| {name} | {cells} |")
    return "\n".join([measured, "", *table, "", rule(rows)]) + "\n"


def rule(rows: dict[str, Usage]) -> str:
    """How many students a server holds, from the table."""
    # A student: the largest notebook, and a server
    notebooks = [name for name in rows if name.startswith("notebook")]
    largest = max(notebooks, key=lambda name: rows[name].memory)
    each = (rows["the server of a student"].memory + rows[largest].memory) / 1000

    # A panel that runs: a part of a core
    live = rows[f"live lab, {LIVE} s of control"]
    load = live.processor / live.seconds

    # Whichever is used up first
    by_memory = int((MEMORY - SYSTEM) / each)
    by_cores = int(CORES / load)
    return (
        f"**The rule**: a student needs the memory of the largest notebook ({largest}) "
        f"and of the own server, together {each:.1f} GB, and a panel that runs needs "
        f"{load:.1f} cores. So {CORES} cores and {MEMORY} GB, of which {SYSTEM} are "
        f"the system's, hold {by_memory} students by memory, and {by_cores} panels at "
        f"once by cores: **count {min(by_memory, by_cores)} students**."
    )


def main() -> None:
    """Measure all, or the notebooks of these numbers, which are only printed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--small", action="store_true", help="CI's sizes")
    parser.add_argument("--only", nargs="+", default=[], help="numbers of notebooks")
    arguments = parser.parse_args()
    small = arguments.small
    rows: dict[str, Usage] = {}

    # What the page needs beside notebooks
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    if arguments.only:
        paths = [path for path in paths if number_of(path) in arguments.only]
    else:
        rows["the server of a student"] = server()
        (live,) = (path for path in paths if path.stem.startswith("08"))
        rows[f"live lab, {LIVE} s of control"] = run(live, small=small, live=True)
        print(rows, file=sys.stderr, flush=True)

    # The notebooks, one after the other
    for path in paths:
        usage = run(path, small=small)
        rows[f"notebook {number_of(path)}, all cells"] = usage
        print(f"{path.stem}: {usage}", file=sys.stderr, flush=True)

    # A page of some would look like one of all
    if arguments.only:
        print(rows)
    else:
        write_bytes(PAGE, page(rows, small=small).encode())


if __name__ == "__main__":
    main()
