"""Gauss-Newton on p in the page, in tensors alone, for its graph.

It is what `Linearisation` and `Calibration` compute with NumPy, for a p of two numbers.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from clothlab.method.gauss_newton import NewtonSettings, around_bias
from clothlab.method.model import DPMPB

_SETTINGS = NewtonSettings()
LAG = 5  # steps, the default of `Linearisation.covariance`
_POINTS = 48  # of the edge of a region


class Calibrated(NamedTuple):
    """What a report on an estimate rests on, in double precision.

    The numbers of a `Calibration`, and how far a region reaches.
    """

    floor: Tensor  # [2, 2]
    lengths: Tensor  # [N]
    scale: Tensor  # [N]
    limit: Tensor  # [N]
    biases: Tensor  # [K, 2]
    usual: Tensor  # [K, D_s]
    sides: Tensor  # [M, 3]
    reach: Tensor  # []
    radius: Tensor  # []


OUTPUTS = (
    "step",
    "covariance",
    "region",
    "log_error_ratio",
    "out_of_distribution",
    "outside_hull",
)


def estimate(
    model: DPMPB, s: Tensor, u: Tensor, p: Tensor, judged: Tensor, known: Calibrated
) -> tuple[Tensor, ...]:
    """A step of p, and what is reported of p before it: `OUTPUTS`.

    Args:
        model: a trained one.
        s: states, `[T + 1, D_s]`.
        u: commands, `[T + 1, D_u]`.
        p: the estimate, `[2]`.
        judged: 1 for each step that counts, 0 where the memory fills, `[T]`.
        known: from runs of known materials.
    """
    # Errors, and by Student's t how much each of them weighs
    errors, jacobian = around_bias(model, s, u, p.double())
    errors = errors * judged.double()[:, None]
    count = judged.sum().double()
    squares = errors.square().sum(0) / count
    sizes = errors.square() / squares.mean().clamp_min(1e-12)
    freedom = _SETTINGS.freedom
    weight = judged.double()[:, None] * (freedom + 1) / (freedom + sizes)

    # The step, and how p scatters
    gradients = torch.einsum("tdi,td->ti", jacobian, weight * errors)
    step = _pseudo_inverse(_curvature(jacobian, weight)) @ gradients.sum(0)
    longest = _SETTINGS.longest / step.norm().clamp_min(1e-12)
    slope = weight * (freedom - sizes) / (freedom + sizes)
    inverse = _inverse(_curvature(jacobian, slope))
    scattered = inverse @ _scatter(gradients) @ inverse
    report = _report(p.double(), count, squares, scattered, known)
    return step * longest.clamp_max(1), *report


def _report(
    p: Tensor, count: Tensor, squares: Tensor, scattered: Tensor, known: Calibrated
) -> tuple[Tensor, ...]:
    """How sure p is, and what is unusual: `OUTPUTS` after the first.

    Args:
        p: the estimate, `[2]`.
        count: steps that were judged, `[]`.
        squares: mean squared errors of these, `[D_s]`.
        scattered: covariance of p by the curvature, `[2, 2]`.
        known: from runs of known materials.
    """
    grown = _interpolated(count, known.lengths, known.scale)
    covariance = grown * (scattered + known.floor)
    region = known.radius * _circle() @ _root(covariance).T

    # Predicted worse than any that was trained on, or beyond all of them
    ratio = _log_error_ratio(squares.clamp_min(1e-20).log(), p, known)
    late = count >= known.lengths[0] - 1
    strange = late & (ratio > _interpolated(count, known.lengths, known.limit))
    outside = _outside_hull(p, covariance, known)
    return covariance, region, ratio, strange, outside


def _curvature(jacobian: Tensor, weight: Tensor) -> Tensor:
    """Of the squared errors, `[2, 2]`."""
    return torch.einsum("tdi,tdj->ij", jacobian * weight[..., None], jacobian)


def _scatter(gradients: Tensor) -> Tensor:
    """Of gradients `[T, 2]`, together with those up to `LAG` steps later, `[2, 2]`."""
    scatter = gradients.T @ gradients
    before = torch.cat([gradients.new_zeros(LAG, 2), gradients])
    for k in range(1, LAG + 1):
        both = gradients.T @ before[LAG - k : -k]
        scatter = scatter + (1 - k / (LAG + 1)) * (both + both.T)
    return scatter


def _inverse(matrix: Tensor) -> Tensor:
    """Of a matrix `[2, 2]`; not finite where there is none."""
    (a, b), (c, d) = matrix
    turned = torch.stack([torch.stack([d, -b]), torch.stack([-c, a])])
    return turned / (a * d - b * c)


def _pseudo_inverse(matrix: Tensor) -> Tensor:
    """Of a symmetric matrix `[2, 2]`.

    It leaves out an axis on which the matrix hardly depends.
    """
    (a, b), (_, d) = matrix
    half = (((a - d) / 2).square() + b.square()).sqrt()
    long = (a + d) / 2 + half
    short = (a + d) / 2 - half
    along = (matrix - short * torch.eye(2, dtype=matrix.dtype)) / (long - short)
    return torch.where(short > 1e-6 * long, _inverse(matrix), along / long)


def _root(matrix: Tensor) -> Tensor:
    """The lower triangle L `[2, 2]` with L Lᵀ = a covariance."""
    (a, b), (_, d) = matrix
    long = a.clamp_min(1e-300).sqrt()
    beside = (d - (b / long).square()).clamp_min(0).sqrt()
    zero = torch.zeros_like(a)
    return torch.stack([torch.stack([long, zero]), torch.stack([b / long, beside])])


def _circle() -> Tensor:
    """Places around the origin, the last of them the first, `[_POINTS, 2]`."""
    angle = torch.linspace(0, 2 * torch.pi, _POINTS, dtype=torch.float64)
    return torch.stack([angle.cos(), angle.sin()], dim=1)


def _interpolated(x: Tensor, places: Tensor, values: Tensor) -> Tensor:
    """As `numpy.interp`, of rising places `[N]` and their values `[N]`."""
    share = ((x - places[:-1]) / places.diff()).clamp(0, 1)
    return values[0] + (share * values.diff()).sum()


def _log_error_ratio(logs: Tensor, p: Tensor, known: Calibrated) -> Tensor:
    """The errors' logs `[D_s]` over what is usual for materials near p `[2]`."""
    gaps = (p - known.biases).square().sum(1)
    near = torch.softmax(-0.5 * gaps / known.reach**2, dim=0)
    return (logs - near @ known.usual).mean()


def _outside_hull(p: Tensor, covariance: Tensor, known: Calibrated) -> Tensor:
    """Whether the region around p `[2]` lies beyond a side of the trained p."""
    normals = known.sides[:, :2]
    reaches = torch.einsum("ki,ij,kj->k", normals, covariance, normals).sqrt()
    return (normals @ p + known.sides[:, 2] > known.radius * reaches).any()
