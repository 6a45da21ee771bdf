"""How sure an estimate is: the region of p around it, and what is reported of it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

SHARE = 0.9  # of the regions that are shown


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


class EstimateReport(NamedTuple):
    """How sure an estimate is, and how familiar its material."""

    covariance: np.ndarray  # of p [D_p, D_p]
    log_error_ratio: float  # log of the prediction error over the usual one
    out_of_distribution: bool  # whether that is too much
    outside_hull: bool  # whether the 90 % region lies beyond the trained p
