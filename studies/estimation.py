"""Can the material be estimated online?

p is estimated from 0 while a cloth is moved at random. What varies is the cloth: one of
those that the model was trained on, or one between them, whose constants are read off
p.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, choose
from clothlab.analysis import nearest_material
from clothlab.simulation.cloth import CLOTHS, Cloth
from studies._grid import Experiment, over
from studies._runs import bias_error, estimate_at_random, trained

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

# Never trained on: geometric means of neighbouring trained values, and one nearer to a
# corner of them
_BETWEEN_VALUES = {  # the two values of C_damp [N s/m], and of C_mass [kg]
    "between-light": ((0.03, 0.05), (0.05, 0.10)),
    "between-heavy": ((0.05, 0.07), (0.10, 0.15)),
    "between-slow": ((0.05, 0.07), (0.05, 0.10)),  # much drag for its mass
    "between-fast": ((0.03, 0.05), (0.10, 0.15)),
    "between-corner": ((0.06, 0.07), (0.05, 0.07)),
}


def _cloth_between(
    name: str, dampings: tuple[float, float], masses: tuple[float, float]
) -> Cloth:
    """The cloth with the geometric means of two values of each constant."""
    damping = (dampings[0] * dampings[1]) ** 0.5
    mass = (masses[0] * masses[1]) ** 0.5
    return Cloth(name, damping=damping, mass=mass)


BETWEEN = {
    name: _cloth_between(name, dampings, masses)
    for name, (dampings, masses) in _BETWEEN_VALUES.items()
}
ESTIMATED = (*CLOTHS, "between-light", "between-heavy")


@dataclass(frozen=True)
class MaterialReadout:
    """A smooth map from p to log C_damp and log C_mass of a cloth.

    It is fitted to the trained materials. Equal steps of a material are not equal steps
    of p: the map is curved, and so a Gaussian process whose prior is a straight one.
    Its constants are fixed: nine materials are too few to fit them.
    """

    model: "Pipeline"
    r2: np.ndarray  # leave-one-cloth-out R² of log C_damp and log C_mass [2]
    # The same of log (C_damp / C_mass), on which alone the motion of a free point in
    # air depends
    ratio_r2: float
    linear_r2: np.ndarray  # as r2, of a straight map [2]

    @classmethod
    def fit(
        cls, biases: dict[str, np.ndarray], cloths: dict[str, Cloth]
    ) -> "MaterialReadout":
        """Fit to the trained p of cloths whose C_damp and C_mass are known."""
        # Slow to import
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, DotProduct, WhiteKernel
        from sklearn.linear_model import LinearRegression
        from sklearn.metrics import r2_score
        from sklearn.model_selection import LeaveOneOut, cross_val_predict
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        # A straight map, and a curved one
        p = np.stack([biases[name] for name in cloths]).astype(np.float64)
        logs = np.log([(cloth.damping, cloth.mass) for cloth in cloths.values()])
        kernel = DotProduct() + RBF(2.0) + WhiteKernel(0.01)
        smooth = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True)
        model = make_pipeline(StandardScaler(), smooth)

        # What is read off the p of each cloth by a map fitted to the others
        one_out = LeaveOneOut()
        curved = cross_val_predict(model, p, logs, cv=one_out)
        straight = cross_val_predict(LinearRegression(), p, logs, cv=one_out)
        ratio = np.array([1, -1])
        return cls(
            model.fit(p, logs),
            r2=r2_score(logs, curved, multioutput="raw_values"),
            ratio_r2=r2_score(logs @ ratio, curved @ ratio),
            linear_r2=r2_score(logs, straight, multioutput="raw_values"),
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
    """Estimate p of one cloth from 0; each repeat has other random commands.

    Args:
        cloth: in the hand, by name; trained on, or one of `BETWEEN`.
        model: seed of the training.
        repeat: number of the run.
        weights: name of the training.
        steps: control steps.
        first_seed: of the random commands.
    """
    learned = trained(f"{weights}-{model}")
    right = choose("cloth", cloth, CLOTHS | BETWEEN)
    number = [*CLOTHS, *BETWEEN].index(cloth)
    seed = first_seed + 100 * model + 20 * repeat + number
    p, trace = estimate_at_random(learned, right, steps, seed)

    # Of the first p and of the final one to the trained one; a cloth never trained on
    # has none
    start = None
    distance = None
    if cloth in learned.biases:
        start = bias_error(np.zeros_like(p), cloth, learned.biases)
        distance = bias_error(p, cloth, learned.biases)
    read = np.array(MaterialReadout.fit(learned.biases, CLOTHS)(p))
    return {
        "trace": trace.round(3),  # p after each step [T, D_p]
        "nearest": nearest_material(p, learned.biases),
        "start": start,  # [spreads of the trained p]
        "distance": distance,
        "read": read,  # C_damp [N s/m] and C_mass [kg] read off the final p
        "error": read / (right.damping, right.mass) - 1,
    }


EXPERIMENTS = (
    Experiment(
        "estimation",
        _run_one,
        over(cloth=ESTIMATED, model=range(5), repeat=range(4)),
        paper={"weights": "torque-paper"},
    ),
)
