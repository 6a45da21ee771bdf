"""Iterative learning control: a search that learns from its own outcomes.

The model predicts where a plan leads, and the plan with the best prediction is one
whose error is in its favour. So a plan is sent unchanged for one period, and its
residual, outcome minus prediction, is learned by a Gaussian process over plans and the
states that they start from. The next plan is the one whose corrected prediction is
best:

    z(u) = h(s, u, p) + mean(u)
    E‖z_ref - z‖² = ‖z_ref - z(u)‖² + D_z variance(u)

The variance is small near plans that were tried and large elsewhere: a trust region
that needs no setting. Not in the paper.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import Arm, ControlPolicy
from clothlab.method.control import (
    Controller,
    ControlSettings,
    best_step,
    steepest_ascent,
)
from clothlab.method.data import Run, check_fits
from clothlab.method.model import DPMPB, Memory, numbers, predict

_SAME_MATERIAL = 0.25  # largest squared distance in p, in units of the trained spread


@dataclass(frozen=True)
class IterativeLearningSettings:
    """How much is tried, and how far an outcome teaches."""

    lookahead: int = 3  # periods; a plan must be good when it is repeated, too
    # Stretches that led near the target, among which to look for starts.
    recorded: int = 150
    starts: int = 6  # best-looking plans that are improved
    iterations: int = 3  # of the descent
    candidates: int = 9  # step sizes tried at once, since many plans are improved

    # Trust in what recordings showed, when the first plan is chosen, and what a spread
    # of p between their material and this one counts there.
    trust: float = 1.0
    difference: float = 0.1

    # The variance counts little while outcomes are poor, and in full once they are
    # good: then there is much to lose. What is good is the aim, and the best of some
    # recent outcomes says how good they are.
    caution: float = 1.0
    least_caution: float = 0.05
    aim: float = 0.1  # [s.d. of z]
    recent: int = 5  # periods

    # How far from a plan and from its start an outcome still teaches.
    plan_scale: float = 1.0  # [s.d. of u]
    state_scale: float = 3.0  # [s.d. of s]

    # Of a prediction before any outcome is known, and how many outcomes that is worth.
    prior_error: float = 0.55  # [s.d. of z]
    prior_count: float = 2.0  # periods
    # Variance of what does not repeat, over that of all residuals.
    noise: float = 0.03
    remembered: int = 60  # periods


class RecordedPlans(NamedTuple):
    """Stretches of recorded commands, and what they led to."""

    u: np.ndarray  # commands [N, T, D_u]
    # Of what was seen after the last command to a target [N] [s.d. of z].
    distance: np.ndarray
    material: np.ndarray  # names [N]


def nearest_plans(
    runs: Sequence[Run], z_ref: ArrayLike, horizon: int = 8, count: int = 150
) -> RecordedPlans:
    """The recorded plans after which z was seen nearest to a target, best first.

    Args:
        runs: recordings, z first in their states.
        z_ref: the target, `[D_z]`.
        horizon: length of a plan [step].
        count: how many are wanted; there may be fewer, since no two plans of one run
            overlap by more than half.

    Raises:
        ValueError: no run is as long as two plans.
    """
    if max([len(run) for run in runs], default=0) < 2 * horizon:
        raise ValueError(f"plans of {horizon} steps need recorded runs that are longer")
    z_ref = np.asarray(z_ref, np.float32)

    # Of each run some, the nearest first.
    found = []
    from_each = -(-count // len(runs))
    for run in runs:
        distance = np.linalg.norm(run.s[horizon:, : len(z_ref)] - z_ref, axis=1)
        for _ in range(min(from_each, len(distance) // horizon)):
            start = int(distance.argmin())
            plan = run.u[start : start + horizon]
            found.append((plan, float(distance[start]), run.material))
            # No other plan begins within half a plan of this one.
            first = max(0, start - horizon // 2 + 1)
            distance[first : start + horizon // 2] = np.inf

    found.sort(key=lambda plan: plan[1])
    u, distance, material = zip(*found[:count], strict=True)
    plans = np.stack(u).astype(np.float64)
    return RecordedPlans(plans, np.array(distance), np.array(material))


def plan_features(
    model: DPMPB, s: Tensor, u: Tensor, learning: IterativeLearningSettings
) -> Tensor:
    """What plans are like, in units of how far an outcome teaches, `[B, D]`.

    Args:
        model: by whose standard deviations states and commands are measured.
        s: states in which the plans start, `[D_s]` or `[B, D_s]`.
        u: their commands, `[B, T, D_u]`.
        learning: how far an outcome teaches.
    """
    plan = (u / model.u_std).flatten(1) / learning.plan_scale
    start = s / model.s_std / learning.state_scale
    return torch.cat([plan, start.expand(u.shape[0], -1)], dim=1)


class ResidualModel:
    """Gaussian process of residuals, with one squared-exponential kernel.

    Args:
        x: features of the plans that were tried, in units of the kernel's length,
            `[N, D]`.
        residuals: outcomes minus predictions, `[N, T, D_z]`.
        settings: with the noise and the prior.
    """

    def __init__(
        self, x: Tensor, residuals: Tensor, settings: IterativeLearningSettings
    ):
        self._x = x
        self._shape = residuals.shape[1:]
        noise = settings.noise * torch.eye(len(x), dtype=x.dtype)
        self._inverse = torch.linalg.inv(_kernel(x, x) + noise)
        self._weights = self._inverse @ residuals.flatten(1)

        # The squared error of a prediction far from all that was tried: the mean of
        # what was seen and, as if seen so many times, of what was assumed before.
        squares = residuals.square().mean(dim=(1, 2)).sum()
        assumed = settings.prior_count * settings.prior_error**2
        self.variance = (assumed + squares) / (settings.prior_count + len(x))

    def __call__(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Mean `[B, T, D_z]` and variance `[B]` for plans with features x `[B, D]`."""
        k = _kernel(x, self._x)
        known = ((k @ self._inverse) * k).sum(1)
        mean = (k @ self._weights).unflatten(1, self._shape)
        return mean, self.variance * (1 - known).clamp_min(0)


