"""Estimation of p by the curvature of its loss, which also says how sure the estimate
is. Not in the paper.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, setting, settings_or_default
from clothlab.method.data import Run, check_run
from clothlab.method.estimation import LARGEST_LOSS, Estimator
from clothlab.method.model import DPMPB


@dataclass(frozen=True)
class NewtonSettings(Checked):
    """Gauss-Newton on p, from development runs (commands from seed 46000 on)."""

    window: int = setting(200, "step", at_least=1)  # how far back the data reach
    # Of a window that begins in the middle of a motion. Of a cloth that hangs still an
    # empty memory is the right one, and the first steps, in which the arm swings up,
    # say most.
    warmup: int = setting(10, "step", at_least=0)
    least: int = setting(5, "step", at_least=2)  # predictions to judge before p moves
    # Degrees of freedom of Student's t: with few, outliers weigh little
    freedom: float = setting(10.0, "-", above=0)
    longest: float = setting(0.5, "-", above=0)  # largest step of p


@dataclass(frozen=True, eq=False)
class Linearisation:
    """How one p predicts a window, and what a small change of p would do."""

    errors: np.ndarray  # seen minus predicted next states [T, D_s] [s.d. of the state]
    # Derivative of the predictions with respect to p [T, D_s, D_p]
    jacobian: np.ndarray

    @classmethod
    def of(
        cls,
        model: DPMPB,
        s: Tensor,
        u: Tensor,
        p: ArrayLike,
        warmup: int = 0,
        nudge: float = 0.03,
    ) -> "Linearisation":
        """Predict with p and its neighbours in one pass, from s `[T + 1, D_s]` and u
        `[T + 1, D_u]` after a warm-up.
        """
        p = np.asarray(p, dtype=np.float64)
        nudges = nudge * np.eye(len(p))
        around = torch.as_tensor(
            np.concatenate([p[None], p + nudges, p - nudges]), dtype=s.dtype
        )
        with torch.no_grad():
            predicted, _ = model(
                s[:-1].expand(len(around), -1, -1),
                u[:-1].expand(len(around), -1, -1),
                around,
            )
            scaled = (predicted / model.s_std)[:, warmup:].double().numpy()
            seen = (s[1:] / model.s_std)[warmup:].double().numpy()
        up, down = scaled[1 : 1 + len(p)], scaled[1 + len(p) :]
        return cls(seen - scaled[0], np.moveaxis(up - down, 0, -1) / (2 * nudge))

    @property
    def loss(self) -> float:
        """Mean squared error in standard deviations, as `prediction_loss` has it."""
        return float((self.errors**2).mean())

    def step(
        self, freedom: float = NewtonSettings.freedom, longest: float = np.inf
    ) -> np.ndarray:
        """Gauss-Newton step to the lowest loss, with the weights of Student's t, at
        most so long, `[D_p]`.
        """
        weight = (freedom + 1) / (freedom + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.jacobian, weight, self.jacobian)
        gradient = np.einsum("tdi,td,td->i", self.jacobian, weight, self.errors)
        step = np.linalg.pinv(curvature, rcond=1e-6, hermitian=True) @ gradient
        return step * min(1, longest / max(float(np.linalg.norm(step)), 1e-12))

    def covariance(
        self, freedom: float = NewtonSettings.freedom, lag: int = 5
    ) -> np.ndarray:
        """Covariance of p at the lowest loss, `[D_p, D_p]`, where errors depend on each
        other over a lag [step].

        Curvature alone would be right if all errors were independent, equally large,
        and the model true. Between two curvatures stands by how much gradients really
        scattered, neighbouring steps included (Newey and West, 1987). A LinAlgError
        says that the predictions do not depend on every direction of p.
        """
        weight = (freedom + 1) / (freedom + self._sizes)
        # Derivative of weight times error
        slope = weight * (freedom - self._sizes) / (freedom + self._sizes)
        inverse = np.linalg.inv(
            np.einsum("tdi,td,tdj->ij", self.jacobian, slope, self.jacobian)
        )
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


class NewtonEstimator(Estimator):
    """One Gauss-Newton step on p whenever a control step has been observed; p so
    follows the lowest loss.

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
        self.settings, self._from_rest = (
            settings_or_default(settings, NewtonSettings),
            from_rest,
        )
        super().__init__(model, p, self.settings.window)

    def _move(self, s: Tensor, u: Tensor, warmup: int) -> float:
        fit = Linearisation.of(self.model, s, u, self.p, warmup)
        if fit.loss < LARGEST_LOSS:
            step = fit.step(self.settings.freedom, self.settings.longest)
            self._p = torch.tensor(self.p + step, dtype=torch.float32)
        return fit.loss

    def _warmup(self, count: int) -> int | None:
        warmup = (
            0 if self._from_rest and count <= self._window else self.settings.warmup
        )
        return warmup if count - 1 - warmup >= self.settings.least else None


def linearise(estimator: Estimator) -> Linearisation | None:
    """How an estimator's present p predicts what it has in its window; None before
    there is anything to judge.
    """
    window = estimator.window
    if window is None:
        return None
    return Linearisation.of(
        estimator.model, window.s, window.u, estimator.p, window.warmup
    )


def best_bias(
    model: DPMPB,
    run: Run,
    p: ArrayLike,
    settings: NewtonSettings | None = None,
    rounds: int = 4,
) -> tuple[np.ndarray, Linearisation]:
    """The p `[D_p]` with the lowest loss over a whole run that begins at rest, and how
    it predicts, by Gauss-Newton.
    """
    settings, found = (
        settings_or_default(settings, NewtonSettings),
        check_array("p", p, (model.bias_size,)),
    )
    check_run(run)
    s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
    fit = Linearisation.of(model, s, u, found)
    for _ in range(rounds):
        found = found + fit.step(settings.freedom, settings.longest)
        fit = Linearisation.of(model, s, u, found)
    return found, fit
