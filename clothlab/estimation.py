"""Online estimation of the parametric bias of an unknown cloth: W stays, only p moves (paper, "Online Estimation")."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, setting
from clothlab.autoencoder import Autoencoder
from clothlab.dpmpb import DPMPB, Sequences, observe
from clothlab.env import Observation
from clothlab.trials import Policy, Wrapper


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


class BiasEstimator:
    """Takes one step of momentum SGD on p whenever a control step has been observed.

    Args:
        model: trained network.
        p: parametric bias to start from `[D_p]`; zeros when left out, as at the start of training.
        settings: rate, momentum, window.

    Raises:
        ValueError: p of another size or not finite.
    """

    def __init__(self, model: DPMPB, p: ArrayLike | None = None, settings: EstimationSettings | None = None):
        self.settings = settings or EstimationSettings()
        self.model = model
        self._start = check_array("p", np.zeros(model.bias_size) if p is None else p, (model.bias_size,), np.float32)
        self.reset()

    def reset(self) -> None:
        """Go back to the p it started from, and forget what was seen."""
        self._p = torch.tensor(self._start, requires_grad=True)
        self._optimizer = torch.optim.SGD([self._p], lr=self.settings.rate, momentum=self.settings.momentum)
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
        seen = [*self._seen, step][-self.settings.window - 1 :]
        if len(seen) > self.settings.warmup + 1:
            states, commands = (torch.as_tensor(np.stack(column)) for column in zip(*seen, strict=True))
            self._optimizer.zero_grad()
            loss = prediction_loss(self.model, states, commands, self._p, self.settings.warmup)
            if not loss.isfinite():
                raise ValueError("this step is so far from what the model was trained on that there is no loss")
            loss.backward(inputs=[self._p])
            self._optimizer.step()
        self._seen = seen
        return self.p


class EstimatingPolicy(Wrapper):
    """Any policy, while p is estimated from what it does; the policy is told each new estimate.

    Args:
        policy: chooses the commands.
        estimator: starts from a p and improves it.
        autoencoder: the one that the estimator's model was trained with.

    Attributes:
        trace: the estimate after each step, a list of `[D_p]`.
    """

    def __init__(self, policy: Policy, estimator: BiasEstimator, autoencoder: Autoencoder):
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
    model: DPMPB, run: Sequences, p: ArrayLike | None = None, settings: EstimationSettings | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Run the online estimation over a recorded run, as if it were happening.

    Args:
        model: trained network.
        run: states and commands.
        p: where to start `[D_p]`; zeros when left out.
        settings: rate, momentum, window.

    Returns:
        The final p `[D_p]` and its trace: p after each step, `[T, D_p]`.
    """
    estimator = BiasEstimator(model, p, settings)
    trace = np.stack([estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)])
    return trace[-1], trace
