"""What figures and tables show: geometry of p, distances to a target, success rates."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, stdtrit

from clothlab._validation import check_array, check_mask, check_number
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.control import ControlSettings

if TYPE_CHECKING:
    from sklearn.decomposition import PCA

    from clothlab.simulation.trial import Trial

# The last periods of a run, by which what learns from its outcomes is judged
LATE = slice(-10, None)
# The cloths between which PC1, then PC2, of a map runs: (ahead, behind)
_ENDS = (
    ("damp0.07-mass0.05", "damp0.03-mass0.15"),
    ("damp0.03-mass0.05", "damp0.07-mass0.15"),
)
SHARE = 0.9  # of the regions of p that are shown


def _stacked(biases: Mapping[str, np.ndarray]) -> np.ndarray:
    """Trained p of all materials, `[K, D_p]`."""
    return check_array("trained p", list(biases.values()), ("K", "D_p"))


def upright(places: Mapping[str, ArrayLike]) -> np.ndarray:
    """Signs `[2]` of PC1 and PC2 that turn a map the way all maps of p are shown.

    `places` `[2]` are those of the materials. The light cloth with much drag comes to
    the right of the heavy one with little, and the light cloth with little drag above
    the heavy one with much. Where one of these is missing, both signs are 1.
    """
    if not {name for ends in _ENDS for name in ends} <= set(places):
        return np.ones(2)
    right, up = (
        float(np.asarray(places[ahead])[k] - np.asarray(places[behind])[k])
        for k, (ahead, behind) in enumerate(_ENDS)
    )
    return np.where([right < 0, up < 0], -1.0, 1.0)


def principal_axes(biases: dict[str, np.ndarray]) -> "PCA":
    """PCA of the trained p, turned `upright`.

    `.transform(p)` gives coordinates on PC1 and PC2, `.explained_variance_ratio_` their
    shares.
    """
    p = _stacked(biases)
    if min(p.shape) < 2:
        raise ValueError(
            "two axes need two materials and two numbers for each at the least, "
            f"got {list(p.shape)}"
        )
    from sklearn.decomposition import PCA  # slow to import

    pca = PCA(n_components=2).fit(p)
    signs = upright(dict(zip(biases, pca.transform(p), strict=True)))
    pca.components_ *= signs[:, None]
    return pca


def spread(biases: dict[str, np.ndarray]) -> float:
    """Root mean square distance of the trained p from their mean.

    It is the yardstick for errors of p.
    """
    p = _stacked(biases)
    return float(np.sqrt(((p - p.mean(0)) ** 2).sum(1).mean()))


def nearest_material(p: ArrayLike, biases: dict[str, np.ndarray]) -> str:
    """Name of the material whose trained p is nearest to `p` `[D_p]`."""
    trained = _stacked(biases)
    gaps = trained - check_array("p", p, trained.shape[1:])
    return list(biases)[np.linalg.norm(gaps, axis=1).argmin()]


def target_distance(
    autoencoder: Autoencoder, trial: "Trial", target: ArrayLike
) -> np.ndarray:
    """Distance ‖z_ref - z‖₂ of every step of a trial to a target, `[T]` [s.d. of z].

    The target is a mask `[H, W]`.
    """
    z_ref = encode(autoencoder, check_mask(target))
    return np.linalg.norm(encode(autoencoder, trial.images) - z_ref, axis=1)


def best_per_period(
    distances: ArrayLike, period: int = ControlSettings.period
) -> np.ndarray:
    """Smallest distance within each whole period of distances `[T]`.

    Step 0 is before any command. Period k is steps (k - 1)·8 + 1 to k·8, the last of
    which is its end, where `period_mask` is 1: there are `(T - 1) // period`, and the
    first is the throw from rest. A periodic motion meets its target once in each.
    """
    distances = check_array("distances", distances, ("T",))
    period = check_number("period", period, int, at_least=1)
    after = distances[1:]
    whole = len(after) // period * period
    return after[:whole].reshape(-1, period).min(axis=1)


def period_ends(
    distances: ArrayLike, period: int = ControlSettings.period
) -> np.ndarray:
    """The distance at the end of each whole period of distances `[T]`: `[P]`."""
    distances = check_array("distances", distances, ("T",))
    return distances[period::period]


def points(distance: ArrayLike, still: float) -> np.ndarray:
    """Points of a throw: 0 if it ends as far as the still cloth, 100 at the target.

    Args:
        distance: at the end of a period, of any shape [s.d. of z].
        still: of the cloth that hangs still [s.d. of z].
    """
    return 100 * (1 - np.asarray(distance, float) / still)


def late_median(best: ArrayLike) -> float:
    """Median of the last ten periods of `best_per_period` `[P]`."""
    best = check_array("best", best, ("P",))
    return float(np.median(best[LATE]))


def crossed_interval(values: ArrayLike) -> tuple[float, float, float]:
    """Mean, lower and upper end of a 95 % interval where two things vary at once.

    `values` are `[units, repeats]`: each unit, such as a cloth and a target, was tried
    in each repeat, such as a training. Both are samples: the interval is about other
    units and other repeats. With one repeat, it is Student's.

    The variance of the mean is estimated by a two-way analysis of variance, its degrees
    of freedom by Satterthwaite (1946, "An approximate distribution of estimates of
    variance components").
    """
    table = check_array("values", values, ("K", "N"))
    mean = float(table.mean())
    if table.size == 1:
        return mean, -np.inf, np.inf  # one number says nothing of its spread

    # How much units and repeats move the mean, and how much what is left of both does
    units, repeats = table.shape
    of_units = table.mean(axis=1) - mean
    of_repeats = table.mean(axis=0) - mean
    left = table - mean - of_units[:, None] - of_repeats
    squares = np.array(
        [
            repeats * of_units @ of_units,
            units * of_repeats @ of_repeats,
            (left**2).sum(),
        ]
    )
    freedom = np.array([units - 1, repeats - 1, (units - 1) * (repeats - 1)])
    parts = squares / np.maximum(freedom, 1) / table.size

    # What is left is in both of the others, and counts once
    variance = max(parts[0] + parts[1] - parts[2], parts[0], parts[1])
    if variance == 0:
        return mean, mean, mean
    degrees = variance**2 / (parts**2 / np.maximum(freedom, 1)).sum()
    half = float(stdtrit(degrees, 0.975) * np.sqrt(variance))  # Student's t
    return mean, mean - half, mean + half


def rate_interval(held: ArrayLike) -> tuple[float, float, float]:
    """Share of the episodes in which something held, and Wilson's 95 % interval.

    `held` is `[N]`, bool; the share and both ends of the interval are 0 to 1.
    """
    values = check_array("held", held, ("N",))
    if not np.isin(values, (0, 1)).all():
        raise ValueError(
            f"held says of each episode whether it did, True or False, got {held!s:.80}"
        )
    from scipy.stats import binomtest  # slow to import

    found = binomtest(int(values.sum()), len(values))
    low, high = found.proportion_ci(method="wilson")
    return float(found.statistic), float(low), float(high)


def inside(
    p: ArrayLike, centre: ArrayLike, covariance: ArrayLike, share: float = SHARE
) -> bool:
    """Whether p `[D_p]` lies in the ellipse around a centre `[D_p]`.

    A normal distribution of this covariance `[D_p, D_p]` has this share in it.
    """
    gap = np.asarray(p) - np.asarray(centre)
    squared = gap @ np.linalg.solve(np.asarray(covariance), gap)
    return bool(squared <= radius(share, len(gap)) ** 2)


def outline(
    centre: ArrayLike, covariance: ArrayLike, share: float = SHARE, points: int = 48
) -> np.ndarray:
    """The edge of that ellipse in a plane, `[points, 2]`, its last point the first."""
    angle = np.linspace(0, 2 * np.pi, points)
    lengths, axes = np.linalg.eigh(np.asarray(covariance))
    halves = axes * np.sqrt(lengths.clip(0))
    circle = radius(share, 2) * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre) + circle @ halves.T


def radius(share: float, size: int) -> float:
    """How many standard deviations such a region reaches, in so many dimensions."""
    return float(np.sqrt(chdtri(size, 1 - share)))  # squared, it is chi-square
