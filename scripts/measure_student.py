"""What one student at work takes of a server: memory and cores, of notebooks and of the live lab's steps."""

import argparse
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from clothlab.simulation.env import CONTROL_PERIOD

ROOT = Path(__file__).resolve().parents[1]
EVERY = 0.5  # [s] between two looks
LAB = f"""
import time
import torch
from clothlab.lab import LiveSession
torch.set_num_threads(1)
session = LiveSession()
began = time.monotonic()
for step in range(150):
    session.step()
    time.sleep(max(0, began + (step + 1) * {CONTROL_PERIOD} - time.monotonic()))
session.close()
"""


@dataclass(frozen=True)
class Taken:
    """What a run took.

    Attributes:
        memory: largest that was seen, of all processes together [MB]; what they share is counted once for each.
        processor: time of all cores together [s].
        seconds: [s] that it lasted.
    """

    memory: float
    processor: float
    seconds: float


def measure(command: list[str]) -> Taken:
    """Run a command, and look at all its processes until it ends.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    began, memory, used = time.monotonic(), 0.0, dict[int, float]()
    running = psutil.Popen(command, cwd=ROOT / "notebooks", stdout=subprocess.DEVNULL)
    while running.poll() is None:
        held = 0
        for each in (running, *running.children(recursive=True)):
            try:
                held += each.memory_info().rss
                used[each.pid] = sum(each.cpu_times()[:2])
            except psutil.Error:  # it has just ended
                continue
        memory = max(memory, held / 1e6)
        time.sleep(EVERY)
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, command)
    seconds = time.monotonic() - began
    return Taken(memory, sum(used.values()), seconds)


def main() -> None:
    """Print a table in Markdown."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=notebooks, default=["00", "08"], help="numbers of notebooks")
    runs = {"live lab, 30 s of control": [sys.executable, "-c", LAB]}
    execute = [sys.executable, "-m", "nbconvert", "--execute", "--to", "notebook", "--stdout", "--log-level=ERROR"]
    for number in parser.parse_args().only:
        runs[f"notebook {number}, all cells"] = [*execute, str(notebooks[number])]
    print("| at work | memory at most [MB] | processor time [s] | time [s] |\n| --- | --- | --- | --- |")
    for name, command in runs.items():
        taken = measure(command)
        print(f"| {name} | {taken.memory:.0f} | {taken.processor:.0f} | {taken.seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
