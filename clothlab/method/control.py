"""Model predictive control by gradient: W and p stay, only the commands move.

A controller is composed of four things, and each of them may be another one:

* a model, which predicts states from commands with one p;
* limits of the commands;
* a loss of predicted states and commands, which says what is wanted;
* a search for commands with a low loss; `GradientSearch` is the paper's.

Source: the paper's section on control, eqs. 5 to 7.
"""

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, choose, settings_or_default
from clothlab.method._inputs import check_model
from clothlab.method._rollouts import Rollout, rollout_of
from clothlab.method.model import DPMPB, Memory

# The loss [B] of predicted states [B, T, D_s] and the commands [B, T, D_u] that lead to
# them, sent from control step t on.
Loss = Callable[[Tensor, Tensor, int], Tensor]
_LossOfPlans = Callable[[Tensor], Tensor]  # plans [B, T, D_u] → loss of each [B]


@dataclass(frozen=True)
class ControlSettings:
    """The constants of the control; the defaults are the paper's."""

    horizon: int = 8  # [step] N_seq
    candidates: int = 30  # N_batch, step sizes tried at once
    iterations: int = 3  # N_iter
    period: int = 8  # [step] N_periodic
    # gamma_max: how far a whole plan moves at most, in standard deviations of u.
    largest_step: float = 1.0
    # A logarithmic scale of step sizes needs a lower end; the paper gives none.
    smallest_step: float = 1e-3
    # The command that a plan gets at its end when it moves on by a step: its "last"
    # once more, as in the paper, or "earlier": the commands of the last period come
    # again, each one step earlier in this one. Older settings call that "periodic".
    warm_start: str = "last"
    # w_loss, the price of muscle tensions in the loss of an image.
    tension_weight: float = 0.001  # [1/N]

    # Entries that a trace keeps: of steps, half an hour.
    traced: ClassVar[int] = 10_000

    def __post_init__(self) -> None:
        if not 0 < self.smallest_step <= self.largest_step:
            raise ValueError(
                "ControlSettings: step sizes go from smallest_step to largest_step, "
                f"got {self.smallest_step} to {self.largest_step}"
            )

    def step_sizes(self) -> Tensor:
        """Values of gamma to try, `[candidates]`, on a logarithmic scale.

        The first is 0: staying where it is keeps the loss from rising.
        """
        low = np.log10(self.smallest_step)
        high = np.log10(self.largest_step)
        rising = torch.logspace(low, high, self.candidates - 1)
        return torch.cat([torch.zeros(1), rising])


class Limits(NamedTuple):
    """Between which commands a plan must lie, and in what unit it is changed."""

    lower: Tensor  # [D_u]
    upper: Tensor  # [D_u]
    # One unit of gamma [D_u]: a standard deviation of u, and 0 for a command whose
    # range is a point, which the descent leaves out (the paper's "w/o stiffness").
    scale: Tensor


def steepest_ascent(
    loss: _LossOfPlans, u: Tensor, scale: Tensor
) -> tuple[Tensor, Tensor]:
    """Losses of plans, and the direction in which each rises (eq. 6).

    From plans u `[B, T, D_u]` and one unit of each command, `scale` `[D_u]`: the losses
    `[B]`, and their gradients `[B, T, D_u]` in these units, each of length one.
    """
    u = u.detach().requires_grad_()
    losses = loss(u)
    (gradient,) = torch.autograd.grad(losses.sum(), u)
    gradient = gradient * scale
    length = torch.linalg.vector_norm(gradient, dim=(1, 2), keepdim=True)
    return losses.detach(), gradient / length.clamp_min(1e-12)


@torch.no_grad()
def best_step(
    loss: _LossOfPlans, u: Tensor, steps: Tensor, limits: Limits
) -> tuple[Tensor, Tensor]:
    """The best of several steps from each plan, and its loss (eq. 7).

    From plans u `[B, T, D_u]` and steps back from them `[K, B, T, D_u]`: the best
    candidate of each plan, `[B, T, D_u]`, and the losses of these, `[B]`.
    """
    candidates = (u - steps).clamp(limits.lower, limits.upper)
    count, plans = candidates.shape[:2]
    losses = loss(candidates.flatten(0, 1)).unflatten(0, (count, plans))
    losses = losses.masked_fill(losses.isnan(), torch.inf)  # argmin would choose these
    best = losses.argmin(0)
    return candidates[best, torch.arange(plans)], losses.amin(0)


