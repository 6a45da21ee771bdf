"""Online estimation of the parametric bias of an unknown cloth: W stays, only p moves (paper, "Online Estimation").

`BiasEstimator` is the paper's rule, momentum SGD. `NewtonEstimator` minimises nearly the same loss by its curvature,
which also says how sure the estimate is.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, check_number, setting
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import DPMPB, Sequences, observe
from clothlab.policies import Policy, Wrapper
from clothlab.simulation.env import Observation

LARGEST_LOSS = 1e38  # nearly the largest number in single precision
NO_LOSS = "this step is so far from what the model was trained on that there is no loss"


@dataclass(frozen=True)
class EstimationSettings(Checked):
    """Momentum SGD on p. The paper names the rule and no numbers; these are this project's, see notebook 07."""

    rate: float = setting(0.1, above=0)
    momentum: float = setting(0.9, at_least=0, at_most=1)
    window: int = setting(200, "step", at_least=1)  # how far back the data reach
    warmup: int = setting(10, "step", at_least=0)  # first steps of the memory, not in the loss

    def __post_init__(self) -> None:
        """Refuse windows from which p would never move."""
        super().__post_init__()
        if self.window <= self.warmup:
            raise ValueError(
                f"EstimationSettings.window must be longer than the warmup of {self.warmup} steps, got {self.window}"
            )


@dataclass(frozen=True)
class NewtonSettings(Checked):
    """Gauss-Newton on p, from development runs (commands from seed 46000 on).

    A run begins with a cloth that hangs still, and of that an empty memory is the right one: its first steps, in which
    the arm swings up, say most. Only where the window begins in the middle of a motion is the warm-up left out.
    """

    window: int = setting(200, "step", at_least=1)  # how far back the data reach
    warmup: int = setting(10, "step", at_least=0)  # of a window that begins in the middle of a motion
    least: int = setting(5, "step", at_least=2)  # predictions to judge before p moves
    freedom: float = setting(10.0, "-", above=0)  # Student's t: the smaller, the less do the largest errors count
    longest: float = setting(0.5, "-", above=0)  # way of p in one step
    lag: int = setting(5, "step", at_least=0)  # over which errors may depend on each other

    def __post_init__(self) -> None:
        """Refuse windows from which p would never move."""
        super().__post_init__()
        if self.window < self.warmup + self.least:
            raise ValueError(
                f"NewtonSettings.window must hold the warmup and {self.least} steps more, got {self.window}"
            )


@dataclass(frozen=True, eq=False)
class Fit:
    """How one p predicts a window, and what a small change of p would do.

    Attributes:
        errors: seen minus predicted next states `[T, D_s]` [s.d. of the state].
        slopes: derivative of the predictions with respect to p `[T, D_s, D_p]`.
    """

    errors: np.ndarray
    slopes: np.ndarray

    @classmethod
    def of(cls, model: DPMPB, s: Tensor, u: Tensor, p: ArrayLike, warmup: int = 0, nudge: float = 0.03) -> "Fit":
        """Predict with p and with its neighbours, all in one pass; slopes are central differences.

        Args:
            model: trained network.
            s: states `[T + 1, D_s]`.
            u: commands `[T + 1, D_u]`.
            p: parametric bias `[D_p]`.
            warmup: first steps, in which the memory fills, left out.
            nudge: half the distance of two neighbours.
        """
        p = np.asarray(p, dtype=np.float64)
        ways = nudge * np.eye(len(p))
        around = torch.as_tensor(np.concatenate([p[None], p + ways, p - ways]), dtype=s.dtype)
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
        """How far p is from the lowest loss, by Gauss-Newton with the weights of Student's t, `[D_p]`.

        With endless `freedom` all errors weigh the same. Where the predictions hardly depend on p, p hardly moves; a
        way longer than `longest` is cut to it.
        """
        freedom = check_number("freedom", freedom, above=0)
        longest = longest if longest is np.inf else check_number("longest", longest, at_least=0)
        weight = (freedom + 1) / (freedom + self._sizes)
        curvature = np.einsum("tdi,td,tdj->ij", self.slopes, weight, self.slopes)
        pull = np.einsum("tdi,td,td->i", self.slopes, weight, self.errors)
        way = np.linalg.pinv(curvature, rcond=1e-6, hermitian=True) @ pull
        return way * min(1, longest / max(float(np.linalg.norm(way)), 1e-12))

    def covariance(self, freedom: float = NewtonSettings.freedom, lag: int = NewtonSettings.lag) -> np.ndarray:
        """Covariance of p at the lowest loss, `[D_p, D_p]`.

        Curvature alone would be right if all errors were independent, equally large, and the model true. Between two
        curvatures stands what the pull on p really scattered by, neighbouring steps included (Newey and West, 1987).

        Raises:
            numpy.linalg.LinAlgError: predictions that do not depend on every direction of p.
        """
        freedom, lag = check_number("freedom", freedom, above=0), check_number("lag", lag, int, at_least=0)
        weight = (freedom + 1) / (freedom + self._sizes)
        bend = weight * (freedom - self._sizes) / (freedom + self._sizes)  # derivative of weight times error
        inverse = np.linalg.inv(np.einsum("tdi,td,tdj->ij", self.slopes, bend, self.slopes))
        pulls = np.einsum("tdi,td,td->ti", self.slopes, weight, self.errors)
        scatter = pulls.T @ pulls
        for k in range(1, min(lag, len(pulls) - 1) + 1):
            both = pulls[k:].T @ pulls[:-k]
            scatter += (1 - k / (lag + 1)) * (both + both.T)
        return inverse @ scatter @ inverse

    @property
    def _sizes(self) -> np.ndarray:
        """Squared errors over their mean."""
        return self.errors**2 / max(self.loss, 1e-12)


