"""Estimation of p by the curvature of its loss.

Momentum SGD needs a rate, and says nothing of how far its p may be off. Around an
estimate, predictions are nearly linear in p; the least squares of such a line say both
where the lowest loss lies and how far it scatters. Not in the paper.
"""

import warnings
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, choose, settings_or_default
from clothlab.method._inputs import check_run, check_same_step
from clothlab.method._rule import LARGEST_LOSS, Moved, Window
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, EstimationSettings, Estimator
from clothlab.method.model import DPMPB

_NUDGE = 0.03  # of p, by which its neighbours differ


@dataclass(frozen=True)
class NewtonSettings:
    """Gauss-Newton on p, from development runs (commands from seed 46000 on)."""

    window: int = 200  # [step] how far back the data reach
    # Of a window that begins in the middle of a motion. Of a cloth that hangs still an
    # empty memory is the right one, and the first steps, in which the arm swings up,
    # say most.
    warmup: int = 10  # [step]
    least: int = 5  # [step] predictions to judge before p moves
    # Degrees of freedom of Student's t: with few, outliers weigh little.
    freedom: float = 10.0
    longest: float = 0.5  # largest step of p


@dataclass(frozen=True, eq=False)
class Linearisation:
    """How one p predicts a window, and what a small change of p would do."""

    errors: np.ndarray  # seen minus predicted next states [T, D_s] [s.d. of the state]
    # Derivative of the predictions with respect to p [T, D_s, D_p].
    jacobian: np.ndarray

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
        # p and its neighbours, up and down in each of its numbers.
        middle = torch.as_tensor(p, dtype=torch.float64)
        size = len(middle)
        nudges = _NUDGE * torch.eye(size, dtype=middle.dtype)
        around = torch.cat([middle[None], middle + nudges, middle - nudges])

        # One pass: p itself is the first of the batch, then come its neighbours.
        several = around.to(s.dtype)
        before = s[:-1].expand(len(several), -1, -1)
        sent = u[:-1].expand(len(several), -1, -1)
        predicted, _ = model(before, sent, several)
        scaled = (predicted / model.s_std)[:, warmup:].double()
        seen = (s[1:] / model.s_std)[warmup:].double()

        # Central differences.
        up = scaled[1 : 1 + size]
        down = scaled[1 + size :]
        jacobian = (up - down).movedim(0, -1) / (2 * _NUDGE)
        return cls((seen - scaled[0]).numpy(), jacobian.numpy())

    @property
    def loss(self) -> float:
        """Mean squared error in standard deviations, as `prediction_loss` has it."""
        return float((self.errors**2).mean())

    def step(
        self, freedom: float = NewtonSettings.freedom, longest: float = np.inf
    ) -> np.ndarray:
        """Gauss-Newton step `[D_p]` to the lowest loss, at most so long.

        Errors are weighed as by Student's t with this freedom: outliers count little.
        """
        weight = (freedom + 1) / (freedom + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.jacobian, weight, self.jacobian)
        gradient = np.einsum("tdi,td,td->i", self.jacobian, weight, self.errors)
        step = np.linalg.pinv(curvature, rcond=1e-6, hermitian=True) @ gradient
        length = float(np.linalg.norm(step))
        return step * min(1, longest / max(length, 1e-12))

    def covariance(
        self, freedom: float = NewtonSettings.freedom, lag: int = 5
    ) -> np.ndarray:
        """Covariance of p at the lowest loss, `[D_p, D_p]`.

        Curvature alone would be right if all errors were independent, equally large,
        and the model true. Between two curvatures stands by how much gradients really
        scattered, together with those up to `lag` steps later (Newey and West, 1987). A
        LinAlgError says that the predictions do not depend on every direction of p.
        """
        weight = (freedom + 1) / (freedom + self._sizes)
        # The derivative of weight times error.
        slope = weight * (freedom - self._sizes) / (freedom + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.jacobian, slope, self.jacobian)
        inverse = np.linalg.inv(curvature)

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
    """A Gauss-Newton step on p for each control step observed.

    p so follows the lowest loss.

    Args:
        model: whose weights stay as they are.
        p: where the estimate starts, `[D_p]`; zeros by default.
        settings: of the rule.
        from_rest: whether all is at rest before the first step that is given.
    """

    def __init__(
        self,
        model: DPMPB,
        p: ArrayLike | None = None,
        settings: NewtonSettings | None = None,
        *,
        from_rest: bool = True,
    ):
        settings = settings_or_default(settings, NewtonSettings)
        super().__init__(model, p, _GaussNewton(settings, from_rest))


