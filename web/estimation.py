"""A step of Gauss-Newton on p, in tensors alone, for its graph.

It is what `NewtonEstimator` does for a p of two numbers.
"""

import torch
from torch import Tensor

from clothlab import DPMPB
from clothlab.method.estimation import NewtonSettings

_NUDGE = 0.03  # of p, by which its neighbours differ


@torch.no_grad()
def step(model: DPMPB, s: Tensor, u: Tensor, p: Tensor, judged: Tensor) -> Tensor:
    """How p moves to the lowest loss in a window, at most so long, `[2]`.

    Args:
        model: a trained one.
        s: states, `[T + 1, D_s]`.
        u: commands, `[T + 1, D_u]`.
        p: the estimate, `[2]`.
        judged: 1 for each step that counts, 0 where the memory fills, `[T]`.
    """
    settings = NewtonSettings()
    errors, jacobian = _around(model, s, u, p.double())
    judged = judged.double()[:, None]
    errors = errors * judged

    # By Student's t, outliers weigh little
    mean = errors.square().mean(1).sum() / judged.sum()
    sizes = errors.square() / mean.clamp_min(1e-12)
    weight = (
        judged
        * (settings.degrees_of_freedom + 1)
        / (settings.degrees_of_freedom + sizes)
    )

    # The lowest loss, were predictions linear in p
    curvature = torch.einsum("tdi,tdj->ij", jacobian * weight[..., None], jacobian)
    gradient = torch.einsum("tdi,td->i", jacobian, weight * errors)
    whole = _pseudo_inverse(curvature) @ gradient
    longest = settings.largest_step / whole.norm().clamp_min(1e-12)
    return whole * longest.clamp_max(1)


def _around(model: DPMPB, s: Tensor, u: Tensor, p: Tensor) -> tuple[Tensor, Tensor]:
    """Errors `[T, D_s]` [s.d. of the state], and what a small change of p would do.

    The second is the derivative of predictions by p, `[T, D_s, 2]`.
    """
    # One pass: p itself is the first of the batch, then come its neighbours
    nudges = _NUDGE * torch.eye(2, dtype=p.dtype)
    several = torch.cat([p[None], p + nudges, p - nudges]).to(s.dtype)
    before = s[:-1].expand(len(several), -1, -1)
    sent = u[:-1].expand(len(several), -1, -1)
    predicted, _ = model(before, sent, several)
    scaled = (predicted / model.s_std).double()
    seen = (s[1:] / model.s_std).double()

    # Central differences
    jacobian = (scaled[1:3] - scaled[3:]).movedim(0, -1) / (2 * _NUDGE)
    return seen - scaled[0], jacobian


def _pseudo_inverse(matrix: Tensor) -> Tensor:
    """Of a symmetric matrix `[2, 2]`.

    It leaves out an axis on which the matrix hardly depends.
    """
    (a, b), (_, d) = matrix
    half = (((a - d) / 2).square() + b.square()).sqrt()
    long = (a + d) / 2 + half
    short = (a + d) / 2 - half
    along = (matrix - short * torch.eye(2, dtype=matrix.dtype)) / (long - short)
    turned = torch.stack([torch.stack([d, -b]), torch.stack([-b, a])])
    inverse = turned / (a * d - b * b)
    return torch.where(short > 1e-6 * long, inverse, along / long)