def optimise_commands(
    loss: _LossOfPlans, u: Tensor, limits: Limits, settings: ControlSettings
) -> tuple[Tensor, np.ndarray]:
    """Descend the gradient of the loss on the commands (eqs. 5 to 7).

    In each iteration many step sizes are tried at once, and the best is kept.

    Args:
        loss: of plans `[B, T, D_u]`, one number for each, `[B]`.
        u: the plan to begin with, `[T, D_u]`; it is not changed.
        limits: of the commands.
        settings: how many iterations and step sizes.

    Returns:
        The best plan `[T, D_u]`, and its loss at the start and after each iteration,
        `[iterations + 1]`.
    """
    gamma = settings.step_sizes()[:, None, None, None] * limits.scale
    plan = u.clamp(limits.lower, limits.upper)[None]
    trace = []
    for _ in range(settings.iterations):
        before, direction = steepest_ascent(loss, plan, limits.scale)
        plan, after = best_step(loss, plan, gamma * direction, limits)
        trace.append(before)
    trace.append(after)
    return plan[0], torch.cat(trace).double().numpy()


# The equations end here. What follows puts them to use, step after step of a run.


@dataclass(frozen=True, eq=False)
class Problem:
    """What a search is asked in one control step: which commands come next?"""

    s: Tensor  # the state now [D_s]
    memory: Memory  # the model's recurrent state before it
    p: np.ndarray  # the parametric bias in use [D_p]
    t: int  # control steps since the reset
    plan: Tensor  # that of the step before, moved on by one [T, D_u]
    solve: bool  # whether to search, or to go on with what is planned
    model: DPMPB
    rollout: Rollout  # the same model with this p, and faster
    loss_of: Loss  # what is wanted
    limits: Limits
    settings: ControlSettings

    def predict(self, plans: Tensor) -> Tensor:
        """States `[B, T, D_s]` to which plans `[B, T, D_u]` lead from here."""
        return self.rollout(self.s, plans, self.memory)

    def loss(self, plans: Tensor) -> Tensor:
        """Loss of each of the plans `[B, T, D_u]`, `[B]`."""
        losses = self.loss_of(self.predict(plans), plans, self.t)
        if losses.shape != plans.shape[:1]:
            raise ValueError(
                f"a loss is [B], one number for each of {len(plans)} plans, got "
                f"{list(losses.shape)}"
            )
        return losses


class Solution(NamedTuple):
    """What a search answers."""

    plan: Tensor  # [T, D_u]; its first command is sent
    # Losses on the way to it; None where the plan was gone on with.
    trace: np.ndarray | None
    learned: Any = None  # what the search wants to be given in the next step


class Search(Protocol):
    """Looks for a plan. What it learns in a run goes through the controller's hands.

    So an interrupted step leaves nothing half learned.
    """

    name: str  # of a policy with this search, in recorded trials

    def begin(
        self, home: Tensor, settings: ControlSettings, learned: Any = None
    ) -> Any:
        """What is known before the first step, perhaps of what was `learned` before.

        The first plan is `home` `[T, D_u]`. Here a search says if it doesn't fit.
        """

    def __call__(self, problem: Problem, learned: Any) -> Solution:
        """A plan, from the problem and from what was returned as `learned` before."""


class GradientSearch:
    """The paper's search: down the gradient, by the best of many step sizes.

    With `plans` `[N, T, D_u]`, each period starts from the one of them that the model
    likes best, where that beats the plan at hand. The paper has none and leaves open
    where a first solve starts.
    """

    name = "control"

    def __init__(self, plans: ArrayLike | None = None):
        empty = np.empty((0, 1, 1))
        plans = empty if plans is None else plans
        plans = check_array("plans", plans, ("N", "T", "D_u"), np.float32)
        self._plans = torch.as_tensor(plans)

    def begin(
        self, home: Tensor, settings: ControlSettings, learned: Any = None
    ) -> None:
        """Nothing is learned; but plans must be as long as those of the controller."""
        if len(self._plans):
            check_array("plans", self._plans, ("N", *home.shape), np.float32)

    def __call__(self, problem: Problem, learned: None = None) -> Solution:
        """The plan at hand, improved by some steps down its gradient."""
        if not problem.solve:
            return Solution(problem.plan, None)

        # Where to start: once a period, perhaps from a recorded plan.
        start = problem.plan
        if len(self._plans) and problem.t % problem.settings.period == 0:
            limits = problem.limits
            plans = self._plans.clamp(limits.lower, limits.upper)
            starts = torch.cat([start[None], plans])
            with torch.no_grad():
                start = starts[problem.loss(starts).argmin()]

        plan, trace = optimise_commands(
            problem.loss, start, problem.limits, problem.settings
        )
        return Solution(plan, trace)


