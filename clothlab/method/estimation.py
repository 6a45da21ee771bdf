"""Online estimation of the parametric bias of an unknown material.

W stays as it was trained, and only p moves, so that the model predicts what is observed
here and now. Source: the paper, "Online Estimation". `BiasEstimator` is the paper's
rule, momentum SGD. `NewtonEstimator` is ours: around an estimate, predictions are
nearly linear in p, and the least squares of such a line say where the lowest loss lies.
"""

import warnings
from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab.method.data import Run, check_fits, warn_of_units
from clothlab.method.model import DPMPB, check_model, numbers, usual_torch


def prediction_loss(
    model: DPMPB, s: Tensor, u: Tensor, p: Tensor, warmup: int = 10
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
    if not 0 <= warmup <= len(s) - 2:
        raise ValueError(
            f"warmup is from 0 to {len(s) - 2}, or no prediction is left to judge, got "
            f"{warmup}"
        )
    several = p if p.ndim > 1 else p[None]
    before = s[:-1].expand(len(several), -1, -1)
    sent = u[:-1].expand(len(several), -1, -1)
    predicted, _ = model(before, sent, several)
    errors = (predicted - s[1:]) / model.s_std
    return errors[:, warmup:].square().mean(dim=(1, 2)).reshape(p.shape[:-1])


class Estimator:
    """Moves p whenever a control step has been observed; subclasses say how.

    Args:
        model: whose weights stay as they are.
        p: where the estimate starts, `[D_p]`; zeros by default.
        settings: of the rule, of its `settings_class`; by default that class's own.

    Raises:
        ValueError: p has another size than the model's, or the window is too short.
    """

    settings_class: Any  # it has `window`, `warmup` and `wait`

    def __init__(self, model: DPMPB, p: ArrayLike | None = None, settings: Any = None):
        check_model(model)
        settings = self.settings_class() if settings is None else settings
        if settings.window - settings.warmup < settings.wait:
            raise ValueError(
                f"a window of {settings.window} steps is too short for the warm-up of "
                f"{settings.warmup}, and p would never move"
            )
        p = np.zeros(model.bias_size) if p is None else p
        self.model = model
        self.settings = settings
        self._start = numbers("p", p, (model.bias_size,))
        # One more than the window: the last state is only predicted.
        self._length = settings.window + 1
        self.reset()

    def reset(self) -> None:
        """Go back to the p it started from, and forget what was seen."""
        self.forget()
        self._p = self._start
        self._from_start = True  # whether the window begins where the run does

    def forget(self) -> None:
        """Forget what was seen, and keep p: for a gap in what is observed."""
        self._seen: deque[tuple[Tensor, Tensor]] = deque(maxlen=self._length)
        self._from_start = False

    @property
    def p(self) -> np.ndarray:
        """The current estimate, `[D_p]`."""
        return self._p.numpy().copy()

    @property
    def window(self) -> tuple[Tensor, Tensor, int] | None:
        """What p is judged by: states `[T, D_s]`, commands `[T, D_u]`, and the warm-up.

        None before there is anything to judge.
        """
        warmup = self._warmup()
        if len(self._seen) - 1 - warmup < self.settings.wait:
            return None
        states, commands = zip(*self._seen, strict=True)
        return torch.stack(states), torch.stack(commands), warmup

    def update(self, s: ArrayLike, u: ArrayLike) -> np.ndarray:
        """Take in one step: the new estimate `[D_p]`.

        Args:
            s: the state before a command, `[D_s]`.
            u: the command, `[D_u]`.

        Raises:
            ValueError: the state is so far from the trained ones that p has no loss.
        """
        state = numbers("s", s, (self.model.state_size,))
        command = numbers("u", u, (self.model.command_size,))
        undo = self._seen.copy(), self._from_start
        self._seen.append((state, command))
        # A full window still holds the first step of a run, this once; it counts as one
        # in the middle of a motion already, as in all that is stored.
        self._from_start = self._from_start and len(self._seen) < self._length
        window = self.window
        if window is None:
            return self.p

        with usual_torch():
            p = self._moved(*window)
        if not p.isfinite().all():
            self._seen, self._from_start = undo
            raise ValueError(
                f"the state {state.tolist()} is so far from what the model was trained "
                "on that there is no loss: is it in the same units?"
            )
        self._p = p
        return self.p

    def linearisation(self) -> "Linearisation | None":
        """How the present p predicts the window, and what a change of p would do.

        None before there is anything to judge.
        """
        window = self.window
        if window is None:
            return None
        s, u, warmup = window
        return Linearisation.of(self.model, s, u, self._p, warmup)

    def _warmup(self) -> int:
        """First steps of the present window, which only fill the memory."""
        raise NotImplementedError

    def _moved(self, s: Tensor, u: Tensor, warmup: int) -> Tensor:
        """p after a step that is judged by this window."""
        raise NotImplementedError


@dataclass(frozen=True)
class EstimationSettings:
    """Of momentum SGD; the paper names the rule and no numbers (notebook 06)."""

    rate: float = 0.1
    momentum: float = 0.9
    window: int = 200  # steps that the data reach back
    warmup: int = 10  # first steps of the window, which only fill the memory
    wait: int = 1  # predictions to judge before p moves


class BiasEstimator(Estimator):
    """The paper's rule: momentum SGD on p, a step for each control step observed."""

    settings_class = EstimationSettings

    def reset(self) -> None:
        """Go back to the p it started from, at rest, and forget what was seen."""
        super().reset()
        self._velocity = torch.zeros_like(self._p)

    def _warmup(self) -> int:
        return self.settings.warmup

    def _moved(self, s: Tensor, u: Tensor, warmup: int) -> Tensor:
        """v ← momentum v + ∂L/∂p, then p ← p - rate v."""
        p = self._p.clone().requires_grad_()
        loss = prediction_loss(self.model, s, u, p, warmup)
        (gradient,) = torch.autograd.grad(loss, p)
        velocity = self.settings.momentum * self._velocity + gradient
        moved = self._p - self.settings.rate * velocity
        if moved.isfinite().all():
            self._velocity = velocity
        return moved


_LARGEST_LOSS = 1e38  # nearly the largest number in single precision


@dataclass(frozen=True)
class NewtonSettings:
    """Of Gauss-Newton on p, chosen on development runs."""

    window: int = 200  # steps that the data reach back
    warmup: int = 10  # first steps of a window that begins in the middle of a motion
    # Whether all is at rest before the first step. Then an empty memory is the right
    # one, and the first steps, in which the arm swings up, say most.
    from_rest: bool = True
    largest_step: float = 0.5  # of p, where predictions are still nearly linear
    # Of Student's t, which errors are taken to follow: with few, outliers weigh little.
    degrees_of_freedom: float = 10.0
    wait: int = 5  # predictions to judge: a step from fewer mostly follows noise


class NewtonEstimator(Estimator):
    """A Gauss-Newton step on p for each control step observed; it needs no rate."""

    settings_class = NewtonSettings

    def _warmup(self) -> int:
        at_rest = self.settings.from_rest and self._from_start
        return 0 if at_rest else self.settings.warmup

    def _moved(self, s: Tensor, u: Tensor, warmup: int) -> Tensor:
        """p ← p + the step to the lowest loss, at most so long."""
        settings = self.settings
        seen = Linearisation.of(self.model, s, u, self._p, warmup)
        if not seen.loss < _LARGEST_LOSS:
            return torch.full_like(self._p, torch.nan)
        step = seen.step(settings.degrees_of_freedom, settings.largest_step)
        return self._p + torch.tensor(step, dtype=torch.float32)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """How one p predicts a window, and what a small change of p would do."""

    # Seen minus predicted next states after the warm-up [T, D_s] [s.d. of the state]
    errors: np.ndarray
    jacobian: np.ndarray  # of the predictions with respect to p [T, D_s, D_p]

    @classmethod
    @torch.no_grad()
    def of(
        cls, model: DPMPB, s: Tensor, u: Tensor, p: ArrayLike, warmup: int = 0
    ) -> "Linearisation":
        """Predict with p and its neighbours in one pass.

        Args:
            model: a trained one.
            s: states, `[T + 1, D_s]`.
            u: commands, `[T + 1, D_u]`.
            p: where predictions are linearised, `[D_p]`.
            warmup: first steps, which only fill the memory.
        """
        # p itself, and a nudge up and down in each of its numbers: one pass of a batch
        # is faster than a gradient of each prediction.
        nudge = 0.03  # small beside trained p, large beside rounding
        centre = torch.as_tensor(p, dtype=torch.float64)
        size = len(centre)
        nudges = nudge * torch.eye(size, dtype=torch.float64)
        around = torch.cat([centre[None], centre + nudges, centre - nudges]).float()

        before = s[:-1].expand(len(around), -1, -1)
        sent = u[:-1].expand(len(around), -1, -1)
        predicted, _ = model(before, sent, around)
        scaled = (predicted / model.s_std)[:, warmup:].double()
        seen = (s[1:] / model.s_std)[warmup:].double()

        # Central differences
        jacobian = (scaled[1 : 1 + size] - scaled[1 + size :]) / (2 * nudge)
        return cls((seen - scaled[0]).numpy(), jacobian.movedim(0, -1).numpy())

    @property
    def loss(self) -> float:
        """Mean squared error in standard deviations, as `prediction_loss` has it."""
        return float((self.errors**2).mean())

    def step(
        self,
        degrees_of_freedom: float = NewtonSettings.degrees_of_freedom,
        largest: float = np.inf,
    ) -> np.ndarray:
        """Gauss-Newton step `[D_p]` to the lowest loss, at most so long.

        Errors are weighed as by Student's t, on the scale of their mean square.
        """
        weight = (degrees_of_freedom + 1) / (degrees_of_freedom + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.jacobian, weight, self.jacobian)
        gradient = np.einsum("tdi,td,td->i", self.jacobian, weight, self.errors)
        step = np.linalg.pinv(curvature, rcond=1e-6, hermitian=True) @ gradient
        length = float(np.linalg.norm(step))
        return step * min(1, largest / max(length, 1e-12))

    def covariance(
        self,
        degrees_of_freedom: float = NewtonSettings.degrees_of_freedom,
        lag: int = 5,
    ) -> np.ndarray:
        """Covariance of p at the lowest loss, `[D_p, D_p]`, by the sandwich estimator.

        Curvature alone would be right if all errors were independent, equally large,
        and the model true. So the scatter of the gradients as it was stands between two
        inverse curvatures, correlations over up to `lag` steps included (Newey and
        West, 1987), but over no more than a quarter of the steps: over all of them the
        gradients add up to zero, at the lowest loss, and would say that p is certain.

        Raises:
            numpy.linalg.LinAlgError: no prediction depends on some direction of p.
        """
        dof = degrees_of_freedom
        weight = (dof + 1) / (dof + self._sizes)
        # The derivative of weight times error.
        slope = weight * (dof - self._sizes) / (dof + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.jacobian, slope, self.jacobian)
        inverse = np.linalg.inv(curvature)

        gradients = np.einsum("tdi,td,td->ti", self.jacobian, weight, self.errors)
        scatter = gradients.T @ gradients
        lag = min(lag, len(gradients) // 4)
        for k in range(1, lag + 1):
            both = gradients[k:].T @ gradients[:-k]
            scatter += (1 - k / (lag + 1)) * (both + both.T)
        return inverse @ scatter @ inverse

    @property
    def _sizes(self) -> np.ndarray:
        """Squared errors over their mean."""
        return self.errors**2 / max(self.loss, 1e-12)


def estimate_bias(
    model: DPMPB,
    run: Run,
    p: ArrayLike | None = None,
    *,
    method: Literal["sgd", "newton"] = "sgd",
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
        The final p `[D_p]`, and p after each step `[T, D_p]`. If the run is too short
        for p to move at all, or its states are far from all that the model was trained
        on, there is a warning.

    Raises:
        ValueError: the run doesn't fit the model, or there is no such method.
    """
    methods: dict[str, type[Estimator]] = {
        "sgd": BiasEstimator,
        "newton": NewtonEstimator,
    }
    if method not in methods:
        raise ValueError(f"unknown method {method!r}; choose from sgd, newton")
    estimator_class = methods[method]
    settings_class = estimator_class.settings_class
    if not (settings is None or isinstance(settings, settings_class)):
        raise ValueError(
            f'settings with method="{method}" is a {settings_class.__name__}, got '
            f"{type(settings).__name__}: write {settings_class.__name__}(name=value)"
        )
    check_fits(model, run)
    warn_of_units(model, run)
    estimator = estimator_class(model, p, settings)
    path = [estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)]

    # A p that nothing has moved looks like any other.
    if estimator.window is None:
        warnings.warn(
            f"a run of {len(run)} steps is too short for this estimation: p is where "
            "it started, and says nothing of the material. Record more steps, or set "
            "a smaller `warmup`",
            stacklevel=2,
        )
    return path[-1], np.stack(path)
