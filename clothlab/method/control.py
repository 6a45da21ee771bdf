"""Model predictive control by gradient: W and p stay, only the commands move.

Source: the paper's section on control, eqs. 5 to 7.
"""

import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab.method.model import DPMPB, check_model, numbers, predict, usual_torch

# So many standard deviations of the trained commands are another unit.
_OTHER_UNIT = 30.0

# What a controller is given: the loss [B] of predicted states [B, T, D_s] and of the
# commands [B, T, D_u] that lead to them, sent from control step t on.
Loss = Callable[[Tensor, Tensor, int], Tensor]
# What is descended: the loss [B] of plans, which are commands [B, T, D_u].
PlanLoss = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class ControlSettings:
    """The constants of the control; the defaults are the paper's."""

    horizon: int = 8  # N_seq [step]
    candidates: int = 30  # N_batch, step sizes tried at once
    iterations: int = 3  # N_iter
    period: int = 8  # N_periodic [step]
    # gamma_max: how far a whole plan moves at most in one iteration, in standard
    # deviations of u.
    largest_step: float = 1.0
    # A logarithmic scale of step sizes needs a lower end; the paper gives none.
    smallest_step: float = 1e-3
    # The command that a plan gets at its end when it moves on by a step: its "last"
    # once more, as in the paper; or that which was sent one "earlier" period ago, so
    # that a good throw comes again.
    warm_start: str = "last"
    tension_weight: float = 0.001  # w_loss, the price of muscle tensions [1/N]

    def __post_init__(self) -> None:
        if self.warm_start not in ("last", "earlier"):
            raise ValueError(
                f"unknown warm_start {self.warm_start!r}; choose from last, earlier"
            )

        for name, least in (("horizon", 1), ("period", 1), ("iterations", 1)):
            if getattr(self, name) < least:
                raise ValueError(
                    f"{name} is at least {least}, got {getattr(self, name)}"
                )
        if self.candidates < 2:
            raise ValueError(
                "candidates are at least 2, since the first step is of size 0, got "
                f"{self.candidates}"
            )

        if not 0 < self.smallest_step <= self.largest_step:
            raise ValueError(
                "step sizes rise from smallest_step to largest_step, got "
                f"{self.smallest_step} to {self.largest_step}"
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
    # One unit of gamma [D_u]: a standard deviation of u. It is 0 for a command with
    # equal limits, which no plan moves: so a stiffness is held (the paper's "w/o
    # stiffness").
    scale: Tensor


def steepest_ascent(loss: PlanLoss, u: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Losses of plans, and the direction in which each rises most (eq. 6).

    From plans u `[B, T, D_u]` and one unit of each command, `scale` `[D_u]`: the losses
    `[B]`, and their gradients `[B, T, D_u]` with respect to v = u / scale, each of
    length one. A step of gamma in v is one of gamma times scale in u.
    """
    with torch.enable_grad():
        u = u.detach().requires_grad_()
        losses = loss(u)
        if not losses.requires_grad:
            raise ValueError(
                "the loss has no gradient: compute it of the predicted states and the "
                "commands by torch alone, without `detach`"
            )
        (gradient,) = torch.autograd.grad(losses.sum(), u)
    gradient = gradient * scale
    length = torch.linalg.vector_norm(gradient, dim=(1, 2), keepdim=True)
    return losses.detach(), gradient / length.clamp_min(1e-12)


@torch.no_grad()
def best_step(
    loss: PlanLoss, u: Tensor, moves: Tensor, limits: Limits
) -> tuple[Tensor, Tensor]:
    """The best of several moves of each plan, and its loss (eq. 7).

    From plans u `[B, T, D_u]` and moves `[K, B, T, D_u]`, which are subtracted: the
    best candidate of each plan, `[B, T, D_u]`, and the losses of these, `[B]`.
    """
    candidates = (u - moves).clamp(limits.lower, limits.upper)
    count, plans = candidates.shape[:2]
    losses = loss(candidates.flatten(0, 1)).unflatten(0, (count, plans))
    losses = losses.masked_fill(losses.isnan(), torch.inf)  # argmin would choose these
    best = losses.argmin(0)
    return candidates[best, torch.arange(plans)], losses.amin(0)


def optimise_commands(
    loss: PlanLoss, u: Tensor, limits: Limits, settings: ControlSettings
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
    sizes = settings.step_sizes()[:, None, None, None] * limits.scale
    plan = u.clamp(limits.lower, limits.upper)[None]
    trace = []
    for _ in range(settings.iterations):
        before, direction = steepest_ascent(loss, plan, limits.scale)
        plan, after = best_step(loss, plan, sizes * direction, limits)
        trace.append(before)
    trace.append(after)
    return plan[0], torch.cat(trace).double().numpy()


def _warn_of_units(model: DPMPB, low: Tensor, high: Tensor) -> None:
    """Warn of limits `[D_u]` far beyond the commands that the model was trained on."""
    far = ((torch.stack([low, high]) - model.u_mean) / model.u_std).abs().amax(0)
    k = int(far.argmax())
    if far[k] > _OTHER_UNIT:
        name = model.command_names[k] if model.command_names else f"command {k}"
        warnings.warn(
            f"limits of {name} reach {far[k]:.0f} standard deviations beyond what the "
            "model was trained on: are they in the same unit?",
            stacklevel=4,
        )


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
        plans: recorded ones, `[N, T, D_u]`. Each period then starts from the one of
            them that the model likes best, where that beats the plan at hand. The
            paper has none, and leaves open where a first solve starts.

    Raises:
        ValueError: p, limits, home or plans do not fit the model or each other.
    """

    @usual_torch()
    def __init__(
        self,
        model: DPMPB,
        loss: Loss,
        p: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
        settings: ControlSettings = ControlSettings(),
        *,
        home: ArrayLike | None = None,
        plans: ArrayLike | None = None,
    ):
        check_model(model)
        if model.s_mean.dtype != torch.float32:
            raise ValueError(
                f"the model computes in {model.s_mean.dtype}, control in single "
                "precision: hand over `model.float()`"
            )
        if not callable(loss):
            raise ValueError(
                "loss is a function, loss(states, commands, t), got "
                f"{type(loss).__name__}"
            )
        self.model = model
        self.loss = loss
        self.settings = settings
        self.set_bias(p)

        command = (model.command_size,)
        low = numbers("lower", lower, command)
        high = numbers("upper", upper, command)
        if not (low <= high).all():
            raise ValueError(
                f"a lower limit is above the upper one: {low.numpy()}, {high.numpy()}"
            )
        self.limits = Limits(low, high, model.u_std * (high > low))
        _warn_of_units(model, low, high)

        middle = (low + high) / 2
        home = middle if home is None else numbers("home", home, command)
        if not ((low <= home) & (home <= high)).all():
            raise ValueError(
                f"home {home.numpy()} is not between the limits {low.numpy()} and "
                f"{high.numpy()}"
            )
        self._home = home.expand(settings.horizon, -1)
        recorded = np.asarray([] if plans is None else plans)
        if not len(recorded):
            recorded = np.empty((0, *self._home.shape))
        shape = (len(recorded), *self._home.shape)
        self._plans = numbers("plans", recorded, shape).clamp(low, high)
        self.reset()

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next step on."""
        self.p = numbers("p", p, (self.model.bias_size,))

    @usual_torch()
    def reset(self) -> None:
        """Forget the last run: phase, memory and plan."""
        self.t = 0  # control steps since the reset
        self.plan = self._home  # being sent [T, D_u]
        self.memory = self.model.initial_memory()  # up to the state of the last search
        self.trace: list[np.ndarray] = []  # of each solve, its losses on the way
        # Commands of the last period
        self._sent: deque[Tensor] = deque(maxlen=self.settings.period)
        self._last: tuple[Tensor, Tensor] | None = None  # state and command

    @usual_torch()
    def act(self, s: ArrayLike, *, solve: bool = True) -> np.ndarray:
        """The next command `[D_u]` in state s `[D_s]`.

        Without a solve it is that of the plan, where there is one already.
        """
        state = numbers("s", s, (self.model.state_size,))
        self._advance_memory()
        solve = solve or not self.t  # a first plan needs a solve
        plan = self.search(state, self._plan_moved_on(), solve)
        if not plan.isfinite().all():
            raise ValueError(
                "the gradient of the loss is not finite, as that of `sqrt` is not "
                "at 0: `torch.linalg.vector_norm` has one there"
            )

        self._last = (state, plan[0])
        self._sent.append(plan[0])
        self.plan = plan
        self.t += 1
        return plan[0].double().numpy()

    def resume(self) -> None:
        """Begin again, as after somebody moved the robot; what was learned stays."""
        self.reset()

    @property
    def period_ended(self) -> bool:
        """Whether the last command was the last of its period."""
        return self.t > 0 and self.t % self.settings.period == 0

    @usual_torch()
    def follow(self, s: ArrayLike, u: ArrayLike) -> None:
        """Take in a step that something else commanded: only the memory goes on.

        From the state s `[D_s]` and the command u `[D_u]`.
        """
        self._advance_memory()
        state = numbers("s", s, (self.model.state_size,))
        self._last = (state, numbers("u", u, (self.model.command_size,)))

    def search(self, s: Tensor, plan: Tensor, solve: bool = True) -> Tensor:
        """A better plan than the one at hand `[T, D_u]`, from state s `[D_s]` on."""
        if not solve:
            return plan
        if len(self._plans) and self.t % self.settings.period == 0:
            starts = torch.cat([plan[None], self._plans])
            with torch.no_grad():
                plan = starts[self.losses(s, starts).argmin()]

        def plan_loss(plans: Tensor) -> Tensor:
            return self.losses(s, plans)

        plan, trace = optimise_commands(plan_loss, plan, self.limits, self.settings)
        self.trace.append(trace)
        return plan

    def losses(self, s: Tensor, plans: Tensor) -> Tensor:
        """Loss `[B]` of what plans `[B, T, D_u]` are predicted to do from here."""
        states = self.predict(s, plans)
        losses = self.loss(states, plans, self.t)
        wanted = f"a loss is [B], one number for each of {len(plans)} plans"
        if not isinstance(losses, Tensor):
            kind = type(losses).__name__
            raise ValueError(f"{wanted}, in a tensor of torch, got {kind}")
        if losses.shape != plans.shape[:1]:
            raise ValueError(f"{wanted}, got {list(losses.shape)}")
        return losses

    def predict(self, s: Tensor, plans: Tensor) -> Tensor:
        """States `[B, T, D_s]` to which plans `[B, T, D_u]` lead from state s."""
        return predict(self.model, s, plans, self.p, self.memory)

    @torch.no_grad()
    def predicted(self) -> Tensor | None:
        """States `[T, D_s]` to which the plan leads; None before the first step."""
        if self._last is None:
            return None
        state, _ = self._last
        return self.predict(state, self.plan[None])[0]

    def _advance_memory(self) -> None:
        """The memory follows what was observed, not what was predicted."""
        if self._last is not None:
            s, u = (each.reshape(1, 1, -1) for each in self._last)
            with torch.no_grad():
                _, self.memory = self.model(s, u, self.p, self.memory)
            self._last = None

    def _plan_moved_on(self) -> Tensor:
        """The plan `[T, D_u]` after a step: one command was sent, and one is added."""
        if not self.t:
            return self.plan
        added = self.plan[-1:]
        repeats = self.settings.warm_start == "earlier"
        if repeats and len(self._sent) == self.settings.period:
            added = self._sent[0][None]
        return torch.cat([self.plan[1:], added])
