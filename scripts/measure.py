"""`make measured`: what a student needs of a server, measured into
`docs/course/measured.md`.

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
import threading
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

from clothlab._files import write_bytes
from course import solutions

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "course" / "measured.md"
SAMPLE = 0.1  # [s] between two looks at the memory
LIVE = 30  # [s] of control in the live lab
DRAWN = """
import asyncio
panel.observe(  # what a page does; without one, the panel pauses
    lambda change: panel._handle_custom_msg({"do": "drawn", "frame": change["new"]["number"]}, []), "frame"
)
panel._handle_custom_msg({"do": "drawn", "frame": panel.frame["number"]}, [])
await asyncio.sleep(%d)
panel.steps
"""
CORES, MEMORY = 8, 32  # of the server that the page counts for: cores, and GB
SYSTEM = 2  # [GB] for the operating system and the hub


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
    """Watch the kernels that this process starts meanwhile, or another process and all
    that it starts.
    """
    usage, over, spent = Usage(), threading.Event(), dict[int, float]()

    def watch() -> None:
        while not over.wait(SAMPLE):
            found = tree(find or psutil.Process())[0 if find else 1 :]
            memory = 0.0
            for each in found:
                try:
                    memory += each.memory_info().rss / 1e6
                    times = each.cpu_times()
                    spent[each.pid] = times.user + times.system
                except psutil.NoSuchProcess:
                    continue
            usage.memory = max(usage.memory, memory)

    start, watcher = time.perf_counter(), threading.Thread(target=watch)
    watcher.start()
    try:
        yield usage
    finally:
        over.set()
        watcher.join()
        usage.seconds = time.perf_counter() - start
        usage.processor = sum(spent.values())


def run(path: Path, *, small: bool, live: bool = False) -> Usage:
    """Run a notebook from top to bottom; with `live` up to its panel, which then has
    time to control.
    """
    notebook = solutions.solved(nbformat.read(path, as_version=4))
    if small:
        notebook = solutions.small(notebook)
    if live:
        (last,) = (
            k
            for k, cell in enumerate(notebook.cells)
            if cell.source.startswith("panel = LivePanel(")
        )
        notebook.cells = [*notebook.cells[: last + 1], new_code_cell(DRAWN % LIVE)]
    with watched() as usage:
        NotebookClient(
            notebook, timeout=None, resources={"metadata": {"path": str(path.parent)}}
        ).execute()
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
    commit = subprocess.check_output(
        ["git", "describe", "--always"], cwd=ROOT, text=True
    ).strip()
    sizes = "with CI's small sizes" if small else "at full size"
    lines = [
        f"Measured by `make measured` at commit {commit}, notebooks {sizes}, one after the other, on "
        f"{os.cpu_count()} cores that had other work as well, Python {platform.python_version()}.",
        "",
        "| at work | memory at most [MB] | processor time [s] | time [s] |",
        "| --- | --- | --- | --- |",
    ]
    for name, usage in rows.items():
        lines.append(
            f"| {name} | {usage.memory:.0f} | {usage.processor:.0f} | {usage.seconds:.0f} |"
        )
    return "\n".join([*lines, "", *rule(rows)]) + "\n"


def rule(rows: dict[str, Usage]) -> list[str]:
    """How many students a server holds, from the table."""
    notebooks = {
        name: usage for name, usage in rows.items() if name.startswith("notebook")
    }
    largest = max(notebooks, key=lambda name: notebooks[name].memory)
    own = rows["the server of a student"].memory
    live = rows[f"live lab, {LIVE} s of control"]
    each = (own + notebooks[largest].memory) / 1000
    load = live.processor / live.seconds
    by_memory, by_cores = int((MEMORY - SYSTEM) / each), int(CORES / load)
    return [
        f"**The rule**: a student needs the memory of the largest notebook ({largest}) and of the own server, together "
        f"{each:.1f} GB, and a panel that runs needs {load:.1f} cores. So {CORES} cores and {MEMORY} GB, of which "
        f"{SYSTEM} are the system's, hold {by_memory} students by memory, and {by_cores} panels at once by cores: "
        f"**count {min(by_memory, by_cores)} students**."
    ]


def main() -> None:
    """Measure all, or the notebooks of these numbers, which are only printed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--small", action="store_true", help="CI's sizes")
    parser.add_argument("--only", nargs="+", default=[], help="numbers of notebooks")
    arguments = parser.parse_args()
    rows: dict[str, Usage] = {}
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    if arguments.only:
        paths = [path for path in paths if path.stem[:2] in arguments.only]
    else:
        rows["the server of a student"] = server()
        (live,) = (path for path in paths if path.stem.startswith("08"))
        rows[f"live lab, {LIVE} s of control"] = run(
            live, small=arguments.small, live=True
        )
        print(rows, file=sys.stderr, flush=True)
    for path in paths:
        rows[f"notebook {path.stem[:2]}, all cells"] = usage = run(
            path, small=arguments.small
        )
        print(f"{path.stem}: {usage}", file=sys.stderr, flush=True)
    if arguments.only:
        print(rows)
    else:
        write_bytes(PAGE, page(rows, small=arguments.small).encode())


if __name__ == "__main__":
    main()
