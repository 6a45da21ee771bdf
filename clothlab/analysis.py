"""What the figures and the results table show: geometry of p, distances to a target, success rates."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.stats import binomtest
from sklearn.decomposition import PCA
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, DotProduct, WhiteKernel
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score
from sklearn.model_selection import LeaveOneOut, cross_val_predict
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from clothlab._validation import check_array, check_number, choose
from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.control import ControlSettings
from clothlab.learning.dpmpb import DPMPB, Sequences
from clothlab.learning.estimation import prediction_loss
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.vision import HEIGHT, WIDTH, chamfer_distance, check_mask
from clothlab.trials import Trial


def _stacked(biases: Mapping[str, np.ndarray]) -> np.ndarray:
    """Trained p of all materials, `[K, D_p]`."""
    return check_array("trained p", list(biases.values()), ("K", "D_p"))


def principal_axes(biases: dict[str, np.ndarray]) -> PCA:
    """PCA of the trained p.

    `.transform(p)` gives coordinates on PC1 and PC2, `.explained_variance_ratio_` their shares.

    Raises:
        ValueError: fewer than two materials, or p of other sizes or not finite.
    """
    p = _stacked(biases)
    if min(p.shape) < 2:
        raise ValueError(f"two axes need two materials and two numbers for each at the least, got {list(p.shape)}")
    return PCA(n_components=2).fit(p)


def spread(biases: dict[str, np.ndarray]) -> float:
    """Root mean square distance of the trained p from their mean: the yardstick for errors of p."""
    p = _stacked(biases)
    return float(np.sqrt(((p - p.mean(0)) ** 2).sum(1).mean()))


def nearest_material(p: ArrayLike, biases: dict[str, np.ndarray]) -> str:
    """Name of the material whose trained p is nearest to `p` `[D_p]`.

    Raises:
        ValueError: p of another size or not finite.
    """
    trained = _stacked(biases)
    gaps = trained - check_array("p", p, trained.shape[1:])
    return list(biases)[np.linalg.norm(gaps, axis=1).argmin()]


def bias_error(p: ArrayLike, material: str, biases: dict[str, np.ndarray]) -> float:
    """Distance of `p` `[D_p]` to the trained p of a material, over the `spread` of all.

    Raises:
        KeyError: a material that was not trained; the message lists the choices.
        ValueError: p of another size, not finite, or too large.
    """
    right = choose("material", material, biases)
    right = check_array("trained p", right, ("D_p",))
    return float(np.linalg.norm(check_array("p", p, np.shape(right)) - right)) / spread(biases)


@dataclass(frozen=True)
class MaterialReadout:
    """A smooth map from p to log C_damp and log C_mass, fitted to the trained materials.

    Equal steps of a material are not equal steps of p: the map is curved, and so a Gaussian process whose prior is a
    straight one. Its constants are fixed: nine materials are too few to fit them.

    Attributes:
        model: the fitted map.
        r2: leave-one-cloth-out R² of log C_damp and log C_mass, `[2]`.
        ratio_r2: the same of log (C_damp / C_mass), on which alone the motion of a free point in air depends.
        linear_r2: as `r2`, of a straight map, `[2]`.
    """

    model: Pipeline
    r2: np.ndarray
    ratio_r2: float
    linear_r2: np.ndarray

    @classmethod
    def fit(cls, biases: dict[str, np.ndarray], cloths: dict[str, Cloth]) -> "MaterialReadout":
        """Fit to the trained p of cloths whose C_damp and C_mass are known."""
        p = np.stack([biases[name] for name in cloths]).astype(np.float64)
        logs = np.log([(cloth.damping, cloth.mass) for cloth in cloths.values()])
        smooth = GaussianProcessRegressor(DotProduct() + RBF(2.0) + WhiteKernel(0.01), optimizer=None, normalize_y=True)
        model, ratio = make_pipeline(StandardScaler(), smooth), np.array([1, -1])
        left_out, straight = (
            cross_val_predict(each, p, logs, cv=LeaveOneOut()) for each in (model, LinearRegression())
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


@dataclass(frozen=True, eq=False)
class Landscape:
    """The loss of a run for every p of a grid on the principal axes.

    Attributes:
        axes: PCA of the trained p.
        x: grid on PC1 `[N]`.
        y: grid on PC2 `[N]`.
        loss: mean squared error in standard deviations `[N, N]`, rows along y.
    """

    axes: PCA
    x: np.ndarray
    y: np.ndarray
    loss: np.ndarray

    @property
    def lowest(self) -> np.ndarray:
        """p with the lowest loss, `[D_p]`."""
        row, column = np.unravel_index(self.loss.argmin(), self.loss.shape)
        return self.axes.inverse_transform([[self.x[column], self.y[row]]])[0]


def loss_landscape(model: DPMPB, run: Sequences, biases: dict[str, np.ndarray], points: int = 31) -> Landscape:
    """Loss of a run over the plane of p, which covers the trained p and the origin with a margin of 30 %.

    Args:
        model: trained network.
        run: states and commands.
        biases: trained p of each material.
        points: of the grid, along each axis.
    """
    axes, points = principal_axes(biases), check_number("points", points, int, at_least=2)
    corners = axes.transform(np.stack([*biases.values(), np.zeros(model.bias_size)]))
    margin = 0.3 * np.ptp(corners, axis=0)
    x, y = np.linspace(corners.min(0) - margin, corners.max(0) + margin, points).T
    p = axes.inverse_transform(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
    with torch.no_grad():
        parts = torch.as_tensor(p, dtype=torch.float32).split(256)
        loss = torch.cat([prediction_loss(model, s, u, part) for part in parts])
    return Landscape(axes, x, y, loss.reshape(points, points).numpy())


def target_distance(autoencoder: Autoencoder, trial: Trial, target: ArrayLike) -> np.ndarray:
    """Distance ‖z_ref - z‖₂ of every step of a trial to a target mask `[H, W]`.

    `[T]`, one being a standard deviation of z.
    """
    return np.linalg.norm(encode(autoencoder, trial.images) - encode(autoencoder, check_mask(target)), axis=1)


def best_per_period(distances: ArrayLike, period: int = ControlSettings.period) -> np.ndarray:
    """Smallest distance within each whole period, `[T // period]`: a periodic motion meets its target once in each.

    The first period, in which the arm only swings up from rest, is left out.
    """
    distances = check_array("distances", distances, ("T",))
    whole = len(distances) // check_number("period", period, int, at_least=1) * period
    return distances[:whole].reshape(-1, period).min(axis=1)[1:]


LARGEST_CONFIDENCE = 1 - 1e-9
LATE = slice(-10, None)  # the last periods of a run, by which what learns from its outcomes is judged


def late_median(best: ArrayLike) -> float:
    """Median of the last ten periods of `best_per_period` `[P]`.

    Raises:
        ValueError: no list of finite numbers, or an empty one.
    """
    values = check_array("best", best, ("P",))
    if not len(values):
        raise ValueError("best is empty: a median needs a period at the least")
    return float(np.median(values[LATE]))


def median_best(runs: Iterable[ArrayLike], period: int = ControlSettings.period) -> float:
    """Median over periods and runs of the smallest distance in a period.

    Raises:
        ValueError: no runs, or one that is no list of finite numbers and has a whole period.
    """
    try:
        each = list(runs)
    except TypeError:
        each = []
    if not each:
        raise ValueError(f"a median needs runs, one at the least, got {runs!s:.80}")
    best = np.concatenate([best_per_period(distances, period) for distances in each])
    if not len(best):
        raise ValueError(f"no run has two whole periods of {period} steps, of which the second is the first to count")
    return float(np.median(best))


def empty_distance(autoencoder: Autoencoder, target: ArrayLike) -> float:
    """Distance ‖z_ref - z‖₂ of an image without cloth to a target mask `[H, W]` [s.d. of z]."""
    nothing = np.zeros((HEIGHT, WIDTH), bool)
    return float(np.linalg.norm(encode(autoencoder, check_mask(target)) - encode(autoencoder, nothing)))


def difference_interval(
    differences: ArrayLike, *, confidence: float = 0.95, resamples: int = 10_000, seed: int = 0
) -> tuple[float, float, float]:
    """Mean of paired differences and its bootstrap interval, trainings and then their runs drawn anew each time.

    Runs of one training resemble each other, so that twenty runs of five trainings say less than twenty of twenty.

    Args:
        differences: one for each training and run, `[K, N]`.
        confidence: of the interval.
        resamples: how often they are drawn.
        seed: of the drawing.

    Returns:
        Mean, lower and upper end.

    Raises:
        ValueError: no differences, or numbers out of range.
    """
    values = check_array("differences", differences, ("K", "N"))
    if not values.size:
        raise ValueError(f"differences are [K, N], one at the least, got the shape {list(values.shape)}")
    rng = np.random.default_rng(check_number("seed", seed, int, at_least=0))
    check_number("confidence", confidence, above=0, at_most=1)
    (k, n), count = values.shape, check_number("resamples", resamples, int, at_least=1)
    rows = rng.integers(k, size=(count, k, 1))
    means = values[rows, rng.integers(n, size=(count, k, n))].mean(axis=(1, 2))
    low, high = np.quantile(means, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(values.mean()), float(low), float(high)


def half_widths_from_zero(differences: ArrayLike) -> float:
    """Mean of paired differences `[K, N]` over half the width of its interval: near or within one, perhaps none.

    Raises:
        ValueError: no differences, or differences that are all alike, whose interval has no width.
    """
    mean, low, high = difference_interval(differences)
    if not low < high:
        raise ValueError(f"these differences are all alike, {mean:g}: their interval has no width")
    return 2 * mean / (high - low)


def rate_interval(held: ArrayLike, *, confidence: float = 0.95) -> tuple[float, float, float]:
    """Part of some episodes in which something held, and Wilson's interval, which is no point where all or none did.

    Args:
        held: in which of them `[N]`, bool.
        confidence: of the interval.

    Returns:
        The part, lower and upper end, 0 to 1.

    Raises:
        ValueError: not a single episode, something else than yes and no, or a confidence of 0 or 1, which no interval
            has.
    """
    values = check_array("held", held, ("N",))
    if not len(values):
        raise ValueError("held is empty: a rate needs an episode at least")
    if not np.isin(values, (0, 1)).all():
        raise ValueError(f"held says of each episode whether it did, True or False, got {held!s:.80}")
    check_number("confidence", confidence, above=0, at_most=LARGEST_CONFIDENCE)
    found = binomtest(int(values.sum()), len(values))
    low, high = found.proportion_ci(confidence, method="wilson")
    return float(found.statistic), float(low), float(high)


def success_rate(distances: ArrayLike, thresholds: ArrayLike) -> np.ndarray:
    """Share of steps whose distance is below each threshold (the curves of the paper's figure on control).

    Args:
        distances: `[..., T]`.
        thresholds: `[N]`.

    Returns:
        `[..., N]`, 0 to 1.
    """
    distances = check_array("distances", distances, (..., "T"))
    thresholds = check_array("thresholds", thresholds, ("N",))
    if not distances.size:
        raise ValueError("distances are empty: a rate needs one at the least")
    return (distances[..., None, :] < thresholds[:, None]).mean(axis=-1)


def chamfer_against_z(autoencoder: Autoencoder, trial: Trial, target: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Log chamfer distance and z distance to a target, for the steps at which cloth is visible.

    Returns:
        log chamfer distance [log pixel] and ‖z_ref - z‖₂, each `[N]`; steps with no cloth in view, or exactly the
        target's image, have no logarithm and are left out.
    """
    chamfer = np.array([chamfer_distance(image, target) if image.any() else np.nan for image in trial.images])
    seen = chamfer > 0
    return np.log(chamfer[seen]), target_distance(autoencoder, trial, target)[seen]
