"""Can the material be estimated online?

p is estimated from 0 while a cloth is moved at random for 40 s (paper, "Simulation
Experiment": the figure on parametric biases). C_damp and C_mass of cloths that were
never trained on are read off p by a map fitted to the others.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, DotProduct, WhiteKernel
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score
from sklearn.model_selection import LeaveOneOut, cross_val_predict
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from clothlab._validation import check_array, choose
from clothlab.analysis import nearest_material
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import bias_error, estimate_at_random, trained

# Never trained on: geometric means of neighbouring trained values, and one nearer to a
# corner of them
BETWEEN = {
    name: Cloth(name, damping=(c * d) ** 0.5, mass=(m * n) ** 0.5)
    for name, (c, d), (m, n) in (
        ("between-light", (0.03, 0.05), (0.05, 0.10)),
        ("between-heavy", (0.05, 0.07), (0.10, 0.15)),
        ("between-slow", (0.05, 0.07), (0.05, 0.10)),  # much drag for its mass
        ("between-fast", (0.03, 0.05), (0.10, 0.15)),
        ("between-corner", (0.06, 0.07), (0.05, 0.07)),
    )
}
ESTIMATED = (*CLOTHS, "between-light", "between-heavy")


@dataclass(frozen=True)
class MaterialReadout:
    """A smooth map from p to log C_damp and log C_mass, fitted to the trained
    materials.

    Equal steps of a material are not equal steps of p: the map is curved, and so a
    Gaussian process whose prior is a straight one. Its constants are fixed: nine
    materials are too few to fit them.
    """

    model: Pipeline
    r2: np.ndarray  # leave-one-cloth-out R² of log C_damp and log C_mass [2]
    # The same of log (C_damp / C_mass), on which alone the motion of a free point in
    # air depends
    ratio_r2: float
    linear_r2: np.ndarray  # as r2, of a straight map [2]

    @classmethod
    def fit(
        cls, biases: dict[str, np.ndarray], cloths: dict[str, Cloth]
    ) -> "MaterialReadout":
        """Linearisation to the trained p of cloths whose C_damp and C_mass are known."""
        p = np.stack([biases[name] for name in cloths]).astype(np.float64)
        logs = np.log([(cloth.damping, cloth.mass) for cloth in cloths.values()])
        smooth = GaussianProcessRegressor(
            DotProduct() + RBF(2.0) + WhiteKernel(0.01),
            optimizer=None,
            normalize_y=True,
        )
        model, ratio = make_pipeline(StandardScaler(), smooth), np.array([1, -1])
        left_out, straight = (
            cross_val_predict(each, p, logs, cv=LeaveOneOut())
            for each in (model, LinearRegression())
        )
        return cls(
            model.fit(p, logs),
            r2_score(logs, left_out, multioutput="raw_values"),
            r2_score(logs @ ratio, left_out @ ratio),
            r2_score(logs, straight, multioutput="raw_values"),
        )

    def __call__(self, p: ArrayLike) -> tuple[float, float]:
        """Read C_damp [N s/m] and C_mass [kg] off one p `[D_p]`."""
        p = check_array("p", p, (self.model.n_features_in_,))
        damping, mass = np.exp(self.model.predict(p[None])[0])
        return float(damping), float(mass)


def _run_one(
    cloth: str,
    model: int,
    repeat: int = 0,
    weights: str = "torque",
    steps: int = 200,
    first_seed: int = 6000,
) -> dict[str, Any]:
    """Estimate p of one cloth from 0; each repeat has other random commands."""
    learned, right = (
        trained(f"{weights}-{model}"),
        choose("cloth", cloth, CLOTHS | BETWEEN),
    )
    seed = first_seed + 100 * model + 20 * repeat + [*CLOTHS, *BETWEEN].index(cloth)
    p, trace = estimate_at_random(learned, right, steps, seed)
    read = np.array(MaterialReadout.fit(learned.biases, CLOTHS)(p))
    return {
        "trace": trace.round(3),  # p after each step [T, D_p]
        "nearest": nearest_material(p, learned.biases),
        # Of the final p to the trained one [spreads of the trained p]; none for a cloth
        # that was never trained on.
        "distance": bias_error(p, cloth, learned.biases)
        if cloth in learned.biases
        else None,
        "read": read,  # C_damp [N s/m] and C_mass [kg] read off the final p
        "error": read / (right.damping, right.mass) - 1,
    }


def _rows(tables: Tables) -> list[Row]:
    """How often the trained p nearest to the estimate is the right one, and errors on
    cloths never trained on.
    """
    table = tables["estimation"]
    known, new = table[table["distance"].notna()], table[table["distance"].isna()]
    seconds = len(table["trace"].iloc[0]) * CONTROL_PERIOD
    accuracy = Row(
        "estimation/accuracy",
        f"after {seconds:g} s, from p = 0: the nearest trained p is the right one",
        100 * (known["nearest"] == known["cloth"]).mean(),
        " %",
        paper="p approaches the right one",
        above=50,
        at_least=95,
        note=f"final distance to it, in spreads, median {known['distance'].median():.2f}",
    )
    errors = 100 * np.abs([*new["error"]]).T
    return [accuracy] + [
        Row(
            f"estimation/{name}",
            f"cloths never trained on: largest error of {name} read off p",
            values.max(),
            " %",
            at_most=25,
            note=f"mean {values.mean():.0f} %",
        )
        for name, values in zip(("C_damp", "C_mass"), errors, strict=True)
    ]


_CASES = over(cloth=ESTIMATED, model=range(5), repeat=range(4))
EXPERIMENTS = (
    Experiment(
        "estimation",
        _run_one,
        _CASES,
        seconds=7,
        paper={"weights": "torque-paper"},
        rows=_rows,
    ),
)
