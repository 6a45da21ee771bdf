"""Does p arrange the cloths by their material?

p is trained without labels, and read by a smooth map fitted to all cloths but one. What
varies is the training.
"""

from typing import Any

import numpy as np

from clothlab.analysis import principal_axes
from clothlab.simulation.cloth import CLOTHS
from studies._grid import Experiment, over
from studies._runs import trained
from studies.estimation import MaterialReadout


def _run_one(model: int, weights: str = "torque") -> dict[str, Any]:
    """Leave-one-cloth-out R² of the log material constants, read off trained p."""
    biases = trained(f"{weights}-{model}").biases
    cloths = {name: CLOTHS[name] for name in biases}
    readout = MaterialReadout.fit(biases, cloths)
    return {
        "r2": readout.r2,  # of log C_damp and log C_mass
        "ratio_r2": readout.ratio_r2,  # of log (C_damp / C_mass)
        "linear_r2": readout.linear_r2,  # as `r2`, of a straight map
        # Of the variance of p, along PC1 and PC2
        "pca_share": principal_axes(biases).explained_variance_ratio_,
    }


def _trained_p(model: int, weights: str = "torque") -> dict[str, Any]:
    """The trained p of all materials."""
    biases = trained(f"{weights}-{model}").biases
    return {
        "materials": " ".join(biases),
        "p": np.stack([*biases.values()]).round(4),  # [K, D_p]
    }


EXPERIMENTS = (
    Experiment(
        "self_organisation",
        _run_one,
        over(model=range(5)),
        paper={"weights": "torque-paper"},
    ),
    Experiment(
        "trained_p",
        _trained_p,
        over(model=range(5), weights=("torque", "muscle")),
        paper={"weights": ("torque-paper", "muscle-paper")},
    ),
)
