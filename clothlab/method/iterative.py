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
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, settings_or_default
from clothlab.method._experience import Attempt, Experience
from clothlab.method._inputs import check_runs
from clothlab.method.control import (
    ControlSettings,
    Limits,
    Problem,
    Solution,
    _LossOfPlans,
    best_step,
    steepest_ascent,
)
from clothlab.method.data import Run
from clothlab.method.model import DPMPB, Memory

# Each step of a descent tries few sizes, since many plans are improved at once.
_CANDIDATES = 9
_SMALLEST_STEP = 10**-2.5  # [s.d. of u]
_SAME_MATERIAL = 0.25  # largest squared distance in p, in units of the trained spread


@dataclass(frozen=True)
class IterativeLearningSettings:
    """How much is tried, and how far an outcome teaches."""

    # A plan must be good when it is repeated, too.
    lookahead: int = 3  # [period]
    # Stretches that led near the target, among which to look for starts.
    recorded: int = 150
    starts: int = 6  # best-looking plans that are improved
    iterations: int = 3  # of the descent

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
    recent: int = 5  # [period]

    # How far from a plan and from its start an outcome still teaches.
    plan_scale: float = 1.0  # [s.d. of u]
    state_scale: float = 3.0  # [s.d. of s]

    # Of a prediction before any outcome is known, and how many outcomes that is worth.
    prior_error: float = 0.55  # [s.d. of z]
    prior_count: float = 2.0  # [period]
    # Variance of what does not repeat, over that of all residuals.
    noise: float = 0.03
    remembered: int = 60  # [period]

    def features(self, model: DPMPB, s: Tensor, u: Tensor) -> Tensor:
        """What plans are like, in units of how far an outcome teaches, `[B, D]`.

        From the states s `[D_s]` or `[B, D_s]` in which they start, and their commands
        u `[B, T, D_u]`.
        """
        plan = (u / model.u_std).flatten(1) / self.plan_scale
        start = s / model.s_std / self.state_scale
        return torch.cat([plan, start.expand(u.shape[0], -1)], dim=1)


class _RecordedPlans(NamedTuple):
    """Stretches of recorded commands, and what they led to."""

    u: np.ndarray  # commands [N, T, D_u]
    # Of what was seen after the last command to a target [N] [s.d. of z].
    distance: np.ndarray
    material: np.ndarray  # names [N]


def nearest_plans(
    runs: Sequence[Run], z_ref: ArrayLike, horizon: int = 8, count: int = 150
) -> _RecordedPlans:
    """The recorded plans after which z was seen nearest to a target, best first.

    Args:
        runs: recordings, z first in their states.
        z_ref: the target, `[D_z]`.
        horizon: length of a plan [step].
        count: how many are wanted; there may be fewer, since no two plans of one run
            overlap by more than half.
    """
    # What was given must belong together.
    runs = check_runs(runs)
    _check_longer(runs, horizon)
    z_ref = check_array("z_ref", z_ref, ("D_z",), np.float32)
    states = runs[0].s.shape[1]
    if len(z_ref) > states:
        raise ValueError(
            f"z_ref has {len(z_ref)} numbers, more than the {states} of a state"
        )

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
    return _RecordedPlans(plans, np.array(distance), np.array(material))


def _check_longer(runs: Sequence[Run], horizon: int) -> None:
    """A ValueError if no run holds a plan and what came after it."""
    longest = max([len(run) for run in runs], default=0)
    if longest < 2 * horizon:
        raise ValueError(f"plans of {horizon} steps need recorded runs that are longer")


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
        self._shape = residuals.shape[1:]
        noise = settings.noise * torch.eye(len(x), dtype=x.dtype)
        self._x = x
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
        mean = (k @ self._weights).unflatten(1, self._shape)
        known = ((k @ self._inverse) * k).sum(1)
        return mean, self.variance * (1 - known).clamp_min(0)


def _kernel(a: Tensor, b: Tensor) -> Tensor:
    """Squared-exponential kernel `[N, M]` of features `[N, D]` and `[M, D]`."""
    return torch.exp(-0.5 * (a[:, None] - b).square().sum(-1))


