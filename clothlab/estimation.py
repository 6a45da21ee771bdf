"""Online estimation of the parametric bias of an unknown cloth: W stays, only p moves (paper, "Online Estimation")."""

from dataclasses import dataclass, field

import numpy as np
import torch

from clothlab.dpmpb import DPMPB, Sequences

__all__ = ["BiasEstimator", "EstimationSettings", "estimate_bias"]


@dataclass(frozen=True)
class EstimationSettings:
    """Momentum SGD on p. The paper names the rule and no numbers; these are this project's, see notebook 07."""

    rate: float = field(default=0.1, metadata={"unit": "-"})
    momentum: float = field(default=0.9, metadata={"unit": "-"})
    window: int = field(default=200, metadata={"unit": "step"})  # how far back the data reach
    warmup: int = field(default=10, metadata={"unit": "step"})  # first steps of the memory, not in the loss


class BiasEstimator:
    """Takes one step of momentum SGD on p whenever a control step has been observed."""

    def __init__(self, model: DPMPB, p: np.ndarray | None = None, settings: EstimationSettings | None = None):
        """Start from the current p.

        Args:
            model: trained network.
            p: parametric bias to start from `[D_p]`; zeros when left out, as at the start of training.
            settings: rate, momentum, window.

        Raises:
            ValueError: p of another size or not finite.
        """
        self.settings = settings or EstimationSettings()
        self.model = model
        p = np.zeros(model.bias_size) if p is None else np.asarray(p)
        if p.shape != (model.bias_size,) or not np.isfinite(p).all():
            raise ValueError(f"p is [{model.bias_size}] and finite, got {p}")
        self._p = torch.tensor(p, dtype=torch.float32, requires_grad=True)
        self._optimizer = torch.optim.SGD([self._p], lr=self.settings.rate, momentum=self.settings.momentum)
        self._s: list[np.ndarray] = []
        self._u: list[np.ndarray] = []

    @property
    def p(self) -> np.ndarray:
        """The current estimate, `[D_p]`."""
        return self._p.detach().numpy().copy()

    def update(self, s: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Take in one step and move p once.

        Args:
            s: state seen before the command, `[D_s]`.
            u: the command, `[D_u]`.

        Returns:
            The new estimate `[D_p]`.
        """
        window = self.settings.window + 1
        self._s, self._u = [*self._s, s][-window:], [*self._u, u][-window:]
        if len(self._s) > self.settings.warmup + 1:
            s = torch.as_tensor(np.stack(self._s), dtype=torch.float32).unsqueeze(0)
            u = torch.as_tensor(np.stack(self._u), dtype=torch.float32).unsqueeze(0)
            self._optimizer.zero_grad()
            self._loss(s, u).backward(inputs=[self._p])
            self._optimizer.step()
        return self.p

    def _loss(self, s: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        predicted, _ = self.model(s[:, :-1], u[:, :-1], self._p)
        first = self.settings.warmup
        return self.model.loss(predicted[:, first:], s[:, 1 + first :])


def estimate_bias(
    model: DPMPB, run: Sequences, p: np.ndarray | None = None, settings: EstimationSettings | None = None
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
