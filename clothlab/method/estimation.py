"""Online estimation of the parametric bias of an unknown material.

W stays as it was trained, and only p moves, so that the model predicts what is observed
here and now. `BiasEstimator` is the paper's rule, momentum SGD; `gauss_newton` has
another one. Source: the paper, "Online Estimation".
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, check_number, settings_or_default
from clothlab.method._inputs import check_model
from clothlab.method._rule import LARGEST_LOSS, Moved, Rule, Window
from clothlab.method.model import DPMPB


@dataclass(frozen=True)
class EstimationSettings:
    """Momentum SGD on p.

    The paper names the rule and no numbers; these are this project's, see notebook 06.
    """

    rate: float = 0.1
    momentum: float = 0.9
    window: int = 200  # [step] how far back the data reach
    # First steps of the window, which only fill the memory and are not in the loss.
    warmup: int = 10  # [step]


def prediction_loss(
    model: DPMPB,
    s: Tensor,
    u: Tensor,
    p: Tensor,
    warmup: int = EstimationSettings.warmup,
) -> Tensor:
    """L(p): how far predicted next states are from those seen (eq. 4, W fixed).

    Args:
        model: whose weights stay as they are.
        s: states, `[T, D_s]`.
        u: commands, `[T, D_u]`.
        p: one parametric bias `[D_p]`, or several `[B, D_p]`.
        warmup: first steps, in which the memory fills; they are not in the loss.

    Returns:
        Mean squared error in standard deviations, `[]` or `[B]`.
    """
    check_number("warmup", warmup, int, at_least=0, at_most=len(s) - 2)
    several = p if p.ndim > 1 else p[None]
    count = len(several)
    before = s[:-1].expand(count, -1, -1)
    sent = u[:-1].expand(count, -1, -1)
    predicted, _ = model(before, sent, several)

    seen = s[1 + warmup :]
    losses = [model.loss(each[warmup:], seen) for each in predicted]
    return torch.stack(losses).reshape(p.shape[:-1])


class _State(NamedTuple):
    """Where an estimation is.

    It is replaced as a whole, so that no step is half taken.
    """

    p: np.ndarray  # the estimate [D_p]
    carried: Any = None  # by the rule
    seen: tuple[tuple[np.ndarray, np.ndarray], ...] = ()  # states and commands


class Estimator:
    """Moves p whenever a control step has been observed, by some rule.

    Args:
        model: whose weights stay as they are.
        p: where the estimate starts, `[D_p]`; zeros by default.
        rule: how it moves.
    """

    def __init__(self, model: DPMPB, p: ArrayLike | None, rule: Rule):
        self.model = check_model(model)
        self._rule = rule
        if rule.warmup(rule.window + 1) is None:
            raise ValueError(
                f"a window of {rule.window} steps is too short for the warm-up, and p "
                "would never move"
            )
        p = np.zeros(model.bias_size) if p is None else p
        self._first = _State(check_array("p", p, (model.bias_size,), np.float32))
        self._state = self._first

    def reset(self) -> None:
        """Go back to the p it started from, and forget what was seen."""
        self._state = self._first

    @property
    def p(self) -> np.ndarray:
        """The current estimate, `[D_p]`."""
        return self._state.p.copy()

    @property
    def window(self) -> Window | None:
        """What the present p is judged by; None before there is anything to judge."""
        return self._window(self._state)

    def update(self, s: ArrayLike, u: ArrayLike) -> np.ndarray:
        """Take in one step: the new estimate `[D_p]`.

        The state s `[D_s]` before a command, and the command u `[D_u]`. A step that is
        refused, since it does not fit or has no finite loss, leaves the estimate as it
        is.
        """
        s = check_array("s", s, (self.model.state_size,), np.float32)
        u = check_array("u", u, (self.model.command_size,), np.float32)
        # One more than the window: the last state is only predicted.
        seen = (*self._state.seen, (s, u))[-self._rule.window - 1 :]
        now = self._state._replace(seen=seen)

        window = self._window(now)
        if window is None:
            self._state = now
            return self.p
        moved = self._rule.move(self.model, window, now.p, now.carried)
        if not (moved.loss < LARGEST_LOSS and np.isfinite(moved.p).all()):
            raise ValueError(
                "this step is so far from what the model was trained on that there is "
                "no loss"
            )
        self._state = now._replace(p=moved.p, carried=moved.carried)
        return self.p

    def _window(self, now: _State) -> Window | None:
        warmup = self._rule.warmup(len(now.seen))
        if warmup is None:
            return None
        s = torch.as_tensor(np.stack([state for state, _ in now.seen]))
        u = torch.as_tensor(np.stack([command for _, command in now.seen]))
        return Window(s, u, warmup)


class BiasEstimator(Estimator):
    """The paper's rule: a step of momentum SGD on p for each control step observed.

    Args:
        model: whose weights stay as they are.
        p: where the estimate starts, `[D_p]`; zeros by default.
        settings: of the rule.
    """

    def __init__(
        self,
        model: DPMPB,
        p: ArrayLike | None = None,
        settings: EstimationSettings | None = None,
    ):
        settings = settings_or_default(settings, EstimationSettings)
        super().__init__(model, p, _MomentumSGD(settings))


class _MomentumSGD:
    """v ← momentum v + ∂L/∂p, then p ← p - rate v."""

    def __init__(self, settings: EstimationSettings):
        self.window = settings.window
        self._settings = settings

    def warmup(self, count: int) -> int | None:
        """As set, once there is at least one step more to predict."""
        warmup = self._settings.warmup
        return warmup if count > warmup + 1 else None

    def move(
        self, model: DPMPB, window: Window, p: np.ndarray, carried: Tensor | None
    ) -> Moved:
        """One step down the gradient; what is carried is the velocity v `[D_p]`."""
        before = torch.tensor(p, requires_grad=True)
        loss = prediction_loss(model, window.s, window.u, before, window.warmup)
        (gradient,) = torch.autograd.grad(loss, before)

        velocity = torch.zeros_like(gradient) if carried is None else carried
        velocity = velocity.mul(self._settings.momentum).add(gradient)
        after = before.detach().add(velocity, alpha=-self._settings.rate)
        return Moved(after.numpy(), loss.item(), velocity)
