"""`make train`: train the autoencoder and the DPMPB on the trials in `data/`, at the paper's settings."""

import argparse
import os
import time
from dataclasses import dataclass

import joblib
import numpy as np
import torch

from clothlab import artifacts
from clothlab.arm import get_arm
from clothlab.artifacts import Trained
from clothlab.autoencoder import train_autoencoder
from clothlab.dpmpb import ModelTraining, Sequences, to_sequences, train_dpmpb

SEEDS = range(5)  # the paper repeats learning and control five times


@dataclass(frozen=True)
class Training:
    """What a set of weights is trained on, and how."""

    arm: str
    trials: tuple[str, ...]
    autoencoder: AutoencoderTraining
    model: ModelTraining


PAPER = ModelTraining()
# All sequences fit into one batch, so that there is one step an epoch: larger steps make up for their number.
PAPER_MUSCLE = ModelTraining(
    epochs=600, batch_size=1000, sequence_length=20, learning_rate=8e-3, bias_learning_rate=2.4e-2
)
TRAININGS = {
    "torque-paper": Training("torque", ("train",), AutoencoderTraining(), PAPER),
    "muscle-paper": Training("muscle", ("muscle-train",), AutoencoderTraining(), PAPER_MUSCLE),
    # Twenty times the experience needs fewer rounds of it.
    "torque": Training("torque", ("train", "train-more"), AutoencoderTraining(epochs=8), ModelTraining(epochs=40)),
    "muscle": Training(
        "muscle", ("muscle-train", "muscle-train-more"), AutoencoderTraining(epochs=8), ModelTraining(epochs=40)
    ),
}


def load_trials(name: str) -> list[Trial]:
    """All trials that a training learns from."""
    return [trial for recording in TRAININGS[name].trials for trial in artifacts.load_trials(recording)]


def train_autoencoder_weights(arm: str) -> None:
    """Train on all training images of an arm and save."""
    images = np.concatenate([trial.images for trial in artifacts.load_trials(TRAININGS[arm].trials)])
    model, losses = train_autoencoder(images, seed=0)
    artifacts.save_autoencoder(model, losses, arm)


def train_one(arm: str, runs: list[Sequences], seed: int, threads: int, progress: bool) -> None:
    """Train one DPMPB and save."""
    torch.set_num_threads(threads)
    model, biases, trace = train_dpmpb(runs, TRAININGS[arm].model, seed=seed, progress=progress)
    autoencoder, _ = artifacts.load_autoencoder(arm)
    artifacts.save(Trained(f"{arm}-{seed}", get_arm(arm), autoencoder, model, biases, trace.losses, sees_with=arm))


def train_models(arm: str, seeds: list[int]) -> None:
    """Train the DPMPB of an arm from several seeds."""
    autoencoder, _ = artifacts.load_autoencoder(arm)
    runs = [to_sequences(autoencoder, trial) for trial in artifacts.load_trials(TRAININGS[arm].trials)]
    # Matrices this small keep one core busy, not two: several trainings side by side beat one on all cores.
    workers = 1 if torch.cuda.is_available() else min(os.cpu_count() or 1, len(seeds))
    threads = max(1, (os.cpu_count() or 1) // workers)
    jobs = [joblib.delayed(train_one)(arm, runs, seed, threads, k == 0) for k, seed in enumerate(seeds)]
    joblib.Parallel(n_jobs=workers)(jobs)


def main() -> None:
    """Train and save what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", choices=TRAININGS, nargs="+", default=list(TRAININGS), help="whose weights")
    parser.add_argument("--only", choices=["autoencoder", "dpmpb"], help="leave the other as it is")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="which of the DPMPB's trainings")
    arguments = parser.parse_args()
    for arm in arguments.arms:
        start = time.perf_counter()
        if arguments.only != "dpmpb":
            train_autoencoder_weights(arm)
            artifacts.write_checksums()
            print(f"{arm}: autoencoder in {time.perf_counter() - start:.0f} s")
        if arguments.only != "autoencoder":
            start = time.perf_counter()
            train_models(arm, arguments.seeds)
            artifacts.write_checksums()
            print(f"{arm}: DPMPB, {len(arguments.seeds)} seeds, in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
