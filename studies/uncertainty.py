"""How sure an estimated p is, and whether its material is like any trained on.

The curvature of the loss (`Linearisation`) says how far p scatters from run to run. The
model's own faults shift the lowest loss, however long a run is, and only runs with
known materials can tell by how much: `calibrate`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from clothlab._validation import choose
from clothlab.analysis import SHARE, radius
from clothlab.method.data import Run, check_fits
from clothlab.method.estimation import Linearisation, NewtonSettings
from clothlab.method.model import DPMPB

_FALSE_ALARMS = 0.05  # share of familiar runs that may be called out of distribution


class EstimateReport(NamedTuple):
    """How sure an estimate is, and how familiar its material."""

    covariance: np.ndarray  # of p [D_p, D_p]
    log_error_ratio: float  # log of the prediction error over the usual one
    out_of_distribution: bool  # whether that is too much
    outside_hull: bool  # whether the 90 % region lies beyond the trained p


def best_bias(
    model: DPMPB,
    run: Run,
    p: ArrayLike,
    settings: NewtonSettings = NewtonSettings(),
    rounds: int = 4,
) -> tuple[np.ndarray, Linearisation]:
    """The p with the lowest loss over a whole run, by Gauss-Newton.

    Args:
        model: a trained one.
        run: states and commands of one material.
        p: where to begin, `[D_p]`.
        settings: of the steps.
        rounds: how many steps.

    Returns:
        That p `[D_p]`, and how it predicts.
    """
    check_fits(model, run)
    found = np.asarray(p, dtype=np.float64)
    s = torch.tensor(run.s)
    u = torch.tensor(run.u)
    warmup = 0 if settings.from_rest else settings.warmup
    seen = Linearisation.of(model, s, u, found, warmup)
    for _ in range(rounds):
        found = found + seen.step(settings.degrees_of_freedom, settings.largest_step)
        seen = Linearisation.of(model, s, u, found, warmup)
    return found, seen


@dataclass(frozen=True, eq=False)
class Calibration:
    """What runs with known materials say about one training."""

    looks: ClassVar[tuple[int, ...]] = (50, 100, 200)  # steps after which it looks

    floor: np.ndarray  # covariance of p that stays however long a run is [D_p, D_p]
    lengths: np.ndarray  # of the runs that were looked at [step], [N]
    # By which covariance grows, so that 90 % regions held the right p in 90 % of these
    # runs [N]
    scale: np.ndarray
    limit: np.ndarray  # log error ratio that few of these runs exceeded [N]
    biases: np.ndarray  # trained p of their materials [K, D_p]
    usual: np.ndarray  # log of their mean squared error in each sensor [K, D_s]

    def covariance(self, fit: Linearisation) -> np.ndarray:
        """Covariance of an estimate `[D_p, D_p]`.

        It holds what scatters, and what the model does wrong.
        """
        scale = np.interp(len(fit.errors), self.lengths, self.scale)
        return scale * (fit.covariance() + self.floor)

    def log_error_ratio(self, fit: Linearisation, p: ArrayLike) -> float:
        """Log of the squared prediction error over what is usual for materials near p.

        It is the mean of the sensors.
        """
        return _log_error_ratio(fit, np.asarray(p), self.biases, self.usual)

    def out_of_distribution(self, fit: Linearisation, p: ArrayLike) -> bool:
        """Whether the material is predicted worse than any that was trained on.

        Too early, it is not.
        """
        if len(fit.errors) < self.lengths[0] - 1:
            return False
        limit = float(np.interp(len(fit.errors), self.lengths, self.limit))
        return self.log_error_ratio(fit, p) > limit

    def outside_hull(
        self, p: ArrayLike, covariance: ArrayLike, share: float = SHARE
    ) -> bool:
        """Whether the region around p lies beyond a side of the trained p.

        Such a material is predicted well perhaps, but was never seen.
        """
        # Of each side of their hull, the normal that points outwards and an offset
        sides = ConvexHull(self.biases).equations
        normals = sides[:, :-1]
        offsets = sides[:, -1]
        squares = np.einsum("ki,ij,kj->k", normals, np.asarray(covariance), normals)
        gaps = normals @ np.asarray(p) + offsets
        reach = radius(share, normals.shape[1]) * np.sqrt(squares)
        return bool((gaps > reach).any())

    def report(self, fit: Linearisation | None, p: ArrayLike) -> EstimateReport | None:
        """All of this about an estimate p and how it predicts.

        None where too little was seen.
        """
        if fit is None:
            return None
        try:
            covariance = self.covariance(fit)
        except np.linalg.LinAlgError:
            return None
        return EstimateReport(
            covariance=covariance,
            log_error_ratio=self.log_error_ratio(fit, p),
            out_of_distribution=self.out_of_distribution(fit, p),
            outside_hull=self.outside_hull(p, covariance),
        )


def _log_error_ratio(
    fit: Linearisation, p: np.ndarray, biases: np.ndarray, usual: np.ndarray
) -> float:
    """See `Calibration.log_error_ratio`.

    What is usual passes smoothly from one material to the next.
    """
    gaps = ((p - biases) ** 2).sum(1)
    weights = np.exp(-0.5 * (gaps - gaps.min()) / _reach(biases) ** 2)
    expected = weights @ usual / weights.sum()
    return float((_log_squares(fit) - expected).mean())


def _reach(biases: np.ndarray) -> float:
    """How far what is usual for a material counts for others near its p, `[K, D_p]`."""
    return 0.3 * float(np.sqrt(((biases - biases.mean(0)) ** 2).sum(1).mean()))


def _log_squares(fit: Linearisation) -> np.ndarray:
    """Log of the mean squared error in each sensor `[D_s]`.

    A sensor that the model leaves out has none at all.
    """
    return np.log(np.maximum((fit.errors**2).mean(0), 1e-20))


_Look = list[tuple[np.ndarray, Linearisation]]  # p and how it predicts, of each run


def calibrate(
    model: DPMPB,
    biases: Mapping[str, np.ndarray],
    runs: Sequence[Run],
    *,
    lengths: Sequence[int] = Calibration.looks,
    settings: NewtonSettings = NewtonSettings(),
) -> Calibration:
    """Learn from known materials how far estimates are off, and how well they predict.

    Args:
        model: whose estimates are calibrated.
        biases: its trained p, `{material: [D_p]}`.
        runs: that begin at rest, at least two with each material, none trained on.
        lengths: rising; of each run the beginning of so many steps is looked at.
        settings: of the estimation.
    """
    # Which run has which material, and what is right for it
    names = list(dict.fromkeys(run.material for run in runs))
    which = np.array([names.index(run.material) for run in runs])
    if not runs or (np.bincount(which) < 2).any():
        raise ValueError("a calibration needs at least two runs of each material")
    trained = [choose("material", name, biases) for name in names]
    known = np.array(trained, dtype=np.float64)

    # Estimates from the beginnings of the runs
    shortest = min(map(len, runs))
    lengths = [length for length in lengths if length <= shortest]
    if not lengths:
        raise ValueError(f"runs of {shortest} steps are too short to calibrate with")
    looks = [_look(model, runs, known[which], n, settings) for n in lengths]

    # What stays of their errors where the curvature says that nothing scatters
    floor, scale = _floor_and_scale(looks, known[which])

    # How well the right materials are predicted
    logs = [np.array([_log_squares(fit) for _, fit in look]) for look in looks]
    limit = [_limit(looks[k], logs[k], which, known) for k in range(len(lengths))]
    return Calibration(
        floor=floor,
        lengths=np.array(lengths),
        scale=scale,
        limit=np.array(limit),
        biases=known,
        usual=_means(logs[-1], which, len(names)),
    )


def _look(
    model: DPMPB,
    runs: Sequence[Run],
    right: np.ndarray,
    length: int,
    settings: NewtonSettings,
) -> _Look:
    """The best p of the first steps of each run, from the right one `[R, D_p]` on."""
    pairs = zip(runs, right, strict=True)
    return [best_bias(model, run[:length], p, settings) for run, p in pairs]


def _floor_and_scale(
    looks: Sequence[_Look], right: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What is added to the covariance `[D_p, D_p]`, and how it then grows `[N]`."""
    # Errors [N, R, D_p], and the covariances that the curvature gives [N, R, D_p, D_p]
    estimates = np.array([[p for p, _ in look] for look in looks])
    gaps = estimates - right
    scatter = np.array([[fit.covariance() for _, fit in look] for look in looks])

    # All lengths have one floor, and each its own scale
    size = gaps.shape[-1]
    floor = _likeliest_floor(gaps.reshape(-1, size), scatter.reshape(-1, size, size))
    squares = np.einsum("nri,nrij,nrj->nr", gaps, np.linalg.inv(scatter + floor), gaps)
    held = np.array([_upper(each, SHARE) for each in squares])
    return floor, held / radius(SHARE, size) ** 2