@dataclass(frozen=True, eq=False)
class _Progress:
    """How far a run has come.

    It is never changed, only replaced as a whole. So a step happens wholly or not at
    all: an interrupt or an error in its middle leaves the progress of before.
    """

    plan: Tensor  # being sent [T, D_u]
    sent: Tensor  # commands of the last period, the latest last [period or fewer, D_u]
    memory: Memory  # the model's recurrent state before the last step
    learned: Any  # by the search
    last: tuple[Tensor, Tensor] | None = None  # state and command of the last step
    t: int = 0  # control steps since the reset
    solves: int = 0
    trace: tuple[np.ndarray, ...] = ()  # of each solve


class Controller:
    """Model predictive control with any differentiable loss of states and commands.

    Args:
        model: a trained one.
        loss: `loss(states, commands, t)` is the loss `[B]` of states `[B, T, D_s]`
            that are predicted for commands `[B, T, D_u]` sent from control step t on.
        p: parametric bias of the material, `[D_p]`.
        lower: smallest commands, `[D_u]`.
        upper: largest commands, `[D_u]`; where both are equal, the command is fixed.
        settings: the constants of the control.
        home: command that the first plan repeats, `[D_u]`; by default the middle
            between the limits.
        search: how better commands are looked for; by default `GradientSearch()`.
    """

    def __init__(
        self,
        model: DPMPB,
        loss: Loss,
        p: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
        settings: ControlSettings | None = None,
        *,
        home: ArrayLike | None = None,
        search: Search | None = None,
    ):
        # What the controller is composed of.
        self.model = check_model(model)
        self.loss = loss
        self.settings = settings_or_default(settings, ControlSettings)
        self.limits = _limits(model, lower, upper)
        self.search: Search = GradientSearch() if search is None else search

        # How a plan goes on, and which is the first.
        warm_starts = {"last": False, "earlier": True, "periodic": True}
        self._repeats = choose("warm start", self.settings.warm_start, warm_starts)
        middle = (self.limits.lower + self.limits.upper) / 2
        if home is not None:
            middle = torch.as_tensor(
                check_array("home", home, middle.shape, np.float32)
            )
        self._home = middle.expand(self.settings.horizon, -1)

        # p or a target that another thread sets waits until a step is over, which
        # otherwise would begin with one and end with the other.
        self._lock = threading.RLock()
        self._rollout_of_model = rollout_of(model)
        self._belief = self._believing(p)
        self._progress = self._beginning()

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._belief[0].copy()

    @property
    def trace(self) -> list[np.ndarray]:
        """Losses of each solve since the reset, of the last `ControlSettings.traced`.

        Of `GradientSearch`, each has the loss at the start and after each iteration.
        """
        return list(self._progress.trace)

    @property
    def solves(self) -> int:
        """How many solves there were since the reset."""
        return self._progress.solves

    @property
    def learned(self) -> Any:
        """What the search has learned since the reset."""
        return self._progress.learned

    @property
    def period_ended(self) -> bool:
        """Whether the last command was the last of its period."""
        now = self._progress
        return now.last is not None and now.t % self.settings.period == 0

    @property
    def steps_left(self) -> int:
        """Steps of the period that come after the command being sent."""
        return -self._progress.t % self.settings.period

    def between_steps(self) -> contextlib.AbstractContextManager:
        """What happens in `with controller.between_steps():` meets no step halfway."""
        return self._lock

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next step on."""
        with self.between_steps():
            self._belief = self._believing(p)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run: phase, memory, plan, and what the search learned."""
        with self.between_steps():
            self._progress = self._beginning()

    def resume(self) -> None:
        """Begin anew, as after somebody moved the robot; what was learned stays."""
        with self.between_steps():
            self._progress = self._beginning(self.learned)

    def act(self, s: ArrayLike, *, solve: bool = True) -> np.ndarray:
        """The next command `[D_u]` in state s `[D_s]`.

        Without a solve it is that of the plan, where there is one already.
        """
        state = self._checked_state(s)
        with self.between_steps():
            # Ask the search.
            now = self._moved_on()
            found = self.search(self._problem(state, now, solve), now.learned)
            if not found.plan.isfinite().all():
                raise ValueError(
                    "the gradient of the loss is not finite, as that of `sqrt` at 0; "
                    "try `vector_norm`"
                )

            # Note what was sent; only now has the step happened.
            command = found.plan[0]
            after = replace(
                now,
                plan=found.plan,
                last=(state, command),
                learned=found.learned,
                t=now.t + 1,
            )
            if found.trace is not None:
                trace = (*now.trace, found.trace)[-self.settings.traced :]
                after = replace(after, solves=now.solves + 1, trace=trace)
            sent = command.double().numpy()
            self._progress = after
        return sent

    def follow(self, s: ArrayLike, u: ArrayLike) -> None:
        """Take in a step that something else commanded.

        The memory goes on, plan and phase stand still. State s `[D_s]` and command u
        `[D_u]`.
        """
        state = self._checked_state(s)
        command = check_array("u", u, (self.model.command_size,), np.float32)
        with self.between_steps():
            last = (state, torch.as_tensor(command))
            memory = self._memory_after_last()
            self._progress = replace(self._progress, memory=memory, last=last)

    def problem(self, s: ArrayLike) -> Problem:
        """What the search would be asked in state s `[D_s]`, were it seen next."""
        with self.between_steps():
            return self._problem(self._checked_state(s), self._moved_on(), True)

    def foresee(self, steps: int) -> Tensor | None:
        """States `[steps, D_s]` to which the plan leads; None before the first step."""
        with self.between_steps():
            now = self._progress
            if now.last is None:
                return None
            state, _ = now.last
            _, rollout = self._belief
            with torch.no_grad():
                return rollout(state, now.plan[None, :steps], now.memory)[0]

    def _checked_state(self, s: ArrayLike) -> Tensor:
        s = check_array("s", s, (self.model.state_size,), np.float32)
        return torch.as_tensor(s)

    def _believing(self, p: ArrayLike) -> tuple[np.ndarray, Rollout]:
        """A parametric bias, and the model with it."""
        p = check_array("p", p, (self.model.bias_size,), np.float32)
        return p, self._rollout_of_model(self.model, torch.as_tensor(p))

    def _beginning(self, learned: Any = None) -> _Progress:
        return _Progress(
            plan=self._home,
            sent=self._home[:0],
            memory=self.model.initial_memory(),
            learned=self.search.begin(self._home, self.settings, learned),
        )

    def _problem(self, s: Tensor, now: _Progress, solve: bool) -> Problem:
        p, rollout = self._belief
        return Problem(
            s=s,
            memory=now.memory,
            p=p,
            t=now.t,
            plan=now.plan,
            solve=solve or not now.t,  # a first plan needs a solve
            model=self.model,
            rollout=rollout,
            loss_of=self.loss,
            limits=self.limits,
            settings=self.settings,
        )

    def _moved_on(self) -> _Progress:
        """The progress when the next state is seen: a step has passed."""
        now = replace(self._progress, memory=self._memory_after_last())
        if not now.t:
            return now

        # One command was sent, and one is added: at the phase of what was just sent, so
        # that what was sent a whole period ago comes one step earlier.
        period = self.settings.period
        sent = torch.cat([now.sent, now.plan[:1]])[-period:]
        added = now.plan[-1:]
        if self._repeats and len(sent) == period:
            added = sent[:1]
        return replace(now, sent=sent, plan=torch.cat([now.plan[1:], added]))

    def _memory_after_last(self) -> Memory:
        """The recurrent state follows what was observed, not what was predicted."""
        now = self._progress
        if now.last is None:
            return now.memory
        _, rollout = self._belief
        return rollout.follow(*now.last, now.memory)


def _limits(model: DPMPB, lower: ArrayLike, upper: ArrayLike) -> Limits:
    """Limits `[D_u]` that fit the model; a ValueError if a lower one is above."""
    shape = (model.command_size,)
    low = torch.as_tensor(check_array("lower", lower, shape, np.float32))
    high = torch.as_tensor(check_array("upper", upper, shape, np.float32))
    if not (low <= high).all():
        raise ValueError(
            f"a lower limit is above the upper one: {low.numpy()}, {high.numpy()}"
        )
    return Limits(low, high, model.u_std * (high > low))
