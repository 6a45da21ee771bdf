"""Does p arrange the cloths by their material?

p is trained without labels; `claims` and the paper's maps read the table. What varies
is the training.
"""

from typing import Any

import numpy as np

from studies._grid import Experiment, over
from studies._runs import trained


def _trained_p(model: int, weights: str = "torque") -> dict[str, Any]:
    """The trained p of all materials."""
    biases = trained(f"{weights}-{model}").biases
    return {
        "materials": " ".join(biases),
        "p": np.stack([*biases.values()]).round(4),  # [K, D_p]
    }


EXPERIMENTS = (
    Experiment(
        "trained_p",
        _trained_p,
        over(model=range(5), weights=("torque", "muscle")),
        paper={"weights": ("torque-paper", "muscle-paper")},
    ),
)
