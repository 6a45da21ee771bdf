"""How much memory a training takes whose runs are larger than that.

Runs of random numbers are written to a folder, mapped and trained on for one epoch,
and their files deleted. What counts is the memory that belongs to this process alone
(RssAnon) and all that it has in reach (RSS), the pages of mapped files included, at
their peaks. `python scripts/large_runs.py` takes 10 GB; Linux alone says such things.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from sampling import sampling

from clothlab.method.data import Run, count_windows
from clothlab.method.training import ModelTraining, train_dpmpb

STATES = 8
COMMANDS = 2
RUN = 5e8  # bytes of a run
BLOCK = 100_000  # steps that are written together
SAMPLE = 0.02  # [s] between two looks at the memory


def write(path: Path, steps: int, width: int, seed: int) -> np.ndarray:
    """Write normal numbers `[steps, width]` in single precision; the file, mapped."""
    rng = np.random.default_rng(seed)
    header = {"descr": "<f4", "fortran_order": False, "shape": (steps, width)}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for start in range(0, steps, BLOCK):
            rows = min(BLOCK, steps - start)
            file.write(rng.standard_normal((rows, width), np.float32).tobytes())
    return np.load(path, mmap_mode="r")


def make_runs(folder: Path, size: float) -> list[Run]:
    """Runs of so many bytes together, of two materials."""
    count = max(2, round(size / RUN))
    steps = int(size / count / 4 / (STATES + COMMANDS))
    runs = []
    for k in range(count):
        s = write(folder / f"s{k}.npy", steps, STATES, 2 * k)
        u = write(folder / f"u{k}.npy", steps, COMMANDS, 2 * k + 1)
        runs.append(Run(s, u, "ab"[k % 2]))
    return runs


def memory() -> dict[str, float]:
    """What this process takes now [GB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    fields = dict(line.split(":", 1) for line in lines)
    names = {"RSS": "VmRSS", "RssAnon": "RssAnon"}
    return {name: int(fields[field].split()[0]) / 1e6 for name, field in names.items()}


@contextmanager
def peaks() -> Iterator[dict[str, float]]:
    """The largest of each since the beginning of the block."""
    most = memory()

    def look() -> None:
        for name, value in memory().items():
            most[name] = max(most[name], value)

    with sampling(look, every=SAMPLE):
        yield most


def measure(size: float, stride: int, folder: Path | None = None) -> dict[str, float]:
    """Peaks of the memory [GB] and times [s] of one epoch on so many bytes."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        # Written, and looked at whether all numbers are finite
        start = time.perf_counter()
        with peaks() as most:
            runs = make_runs(Path(name), size)
            written = time.perf_counter()
            settings = ModelTraining(epochs=1, stride=stride)
            train_dpmpb(runs, settings, device="cpu", progress=False)
        trained = time.perf_counter()

        # What copies of all windows would take, with the usual stride
        windows = sum(count_windows(run, 30, ModelTraining.stride) for run in runs)
        each = 31 * STATES + 30 * COMMANDS
        return {
            "data": sum(run.s.nbytes + run.u.nbytes for run in runs) / 1e9,
            "copies of windows": 4 * each * windows / 1e9,
            **most,
            "written in": written - start,
            "trained in": trained - written,
        }


def main() -> None:
    """Measure once, and print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=float, default=10.0, help="of the runs [GB]")
    parser.add_argument("--stride", type=int, default=5000, help="between windows")
    parser.add_argument("--folder", type=Path, help="for the files; a temporary one")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    found = measure(1e9 * arguments.size, arguments.stride, arguments.folder)
    for name, value in found.items():
        print(f"{name:20}{value:8.2f} {'s' if name.endswith('in') else 'GB'}")


if __name__ == "__main__":
    main()
