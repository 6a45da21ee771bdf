"""Online estimation of the parametric bias of an unknown material: W stays, only p
moves (paper, "Online Estimation").

`BiasEstimator` is the paper's rule, momentum SGD.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import (
    Checked,
    check_array,
    check_number,
    choose,
    setting,
    settings_or_default,
)
from clothlab.method.data import Run, check_run
from clothlab.method.model import DPMPB, check_model

LARGEST_LOSS = 1e38  # nearly the largest number in single precision


@dataclass(frozen=True)
class EstimationSettings(Checked):
    """Momentum SGD on p.

    The paper names the rule and no numbers; these are this project's, see notebook 06.
    """

    rate: float = setting(0.1, above=0)
    momentum: float = setting(0.9, at_least=0, at_most=1)
    window: int = setting(200, "step", at_least=1)  # how far back the data reach
    # First steps of the memory, not in the loss
    warmup: int = setting(10, "step", at_least=0)


def prediction_loss(
    model: DPMPB,
    s: Tensor,
    u: Tensor,
    p: Tensor,
    warmup: int = EstimationSettings.warmup,
) -> Tensor:
    """L(p): how far the model's next states are from those that were seen (eq. 4, with
    W fixed).

    Mean squared error in standard deviations `[]`, or `[B]` for several p `[B, D_p]`,
    of states `[T, D_s]` and commands `[T, D_u]` after a warm-up, in which the memory
    fills.
    """
    check_number("warmup", warmup, int, at_least=0, at_most=len(s) - 2)
    many = p if p.ndim > 1 else p[None]
    predicted, _ = model(
        s[:-1].expand(len(many), -1, -1), u[:-1].expand(len(many), -1, -1), many
    )
    losses = [model.loss(each[warmup:], s[1 + warmup :]) for each in predicted]
    return torch.stack(losses).reshape(p.shape[:-1])


class Window(NamedTuple):
    """The last steps that were observed."""

    s: Tensor  # states [T, D_s]
    u: Tensor  # commands [T, D_u]
    warmup: int  # first steps, which only fill the memory


class Estimator:
    """Moves p, from zero or a given one `[D_p]`, whenever a control step has been
    observed; subclasses say how.
    """

    def __init__(self, model: DPMPB, p: ArrayLike | None, window: int):
        self._window, self.model = window, check_model(model)
        if self._warmup(window + 1) is None:
            raise ValueError(
                f"a window of {window} steps is too short for the warm-up, and p would never move"
            )
        self._start = check_array(
            "p",
            np.zeros(model.bias_size) if p is None else p,
            (model.bias_size,),
            np.float32,
        )
        self.reset()

    def reset(self) -> None:
        """Go back to the p it started from, and forget what was seen."""
        self._p = torch.tensor(self._start, requires_grad=True)
        self._seen: list[tuple[np.ndarray, np.ndarray]] = []

    @property
    def p(self) -> np.ndarray:
        """The current estimate, `[D_p]`."""
        return self._p.detach().numpy().copy()

    def update(self, s: ArrayLike, u: ArrayLike) -> np.ndarray:
        """Take in one step, the state `[D_s]` before a command and the command `[D_u]`:
        the new estimate `[D_p]`.

        A step that is refused, since it does not fit or has no finite loss, leaves the
        estimate as it is.
        """
        step = (
            check_array("s", s, (self.model.state_size,), np.float32),
            check_array("u", u, (self.model.command_size,), np.float32),
        )
        seen = [*self._seen, step][-self._window - 1 :]
        warmup = self._warmup(len(seen))
        if (
            warmup is not None
            and not self._move(*_columns(seen), warmup) < LARGEST_LOSS
        ):
            raise ValueError(
                "this step is so far from what the model was trained on that there is no loss"
            )
        self._seen = seen
        return self.p

    @property
    def window(self) -> Window | None:
        """What the present p is judged by; None before there is anything to judge."""
        warmup = self._warmup(len(self._seen))
        return None if warmup is None else Window(*_columns(self._seen), warmup)

    def _move(self, s: Tensor, u: Tensor, warmup: int) -> float:
        """Move p once, unless the loss is not finite; returns the loss."""
        raise NotImplementedError

    def _warmup(self, count: int) -> int | None:
        """How many first steps are left out of so many; None where there is nothing to
        judge yet.
        """
        raise NotImplementedError


def _columns(seen: list[tuple[np.ndarray, np.ndarray]]) -> tuple[Tensor, Tensor]:
    """States `[T, D_s]` and commands `[T, D_u]`."""
    s, u = (torch.as_tensor(np.stack(column)) for column in zip(*seen, strict=True))
    return s, u


class BiasEstimator(Estimator):
    """The paper's rule: one step of momentum SGD on p whenever a control step has been
    observed.
    """

    def __init__(
        self,
        model: DPMPB,
        p: ArrayLike | None = None,
        settings: EstimationSettings | None = None,
    ):
        self.settings = settings_or_default(settings, EstimationSettings)
        super().__init__(model, p, self.settings.window)

    def reset(self) -> None:
        super().reset()
        self._optimizer = torch.optim.SGD(
            [self._p], lr=self.settings.rate, momentum=self.settings.momentum
        )

    def _move(self, s: Tensor, u: Tensor, warmup: int) -> float:
        self._optimizer.zero_grad()
        loss = prediction_loss(self.model, s, u, self._p, warmup)
        if loss.isfinite():
            loss.backward(inputs=[self._p])
            self._optimizer.step()
        return loss.item()

    def _warmup(self, count: int) -> int | None:
        return self.settings.warmup if count > self.settings.warmup + 1 else None


def estimate_bias(
    model: DPMPB,
    run: Run,
    p: ArrayLike | None = None,
    *,
    method: str = "sgd",
    settings: Any = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Run the online estimation over a recorded run.

    Args:
        model: whose weights stay as they are.
        run: states and commands of one material.
        p: where the estimate starts, `[D_p]`; zeros by default.
        method: "sgd" for the paper's momentum SGD, "newton" for Gauss-Newton.
        settings: of that method, `EstimationSettings` or `NewtonSettings`.

    Returns:
        The final p `[D_p]`, and p after each step `[T, D_p]`.
    """
    from clothlab.method.gauss_newton import (
        NewtonEstimator,  # which builds on this module
    )

    check_run(run)
    kinds: dict[str, Any] = {"sgd": BiasEstimator, "newton": NewtonEstimator}
    estimator = choose("method", method, kinds)(model, p, settings)
    path = [estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)]
    return path[-1], np.stack(path)
