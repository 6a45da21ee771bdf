"""Who else could do it: policies against which control and practice are measured, each with the same time per solve."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from sklearn.neighbors import NearestNeighbors
from torch import Tensor, nn

from clothlab._validation import Checked, setting
from clothlab.experiments.oracle import SearchSettings, cross_entropy
from clothlab.learning._training import training
from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.control import ControlPolicy, Loss, Predict
from clothlab.learning.dpmpb import DPMPB, Sequences, observe
from clothlab.learning.fast_rollout import FastDPMPB
from clothlab.policies import Policy
from clothlab.simulation.arm import Arm
from clothlab.simulation.env import Observation

HIDDEN = 256


class Repeat(Policy):
    """Sends the same plan `[T, D_u]` again and again."""

    name = "repeat"

    def __init__(self, plan: ArrayLike):
        self.plan = np.asarray(plan, dtype=np.float64)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        self._commands = itertools.cycle(self.plan)

    def __call__(self, observation: Observation) -> np.ndarray:
        return next(self._commands)


class CrossEntropyPolicy(ControlPolicy):
    """The paper's loss and horizon, with the cross-entropy method in place of the gradient.

    Four rounds of 25 samples cost what three gradient steps with 30 candidates each do.
    """

    name = "cross-entropy"
    how = SearchSettings(rounds=4, tries=25, elite=5)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and draw anew."""
        super().reset(seed)
        self._rng = np.random.default_rng(seed)

    def search(self, predict: Predict, loss: Loss, start: Tensor) -> tuple[Tensor, np.ndarray]:
        """Draw plans around the best so far."""

        def cost(plans: np.ndarray) -> np.ndarray:
            with torch.no_grad():
                return loss(predict(torch.as_tensor(plans, dtype=torch.float32))).numpy()

        plans, trace = cross_entropy(cost, start[None].numpy(), self.lower, self.upper, self.how, rng=self._rng)
        return torch.as_tensor(plans[0], dtype=torch.float32), trace


