"""`make train`: train the autoencoder and the DPMPB on the trials in `data/`, at the paper's settings."""

import argparse
import os
import time

import joblib
import numpy as np
import torch

from clothlab import artifacts
from clothlab.autoencoder import train_autoencoder
from clothlab.dpmpb import Sequences, to_sequences, train_dpmpb

SEEDS = range(5)  # the paper repeats learning and control five times


def train_autoencoder_weights() -> None:
    """Train on all training images and save."""
    images = np.concatenate([trial.images for trial in artifacts.load_trials("train")])
    model, losses = train_autoencoder(images, seed=0)
    artifacts.save_autoencoder(model, losses, "torque")


def train_one(runs: list[Sequences], seed: int, threads: int, progress: bool) -> None:
    """Train one DPMPB and save."""
    torch.set_num_threads(threads)
    model, biases, losses = train_dpmpb(runs, seed=seed, progress=progress)
    artifacts.save_dpmpb(model, biases, losses, f"torque-{seed}")


def main() -> None:
    """Train and save what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=["autoencoder", "dpmpb"], help="leave the other as it is")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="which of the DPMPB's trainings")
    arguments = parser.parse_args()
    start = time.perf_counter()
    if arguments.only != "dpmpb":
        train_autoencoder_weights()
        artifacts.write_checksums()
        print(f"autoencoder in {time.perf_counter() - start:.0f} s")
    if arguments.only != "autoencoder":
        start = time.perf_counter()
        autoencoder, _ = artifacts.load_autoencoder("torque")
        runs = [to_sequences(autoencoder, trial) for trial in artifacts.load_trials("train")]
        # Matrices this small keep one core busy, not two: several trainings side by side beat one on all cores.
        workers = 1 if torch.cuda.is_available() else min(os.cpu_count() or 1, len(arguments.seeds))
        threads = max(1, (os.cpu_count() or 1) // workers)
        jobs = [joblib.delayed(train_one)(runs, seed, threads, k == 0) for k, seed in enumerate(arguments.seeds)]
        joblib.Parallel(n_jobs=workers)(jobs)
        artifacts.write_checksums()
        print(f"DPMPB, {len(jobs)} seeds, in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
