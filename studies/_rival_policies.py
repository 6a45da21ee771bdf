"""Policies of rivals that make a plan anew for each period, and learn from no outcome.

One searches with an ensemble of models, the other asks a network for the plan.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from clothlab.masks import Observation
from clothlab.method._memories import AnyMemory
from clothlab.method._rollouts import rollout_of
from clothlab.method.autoencoder import encode
from clothlab.method.cloth_task import observe
from clothlab.method.control import ControlSettings
from clothlab.method.iterative import IterativeLearningSettings, nearest_plans
from clothlab.method.model import PredictiveModel
from clothlab.method.policy import Policy
from studies._rival_models import HindsightPlans, hindsight_input
from studies._throws import Task


class Belief(NamedTuple):
    """A model, and what it knows of the material in the hand."""

    model: PredictiveModel  # its first memory may be one of that material
    biases: dict[str, np.ndarray]  # of recorded materials [D_p]
    p: np.ndarray  # of this one, or what stands in its place [D_p]


class PeriodPolicy(Policy):
    """Makes a plan when a period begins, and sends it unchanged."""

    def __init__(self, task: Task):
        learned = task.learned
        self._autoencoder = learned.autoencoder
        self._z_ref = torch.as_tensor(encode(learned.autoencoder, task.target))
        self._lower = torch.as_tensor(learned.arm.command_lower, dtype=torch.float32)
        self._upper = torch.as_tensor(learned.arm.command_upper, dtype=torch.float32)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        self._left: list[Tensor] = []

    def __call__(self, observation: Observation) -> np.ndarray:
        s = torch.as_tensor(observe(self._autoencoder, observation))
        if not self._left:
            plan = self._plan(s).clamp(self._lower, self._upper)
            self._left = list(plan)
        u = self._left.pop(0)
        self._sent(s, u)
        return u.double().numpy()

    def _plan(self, s: Tensor) -> Tensor:
        """Commands of a period `[T, D_u]` from the state s `[D_s]` on."""
        raise NotImplementedError

    def _sent(self, s: Tensor, u: Tensor) -> None:
        """Take note of a step."""


class EnsemblePolicy(PeriodPolicy):
    """The cross-entropy method on the predictions of several models.

    A plan costs what iterative learning control charges, with the variance between
    models in place of that of a Gaussian process: the root mean square over the periods
    looked ahead of the best step's ‖z_ref - mean‖² + penalty D_z variance.

    Args:
        task: of which the runs give the first plans.
        beliefs: the models, and what each knows of the material.
        penalty: weight of the variance.
        recorded_first: whether the first throw is a recorded plan, chosen by the sum of
            its squared cost and the squared distance that was seen, as iterative
            learning control chooses its first one.
        rounds: how often plans are drawn, after the recorded ones.
        count: plans in a round, of which a tenth are kept.
    """

    name = "ensemble"

    def __init__(
        self,
        task: Task,
        beliefs: list[Belief],
        penalty: float,
        recorded_first: bool,
        rounds: int = 4,
        count: int = 100,
    ):
        # How much is tried, as far ahead as iterative learning control looks
        settings = IterativeLearningSettings()
        self._ahead = settings.lookahead
        self._penalty = penalty
        self._recorded_first = recorded_first
        self._rounds = rounds
        self._count = count
        self._seed = task.seed

        # The models, each with what it was told
        self._models = [each.model for each in beliefs]
        self._rollouts = []
        for model, _, p in beliefs:
            told = torch.as_tensor(p, dtype=torch.float32)
            self._rollouts.append(rollout_of(model)(model, told))
        super().__init__(task)

        # Where the search begins
        plans = nearest_plans(
            task.runs, self._z_ref, ControlSettings.period, settings.recorded
        )
        self._recorded = torch.as_tensor(plans.u, dtype=torch.float32)
        self._seen = torch.as_tensor(plans.distance, dtype=torch.float32)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run."""
        super().reset(seed)
        self._first = True
        first: list[AnyMemory] = [model.initial_memory() for model in self._models]
        self._memories = first
        self._generator = torch.Generator().manual_seed(self._seed + seed)

    @torch.no_grad()
    def _plan(self, s: Tensor) -> Tensor:
        """Recorded plans at first, then around the best ones so far."""
        least = 0.05 * self._models[0].u_std
        plans = self._recorded.clamp(self._lower, self._upper)
        costs = self.costs(s, plans)
        if self._first and self._recorded_first:
            self._first = False
            return plans[(costs.square() + self._seen.square()).argmin()]

        for _ in range(self._rounds):
            kept = costs.argsort()[: self._count // 10]
            best = plans[kept]
            noise = torch.randn(self._count, *best.shape[1:], generator=self._generator)
            drawn = best.mean(0) + noise * best.std(0).clamp_min(least)
            drawn = drawn.clamp(self._lower, self._upper)
            plans = torch.cat([best, drawn])
            costs = torch.cat([costs[kept], self.costs(s, drawn)])
        return plans[costs.argmin()]

    @torch.no_grad()
    def costs(self, s: Tensor, plans: Tensor) -> Tensor:
        """What plans `[B, T, D_u]` cost from the state s `[D_s]`, `[B]` [s.d. of z]."""
        latent = len(self._z_ref)
        repeated = plans.repeat(1, self._ahead, 1)
        predicted = []
        for rollout, memory in zip(self._rollouts, self._memories, strict=True):
            predicted.append(rollout(s, repeated, memory)[..., :latent])
        z = torch.stack(predicted)

        # Between models z varies, and each period has its best step
        variance = z.var(0, correction=0).mean(-1)
        squares = (z.mean(0) - self._z_ref).square().sum(-1)
        squares = squares + self._penalty * latent * variance
        periods = squares.unflatten(1, (self._ahead, plans.shape[1]))
        return periods.amin(2).mean(1).sqrt()

    @torch.no_grad()
    def _sent(self, s: Tensor, u: Tensor) -> None:
        after = []
        for rollout, memory in zip(self._rollouts, self._memories, strict=True):
            after.append(rollout.follow(s, u, memory))
        self._memories = after


class HindsightPolicy(PeriodPolicy):
    """Sends the plan that a network makes of a state and of what is wanted.

    Args:
        task: with the target.
        network: trained by hindsight.
        code: what it is told of the material `[D_c]`.
        from_state: whether it is told the state, too.
    """

    name = "hindsight"

    def __init__(
        self, task: Task, network: HindsightPlans, code: np.ndarray, from_state: bool
    ):
        super().__init__(task)
        self._from_state = from_state
        self._model = task.learned.model
        self._network = network
        self._code = torch.as_tensor(code, dtype=torch.float32)

    def _plan(self, s: Tensor) -> Tensor:
        start = s if self._from_state else None
        x = hindsight_input(self._model, start, self._z_ref, self._code)
        return self._model.u_mean + self._model.u_std * self._network.likeliest(x)
