"""Iterative learning control: a policy that learns from its own outcomes.

The model predicts where a plan leads, and the plan with the best prediction is one
whose error is in its favour. So a plan is sent unchanged for one period, and its
residual, outcome minus prediction, is learned by a Gaussian process over plans and the
states that they start from. The next plan is the one whose corrected prediction is
best,

    z(u) = h(s, u, p) + mean(u),    E‖z_ref - z‖² = ‖z_ref - z(u)‖² + D_z variance(u),

where the variance is small near plans that were tried and large elsewhere: a trust
region that needs no setting.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, setting, settings_or_default
from clothlab.masks import Observation
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import ControlPolicy, observe
from clothlab.method.control import TRACED, ControlSettings, best_step, downhill, whole
from clothlab.method.data import Run, check_runs
from clothlab.method.model import DPMPB, Memory


@dataclass(frozen=True)
class IterativeLearningSettings(Checked):
    """How much is tried, and how far an outcome teaches."""

    # a plan must be good when it is repeated, too
    lookahead: int = setting(3, "period", at_least=1)
    # Stretches that led near the target, among which to look for starts
    recorded: int = setting(150, at_least=1)
    # Best-looking plans from which the descent begins
    starts: int = setting(6, at_least=1)
    iterations: int = setting(3, at_least=0)  # of the descent
    # In what recordings showed, when the first plan is chosen
    trust: float = setting(1.0, at_least=0)
    # What a spread of p between their material and this one counts there
    difference: float = setting(0.1, at_least=0)
    # The variance counts little while outcomes are poor, and in full once they are
    # good: then there is much to lose.
    caution: float = setting(1.0, at_least=0)
    least_caution: float = setting(0.05, at_least=0)
    aim: float = setting(0.1, "s.d. of z", above=0)  # what is good
    # The best of so many outcomes says how good they are
    recent: int = setting(5, "period", at_least=1)
    # How far from a plan its outcome still teaches
    plan_scale: float = setting(1.0, "s.d. of u", above=0)
    # And how far from its start
    state_scale: float = setting(3.0, "s.d. of s", above=0)
    # Of a prediction, before any outcome is known
    prior_error: float = setting(0.55, "s.d. of z", above=0)
    # How many outcomes that prior is worth
    prior_count: float = setting(2.0, "period", above=0)
    # Variance of what does not repeat, over that of all residuals
    noise: float = setting(0.03, above=0)
    remembered: int = setting(60, "period", at_least=1)


class RecordedPlans(NamedTuple):
    """Stretches of recorded commands, and the states that followed."""

    u: np.ndarray  # [N, T, D_u]
    # Of what was seen after the last command to a target [N] [s.d. of z]
    distance: np.ndarray
    material: np.ndarray  # names [N]


def nearest_plans(
    runs: Sequence[Run], z_ref: ArrayLike, horizon: int = 8, count: int = 150
) -> RecordedPlans:
    """The recorded plans, `count` or fewer, after which z was seen nearest to `z_ref`,
    best first.

    No two plans of one run overlap by more than half.
    """
    runs = check_runs(runs)
    z_ref = check_array("z_ref", z_ref, ("D_z",), np.float32)
    if runs and len(z_ref) > runs[0].s.shape[1]:
        raise ValueError(
            f"z_ref has {len(z_ref)} numbers, more than the {runs[0].s.shape[1]} of a state"
        )
    from_each = -(-count // max(len(runs), 1))
    found = []
    for run in runs:
        distance = np.linalg.norm(run.s[horizon:, : len(z_ref)] - z_ref, axis=1)
        for _ in range(min(from_each, len(distance) // horizon)):
            start = int(distance.argmin())
            found.append(
                (run.u[start : start + horizon], float(distance[start]), run.material)
            )
            distance[max(0, start - horizon // 2 + 1) : start + horizon // 2] = np.inf
    if not found:
        raise ValueError(f"plans of {horizon} steps need recorded runs that are longer")
    u, distances, materials = zip(
        *sorted(found, key=lambda plan: plan[1])[:count], strict=True
    )
    return RecordedPlans(
        np.stack(u).astype(np.float64), np.array(distances), np.array(materials)
    )


@dataclass(frozen=True, eq=False)
class Attempt:
    """One period: a plan, where it started, and where it led."""

    s: Tensor  # state at its start [D_s]
    memory: Memory  # recurrent state there
    u: Tensor  # the plan [T, D_u]
    p: np.ndarray  # the bias in use [D_p]
    z: Tensor  # what was seen after each command [T, D_z]


class ResidualModel:
    """Gaussian process of residuals, outcomes minus predictions `[N, T, D_z]`, with one
    squared-exponential kernel.

    Features x `[N, D]` of the plans that were tried are in units of the kernel's
    length.
    """

    def __init__(
        self, x: Tensor, residuals: Tensor, settings: IterativeLearningSettings
    ):
        self._x, self._shape = x, residuals.shape[1:]
        kernel = _kernel(x, x) + settings.noise * torch.eye(len(x), dtype=x.dtype)
        self._inverse = torch.linalg.inv(kernel)
        self._weights = self._inverse @ residuals.flatten(1)
        squares = residuals.square().mean(dim=(1, 2)).sum()
        # Of a prediction's error far from all that was tried [(s.d. of z)²].
        self.variance = (settings.prior_count * settings.prior_error**2 + squares) / (
            settings.prior_count + len(x)
        )

    def __call__(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Mean `[B, T, D_z]` and variance `[B]` of the residuals of plans with features
        x `[B, D]`.
        """
        k = _kernel(x, self._x)
        known = ((k @ self._inverse) * k).sum(1)
        return (k @ self._weights).unflatten(1, self._shape), self.variance * (
            1 - known
        ).clamp_min(0)


