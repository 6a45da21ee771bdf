"""Does z describe the cloth?

Do distances of z to a target order images as their outlines do? What varies is the
target.
"""

from typing import Any

import numpy as np

from clothlab import data
from studies._grid import Experiment, over
from studies._runs import MIDDLE, chamfer_against_z, random_trial


def _compare(target: str, weights: str = "torque", steps: int = 450) -> dict[str, Any]:
    """Two distances to a target and their correlation.

    The log chamfer distance [log pixel] and the distance of z [s.d. of z], both `[N]`.
    """
    autoencoder, _ = data.load_autoencoder(weights)
    trial = random_trial("torque", MIDDLE, steps, seed=5000)
    mask = data.load_target(target)
    log_chamfer, z_distance = chamfer_against_z(autoencoder, trial, mask)
    return {
        "correlation": float(np.corrcoef(log_chamfer, z_distance)[0, 1]),
        "log_chamfer": log_chamfer.round(4),
        "z_distance": z_distance.round(4),
    }


_PAPER = {"weights": "torque-paper"}
EXPERIMENTS = (
    Experiment(
        "chamfer", _compare, over(target=("target-1", "target-2")), paper=_PAPER
    ),
)