class _Forecast:
    """What is expected of plans: predictions, corrected by what attempts taught.

    Args:
        problem: the state to start from, the model and its p.
        z_ref: the target, `[D_z]`.
        settings: how far an outcome teaches.
        caution: weight of the variance.
    """

    def __init__(
        self,
        problem: Problem,
        z_ref: Tensor,
        settings: IterativeLearningSettings,
        caution: float,
    ):
        self._problem = problem
        self._z_ref = z_ref
        self._settings = settings
        self._caution = caution
        self.residuals: Any = None  # a `ResidualModel`, once there are attempts

    def learn(self, attempts: Sequence[Attempt]) -> None:
        """Learn how predictions with the present p erred in the attempts."""
        s = torch.stack([each.s for each in attempts])
        u = torch.stack([each.u for each in attempts])
        z = torch.stack([each.z for each in attempts])
        memories = zip(*(each.memory for each in attempts), strict=True)
        memory = Memory(*(torch.cat(parts, dim=1) for parts in memories))
        with torch.no_grad():
            states = self._problem.rollout(s, u, memory)
            predicted = states[..., : len(self._z_ref)]
            x = self.features(s, u)
            self.residuals = ResidualModel(x, z - predicted, self._settings)

    def features(self, s: Tensor, u: Tensor) -> Tensor:
        """What plans u `[B, T, D_u]` from states s `[B, D_s]` are like, `[B, D]`."""
        return self._settings.features(self._problem.model, s, u)

    def distance(self, plans: Tensor) -> Tensor:
        """Distance to the target expected of plans `[B, T, D_u]`, `[B]` [s.d. of z].

        Each plan is sent again and again. The root mean square over the periods that
        are looked ahead, each with its best step.
        """
        ahead = self._settings.lookahead
        period = plans.shape[1]
        latent = len(self._z_ref)
        states = self._problem.predict(plans.repeat(1, ahead, 1))
        states = states.unflatten(1, (ahead, period))

        total = plans.new_zeros(plans.shape[0])
        start = self._problem.s.expand(plans.shape[0], -1)
        for k in range(ahead):
            # Where this period leads, corrected by what was learned.
            predicted = states[:, k, :, :latent]
            variance = torch.tensor(self._settings.prior_error**2)
            if self.residuals is not None:
                mean, variance = self.residuals(self.features(start, plans))
                predicted = predicted + mean

            # What that is worth, and where the next period starts.
            squares = (predicted - self._z_ref).square().sum(-1).amin(1)
            squares = squares + self._caution * latent * variance
            total = total + squares / ahead
            start = torch.cat([predicted[:, -1], states[:, k, -1, latent:]], dim=1)
        return total.clamp_min(1e-12).sqrt()


def _caution(
    attempts: Sequence[Attempt], z_ref: Tensor, settings: IterativeLearningSettings
) -> float:
    """Weight of the variance: smaller as long as recent outcomes are poor.

    By (aim / best recent outcome)².
    """
    best = math.inf
    for attempt in attempts[-settings.recent :]:
        distances = torch.linalg.vector_norm(attempt.z - z_ref, dim=1)
        best = min(best, float(distances.min()))
    good = min(1.0, (settings.aim / max(best, 1e-9)) ** 2)
    return max(settings.least_caution, settings.caution * good)


class _Choice(NamedTuple):
    """A plan, and how it was come by."""

    u: Tensor  # [T, D_u]
    expected: float  # distance to the target [s.d. of z]
    trace: np.ndarray | None  # best distances on the way; None if nothing was searched