def prediction_loss(model: DPMPB, s: Tensor, u: Tensor, p: Tensor, warmup: int = EstimationSettings.warmup) -> Tensor:
    """L(p) over a run: how far the model's next states are from those that were seen (eq. 4, with W fixed).

    Args:
        model: trained network.
        s: states `[T, D_s]`.
        u: commands `[T, D_u]`.
        p: one parametric bias `[D_p]`, or several `[B, D_p]`.
        warmup: first steps, in which the memory fills, left out.

    Returns:
        Mean squared error in standard deviations, of each p: `[]` or `[B]`.
    """
    many = p if p.ndim > 1 else p[None]
    predicted, _ = model(s[:-1].expand(len(many), -1, -1), u[:-1].expand(len(many), -1, -1), many)
    losses = [model.loss(each[warmup:], s[1 + warmup :]) for each in predicted]
    return torch.stack(losses).reshape(p.shape[:-1])


class Estimator(ABC):
    """Moves p whenever a control step has been observed.

    Args:
        model: trained network.
        p: parametric bias to start from `[D_p]`; zeros when left out, as at the start of training.
        settings: how it moves, and how far back the data reach.

    Raises:
        ValueError: p of another size or not finite.
    """

    def __init__(self, model: DPMPB, p: ArrayLike | None, settings: EstimationSettings | NewtonSettings):
        self._window, self.model = settings.window, model
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
        """Take in one step and move p once.

        Args:
            s: state seen before the command, `[D_s]`.
            u: the command, `[D_u]`.

        Returns:
            The new estimate `[D_p]`.

        Raises:
            ValueError: a state or a command of another size, not finite or absurdly large; the estimate stays.
        """
        step = (
            check_array("s", s, (self.model.state_size,), np.float32),
            check_array("u", u, (self.model.command_size,), np.float32),
        )
        seen = [*self._seen, step][-self._window - 1 :]
        self._move(seen)
        self._seen = seen
        return self.p

    @property
    def fit(self) -> Fit | None:
        """How an estimate predicts what is in the window; None before there is anything to judge."""
        return self._judge(self._seen)

    @property
    def covariance(self) -> np.ndarray | None:
        """Covariance of the p with the lowest loss `[D_p, D_p]`, as `Fit.covariance`; None where not known yet."""
        fit = self.fit
        try:
            return None if fit is None else fit.covariance()
        except np.linalg.LinAlgError:
            return None

    @abstractmethod
    def _move(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Move p once by what was seen, or raise and leave it."""

    @abstractmethod
    def _judge(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> Fit | None:
        """How the current p predicts what was seen."""


class BiasEstimator(Estimator):
    """Takes one step of momentum SGD on p whenever a control step has been observed: the paper's rule.

    Args:
        model: trained network.
        p: parametric bias to start from `[D_p]`; zeros when left out, as at the start of training.
        settings: rate, momentum, window.

    Raises:
        ValueError: p of another size or not finite.
    """

    def __init__(self, model: DPMPB, p: ArrayLike | None = None, settings: EstimationSettings | None = None):
        self.settings = settings or EstimationSettings()
        super().__init__(model, p, self.settings)

    def reset(self) -> None:
        """Go back to the p it started from, and forget what was seen."""
        super().reset()
        self._optimizer = torch.optim.SGD([self._p], lr=self.settings.rate, momentum=self.settings.momentum)

    def _move(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> None:
        if len(seen) > self.settings.warmup + 1:
            self._optimizer.zero_grad()
            loss = prediction_loss(self.model, *_columns(seen), self._p, self.settings.warmup)
            if not loss.isfinite():
                raise ValueError(NO_LOSS)
            loss.backward(inputs=[self._p])
            self._optimizer.step()

    def _judge(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> Fit | None:
        if len(seen) <= self.settings.warmup + 1:
            return None
        return Fit.of(self.model, *_columns(seen), self.p, self.settings.warmup)


class NewtonEstimator(Estimator):
    """Takes one Gauss-Newton step on p whenever a control step has been observed, and so follows the lowest loss.

    Args:
        model: trained network.
        p: parametric bias to start from `[D_p]`; zeros when left out, as at the start of training.
        settings: window, weights, longest move.
        from_rest: whether the first step that it is given is that of a cloth that hangs still.

    Raises:
        ValueError: p of another size or not finite.
    """

    def __init__(
        self,
        model: DPMPB,
        p: ArrayLike | None = None,
        settings: NewtonSettings | None = None,
        *,
        from_rest: bool = True,
    ):
        self.settings, self._from_rest = settings or NewtonSettings(), from_rest
        super().__init__(model, p, self.settings)

    def _move(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> None:
        fit = self._judge(seen)
        if fit is None:
            return
        if not fit.loss < LARGEST_LOSS:
            raise ValueError(NO_LOSS)
        self._p = torch.tensor(self.p + fit.step(self.settings.freedom, self.settings.longest), dtype=torch.float32)

    def _judge(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> Fit | None:
        whole = self._from_rest and len(seen) <= self._window
        warmup = 0 if whole else self.settings.warmup
        if len(seen) - 1 - warmup < self.settings.least:
            return None
        return Fit.of(self.model, *_columns(seen), self.p, warmup)


def _columns(seen: list[tuple[np.ndarray, np.ndarray]]) -> tuple[Tensor, Tensor]:
    """States `[T, D_s]` and commands `[T, D_u]`."""
    s, u = (torch.as_tensor(np.stack(column)) for column in zip(*seen, strict=True))
    return s, u


class EstimatingPolicy(Wrapper):
    """Any policy, while p is estimated from what it does; the policy is told each new estimate.

    Args:
        policy: chooses the commands.
        estimator: starts from a p and improves it.
        autoencoder: the one that the estimator's model was trained with.

    Attributes:
        trace: the estimate after each step, a list of `[D_p]`.
    """

    def __init__(self, policy: Policy, estimator: Estimator, autoencoder: Autoencoder):
        self.estimator, self.autoencoder = estimator, autoencoder
        super().__init__(policy)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and begin with the p that the estimator started from."""
        super().reset(seed)
        self.estimator.reset()
        self.set_bias(self.estimator.p)
        self.trace: list[np.ndarray] = []

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.policy(observation)
        self.trace.append(self.estimator.update(observe(self.autoencoder, observation), u))
        self.set_bias(self.trace[-1])
        return u


def estimate_bias(
    model: DPMPB,
    run: Sequences,
    p: ArrayLike | None = None,
    settings: EstimationSettings | NewtonSettings | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Run the online estimation over a recorded run, as if it were happening.

    Args:
        model: trained network.
        run: states and commands.
        p: where to start `[D_p]`; zeros when left out.
        settings: of momentum SGD, as by default, or of Gauss-Newton: they say which.

    Returns:
        The final p `[D_p]` and its trace: p after each step, `[T, D_p]`.
    """
    estimator = new_estimator(model, p, settings)
    trace = np.stack([estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)])
    return trace[-1], trace


def new_estimator(
    model: DPMPB, p: ArrayLike | None = None, settings: EstimationSettings | NewtonSettings | None = None
) -> Estimator:
    """The estimator that these settings are made for; momentum SGD when left out."""
    if isinstance(settings, NewtonSettings):
        return NewtonEstimator(model, p, settings)
    return BiasEstimator(model, p, settings)