def _kernel(a: Tensor, b: Tensor) -> Tensor:
    """Squared-exponential kernel `[N, M]` of features `[N, D]` and `[M, D]`."""
    return torch.exp(-0.5 * (a[:, None] - b).square().sum(-1))


@dataclass(eq=False)
class Attempt:
    """One period: a plan, where it started, and where it led."""

    s: Tensor  # state at its start [D_s]
    memory: Memory  # recurrent state there
    u: Tensor  # the plan [T, D_u]
    p: Tensor  # the bias in use [D_p]
    z_ref: Tensor  # where it aimed [D_z]
    z: Tensor  # what was seen after each command so far [T, D_z]


class IterativeController(Controller):
    """Control that learns from each period how the model's predictions err.

    A plan is chosen at the start of a period and sent unchanged. Only the distance of z
    is minimised: tensions are not counted. What was learned is about the model and the
    cloth, not about the target: it stays when that changes. While `exploring`, new
    plans are tried; else the best known one is sent again.

    With `biases`, the first plan is one that the model likes and that led near the
    target with a material like this one. It is sent twice, since the arm swings up in
    the first period. Once p has moved by half a spread of the biases, another material
    is in the hand: attempts are forgotten.

    An entry of `trace` has the best expected distance at the start of a search and
    after each iteration.

    Args:
        model: a trained one, z first in its states.
        z_ref: the target, `[D_z]`.
        p: parametric bias of the material, `[D_p]`.
        lower: smallest commands, `[D_u]`.
        upper: largest commands, `[D_u]`; where both are equal, the command is fixed.
        runs: recordings, whose plans that led near the target are the first tries.
        learning: how much is tried, and how far an outcome teaches.
        biases: trained p of the recordings' materials, `{name: [D_p]}`.
        settings: of the control; its horizon must be its period.
        home: command that the first plan repeats, `[D_u]`; by default the middle
            between the limits.
    """

    def __init__(
        self,
        model: DPMPB,
        z_ref: ArrayLike,
        p: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
        runs: Sequence[Run],
        learning: IterativeLearningSettings = IterativeLearningSettings(),
        *,
        biases: Mapping[str, np.ndarray] | None = None,
        settings: ControlSettings = ControlSettings(),
        home: ArrayLike | None = None,
    ):
        if settings.horizon != settings.period:
            raise ValueError(
                "iterative learning sends plans of a whole period: the horizon of "
                f"{settings.horizon} steps must be the period of {settings.period}"
            )
        for run in runs:
            check_fits(model, run)
        self.learning = learning
        self.exploring = True
        self._runs = runs
        self._biases = dict(biases or {}) if learning.trust else {}
        self.set_target(z_ref)
        super().__init__(model, self._distance, p, lower, upper, settings, home=home)

    def set_target(self, z_ref: ArrayLike) -> None:
        """Aim at another z `[D_z]` from the next period on."""
        self.z_ref = numbers("z_ref", z_ref, np.shape(z_ref))
        self._recorded: RecordedPlans | None = None  # found when it is asked for

    def reset(self) -> None:
        """Forget the last run, and what was learned in it."""
        super().reset()
        self.attempts: list[Attempt] = []  # of the periods that are over
        self.under_way: Attempt | None = None  # the present period
        # Of each period's plan, when it was chosen: distance to the target [s.d. of z]
        self.expected: list[float] = []

    def resume(self) -> None:
        """Begin again, as after somebody moved the robot; what was learned stays."""
        attempts = self.attempts
        self.reset()
        self.attempts = attempts

    def search(self, s: Tensor, plan: Tensor, solve: bool = True) -> Tensor:
        """A plan for a new period, or the rest `[T, D_u]` of this period's."""
        if self.under_way is not None:
            z = s[None, : len(self.z_ref)]
            self.under_way.z = torch.cat([self.under_way.z, z])
        if self.t % self.settings.period:
            return plan

        # A period is over, and the next one begins.
        if self.under_way is not None:
            self.attempts.append(self.under_way)
        before = self.attempts[-1] if self.attempts else None
        self.attempts = self._still_true(self.attempts)
        # Two attempts with one plan, from rest and from a swing, come before a search.
        too_few = bool(self._biases) and len(self.attempts) < 2
        again = not solve or (too_few and len(self.attempts) == 1)
        if before and again:
            plan, expected = before.u, self._expected_again(s, before.u)
        elif too_few:
            plan, expected = self._recorded_plan(s)
        else:
            plan, expected = self._best_plan(s, plan)
        nothing = torch.empty(0, len(self.z_ref))
        self.under_way = Attempt(s, self.memory, plan, self.p, self.z_ref, nothing)
        self.expected.append(expected)
        return plan

    @property
    def basis(self) -> str:
        """What the plan being sent rests on, in words."""
        if self._biases and len(self.attempts) < 2:
            return "recordings"
        return f"{len(self.attempts)} attempts"

    def forecast(self, s: Tensor) -> "Forecast":
        """What is expected of plans from state s `[D_s]` on, after the attempts."""
        return Forecast(self, s)

    def recorded(self) -> RecordedPlans:
        """The recorded plans that led nearest to the target; found once for each."""
        if self._recorded is None:
            period = self.settings.period
            count = self.learning.recorded
            self._recorded = nearest_plans(self._runs, self.z_ref, period, count)
        return self._recorded

    def _still_true(self, attempts: list[Attempt]) -> list[Attempt]:
        """The last attempts, as far as they were made with a material like this one."""
        kept = attempts[-self.learning.remembered :]
        if not self._biases:
            return kept
        return [each for each in kept if self._gap(each.p) < _SAME_MATERIAL]

    def _gap(self, p: ArrayLike) -> float:
        """Squared distance of p from the one in use, over the spread of the biases."""
        squares = float(np.square(np.asarray(p) - self.p.numpy()).sum())
        spread = float(np.var(list(self._biases.values()), axis=0).sum())
        # One material has no spread, and every p is its own.
        return squares / spread if spread else 0.0

    def _expected_again(self, s: Tensor, plan: Tensor) -> float:
        """What is expected of a plan `[T, D_u]` that is sent once more, from here."""
        with torch.no_grad():
            return float(self.forecast(s).distance(plan[None]))

    def _recorded_plan(self, s: Tensor) -> tuple[Tensor, float]:
        """A recorded plan that is good by prediction, and was with a near material.

        The sum of three squares decides: the distance that is predicted, the one that
        was seen, and the distance in p between the recording's material and this one.
        """
        recorded = self.recorded()
        plans = self._within_limits(recorded.u)
        with torch.no_grad():
            expected = self.forecast(s).distance(plans)

        gaps = {name: self._gap(p) for name, p in self._biases.items()}
        gap = np.array([gaps.get(name, 1.0) for name in recorded.material])
        shown = recorded.distance**2 + self.learning.difference * gap
        scores = expected.numpy() ** 2 + self.learning.trust * shown
        best = int(scores.argmin())
        self.trace.append(expected[best, None].numpy())
        return plans[best], float(expected[best])

    def _best_plan(self, s: Tensor, plan: Tensor) -> tuple[Tensor, float]:
        """The plan that is expected to lead nearest, by a descent from some starts."""
        expected = self.forecast(s).distance
        tried = [attempt.u for attempt in self.attempts]

        # Where to start: plans that were tried, recorded ones, and the one at hand.
        starts = [torch.stack(tried)] if tried else []
        if self.exploring or not tried:
            starts.append(self._within_limits(self.recorded().u))
            starts.append(plan[None])
        plans = torch.cat(starts)
        with torch.no_grad():
            losses = expected(plans)
        best = losses.argsort()[: self.learning.starts if self.exploring else 1]
        plans, losses = plans[best], losses[best]

        # The descent, of all of them at once.
        few = replace(
            self.settings, candidates=self.learning.candidates, smallest_step=10**-2.5
        )
        gamma = few.step_sizes()[:, None, None, None] * self.limits.scale
        trace = [losses.min().item()]
        for _ in range(self.learning.iterations if self.exploring else 0):
            _, direction = steepest_ascent(expected, plans, self.limits.scale)
            plans, losses = best_step(expected, plans, gamma * direction, self.limits)
            trace.append(losses.min().item())
        self.trace.append(np.array(trace))
        return plans[losses.argmin()], trace[-1]

    def _within_limits(self, plans: np.ndarray) -> Tensor:
        """Recorded plans `[N, T, D_u]` within the limits of the commands."""
        tensor = torch.as_tensor(plans, dtype=torch.float32)
        return tensor.clamp(self.limits.lower, self.limits.upper)

    def _distance(self, states: Tensor, commands: Tensor, t: int) -> Tensor:
        """Distance `[B]` to the target at the best of the predicted steps."""
        z = states[..., : len(self.z_ref)]
        return torch.linalg.vector_norm(z - self.z_ref, dim=-1).amin(1)


