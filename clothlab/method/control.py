"""Gradient-based control: W and p stay, only the commands move (paper, eqs. 5 to 7)."""

import functools
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import (
    Checked,
    check_array,
    choose,
    setting,
    settings_or_default,
)
from clothlab.method.fast_rollout import rollout_of
from clothlab.method.model import DPMPB, check_model

# Commands [B, T, D_u] → predicted states [B, T, D_s]
Predict = Callable[[Tensor], Tensor]
# Predicted states, or commands → loss of each sequence [B]
Loss = Callable[[Tensor], Tensor]

TRACED = 10_000  # steps that a trace keeps, half an hour at 5 Hz

_P = ParamSpec("_P")
_R = TypeVar("_R")
_Self = TypeVar("_Self", bound="Planner")


@dataclass(frozen=True)
class ControlSettings(Checked):
    """The constants of the control; the defaults are the paper's."""

    horizon: int = setting(8, "step", at_least=1)  # N_seq
    candidates: int = setting(30, at_least=2)  # N_batch, step sizes tried at once
    # gamma_max, in standard deviations of u
    largest_step: float = setting(1.0, above=0)
    # a logarithmic scale needs one; not the paper's
    smallest_step: float = setting(1e-3, above=0)
    iterations: int = setting(3, at_least=1)  # N_iter
    period: int = setting(8, "step", at_least=1)  # N_periodic
    # Command after a plan's end: its "last" (paper), or "periodic": a period ago's
    warm_start: str = setting("last")


def step_sizes(settings: ControlSettings) -> Tensor:
    """Values of gamma to try, `[candidates]`: 0, which keeps the loss from rising, and
    a logarithmic scale.
    """
    low, high = np.log10([settings.smallest_step, settings.largest_step])
    return torch.cat(
        [torch.zeros(1), torch.logspace(low, high, settings.candidates - 1)]
    )


