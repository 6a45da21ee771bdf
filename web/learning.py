"""Iterative learning control, in tensors alone, for graphs.

A Gaussian process over plans learns from attempts how predictions err; a plan is good
whose corrected prediction is near the target. `IterativeController` computes the same.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from clothlab import DPMPB
from clothlab.method.iterative import IterativeLearningSettings
from web.network import Memory, Network


class Learned(NamedTuple):
    """What attempts taught of predictions."""

    x: Tensor  # features of the plans that were tried [N, D]
    inverse: Tensor  # of the covariance of their residuals [N, N]
    weights: Tensor  # of each of them in a mean [N, T D_z]
    variance: Tensor  # far from all that was tried []

    def __call__(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Mean `[B, T D_z]` and variance `[B]` for plans with features x `[B, D]`."""
        k = kernel(x, self.x)
        known = ((k @ self.inverse) * k).sum(1)
        return k @ self.weights, self.variance * (1 - known).clamp_min(0)


def kernel(a: Tensor, b: Tensor) -> Tensor:
    """Squared-exponential kernel `[N, M]` of features `[N, D]` and `[M, D]`."""
    return torch.exp(-0.5 * (a[:, None] - b).square().sum(-1))


class Learning:
    """Iterative learning control with a trained model.

    Args:
        model: a trained one.
        latent: how many numbers z has, which come first in a state.
        settings: how far an outcome teaches.
    """

    def __init__(self, model: DPMPB, latent: int, settings: IterativeLearningSettings):
        self._model = model
        self._latent = latent
        self._settings = settings

    def features(self, s: Tensor, u: Tensor) -> Tensor:
        """What plans u `[B, T, D_u]` from states s `[B, D_s]` are like, `[B, D]`."""
        plan = (u / self._model.u_std).flatten(1) / self._settings.plan_scale
        start = s / self._model.s_std / self._settings.state_scale
        return torch.cat([plan, start.expand(len(u), -1)], dim=1)

    def teach(
        self, s: Tensor, u: Tensor, z: Tensor, tried: Tensor, p: Tensor, memory: Memory
    ) -> Learned:
        """What attempts teach.

        Args:
            s: states in which they began, `[N, D_s]`.
            u: their plans, `[N, T, D_u]`.
            z: what was seen after each command, `[N, T, D_z]`.
            tried: 1 for each attempt, 0 where there is none yet, `[N]`.
            p: parametric bias, `[D_p]`.
            memory: that before them.
        """
        settings = self._settings
        predicted = Network(self._model, p).predict(s, u, memory)
        x = self.features(s, u)

        # Of those that were tried, the covariance and what it makes of their residuals
        both = tried[:, None] * tried
        noise = settings.noise * torch.eye(len(x))
        inverse = both * _inverse(both * kernel(x, x) + noise)
        residuals = (z - predicted[..., : self._latent]).flatten(1)
        residuals = tried[:, None] * residuals

        # The squared error far from them: what was seen, and what was assumed before
        squares = residuals.square().mean(1).sum()
        assumed = settings.prior_count * settings.prior_error**2
        variance = (assumed + squares) / (settings.prior_count + tried.sum())
        return Learned(x, inverse, inverse @ residuals, variance)

    def distance(
        self,
        plans: Tensor,
        start: tuple[Tensor, Tensor, Memory],
        target: tuple[Tensor, Tensor],
        learned: Learned,
    ) -> Tensor:
        """Distance to the target expected of plans, `[B]` [s.d. of z].

        Each plan is sent again and again. The root mean square over the periods that
        are looked ahead, each with its best step.

        Args:
            plans: commands of a period, `[B, T, D_u]`.
            start: the state `[D_s]`, p `[D_p]`, and the memory.
            target: its z `[D_z]`, and the weight of the variance, `[]`.
            learned: what attempts taught.
        """
        s, p, memory = start
        z_ref, caution = target
        ahead = self._settings.lookahead
        states = Network(self._model, p).predict(s, plans.repeat(1, ahead, 1), memory)
        periods = states.unflatten(1, (ahead, -1)).unbind(1)

        total = plans.new_zeros(len(plans))
        s = s.expand(len(plans), -1)
        for period in periods:
            # Where it leads, corrected by what was learned
            mean, variance = learned(self.features(s, plans))
            predicted = period[..., : self._latent]
            predicted = predicted + mean.unflatten(1, (-1, self._latent))

            # What that is worth, and where the next one starts
            squares = (predicted - z_ref).square().sum(-1).amin(1)
            total = total + (squares + caution * self._latent * variance) / ahead
            s = torch.cat([predicted[:, -1], period[:, -1, self._latent :]], dim=1)
        return total.clamp_min(1e-12).sqrt()


def _inverse(matrix: Tensor) -> Tensor:
    """Of a symmetric and positive definite matrix `[N, N]`, by elimination.

    ONNX has no inverse.
    """
    count = len(matrix)
    unit = torch.eye(count, dtype=torch.float64)
    rows = torch.cat([matrix.double(), unit], dim=1)
    for k in range(count):
        row = rows[k] / rows[k, k]
        rows = rows - torch.outer(rows[:, k] - unit[k], row)
    return rows[:, count:].to(matrix.dtype)