class Forecast:
    """What is expected of plans: predictions, corrected by what attempts taught.

    Args:
        controller: with the model, its p, the target and the attempts.
        s: the state to start from, `[D_s]`.
    """

    def __init__(self, controller: IterativeController, s: Tensor):
        self._controller = controller
        self._s = s
        self.caution = _caution(controller)
        self.residuals: ResidualModel | None = None  # once there are attempts
        if controller.attempts:
            self.residuals = self._learned(controller.attempts)

    @torch.no_grad()
    def _learned(self, attempts: Sequence[Attempt]) -> ResidualModel:
        """How predictions with the present p erred in the attempts."""
        controller = self._controller
        s = torch.stack([each.s for each in attempts])
        u = torch.stack([each.u for each in attempts])
        z = torch.stack([each.z for each in attempts])
        h = torch.cat([each.memory.h for each in attempts], dim=1)
        c = torch.cat([each.memory.c for each in attempts], dim=1)
        states = predict(controller.model, s, u, controller.p, Memory(h, c))
        errors = z - states[..., : z.shape[2]]
        return ResidualModel(self.features(s, u), errors, controller.learning)

    def features(self, s: Tensor, u: Tensor) -> Tensor:
        """What plans u `[B, T, D_u]` from states s `[B, D_s]` are like, `[B, D]`."""
        controller = self._controller
        return plan_features(controller.model, s, u, controller.learning)

    def distance(self, plans: Tensor) -> Tensor:
        """Distance to the target expected of plans `[B, T, D_u]`, `[B]` [s.d. of z].

        Each plan is sent again and again. The root mean square over the periods that
        are looked ahead, each with its best step.
        """
        controller = self._controller
        z_ref = controller.z_ref
        latent = len(z_ref)
        ahead = controller.learning.lookahead
        states = controller.predict(self._s, plans.repeat(1, ahead, 1))
        states = states.unflatten(1, (ahead, plans.shape[1]))

        total = plans.new_zeros(plans.shape[0])
        start = self._s.expand(plans.shape[0], -1)
        for k in range(ahead):
            # Where this period leads, corrected by what was learned.
            predicted = states[:, k, :, :latent]
            variance = torch.tensor(controller.learning.prior_error**2)
            if self.residuals is not None:
                mean, variance = self.residuals(self.features(start, plans))
                predicted = predicted + mean

            # What that is worth, and where the next period starts.
            squares = (predicted - z_ref).square().sum(-1).amin(1)
            squares = squares + self.caution * latent * variance
            total = total + squares / ahead
            start = torch.cat([predicted[:, -1], states[:, k, -1, latent:]], dim=1)
        return total.clamp_min(1e-12).sqrt()