def downhill(loss: Loss, u: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Losses `[B]` of plans `[B, T, D_u]`, and their gradients, whose lengths are one,
    in units of `scale` `[D_u]`.
    """
    u = u.detach().requires_grad_()
    losses = loss(u)
    (g,) = torch.autograd.grad(losses.sum(), u)
    g = g * scale
    return losses.detach(), g / torch.linalg.vector_norm(
        g, dim=(1, 2), keepdim=True
    ).clamp_min(1e-12)


@torch.no_grad()
def best_step(
    loss: Loss, u: Tensor, steps: Tensor, lower: Tensor, upper: Tensor
) -> tuple[Tensor, Tensor]:
    """The best of several steps `[K, B, T, D_u]` back from plans `[B, T, D_u]`, and
    their losses `[B]`.
    """
    candidates = (u - steps).clamp(lower, upper)
    losses = loss(candidates.flatten(0, 1)).unflatten(0, candidates.shape[:2])
    return candidates[losses.argmin(0), torch.arange(len(u))], losses.amin(0)


def optimise_commands(
    predict: Predict,
    loss: Loss,
    u: Tensor,
    lower: Tensor,
    upper: Tensor,
    scale: Tensor,
    settings: ControlSettings,
) -> tuple[Tensor, np.ndarray]:
    """Descend the gradient of the loss on the commands, choosing the best of many step
    sizes each time (eqs. 5 to 7).

    From `u` `[T, D_u]`, within `lower` to `upper` `[D_u]`; `scale` `[D_u]` is one unit
    of gamma. Returns the best commands `[T, D_u]`, and the loss at the start and after
    each iteration, `[iterations + 1]`.
    """

    def loss_of(plans: Tensor) -> Tensor:
        return loss(predict(plans))

    gamma = step_sizes(settings)[:, None, None, None] * scale
    plan, trace = u.clamp(lower, upper)[None], []
    for _ in range(settings.iterations):
        start, direction = downhill(loss_of, plan, scale)
        plan, best = best_step(loss_of, plan, gamma * direction, lower, upper)
        trace.append(start.item())
    return plan[0], np.array([*trace, best.item()])


def whole(
    step: Callable[Concatenate[_Self, _P], _R],
) -> Callable[Concatenate[_Self, _P], _R]:
    """Let a method of a controller happen wholly or not at all, and alone.

    After an interrupt or an error all attributes are those of before: a step that was
    half taken would leave a memory, a phase and a plan of different steps. And p or a
    target that another thread sets waits until a solve is over, which otherwise would
    begin with one and end with the other. Methods that are whole replace lists and
    never change them.
    """

    @functools.wraps(step)
    def run(self: _Self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        with self._alone:
            before = dict(vars(self))
            try:
                return step(self, *args, **kwargs)
            except BaseException:
                vars(self).update(before)
                raise

    return run


class Planner:
    """A model, the p in use, and the limits of the commands; a command whose range is a
    point is fixed.
    """

    def __init__(self, model: DPMPB, lower: ArrayLike, upper: ArrayLike):
        self._alone = threading.RLock()
        self.model = check_model(model)
        self._rollout_of_model = rollout_of(model)
        shape = (model.command_size,)
        self.lower = torch.as_tensor(check_array("lower", lower, shape, np.float32))
        self.upper = torch.as_tensor(check_array("upper", upper, shape, np.float32))
        if not (self.lower <= self.upper).all():
            raise ValueError(
                f"a lower limit is above the upper one: {self.lower.numpy()}, {self.upper.numpy()}"
            )
        # One unit of gamma. The descent leaves out what is fixed (the paper's "w/o
        # stiffness").
        self.scale = model.u_std * (self.upper > self.lower)

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.numpy().copy()

    @whole
    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next solve on."""
        self._p = torch.as_tensor(
            check_array("p", p, (self.model.bias_size,), np.float32)
        )
        self._predict = self._rollout_of_model(self.model, self._p)


class Controller(Planner):
    """Model predictive control with any differentiable loss of predicted states.

    `loss(states, t)` is the loss `[B]` of states `[B, T, D_s]` predicted for the
    commands from control step t on; p is `[D_p]`, limits are `[D_u]`. The first plan
    repeats the command `home` `[D_u]`, by default the middle of the limits. With
    `plans` `[N, horizon, D_u]`, each period starts from the one that the model likes
    best, where that beats the warm start. The paper has none and leaves open where the
    first solve starts. `trace` has the losses of each solve since the reset,
    `[iterations + 1]`, the last `TRACED` of them; `solves` counts them all.
    """

    def __init__(
        self,
        model: DPMPB,
        loss: Callable[[Tensor, int], Tensor],
        p: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
        settings: ControlSettings | None = None,
        *,
        home: ArrayLike | None = None,
        plans: ArrayLike | None = None,
    ):
        super().__init__(model, lower, upper)
        self.loss, self.settings = loss, settings_or_default(settings, ControlSettings)
        self._periodic = choose(
            "warm start", self.settings.warm_start, {"last": False, "periodic": True}
        )
        middle = (self.lower + self.upper) / 2
        home = (
            middle
            if home is None
            else check_array("home", home, middle.shape, np.float32)
        )
        self._home = torch.as_tensor(home).expand(self.settings.horizon, -1)
        plans = np.empty((0, *self._home.shape)) if plans is None else plans
        plans = check_array("plans", plans, ("N", *self._home.shape), np.float32)
        self._plans = torch.as_tensor(plans).clamp(self.lower, self.upper)
        self.set_bias(p)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last run: phase, memory and plan."""
        self.trace: list[np.ndarray] = []
        self.solves = 0
        self._t = 0
        self._memory = self.model.initial_memory()
        self._last: tuple[Tensor, Tensor] | None = None
        self._u = self._home
        self._sent = self._u[:0]

    @whole
    def act(self, s: ArrayLike, *, solve: bool = True) -> np.ndarray:
        """The next command `[D_u]` in state s `[D_s]`; without a solve, that of the
        last plan where there is one.
        """
        state = torch.as_tensor(
            check_array("s", s, (self.model.state_size,), np.float32)
        )
        self._move_on()
        if solve or not self.trace:
            self._solve(state)
        return self._send(state)

    @whole
    def follow(self, s: ArrayLike, u: ArrayLike) -> None:
        """Take in a step that something else commanded, state `[D_s]` and command
        `[D_u]`: memory goes on.
        """
        self._remember()
        s = check_array("s", s, (self.model.state_size,), np.float32)
        u = check_array("u", u, (self.model.command_size,), np.float32)
        self._last = (torch.as_tensor(s), torch.as_tensor(u))

    def _solve(self, s: Tensor) -> None:
        def predict(u: Tensor) -> Tensor:
            return self._predict(s, u, self._memory)

        def loss(states: Tensor) -> Tensor:
            losses = self.loss(states, self._t)
            if losses.shape != states.shape[:1]:
                raise ValueError(
                    f"a loss is [B], one number for each of {len(states)} plans, got {list(losses.shape)}"
                )
            return losses

        start = self._u
        if len(self._plans) and self._t % self.settings.period == 0:
            with torch.no_grad():
                starts = torch.cat([start[None], self._plans])
                start = starts[loss(predict(starts)).argmin()]
        plan, trace = self.search(predict, loss, start)
        if not plan.isfinite().all():
            raise ValueError(
                "the gradient of the loss is not finite, as that of `sqrt` at 0; try `vector_norm`"
            )
        self._u = plan
        self._note(trace)

    def _note(self, trace: np.ndarray) -> None:
        """A solve is over: count it, and keep the trace of its loss."""
        self.trace = [*self.trace, trace][-TRACED:]
        self.solves += 1

    def search(
        self, predict: Predict, loss: Loss, start: Tensor
    ) -> tuple[Tensor, np.ndarray]:
        """Better commands than `start` `[T, D_u]`, and the trace of their loss;
        overwrite it to search differently.
        """
        return optimise_commands(
            predict, loss, start, self.lower, self.upper, self.scale, self.settings
        )

    def _move_on(self) -> None:
        """A step has passed: the plan moves on with it."""
        self._remember()
        if self.trace:
            self._sent = torch.cat([self._sent, self._u[:1]])[-self.settings.period :]
            repeats = self._periodic and len(self._sent) == self.settings.period
            self._u = torch.cat(
                [self._u[1:], self._sent[:1] if repeats else self._u[-1:]]
            )

    def _remember(self) -> None:
        """Memory follows what was observed, not what was predicted."""
        if self._last is not None:
            self._memory = self._predict.follow(*self._last, self._memory)

    def _send(self, s: Tensor) -> np.ndarray:
        self._last = (s, self._u[0])
        self._t += 1
        return self._u[0].double().numpy()