def _likeliest_floor(gaps: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """Covariance `[D_p, D_p]` with which gaps `[N, D_p]` are most likely.

    It is added to the `scatter` `[N, D_p, D_p]` of each.
    """
    # By its root, a lower triangle, so that it stays a covariance
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

    # From half of what the gaps themselves scatter
    half = gaps.T @ gaps / len(gaps) / 2 + 1e-9 * np.eye(size)
    start = np.linalg.cholesky(half)[lower]
    return floor_of(minimize(negative_log_likelihood, start, method="Nelder-Mead").x)


def _upper(values: np.ndarray, share: float) -> float:
    """What the next value stays below with this probability (conformal prediction).

    All values are equally likely. No quantile of NumPy's is the value of this rank for
    every number of values.
    """
    rank = int(np.ceil((len(values) + 1) * share))
    return float(np.sort(values)[min(rank, len(values)) - 1])


def _means(logs: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Mean of each material's runs, `[R, D_s]` -> `[K, D_s]`."""
    return np.array([logs[which == k].mean(0) for k in range(count)])


def _limit(
    look: _Look, logs: np.ndarray, which: np.ndarray, known: np.ndarray
) -> float:
    """Log error ratio that few runs exceed, each judged by what is usual in the others.

    `logs` are `[R, D_s]`, `which` names each run's material, `known` its p `[K, D_p]`.
    """
    ratios = []
    for k, (p, fit) in enumerate(look):
        others = np.arange(len(look)) != k
        usual = _means(logs[others], which[others], len(known))
        ratios.append(_log_error_ratio(fit, p, known, usual))
    return _upper(np.array(ratios), 1 - _FALSE_ALARMS)