def _kernel(a: Tensor, b: Tensor) -> Tensor:
    return torch.exp(-0.5 * (a[:, None] - b).square().sum(-1))


class IterativeLearningPolicy(ControlPolicy):
    """Realises a target image once a period, and learns from each period how the
    model's predictions err.

    A plan is chosen at the start of a period and sent unchanged. What was learned is
    about the model and the cloth, not about the target: it stays when the target
    changes. While `exploring`, it tries new plans; else it sends the best known one
    again. The first plans are those of recorded `runs` after which the cloth was
    nearest to the target.

    With `biases`, the trained p of the runs' materials, the first plan is one that the
    model likes and that led near the target with a material like this one. It is sent
    twice, since the arm swings up in the first period. Once p has moved by half a
    spread of the biases, another material is in the hand: attempts are forgotten.

    Each period so far is in `attempts`, and its expected distance [s.d. of z] in
    `predicted_distances`; `trace` has the best expected distances at the start of each
    solve and after each iteration.
    """

    name = "iterative"

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Any,
        target: ArrayLike,
        p: ArrayLike,
        runs: Sequence[Run],
        settings: IterativeLearningSettings | None = None,
        control: ControlSettings | None = None,
        biases: Mapping[str, np.ndarray] | None = None,
    ):
        self.learning = settings_or_default(settings, IterativeLearningSettings)
        self.exploring = True
        self._runs = check_runs(runs)
        self._biases = dict(biases or {}) if self.learning.trust else {}
        super().__init__(model, autoencoder, arm, target, p, control)

    @whole
    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next period on; what was learned
        stays.
        """
        super().set_target(mask)
        self._predicted_distance: float | None = None
        self._recorded = nearest_plans(
            self._runs, self.z_ref, self.settings.period, self.learning.recorded
        )
        self._plans = torch.as_tensor(self._recorded.u, dtype=torch.float32).clamp(
            self.lower, self.upper
        )

    def reset(self, seed: int = 0) -> None:
        """Forget the last run: phase, memory, plan and what was learned."""
        self.attempts: list[Attempt] = []
        self.predicted_distances: list[float] = []
        self.resume(seed)

    def resume(self, seed: int = 0) -> None:
        """Begin a period anew, as after somebody else has moved the arm; what was
        learned stays.
        """
        super().reset(seed)
        self._seen: list[Tensor] = []
        self._begun: tuple[Tensor, Memory, Tensor, np.ndarray] | None = (
            None  # what an attempt begins with
        )
        self._predicted_distance = None

    @property
    def predicted_distance(self) -> float | None:
        """Expected distance of the plan being sent [s.d. of z]; None before there is
        one for the present target.
        """
        return self._predicted_distance

    @property
    def basis(self) -> str:
        """What the plan being sent rests on, in words."""
        unknown = self._biases and len(self.attempts) < 2
        return "recordings" if unknown else f"{len(self.attempts)} attempts"

    def __call__(self, observation: Observation) -> np.ndarray:
        return self._step(observation, self._plan)

    def step_without_solving(self, observation: Observation) -> np.ndarray:
        """Return the next command of the plan, `[D_u]`, which is sent once more where a
        period begins.
        """
        return self._step(
            observation, self._plan if self._begun is None else self._repeat
        )

    @whole
    def _step(
        self,
        observation: Observation,
        choose_plan: Callable[[Tensor], tuple[Tensor, float]],
    ) -> np.ndarray:
        self._move_on()
        s = torch.as_tensor(observe(self.autoencoder, observation))
        self._seen = [*self._seen, s[self.layout.z]]
        if self._t % self.settings.period == 0:
            if self._begun is not None:
                attempt = Attempt(*self._begun, torch.stack(self._seen))
                self.attempts = [*self.attempts, attempt][-self.learning.remembered :]
            if self._biases:
                self.attempts = [
                    each for each in self.attempts if self._gap(each.p) < 0.25
                ]
            self._u, self._predicted_distance = choose_plan(s)
            self._begun = (s, self._memory, self._u, self.p)
            self.predicted_distances = [
                *self.predicted_distances,
                self._predicted_distance,
            ][-TRACED:]
            self._seen = []
        return self._send(s)

    def residual_model(self) -> ResidualModel | None:
        """How predictions with the present p erred in the attempts so far; None before
        the first outcome.
        """
        if not self.attempts:
            return None
        s, u, z = (
            torch.stack([getattr(each, name) for each in self.attempts])
            for name in ("s", "u", "z")
        )
        parts = zip(*(each.memory for each in self.attempts), strict=True)
        with torch.no_grad():
            predicted = self._predict(
                s, u, Memory(*(torch.cat(part, dim=1) for part in parts))
            )[..., self.layout.z]
            return ResidualModel(self._features(s, u), z - predicted, self.learning)

    def expected_distance(
        self, s: Tensor, u: Tensor, residuals: ResidualModel | None
    ) -> Tensor:
        """Expected distance to the target when plans `[B, T, D_u]` are sent from s
        `[D_s]`, again and again.

        Root mean square over the periods looked ahead, each with its best step, `[B]`
        [s.d. of z].
        """
        ahead, period, z = self.learning.lookahead, self.settings.period, self.layout.z
        caution = self._caution() * len(self.z_ref)
        states = self._predict(s, u.repeat(1, ahead, 1), self._memory).unflatten(
            1, (ahead, period)
        )
        start, total = s.expand(len(u), -1), torch.zeros(len(u))
        for k in range(ahead):
            predicted, variance = (
                states[:, k, :, z],
                torch.tensor(self.learning.prior_error**2),
            )
            if residuals is not None:
                mean, variance = residuals(self._features(start, u))
                predicted = predicted + mean
            squares = (predicted - self.z_ref).square().sum(-1).amin(
                1
            ) + caution * variance
            total = total + squares / ahead
            start = torch.cat([predicted[:, -1], states[:, k, -1, z.stop :]], dim=1)
        return total.clamp_min(1e-12).sqrt()

    def _caution(self) -> float:
        """Weight of the variance: `caution`, less by (aim / best recent outcome)² as
        long as that is poor.
        """
        settings = self.learning
        recent = self.attempts[-settings.recent :]
        distances = [
            float(torch.linalg.vector_norm(each.z - self.z_ref, dim=1).min())
            for each in recent
        ]
        best = min(distances, default=math.inf)
        return max(
            settings.least_caution,
            settings.caution * min(1.0, (settings.aim / max(best, 1e-9)) ** 2),
        )

    def _features(self, s: Tensor, u: Tensor) -> Tensor:
        plan = (u / self.model.u_std).flatten(1) / self.learning.plan_scale
        return torch.cat(
            [plan, s / self.model.s_std / self.learning.state_scale], dim=1
        )

    def _gap(self, p: np.ndarray) -> float:
        """Squared distance of another p to the present one, over the spread of the
        biases.
        """
        squares = float(np.square(p - self.p).sum())
        return (
            squares
            / max(float(np.var(list(self._biases.values()), axis=0).sum()), 1e-12)
            if squares
            else 0.0
        )

    def _recorded_plan(self, s: Tensor) -> tuple[Tensor, float]:
        """The recorded plan that is near by prediction and was near, with a material
        whose p is near.
        """
        gaps = {name: self._gap(p) for name, p in self._biases.items()}
        gap = np.array([gaps.get(name, 1.0) for name in self._recorded.material])
        with torch.no_grad():
            expected = self.expected_distance(s, self._plans, None)
        shown = self._recorded.distance**2 + self.learning.difference * gap
        best = int((expected.numpy() ** 2 + self.learning.trust * shown).argmin())
        self._note(expected[best, None].numpy())
        return self._plans[best], float(expected[best])

    def _plan(self, s: Tensor) -> tuple[Tensor, float]:
        if self._biases and len(self.attempts) < 2:
            return self._repeat(s) if self.attempts else self._recorded_plan(s)
        residuals = self.residual_model()

        def loss(plans: Tensor) -> Tensor:
            return self.expected_distance(s, plans, residuals)

        tried = [attempt.u for attempt in self.attempts]
        starts = torch.stack(tried) if tried else self._plans[:0]
        if self.exploring or not tried:
            starts = torch.cat([starts, self._plans, self._u[None]])
        with torch.no_grad():
            losses = loss(starts)
        best = losses.argsort()[: self.learning.starts if self.exploring else 1]
        u, losses = starts[best], losses[best]
        trace = [losses.min().item()]
        sizes = torch.cat(
            [
                torch.zeros(1),
                torch.logspace(-2.5, math.log10(self.settings.largest_step), 8),
            ]
        )
        for _ in range(self.learning.iterations if self.exploring else 0):
            _, direction = downhill(loss, u, self.scale)
            steps = sizes[:, None, None, None] * (direction * self.scale)
            u, losses = best_step(loss, u, steps, self.lower, self.upper)
            trace.append(losses.min().item())
        self._note(np.array(trace))
        return u[losses.argmin()], trace[-1]

    def _repeat(self, s: Tensor) -> tuple[Tensor, float]:
        """The plan of the period that just ended, and what is expected of it from here.

        Where p has moved since, its attempt may be forgotten already: the plan is that
        of the period itself.
        """
        u = self.attempts[-1].u if self._begun is None else self._begun[2]
        with torch.no_grad():
            return u, float(self.expected_distance(s, u[None], self.residual_model()))