class IterativeSearch:
    """A search that learns from each period how the model's predictions err.

    A plan is chosen at the start of a period and sent unchanged. Only the distance of z
    is minimised: what the loss says of tensions is not counted. What was learned is
    about the model and the cloth, not about the target: it stays when that changes.
    While `exploring`, new plans are tried; else the best known one is sent again.

    With `biases`, the first plan is one that the model likes and that led near the
    target with a material like this one. It is sent twice, since the arm swings up in
    the first period. Once p has moved by half a spread of the biases, another material
    is in the hand: attempts are forgotten.

    The trace of a solve has the best expected distance at its start and after each
    iteration. What was learned, `Controller.learned`, holds the `attempts`.

    Args:
        runs: recordings, whose plans that led near the target are the first tries.
        settings: how much is tried, and how far an outcome teaches.
        biases: trained p of the recordings' materials, `{name: [D_p]}`.
    """

    name = "iterative"

    def __init__(
        self,
        runs: Sequence[Run],
        settings: IterativeLearningSettings | None = None,
        *,
        biases: Mapping[str, np.ndarray] | None = None,
    ):
        self.settings = settings_or_default(settings, IterativeLearningSettings)
        self.exploring = True
        self._runs = check_runs(runs)
        self._biases = dict(biases or {}) if self.settings.trust else {}
        self._nearest: tuple[Tensor, _RecordedPlans] | None = None

    def begin(
        self, home: Tensor, settings: ControlSettings, learned: Experience | None = None
    ) -> Experience:
        """A new run; what was learned in another one may stay."""
        _check_longer(self._runs, settings.period)
        if len(home) != settings.period:
            raise ValueError(
                "iterative learning sends plans of a whole period: the horizon of "
                f"{len(home)} steps must be the period of {settings.period}"
            )
        if learned is None:
            return Experience()
        return replace(learned, under_way=None)

    def __call__(self, problem: Problem, learned: Experience) -> Solution:
        """A plan for a new period, or at hand the rest of this period's."""
        z_ref = _target_of(problem)
        z = problem.s[: len(z_ref)]
        now = learned.under_way
        if now is not None:
            now = replace(now, z=torch.cat([now.z, z[None]]))
            learned = replace(learned, under_way=now)
        if problem.t % problem.settings.period:
            return Solution(problem.plan, None, learned)

        # A period is over, and the next one begins.
        attempts = self._after_period(problem, learned)
        learned = replace(learned, attempts=attempts)
        plan, expected, trace = self._choose(problem, learned)
        begun = Attempt(
            problem.s, problem.memory, plan, problem.p, z.new_empty(0, len(z))
        )
        learned = replace(
            learned,
            expected=(*learned.expected, expected)[-ControlSettings.traced :],
            under_way=begun,
            z_ref=z_ref,
        )
        return Solution(plan, trace, learned)

    def forecast(self, problem: Problem, attempts: Sequence[Attempt] = ()) -> _Forecast:
        """What is expected of plans in this problem, after these attempts."""
        z_ref = _target_of(problem)
        caution = _caution(attempts, z_ref, self.settings)
        forecast = _Forecast(problem, z_ref, self.settings, caution)
        if attempts:
            forecast.learn(attempts)
        return forecast

    def basis(self, learned: Experience) -> str:
        """What the plan being sent rests on, in words."""
        if self._biases and len(learned.attempts) < 2:
            return "recordings"
        return f"{len(learned.attempts)} attempts"

    def recorded(self, problem: Problem) -> _RecordedPlans:
        """The recorded plans that led nearest to the target; found once for each."""
        z_ref = _target_of(problem)
        if self._nearest is None or self._nearest[0] is not z_ref:
            period = problem.settings.period
            plans = nearest_plans(self._runs, z_ref, period, self.settings.recorded)
            self._nearest = (z_ref, plans)
        return self._nearest[1]

    def _after_period(
        self, problem: Problem, learned: Experience
    ) -> tuple[Attempt, ...]:
        """The attempts, with that of the period that is over, if there was one."""
        attempts = learned.attempts
        if learned.under_way is not None:
            attempts = (*attempts, learned.under_way)[-self.settings.remembered :]
        if not self._biases:
            return attempts
        kept = []
        for attempt in attempts:
            if self._gap(attempt.p, problem.p) < _SAME_MATERIAL:
                kept.append(attempt)
        return tuple(kept)

    def _gap(self, p: np.ndarray, other: np.ndarray) -> float:
        """Squared distance of two p, over the spread of the biases."""
        squares = float(np.square(p - other).sum())
        if not squares:
            return 0.0
        spread = float(np.var(list(self._biases.values()), axis=0).sum())
        return squares / max(spread, 1e-12)

    def _choose(self, problem: Problem, learned: Experience) -> _Choice:
        """The plan of the next period."""
        unknown = self._biases and len(learned.attempts) < 2
        if unknown and problem.solve and not learned.attempts:
            return self._recorded_plan(problem)
        if unknown or not problem.solve:
            return self._once_more(problem, learned)
        return self._best_plan(problem, learned)

    def _once_more(self, problem: Problem, learned: Experience) -> _Choice:
        """The plan of the period that just ended, and what is expected of it from here.

        Where p has moved since, its attempt may be forgotten already: the plan is that
        of the period itself.
        """
        before = learned.under_way or learned.attempts[-1]
        forecast = self.forecast(problem, learned.attempts)
        with torch.no_grad():
            expected = float(forecast.distance(before.u[None]))
        return _Choice(before.u, expected, None)

    def _recorded_plan(self, problem: Problem) -> _Choice:
        """A recorded plan that is good by prediction, and was with a near material.

        The sum of three squares decides: the distance that is predicted, the one that
        was seen, and the distance in p between the recording's material and this one.
        """
        recorded = self.recorded(problem)
        plans = _within(problem.limits, recorded.u)
        with torch.no_grad():
            expected = self.forecast(problem).distance(plans)

        gaps = {name: self._gap(p, problem.p) for name, p in self._biases.items()}
        gap = np.array([gaps.get(name, 1.0) for name in recorded.material])
        shown = recorded.distance**2 + self.settings.difference * gap
        scores = expected.numpy() ** 2 + self.settings.trust * shown
        best = int(scores.argmin())
        trace = expected[best, None].numpy()
        return _Choice(plans[best], float(expected[best]), trace)

    def _best_plan(self, problem: Problem, learned: Experience) -> _Choice:
        """The plan that is expected to lead nearest, by a descent from some starts."""
        loss = self.forecast(problem, learned.attempts).distance
        tried = [attempt.u for attempt in learned.attempts]

        # Where to start: plans that were tried, recorded ones, and the one at hand.
        starts = [torch.stack(tried)] if tried else []
        if self.exploring or not tried:
            starts.append(_within(problem.limits, self.recorded(problem).u))
            starts.append(problem.plan[None])
        plans = torch.cat(starts)
        with torch.no_grad():
            losses = loss(plans)
        count = self.settings.starts if self.exploring else 1
        best = losses.argsort()[:count]
        return self._improved(problem, loss, plans[best], losses[best])

    def _improved(
        self, problem: Problem, loss: _LossOfPlans, plans: Tensor, losses: Tensor
    ) -> _Choice:
        """The best plan after a descent from plans `[B, T, D_u]` with losses `[B]`."""
        limits = problem.limits
        few = replace(
            problem.settings, candidates=_CANDIDATES, smallest_step=_SMALLEST_STEP
        )
        gamma = few.step_sizes()[:, None, None, None]
        trace = [losses.min().item()]
        for _ in range(self.settings.iterations if self.exploring else 0):
            _, direction = steepest_ascent(loss, plans, limits.scale)
            steps = gamma * (direction * limits.scale)
            plans, losses = best_step(loss, plans, steps, limits)
            trace.append(losses.min().item())
        return _Choice(plans[losses.argmin()], trace[-1], np.array(trace))


def _target_of(problem: Problem) -> Tensor:
    """The target `[D_z]`, which the loss of an image knows."""
    return problem.loss_of.z_ref  # type: ignore[attr-defined]


def _within(limits: Limits, plans: np.ndarray) -> Tensor:
    """Recorded plans `[N, T, D_u]` within the limits of the commands."""
    recorded = torch.as_tensor(plans, dtype=torch.float32)
    return recorded.clamp(limits.lower, limits.upper)