def _caution(controller: IterativeController) -> float:
    """Weight of the variance: smaller as long as recent outcomes are poor.

    By (aim / best recent outcome)².
    """
    learning = controller.learning
    best = math.inf
    for attempt in controller.attempts[-learning.recent :]:
        distances = torch.linalg.vector_norm(attempt.z - controller.z_ref, dim=1)
        best = min(best, float(distances.min()))
    good = min(1.0, (learning.aim / max(best, 1e-9)) ** 2)
    return max(learning.least_caution, learning.caution * good)


class IterativePolicy(ControlPolicy):
    """Realises a target image again and again, and learns from each period.

    Args:
        model: trained on the z of this autoencoder.
        autoencoder: makes z of an image.
        arm: the arm whose commands these are, perhaps with narrower limits.
        target: mask `[H, W]`.
        p: parametric bias of the cloth, `[D_p]`.
        runs: recordings, whose plans that led near the target are the first tries.
        learning: how much is tried, and how far an outcome teaches.
        biases: trained p of the recordings' materials, `{name: [D_p]}`.
    """

    name = "iterative"
    controller: IterativeController

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm,
        target: ArrayLike,
        p: ArrayLike,
        runs: Sequence[Run],
        learning: IterativeLearningSettings = IterativeLearningSettings(),
        *,
        biases: Mapping[str, np.ndarray] | None = None,
    ):
        self._set_task(model, autoencoder, arm, target)
        self.controller = IterativeController(
            model,
            self.z_ref,
            p,
            arm.command_lower,
            arm.command_upper,
            runs,
            learning,
            biases=biases,
            home=arm.home_command,
        )

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next period on."""
        super().set_target(mask)
        self.controller.set_target(self.z_ref)

    @property
    def predicted_distance(self) -> float | None:
        """Distance to the target that is expected of the plan [s.d. of z], or None.

        None, too, as long as the plan aims at the target before.
        """
        now = self.controller.under_way
        if now is None or now.z_ref is not self.controller.z_ref:
            return None
        return self.controller.expected[-1]
