"""Models with less or with more knowledge of the material.

One is without p, one is given C_damp and C_mass in its place.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clothlab.method.training import train_dpmpb
from clothlab.weights import ClothCheckpoint
from studies._grid import shared
from studies._runs import config_of, find_cloth, recorded_runs, trained

KINDS = ("none", "known")


@shared
def train(kind: str, arm: str, seed: int) -> ClothCheckpoint:
    """A model that was trained in the usual way, on all recordings of an arm.

    Args:
        kind: "none" for D_p = 0, "known" for a p that is log C_damp and log C_mass of
            each cloth, standardised.
        arm: whose recordings it learns from.
        seed: of the training.
    """
    learned = trained(f"{arm}-{seed}")
    settings = config_of(learned).model
    known = None
    if kind == "none":
        settings = replace(settings, bias_size=0)
    else:
        names = [*learned.biases]
        known = {name: constants(name, names) for name in names}

    runs = recorded_runs(learned)
    model, biases, losses = train_dpmpb(
        runs, settings, known=known, seed=seed, progress=False
    )
    return replace(learned, model=model, biases=biases, losses=losses)


def constants(name: str, recorded: Sequence[str]) -> np.ndarray:
    """Log C_damp and log C_mass of a cloth `[2]`, standardised by recorded ones."""
    logs = np.array([_logs(each) for each in recorded])
    return (_logs(name) - logs.mean(0)) / logs.std(0)


def _logs(name: str) -> np.ndarray:
    cloth = find_cloth(name)
    return np.log([cloth.damping, cloth.mass])
