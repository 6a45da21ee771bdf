"""One iteration of a descent on plans, in tensors alone, for graphs.

It is what the paper's control does (eqs. 6 and 7), and iterative learning with fewer
sizes of a step. The page repeats it.
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor


def step_sizes(smallest: float, largest: float, count: int) -> Tensor:
    """Sizes of a step to try `[count]`, on a logarithmic scale; the first is 0."""
    rising = torch.logspace(math.log10(smallest), math.log10(largest), count - 1)
    return torch.cat([torch.zeros(1), rising])


def improve(
    loss: Callable[[Tensor], Tensor], plans: Tensor, limits: Tensor, sizes: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """The best of many steps down the gradient, from each of several plans.

    Args:
        loss: of plans, `[B]`.
        plans: commands, `[B, T, D_u]`.
        limits: the smallest and largest commands, and the unit of a step, `[3, D_u]`.
        sizes: of the steps, in these units, `[K]`.

    Returns:
        The best plans `[B, T, D_u]`, their losses before `[B]`, and after it `[B]`.
    """
    lower, upper, unit = limits
    plans = plans.clamp(lower, upper).detach().requires_grad_()
    before = loss(plans)
    (gradient,) = torch.autograd.grad(before.sum(), plans)

    # In units of each command, of length one
    gradient = gradient * unit
    length = torch.linalg.vector_norm(gradient, dim=(1, 2), keepdim=True)
    direction = gradient / length.clamp_min(1e-12) * unit

    # The best candidate of each plan, [K, B, T, D_u]
    with torch.no_grad():
        candidates = (plans - sizes[:, None, None, None] * direction).clamp(
            lower, upper
        )
        losses = loss(candidates.flatten(0, 1)).unflatten(0, candidates.shape[:2])
        losses = losses.masked_fill(losses.isnan(), torch.inf)
        best = losses.argmin(0)
        found = candidates[best, torch.arange(len(plans))]
        return found, before.detach(), losses.amin(0)


def limits_of(lower: Tensor, upper: Tensor, u_std: Tensor) -> Tensor:
    """Limits `[3, D_u]` for `improve`; where both are equal, a command stays."""
    return torch.stack([lower, upper, u_std * (upper > lower)])
