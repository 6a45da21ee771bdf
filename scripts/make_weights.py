"""`make train`: train autoencoders and DPMPBs, on the paper's amount of recordings and on twenty times as much."""

import argparse
import os
import time

import torch
from reproduce import Plan, train_autoencoders, train_models

from clothlab.training_configs import TRAINING_CONFIGS


def main() -> None:
    """Train what was asked for, and save it in `data/weights`."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = list(TRAINING_CONFIGS)
    parser.add_argument("--names", choices=names, nargs="+", default=names, help="which weights")
    parser.add_argument("--only", choices=["autoencoder", "dpmpb"], help="leave the other as it is")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=range(Plan.seeds), help="which of the DPMPB's trainings"
    )
    arguments = parser.parse_args()
    configs = [TRAINING_CONFIGS[name] for name in arguments.names]
    # Small matrices keep one core busy, not two: trainings side by side beat one on all cores.
    options = {"workers": 1 if torch.cuda.is_available() else os.cpu_count(), "progress": True}
    start = time.perf_counter()
    if arguments.only != "dpmpb":
        train_autoencoders(configs, **options)
    if arguments.only != "autoencoder":
        train_models(configs, arguments.seeds, **options)
    print(f"{', '.join(arguments.names)} in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
