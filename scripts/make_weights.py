"""`make train`: train autoencoders and DPMPBs, on the paper's amount of recordings and on twenty times as much."""

import argparse
import os
import time
from collections.abc import Callable, Sequence

import joblib
import torch

from clothlab import artifacts
from clothlab.training_configs import RECIPES, seen_by, train_eyes, train_model

SEEDS = range(5)  # the paper repeats learning and control five times


def autoencoders(names: Sequence[str]) -> list[str]:
    """Those to train: who sees with another one's has none of its own."""
    return [name for name in names if not isinstance(RECIPES[name].autoencoder, str)]


def side_by_side(function: Callable[..., None], jobs: Sequence[tuple]) -> None:
    """Call a function for each job; the first shows its progress.

    Matrices this small keep one core busy, not two: several trainings side by side beat one on all cores.
    """
    workers = 1 if torch.cuda.is_available() else min(os.cpu_count() or 1, len(jobs))
    joblib.Parallel(n_jobs=workers)(joblib.delayed(function)(*job, progress=k == 0) for k, job in enumerate(jobs))


def main() -> None:
    """Train and save what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--names", choices=RECIPES, nargs="+", default=list(RECIPES), help="which weights")
    parser.add_argument("--only", choices=["autoencoder", "dpmpb"], help="leave the other as it is")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="which of the DPMPB's trainings")
    arguments = parser.parse_args()
    start = time.perf_counter()
    if arguments.only != "dpmpb":
        side_by_side(train_eyes, [(name,) for name in autoencoders(arguments.names)])
        artifacts.write_checksums()
        print(f"autoencoders in {time.perf_counter() - start:.0f} s")
    for name in arguments.names if arguments.only != "autoencoder" else ():
        start = time.perf_counter()
        runs = seen_by(name)
        side_by_side(train_model, [(name, runs, seed) for seed in arguments.seeds])
        artifacts.write_checksums()
        print(f"{name}: DPMPB, {len(arguments.seeds)} seeds, in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
