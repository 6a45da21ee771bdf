"""Does p arrange the cloths by their material?

p is trained without labels. How well do C_damp and C_mass of a cloth follow from its p,
by a smooth map fitted to the other eight (paper, "Simulation Experiment": the figure on
parametric biases)?
"""

from typing import Any

import numpy as np

from clothlab.analysis import principal_axes
from clothlab.simulation.cloth import CLOTHS
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import trained
from studies.estimation import MaterialReadout


def _run_one(model: int, weights: str = "torque") -> dict[str, Any]:
    """Leave-one-cloth-out R² of the log material constants from the trained p of one
    training.
    """
    biases = trained(f"{weights}-{model}").biases
    readout = MaterialReadout.fit(biases, {name: CLOTHS[name] for name in biases})
    return {
        "r2": readout.r2,  # of log C_damp and log C_mass
        "ratio_r2": readout.ratio_r2,  # of log (C_damp / C_mass)
        "linear_r2": readout.linear_r2,  # as `r2`, of a straight map
        "pca_share": principal_axes(biases).explained_variance_ratio_,  # of PC1 and PC2
    }


def _rows(tables: Tables) -> list[Row]:
    """R² of each constant."""
    table = tables["self_organisation"]
    ratio = f"of their ratio {table['ratio_r2'].mean():.2f} ± {table['ratio_r2'].std(ddof=0):.2f}"
    return [
        Row(
            f"self_organisation/{name}",
            f"log {name} from p, leave one cloth out: R²",
            values.mean(),
            spread=values.std(),
            paper=paper,
            above=0.5,
            at_least=0.9,
            note=ratio,
        )
        for name, values, paper in zip(
            ("C_damp", "C_mass"),
            np.array([*table["r2"]]).T,
            ("in order along PC1", "not always in order"),
            strict=True,
        )
    ]


_PAPER = {"weights": "torque-paper"}
EXPERIMENTS = (
    Experiment(
        "self_organisation",
        _run_one,
        over(model=range(5)),
        seconds=1,
        paper=_PAPER,
        rows=_rows,
    ),
)
