"""Online estimation of the parametric bias of an unknown material: W stays, only p moves (paper, "Online Estimation").

`BiasEstimator` is the paper's rule, momentum SGD. `NewtonEstimator` minimises nearly the same loss by its curvature,
which also says how sure the estimate is.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, check_number, setting, settings_or_default
from clothlab.learning.dpmpb import DPMPB, Sequences, check_model, check_run

_LARGEST_LOSS = 1e38  # nearly the largest number in single precision


@dataclass(frozen=True)
class EstimationSettings(Checked):
    """Momentum SGD on p. The paper names the rule and no numbers; these are this project's, see notebook 06."""

    rate: float = setting(0.1, above=0)
    momentum: float = setting(0.9, at_least=0, at_most=1)
    window: int = setting(200, "step", at_least=1)  # how far back the data reach
    warmup: int = setting(10, "step", at_least=0)  # first steps of the memory, not in the loss


@dataclass(frozen=True)
class NewtonSettings(Checked):
    """Gauss-Newton on p, from development runs (commands from seed 46000 on)."""

    window: int = setting(200, "step", at_least=1)  # how far back the data reach
    # Of a window that begins in the middle of a motion. Of a cloth that hangs still an empty memory is the right one,
    # and the first steps, in which the arm swings up, say most.
    warmup: int = setting(10, "step", at_least=0)
    least: int = setting(5, "step", at_least=2)  # predictions to judge before p moves
    freedom: float = setting(10.0, "-", above=0)  # degrees of freedom of Student's t: with few, outliers weigh little
    longest: float = setting(0.5, "-", above=0)  # largest step of p


@dataclass(frozen=True, eq=False)
class Fit:
    """How one p predicts a window, and what a small change of p would do."""

    errors: np.ndarray  # seen minus predicted next states [T, D_s] [s.d. of the state]
    jacobian: np.ndarray  # derivative of the predictions with respect to p [T, D_s, D_p]

    @classmethod
    def of(cls, model: DPMPB, s: Tensor, u: Tensor, p: ArrayLike, warmup: int = 0, nudge: float = 0.03) -> "Fit":
        """Predict with p and its neighbours in one pass, from s `[T + 1, D_s]` and u `[T + 1, D_u]` after a warm-up."""
        p = np.asarray(p, dtype=np.float64)
        nudges = nudge * np.eye(len(p))
        around = torch.as_tensor(np.concatenate([p[None], p + nudges, p - nudges]), dtype=s.dtype)
        with torch.no_grad():
            predicted, _ = model(s[:-1].expand(len(around), -1, -1), u[:-1].expand(len(around), -1, -1), around)
            scaled = (predicted / model.s_std)[:, warmup:].double().numpy()
            seen = (s[1:] / model.s_std)[warmup:].double().numpy()
        up, down = scaled[1 : 1 + len(p)], scaled[1 + len(p) :]
        return cls(seen - scaled[0], np.moveaxis(up - down, 0, -1) / (2 * nudge))

    @property
    def loss(self) -> float:
        """Mean squared error in standard deviations, as `prediction_loss` has it."""
        return float((self.errors**2).mean())

    def step(self, freedom: float = NewtonSettings.freedom, longest: float = np.inf) -> np.ndarray:
        """Gauss-Newton step to the lowest loss, with the weights of Student's t, at most so long, `[D_p]`."""
        weight = (freedom + 1) / (freedom + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.jacobian, weight, self.jacobian)
        gradient = np.einsum("tdi,td,td->i", self.jacobian, weight, self.errors)
        step = np.linalg.pinv(curvature, rcond=1e-6, hermitian=True) @ gradient
        return step * min(1, longest / max(float(np.linalg.norm(step)), 1e-12))

    def covariance(self, freedom: float = NewtonSettings.freedom, lag: int = 5) -> np.ndarray:
        """Covariance of p at the lowest loss, `[D_p, D_p]`, where errors depend on each other over a lag [step].

        Curvature alone would be right if all errors were independent, equally large, and the model true. Between two
        curvatures stands by how much gradients really scattered, neighbouring steps included (Newey and West, 1987). A
        LinAlgError says that the predictions do not depend on every direction of p.
        """
        weight = (freedom + 1) / (freedom + self._sizes)
        slope = weight * (freedom - self._sizes) / (freedom + self._sizes)  # derivative of weight times error
        inverse = np.linalg.inv(np.einsum("tdi,td,tdj->ij", self.jacobian, slope, self.jacobian))
        gradients = np.einsum("tdi,td,td->ti", self.jacobian, weight, self.errors)
        scatter = gradients.T @ gradients
        for k in range(1, min(lag, len(gradients) - 1) + 1):
            both = gradients[k:].T @ gradients[:-k]
            scatter += (1 - k / (lag + 1)) * (both + both.T)
        return inverse @ scatter @ inverse

    @property
    def _sizes(self) -> np.ndarray:
        """Squared errors over their mean."""
        return self.errors**2 / max(self.loss, 1e-12)


