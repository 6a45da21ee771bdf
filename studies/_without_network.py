"""Refinement of a throw from its outcomes alone, without a network.

A recorded plan is replayed, and improved from period to period: by an evolution
strategy, or by a Gaussian process of where plans lead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from clothlab.method.autoencoder import encode
from clothlab.method.cloth_task import observe
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.iterative import (
    IterativeLearningSettings,
    ResidualModel,
    nearest_plans,
    plan_features,
)
from clothlab.method.rollout import Policy
from clothlab.simulation.vision import Observation
from clothlab.weights import ClothCheckpoint

_PERIOD = ControlSettings.period  # [step]
_LONGER = 1.5  # steps of the evolution grow so after a success,
_SHORTER = _LONGER**-0.25  # and shrink so after a failure: one success in five
_BEST = 3  # plans that were tried, around which others are drawn
_DRAWN = 100  # plans around each of them
_SMALLEST = 0.03  # step of a drawn plan [s.d. of u]
_LARGEST = 1.0


class Outcome(NamedTuple):
    """One period: where it began, what was sent, and what was seen after it."""

    s: np.ndarray  # [D_s]
    u: np.ndarray  # [T, D_u]
    z: np.ndarray  # [T, D_z]


class Refining(Policy):
    """Sends a plan for a period, sees where it led, and makes the next one.

    The first plan is a recorded one, the nearest to the target. It is sent twice, since
    the arm swings up in the first period.

    Its first plan is `first` `[T, D_u]`.

    Args:
        learned: whose autoencoder sees, whose arm limits the commands, and in whose
            standard deviations they are changed. Its network predicts nothing.
        target: mask `[H, W]`.
        runs: recordings to begin with.
    """

    def __init__(self, learned: ClothCheckpoint, target: np.ndarray, runs: list[Run]):
        self._learned = learned
        self._z_ref = encode(learned.autoencoder, target)
        self._unit = learned.model.u_std.numpy()
        self.first = nearest_plans(runs, self._z_ref, _PERIOD, count=1).u[0]
        self.reset()

    def reset(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self._plan = self.first
        self._outcomes: list[Outcome] = []
        self._states: list[np.ndarray] = []  # since the period began

    def __call__(self, observation: Observation) -> np.ndarray:
        self._states.append(observe(self._learned.autoencoder, observation))
        if len(self._states) > _PERIOD:
            self._end_period()
        return self._plan[len(self._states) - 1]

    def _end_period(self) -> None:
        """Note where the plan led, and make the next one."""
        states = np.stack(self._states)
        seen = states[1:, : len(self._z_ref)]
        self._outcomes.append(Outcome(states[0], self._plan, seen))
        if len(self._outcomes) > 1:
            arm = self._learned.arm
            plan = self._next_plan()
            self._plan = plan.clip(arm.command_lower, arm.command_upper)
        self._states = self._states[-1:]

    def _cost(self, outcome: Outcome) -> float:
        """Smallest distance to the target [s.d. of z]."""
        return float(np.linalg.norm(outcome.z - self._z_ref, axis=1).min())

    def _next_plan(self) -> np.ndarray:
        """The plan `[T, D_u]` of the next period, after two at the least."""
        raise NotImplementedError


class EvolutionPolicy(Refining):
    """(1 + 1) evolution strategy: a random step from the best plan so far.

    `step` [s.d. of u] is the first one's; others follow the rule of one success in five
    (Rechenberg, 1973).
    """

    name = "evolution"

    def __init__(
        self, learned: ClothCheckpoint, target: np.ndarray, runs: list[Run], step: float
    ):
        self._step = step
        super().__init__(learned, target, runs)

    def reset(self, seed: int = 0) -> None:
        super().reset(seed)
        self._size = self._step
        self._parent: Outcome | None = None

    def _next_plan(self) -> np.ndarray:
        last = self._outcomes[-1]
        if self._parent is None:
            self._parent = last
        elif self._cost(last) < self._cost(self._parent):
            self._parent = last
            self._size *= _LONGER
        else:
            self._size *= _SHORTER
        drawn = self._rng.normal(size=last.u.shape)
        return self._parent.u + self._size * self._unit * drawn


@dataclass(frozen=True)
class ProcessSettings:
    """How far outcomes teach, and what it counts that an outcome is not known."""

    scale: float  # of plans [s.d. of u]
    # Weight of the variance: below 0 what is not known attracts, above 0 it repels
    caution: float


class ProcessPolicy(Refining):
    """Gaussian process of where plans lead: Bayesian optimisation of the throw.

    It is the one of iterative learning control, with what was recorded in the place of
    the network's prediction: the outcome of the replayed throw, corrected by what other
    recorded stretches led to. What is seen with the cloth in the hand corrects that. Of
    many plans around the best ones so far the one with the best forecast is sent.
    """

    name = "process"

    def __init__(
        self,
        learned: ClothCheckpoint,
        target: np.ndarray,
        runs: list[Run],
        settings: ProcessSettings,
    ):
        super().__init__(learned, target, runs)
        self._caution = settings.caution
        self._settings = IterativeLearningSettings(plan_scale=settings.scale)
        self._aim = torch.as_tensor(self._z_ref)

        # What the recordings say: a first guess, and corrections around it
        recorded = _stretches(runs, len(self._z_ref))
        s, u, z = _stacked(recorded)
        first = torch.as_tensor(self.first, dtype=torch.float32)
        replayed = int((u - first).abs().sum(dim=(1, 2)).argmin())
        self._guess = z[replayed]
        self._recorded = ResidualModel(
            self._features(s, u), z - self._guess, self._settings
        )

    def _next_plan(self) -> np.ndarray:
        plans = torch.as_tensor(self._candidates(), dtype=torch.float32)
        start = torch.as_tensor(self._states[-1])
        mean, variance = self._forecast(start, plans)
        squares = (mean - self._aim).square().sum(-1).amin(1)
        scores = squares + self._caution * len(self._aim) * variance
        return plans[scores.argmin()].numpy().astype(np.float64)

    def _candidates(self) -> np.ndarray:
        """Plans that were tried, and many around the best of them `[N, T, D_u]`."""
        # The first period swings up: what it led to says little of its plan
        best = sorted(self._outcomes[1:], key=self._cost)[:_BEST]
        plans = [outcome.u[None] for outcome in best]
        arm = self._learned.arm
        for outcome in best:
            logs = self._rng.uniform(np.log(_SMALLEST), np.log(_LARGEST), _DRAWN)
            drawn = self._rng.normal(size=(_DRAWN, *outcome.u.shape))
            steps = np.exp(logs)[:, None, None] * self._unit * drawn
            around = outcome.u + steps
            plans.append(around.clip(arm.command_lower, arm.command_upper))
        return np.concatenate(plans)

    def _forecast(self, start: Tensor, plans: Tensor) -> tuple[Tensor, Tensor]:
        """Mean `[B, T, D_z]` and variance `[B]` of where plans lead from a state."""
        s, u, z = _stacked(self._outcomes)
        tried = self._features(s, u)
        residuals = z - self._by_recordings(tried)
        seen = ResidualModel(tried, residuals, self._settings)

        x = self._features(start, plans)
        correction, variance = seen(x)
        return self._by_recordings(x) + correction, variance

    def _by_recordings(self, x: Tensor) -> Tensor:
        mean, _ = self._recorded(x)
        return self._guess + mean

    def _features(self, s: Tensor, u: Tensor) -> Tensor:
        return plan_features(self._learned.model, s, u, self._settings)


def _stretches(runs: Sequence[Run], latent: int) -> list[Outcome]:
    """All recorded stretches of a period."""
    found = []
    for run in runs:
        for start in range(len(run) - _PERIOD):
            end = start + _PERIOD
            z = run.s[start + 1 : end + 1, :latent]
            found.append(Outcome(run.s[start], run.u[start:end], z))
    return found


def _stacked(outcomes: Sequence[Outcome]) -> tuple[Tensor, Tensor, Tensor]:
    """States `[N, D_s]`, plans `[N, T, D_u]` and what they led to `[N, T, D_z]`."""
    columns = [np.stack(column) for column in zip(*outcomes, strict=True)]
    s, u, z = (torch.as_tensor(each, dtype=torch.float32) for each in columns)
    return s, u, z
