"""How sure an estimated p is, and whether its material is like any that the model was
trained on.

The curvature of the loss (`Linearisation`) says how far p scatters from run to run. The
model's own faults shift the lowest loss, however long a run is, and only runs with
known materials can tell by how much: `calibrate`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.spatial import ConvexHull
from scipy.stats import chi2

from clothlab._validation import choose
from clothlab.method.data import Run, check_runs
from clothlab.method.gauss_newton import Linearisation, NewtonSettings, best_bias
from clothlab.method.model import DPMPB

_SHARE = 0.9  # of the regions that are shown
_FALSE_ALARMS = 0.05  # share of familiar runs that may be called out of distribution
LENGTHS = (50, 100, 200)  # steps after which a calibration looks


def inside(
    p: ArrayLike, centre: ArrayLike, covariance: ArrayLike, share: float = _SHARE
) -> bool:
    """Whether p `[D_p]` lies in the ellipse that a normal distribution fills with this
    share.
    """
    gap = np.asarray(p) - np.asarray(centre)
    return bool(
        gap @ np.linalg.solve(np.asarray(covariance), gap)
        <= _radius(share, len(gap)) ** 2
    )


def outline(
    centre: ArrayLike, covariance: ArrayLike, share: float = _SHARE, points: int = 48
) -> np.ndarray:
    """The edge of that ellipse in a plane, `[points, 2]`, its last point the first."""
    angle = np.linspace(0, 2 * np.pi, points)
    lengths, axes = np.linalg.eigh(np.asarray(covariance))
    halves = axes * np.sqrt(lengths.clip(0))
    return (
        np.asarray(centre)
        + _radius(share, 2) * np.column_stack([np.cos(angle), np.sin(angle)]) @ halves.T
    )


def _radius(share: float, size: int) -> float:
    return float(np.sqrt(chi2.ppf(share, size)))


class EstimateReport(NamedTuple):
    """How sure an estimate is, and how familiar its material."""

    covariance: np.ndarray  # of p [D_p, D_p]
    log_error_ratio: float  # log of the prediction error over the usual one
    out_of_distribution: bool  # whether that is too much
    outside_hull: bool  # whether the 90 % region lies beyond the trained p


@dataclass(frozen=True, eq=False)
class Calibration:
    """What runs with known materials say about one training."""

    floor: np.ndarray  # covariance of p that stays however long a run is [D_p, D_p]
    lengths: np.ndarray  # of the runs that were looked at [step], [N]
    # By which covariance grows, so that 90 % regions held the right p in 90 % of these
    # runs [N]
    scale: np.ndarray
    limit: np.ndarray  # log error ratio that few of these runs exceeded [N]
    biases: np.ndarray  # trained p of their materials [K, D_p]
    usual: np.ndarray  # log of their mean squared error in each sensor [K, D_s]

    def covariance(self, fit: Linearisation) -> np.ndarray:
        """Covariance of an estimate `[D_p, D_p]`: what scatters and what the model does
        wrong.
        """
        return np.interp(len(fit.errors), self.lengths, self.scale) * (
            fit.covariance() + self.floor
        )

    def log_error_ratio(self, fit: Linearisation, p: ArrayLike) -> float:
        """Log of the squared prediction error over what is usual for materials near p,
        mean of the sensors.
        """
        return _log_error_ratio(fit, np.asarray(p), self.biases, self.usual)

    def out_of_distribution(self, fit: Linearisation, p: ArrayLike) -> bool:
        """Whether the material is predicted worse than any that the model was trained
        on; too early, it is not.
        """
        enough = len(fit.errors) >= self.lengths[0] - 1
        return enough and self.log_error_ratio(fit, p) > float(
            np.interp(len(fit.errors), self.lengths, self.limit)
        )

    def outside_hull(
        self, p: ArrayLike, covariance: ArrayLike, share: float = _SHARE
    ) -> bool:
        """Whether the region around p lies beyond a side of the trained p: predicted
        well perhaps, but never seen.
        """
        sides = ConvexHull(self.biases).equations
        normals, offsets = sides[:, :-1], sides[:, -1]
        widths = np.sqrt(
            np.einsum("ki,ij,kj->k", normals, np.asarray(covariance), normals)
        )
        gaps = normals @ np.asarray(p) + offsets
        return bool((gaps > _radius(share, normals.shape[1]) * widths).any())

    def report(self, fit: Linearisation | None, p: ArrayLike) -> EstimateReport | None:
        """All of this about an estimate p and how it predicts (`linearise`); None where
        too little was seen.
        """
        if fit is None:
            return None
        try:
            covariance = self.covariance(fit)
        except np.linalg.LinAlgError:
            return None
        ratio, beyond = self.log_error_ratio(fit, p), self.outside_hull(p, covariance)
        return EstimateReport(
            covariance, ratio, self.out_of_distribution(fit, p), beyond
        )


def _log_error_ratio(
    fit: Linearisation, p: np.ndarray, biases: np.ndarray, usual: np.ndarray
) -> float:
    """See `Calibration.log_error_ratio`: what is usual passes smoothly from one
    material to the next.
    """
    reach = 0.3 * np.sqrt(((biases - biases.mean(0)) ** 2).sum(1).mean())
    gaps = ((p - biases) ** 2).sum(1)
    weights = np.exp(-0.5 * (gaps - gaps.min()) / reach**2)
    expected = weights @ usual / weights.sum()
    return float((_log_squares(fit) - expected).mean())


def _log_squares(fit: Linearisation) -> np.ndarray:
    """Log of the mean squared error in each sensor `[D_s]`; a sensor that the model
    leaves out has none at all.
    """
    return np.log(np.maximum((fit.errors**2).mean(0), 1e-20))


def calibrate(
    model: DPMPB,
    biases: Mapping[str, np.ndarray],
    runs: Sequence[Run],
    *,
    lengths: Sequence[int] = LENGTHS,
    settings: NewtonSettings | None = None,
) -> Calibration:
    """Learn from runs with known materials how far estimates are off, and how well they
    predict.

    The runs begin at rest, at least two with each material, none of them trained on. Of
    each the beginnings of rising `lengths` [step] are looked at.
    """
    runs = check_runs(runs)
    names = list(dict.fromkeys(run.material for run in runs))
    which = np.array([names.index(run.material) for run in runs])
    if not runs or (np.bincount(which) < 2).any():
        raise ValueError("a calibration needs at least two runs of each material")
    known = np.array(
        [choose("material", name, biases) for name in names], dtype=np.float64
    )
    lengths = [length for length in lengths if length <= min(map(len, runs))]
    if not lengths:
        raise ValueError(
            f"runs of {min(map(len, runs))} steps are too short to calibrate with"
        )
    looks = [
        [
            best_bias(model, run[:length], p, settings)
            for run, p in zip(runs, known[which], strict=True)
        ]
        for length in lengths
    ]
    gaps = np.array(
        [
            [p - right for (p, _), right in zip(look, known[which], strict=True)]
            for look in looks
        ]
    )
    scatter = np.array([[fit.covariance() for _, fit in look] for look in looks])
    floor = _likeliest_floor(
        gaps.reshape(-1, gaps.shape[-1]), scatter.reshape(-1, *scatter.shape[2:])
    )
    squares = np.einsum("nri,nrij,nrj->nr", gaps, np.linalg.inv(scatter + floor), gaps)
    scale = (
        np.array([_upper(each, _SHARE) for each in squares])
        / _radius(_SHARE, gaps.shape[-1]) ** 2
    )
    logs = np.array([[_log_squares(fit) for _, fit in look] for look in looks])
    limit = [
        _limit(look, each, which, known) for look, each in zip(looks, logs, strict=True)
    ]
    usual = _means(logs[-1], which, len(names))
    return Calibration(floor, np.array(lengths), scale, np.array(limit), known, usual)


def _likeliest_floor(gaps: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """Covariance `[D_p, D_p]` that, added to each `scatter` `[N, D_p, D_p]`, makes
    `gaps` `[N, D_p]` most likely.
    """
    size = gaps.shape[1]
    lower = np.tril_indices(size)

    def floor_of(x: np.ndarray) -> np.ndarray:
        root = np.zeros((size, size))
        root[lower] = x
        return root @ root.T

    def negative_log_likelihood(x: np.ndarray) -> float:
        total = scatter + floor_of(x)
        squares = np.einsum("ni,nij,nj->n", gaps, np.linalg.inv(total), gaps)
        return float((np.log(np.linalg.det(total)) + squares).mean())

    start = np.linalg.cholesky(gaps.T @ gaps / len(gaps) / 2 + 1e-9 * np.eye(size))[
        lower
    ]
    return floor_of(minimize(negative_log_likelihood, start, method="Nelder-Mead").x)


def _upper(values: np.ndarray, share: float) -> float:
    """What the next value stays below with this probability, of equally likely values
    (conformal prediction).
    """
    rank = int(np.ceil((len(values) + 1) * share))
    return float(np.sort(values)[min(rank, len(values)) - 1])


def _means(logs: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    return np.array([logs[which == k].mean(0) for k in range(count)])


def _limit(
    look: list[tuple[np.ndarray, Linearisation]],
    logs: np.ndarray,
    which: np.ndarray,
    known: np.ndarray,
) -> float:
    """Log error ratio that few runs exceed, each judged by what is usual in the others."""
    ratios = []
    for k, (p, fit) in enumerate(look):
        others = np.arange(len(look)) != k
        ratios.append(
            _log_error_ratio(
                fit, p, known, _means(logs[others], which[others], len(known))
            )
        )
    return _upper(np.array(ratios), 1 - _FALSE_ALARMS)