class _GaussNewton:
    """p ← p + the step to the lowest loss, at most so long."""

    def __init__(self, settings: NewtonSettings, from_rest: bool):
        self.window = settings.window
        self._settings = settings
        self._from_rest = from_rest

    def warmup(self, count: int) -> int | None:
        """0 for a window that begins at rest, else as set; None if it is too short."""
        begins_at_rest = self._from_rest and count <= self.window
        warmup = 0 if begins_at_rest else self._settings.warmup
        return warmup if count - 1 - warmup >= self._settings.least else None

    def move(self, model: DPMPB, window: Window, p: np.ndarray, carried: Any) -> Moved:
        """One step; nothing is carried from the one before."""
        seen = Linearisation.of(model, window.s, window.u, p, window.warmup)
        if not seen.loss < LARGEST_LOSS:
            return Moved(p, seen.loss)
        step = seen.step(self._settings.freedom, self._settings.longest)
        return Moved((p + step).astype(np.float32), seen.loss)


def linearise(estimator: Estimator) -> Linearisation | None:
    """How an estimator's present p predicts what it has in its window.

    None before there is anything to judge.
    """
    window = estimator.window
    if window is None:
        return None
    s, u, warmup = window
    return Linearisation.of(estimator.model, s, u, estimator.p, warmup)


def best_bias(
    model: DPMPB,
    run: Run,
    p: ArrayLike,
    settings: NewtonSettings | None = None,
    rounds: int = 4,
    *,
    from_rest: bool = True,
) -> tuple[np.ndarray, Linearisation]:
    """The p with the lowest loss over a whole run, by Gauss-Newton.

    Args:
        model: a trained one.
        run: states and commands of one material.
        p: where to begin, `[D_p]`.
        settings: of the steps.
        rounds: how many steps.
        from_rest: whether all is at rest before the first step; else the first ones
            only fill the memory.

    Returns:
        That p `[D_p]`, and how it predicts.
    """
    settings = settings_or_default(settings, NewtonSettings)
    check_same_step(model, check_run(run))
    found = check_array("p", p, (model.bias_size,))
    s = torch.tensor(run.s)
    u = torch.tensor(run.u)
    warmup = 0 if from_rest else settings.warmup
    seen = Linearisation.of(model, s, u, found, warmup)
    for _ in range(rounds):
        found = found + seen.step(settings.freedom, settings.longest)
        seen = Linearisation.of(model, s, u, found, warmup)
    return found, seen


def estimate_bias(
    model: DPMPB,
    run: Run,
    p: ArrayLike | None = None,
    *,
    method: str = "sgd",
    settings: Any = None,
    from_rest: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Run the online estimation over a recorded run.

    Args:
        model: whose weights stay as they are.
        run: states and commands of one material.
        p: where the estimate starts, `[D_p]`; zeros by default.
        method: "sgd" for the paper's momentum SGD, "newton" for Gauss-Newton.
        settings: of that method, `EstimationSettings` or `NewtonSettings`.
        from_rest: whether all is at rest before the first step. Only Gauss-Newton makes
            use of it; the paper's rule always leaves out the first steps.

    Returns:
        The final p `[D_p]`, and p after each step `[T, D_p]`. If the run is too short
        for p to move at all, there is a warning.
    """
    check_same_step(model, check_run(run))
    newton = partial(NewtonEstimator, from_rest=from_rest)
    methods: dict[str, Any] = {
        "sgd": (BiasEstimator, EstimationSettings),
        "newton": (newton, NewtonSettings),
    }
    make, kind = choose("method", method, methods)
    what = f'settings with method="{method}"'
    estimator = make(model, p, settings_or_default(settings, kind, what))
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
