"""`make train`: train autoencoders and DPMPBs, on the paper's amount of recordings and on twenty times as much."""

import argparse
import os
import time
from collections.abc import Callable, Sequence

import joblib
import numpy as np
import torch

from clothlab import artifacts
from clothlab.arm import get_arm
from clothlab.artifacts import Trained
from clothlab.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.dpmpb import Sequences, to_sequences, train_dpmpb
from clothlab.recipes import RECIPES, sees_with

SEEDS = range(5)  # the paper repeats learning and control five times


def train_one_autoencoder(name: str, training: AutoencoderTraining, progress: bool) -> None:
    """Train on all images of a training and save."""
    torch.set_num_threads(1)
    images = np.concatenate([trial.images for trial in RECIPES[name].load_trials()])
    model, losses = train_autoencoder(images, training, seed=0, progress=progress)
    artifacts.save_autoencoder(model, losses, name)


def autoencoders(names: Sequence[str]) -> list[tuple[str, AutoencoderTraining]]:
    """Those to train: who sees with another one's has none of its own."""
    found = [(name, RECIPES[name].autoencoder) for name in names]
    return [(name, training) for name, training in found if not isinstance(training, str)]


def train_one(name: str, runs: list[Sequences], seed: int, progress: bool) -> None:
    """Train one DPMPB and save."""
    torch.set_num_threads(1)
    recipe, eye = RECIPES[name], sees_with(name)
    autoencoder, _ = artifacts.load_autoencoder(eye)
    model, biases, trace = train_dpmpb(runs, recipe.model, seed=seed, progress=progress)
    arm = get_arm(recipe.arm)
    artifacts.save(Trained(f"{name}-{seed}", arm, autoencoder, model, biases, trace.losses, sees_with=eye))


def side_by_side(function: Callable[..., None], jobs: Sequence[tuple]) -> None:
    """Call a function for each job; the first shows its progress.

    Matrices this small keep one core busy, not two: several trainings side by side beat one on all cores.
    """
    workers = 1 if torch.cuda.is_available() else min(os.cpu_count() or 1, len(jobs))
    joblib.Parallel(n_jobs=workers)(joblib.delayed(function)(*job, k == 0) for k, job in enumerate(jobs))


def main() -> None:
    """Train and save what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--names", choices=RECIPES, nargs="+", default=list(RECIPES), help="which weights")
    parser.add_argument("--only", choices=["autoencoder", "dpmpb"], help="leave the other as it is")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="which of the DPMPB's trainings")
    arguments = parser.parse_args()
    start = time.perf_counter()
    if arguments.only != "dpmpb":
        side_by_side(train_one_autoencoder, autoencoders(arguments.names))
        artifacts.write_checksums()
        print(f"autoencoders in {time.perf_counter() - start:.0f} s")
    for name in arguments.names if arguments.only != "autoencoder" else ():
        start = time.perf_counter()
        autoencoder, _ = artifacts.load_autoencoder(sees_with(name))
        runs = [to_sequences(autoencoder, trial) for trial in RECIPES[name].load_trials()]
        side_by_side(train_one, [(name, runs, seed) for seed in arguments.seeds])
        artifacts.write_checksums()
        print(f"{name}: DPMPB, {len(arguments.seeds)} seeds, in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