class MeanLossPolicy(ControlPolicy):
    """The paper's gradient on the mean loss of several models, which seldom err in the same way.

    Args:
        members: `(model, p)` of the others, trained with the same autoencoder; the rest as `ControlPolicy`.
    """

    name = "ensemble"

    def __init__(self, *arguments: Any, members: Sequence[tuple[DPMPB, ArrayLike]], **options: Any):
        self._members = [(model, torch.as_tensor(np.asarray(p, dtype=np.float32))) for model, p in members]
        super().__init__(*arguments, **options)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, with all members' memories."""
        super().reset(seed)
        self._memories = [self.model.initial_memory()] * len(self._models)

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` for the first model."""
        super().set_bias(p)
        models, biases = zip((self.model, self._p), *self._members, strict=True)
        self._models = list(map(FastDPMPB, models, biases))

    def _follow(self, observation: Observation) -> Tensor:
        if self._last is not None:
            self._memories = [each.follow(*self._last, m) for each, m in zip(self._models, self._memories, strict=True)]
        self._s = super()._follow(observation)
        return self._s

    def search(self, predict: Predict, loss: Loss, start: Tensor) -> tuple[Tensor, np.ndarray]:
        """Descend the mean loss."""

        def each(u: Tensor) -> Tensor:
            return torch.stack([f(self._s, u, m) for f, m in zip(self._models, self._memories, strict=True)])

        def mean(states: Tensor) -> Tensor:
            return loss(states.flatten(0, 1)).unflatten(0, states.shape[:2]).mean(0)

        return super().search(each, mean, start)


@dataclass(frozen=True)
class ChangesTraining(Checked):
    """How the model of changes is trained."""

    updates: int = setting(3000, at_least=1)
    batch_size: int = setting(512, at_least=1)  # pairs of stretches
    neighbours: int = setting(16, at_least=1)  # a stretch is paired with those that start most alike, on the same cloth
    stride: int = setting(2, "step", at_least=1)
    learning_rate: float = setting(2e-3, above=0)


class ChangesModel(nn.Module):
    """How the outcome changes when the commands change, from the last outcome; after Iterative Residual Policy.

    Chi et al., "Iterative Residual Policy for Goal-Conditioned Dynamic Manipulation of Deformable Objects", RSS 2022.
    It knows no p: the last outcome says what the cloth is like.

    Args:
        state_size: D_s.
        command_size: D_u.
        latent_size: D_z.
        period: length of a plan [step].
    """

    def __init__(self, state_size: int, command_size: int, latent_size: int, period: int = 8):
        super().__init__()
        self.shape = (period, latent_size)
        outcome = period * latent_size
        sizes = 2 * (state_size + period * command_size) + outcome
        hidden = [nn.Linear(sizes, HIDDEN), nn.Tanh(), nn.Linear(HIDDEN, HIDDEN), nn.Tanh()]
        self.net = nn.Sequential(*hidden, nn.Linear(HIDDEN, outcome))

    def forward(self, s: Tensor, u: Tensor, z: Tensor, other_s: Tensor, other_u: Tensor) -> Tensor:
        """Predict the outcome of another plan from that of one plan, all in standard deviations.

        Args:
            s: state at the start `[B, D_s]`.
            u: plan `[B, T, D_u]`.
            z: its outcome `[B, T, D_z]`.
            other_s: state at the start of the other `[B, D_s]`.
            other_u: the other plan `[B, T, D_u]`.

        Returns:
            Outcome of the other `[B, T, D_z]`.
        """
        parts = (s, other_s - s, u.flatten(1), (other_u - u).flatten(1), z.flatten(1))
        return z + self.net(torch.cat(parts, dim=1)).unflatten(1, self.shape)


def train_changes(
    runs: Sequence[Sequences],
    model: DPMPB,
    latent_size: int,
    settings: ChangesTraining | None = None,
    *,
    period: int = 8,
    seed: int = 0,
) -> ChangesModel:
    """Train on pairs of recorded stretches of one cloth that start alike.

    Args:
        runs: the recordings that `model` was trained on.
        model: gives the standard deviations of s and u.
        latent_size: D_z.
        settings: how.
        period: length of a plan [step].
        seed: of weights and batches.
    """
    settings = settings or ChangesTraining()
    first, second, s, u, z = _pairs(runs, model, latent_size, period, settings)
    with training(seed):
        changes = ChangesModel(s.shape[1], u.shape[2], latent_size, period)
        optimizer = torch.optim.Adam(changes.parameters(), lr=settings.learning_rate, fused=True)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.updates)
        for _ in range(settings.updates):
            pick = torch.randint(len(first), (settings.batch_size,))
            a, b = first[pick], second[pick]
            loss = nn.functional.mse_loss(changes(s[a], u[a], z[a], s[b], u[b]), z[b])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
    return changes.eval().requires_grad_(False)


def _pairs(
    runs: Sequence[Sequences], model: DPMPB, latent_size: int, period: int, settings: ChangesTraining
) -> tuple[Tensor, ...]:
    """Numbers of the two stretches of each pair, and all stretches' starts, plans and outcomes."""
    rows, materials = [], []
    for run in runs:
        s = (torch.as_tensor(run.s) - model.s_mean) / model.s_std
        u = (torch.as_tensor(run.u) - model.u_mean) / model.u_std
        starts = range(0, len(run) - period, settings.stride)
        rows += [(s[k], u[k : k + period], s[k + 1 : k + 1 + period, :latent_size]) for k in starts]
        materials += [run.material] * len(starts)
    s, u, z = (torch.stack(column) for column in zip(*rows, strict=True))
    first, second = [], []
    for material in dict.fromkeys(materials):
        members = np.flatnonzero(np.array(materials) == material)
        count = min(settings.neighbours + 1, len(members))
        found = NearestNeighbors(n_neighbors=count).fit(s[members]).kneighbors(s[members], return_distance=False)
        first.append(np.repeat(members, count))
        second.append(members[found].ravel())
    return torch.as_tensor(np.concatenate(first)), torch.as_tensor(np.concatenate(second)), s, u, z


class ChangesPolicy(Policy):
    """Sends a plan each period, changed from the last by what the model of changes says of its outcome.

    Args:
        changes: trained model of changes.
        model: gives the standard deviations of s and u.
        autoencoder: the one that both were trained with.
        arm: gives the range of the commands.
        target: mask `[H, W]`.
        plan: the first `[period, D_u]`, such as the first of `nearest_plans`.
    """

    name = "changes"
    samples, first_width, last_width, settled = 200, 0.5, 0.05, 20  # widths [s.d. of u], a period count

    def __init__(
        self,
        changes: ChangesModel,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm,
        target: ArrayLike,
        plan: ArrayLike,
    ):
        self.changes, self.model, self.autoencoder, self.arm = changes, model, autoencoder, arm
        z = arm.layout(autoencoder.latent_size).z
        self._goal = (torch.as_tensor(encode(autoencoder, target)) - model.s_mean[z]) / model.s_std[z]
        self._first = (torch.as_tensor(np.asarray(plan, dtype=np.float32)) - model.u_mean) / model.u_std
        bounds = (arm.command_lower, arm.command_upper)
        self._lower, self._upper = (
            (torch.as_tensor(each, dtype=torch.float32) - model.u_mean) / model.u_std for each in bounds
        )
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and draw anew."""
        self._generator = torch.Generator().manual_seed(seed)
        self._seen: list[Tensor] = []
        self._t, self._u = 0, self._first

    def __call__(self, observation: Observation) -> np.ndarray:
        s = (torch.as_tensor(observe(self.autoencoder, observation)) - self.model.s_mean) / self.model.s_std
        period = len(self._first)
        self._seen.append(s[: len(self._goal)])
        if self._t % period == 0:
            if self._t:
                self._u = self._change(s, torch.stack(self._seen[-period:]))
            self._start = s
        u = self._u[self._t % period] * self.model.u_std + self.model.u_mean
        self._t += 1
        return np.clip(u.double().numpy(), self.arm.command_lower, self.arm.command_upper)

    def _change(self, s: Tensor, z: Tensor) -> Tensor:
        share = min(self._t / len(self._first) / self.settled, 1.0)
        width = self.first_width ** (1 - share) * self.last_width**share
        noise = width * torch.randn(self.samples, *self._u.shape, generator=self._generator)
        tries = torch.cat([self._u[None], self._u + noise]).clamp(self._lower, self._upper)
        last = [x.expand(len(tries), *x.shape) for x in (self._start, self._u, z)]
        outcome = self.changes(*last, s.expand(len(tries), -1), tries)
        return tries[torch.linalg.vector_norm(outcome - self._goal, dim=-1).amin(1).argmin()]