def prediction_loss(model: DPMPB, s: Tensor, u: Tensor, p: Tensor, warmup: int = EstimationSettings.warmup) -> Tensor:
    """L(p): how far the model's next states are from those that were seen (eq. 4, with W fixed).

    Mean squared error in standard deviations `[]`, or `[B]` for several p `[B, D_p]`, of states `[T, D_s]` and commands
    `[T, D_u]` after a warm-up, in which the memory fills.
    """
    check_number("warmup", warmup, int, at_least=0, at_most=len(s) - 2)
    many = p if p.ndim > 1 else p[None]
    predicted, _ = model(s[:-1].expand(len(many), -1, -1), u[:-1].expand(len(many), -1, -1), many)
    losses = [model.loss(each[warmup:], s[1 + warmup :]) for each in predicted]
    return torch.stack(losses).reshape(p.shape[:-1])


class Estimator:
    """Moves p, from zero or a given one `[D_p]`, whenever a control step has been observed; subclasses say how."""

    def __init__(self, model: DPMPB, p: ArrayLike | None, window: int):
        self._window, self.model = window, check_model(model)
        if self._warmup(window + 1) is None:
            raise ValueError(f"a window of {window} steps is too short for the warm-up, and p would never move")
        self._start = check_array("p", np.zeros(model.bias_size) if p is None else p, (model.bias_size,), np.float32)
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
        """Take in one step, the state `[D_s]` before a command and the command `[D_u]`: the new estimate `[D_p]`.

        A step that is refused, since it does not fit or has no finite loss, leaves the estimate as it is.
        """
        step = (
            check_array("s", s, (self.model.state_size,), np.float32),
            check_array("u", u, (self.model.command_size,), np.float32),
        )
        seen = [*self._seen, step][-self._window - 1 :]
        warmup = self._warmup(len(seen))
        if warmup is not None and not self._move(*_columns(seen), warmup) < _LARGEST_LOSS:
            raise ValueError("this step is so far from what the model was trained on that there is no loss")
        self._seen = seen
        return self.p

    @property
    def fit(self) -> Fit | None:
        """How the estimate predicts what is in the window; None before there is anything to judge."""
        warmup = self._warmup(len(self._seen))
        return None if warmup is None else Fit.of(self.model, *_columns(self._seen), self.p, warmup)

    def _move(self, s: Tensor, u: Tensor, warmup: int) -> float:
        """Move p once, unless the loss is not finite; returns the loss."""
        raise NotImplementedError

    def _warmup(self, count: int) -> int | None:
        """How many first steps are left out of so many; None where there is nothing to judge yet."""
        raise NotImplementedError


def _columns(seen: list[tuple[np.ndarray, np.ndarray]]) -> tuple[Tensor, Tensor]:
    """States `[T, D_s]` and commands `[T, D_u]`."""
    s, u = (torch.as_tensor(np.stack(column)) for column in zip(*seen, strict=True))
    return s, u


class BiasEstimator(Estimator):
    """The paper's rule: one step of momentum SGD on p whenever a control step has been observed."""

    def __init__(self, model: DPMPB, p: ArrayLike | None = None, settings: EstimationSettings | None = None):
        self.settings = settings_or_default(settings, EstimationSettings)
        super().__init__(model, p, self.settings.window)

    def reset(self) -> None:
        super().reset()
        self._optimizer = torch.optim.SGD([self._p], lr=self.settings.rate, momentum=self.settings.momentum)

    def _move(self, s: Tensor, u: Tensor, warmup: int) -> float:
        self._optimizer.zero_grad()
        loss = prediction_loss(self.model, s, u, self._p, warmup)
        if loss.isfinite():
            loss.backward(inputs=[self._p])
            self._optimizer.step()
        return loss.item()

    def _warmup(self, count: int) -> int | None:
        return self.settings.warmup if count > self.settings.warmup + 1 else None


class NewtonEstimator(Estimator):
    """One Gauss-Newton step on p whenever a control step has been observed; p so follows the lowest loss.

    `from_rest` says whether all is at rest before the first step that is given.
    """

    def __init__(
        self,
        model: DPMPB,
        p: ArrayLike | None = None,
        settings: NewtonSettings | None = None,
        *,
        from_rest: bool = True,
    ):
        self.settings, self._from_rest = settings_or_default(settings, NewtonSettings), from_rest
        super().__init__(model, p, self.settings.window)

    def _move(self, s: Tensor, u: Tensor, warmup: int) -> float:
        fit = Fit.of(self.model, s, u, self.p, warmup)
        if fit.loss < _LARGEST_LOSS:
            step = fit.step(self.settings.freedom, self.settings.longest)
            self._p = torch.tensor(self.p + step, dtype=torch.float32)
        return fit.loss

    def _warmup(self, count: int) -> int | None:
        warmup = 0 if self._from_rest and count <= self._window else self.settings.warmup
        return warmup if count - 1 - warmup >= self.settings.least else None


def estimate_bias(
    model: DPMPB,
    run: Sequences,
    p: ArrayLike | None = None,
    settings: EstimationSettings | NewtonSettings | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Run the online estimation over a recorded run: the final p `[D_p]`, and p after each step `[T, D_p]`.

    The settings say which one: of momentum SGD, as by default, or of Gauss-Newton.
    """
    check_run(run)
    kind: Any = NewtonEstimator if isinstance(settings, NewtonSettings) else BiasEstimator
    estimator = kind(model, p, settings)
    trace = np.stack([estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)])
    return trace[-1], trace
