"""Checks of notebook 06: what is drawn, what is right, and what usual slips give."""

import numpy as np
import torch

from clothlab.checks.ask import Question, exercise
from clothlab.method.data import Run


@exercise("a step of p", 2)
def bare_step(rng: np.random.Generator) -> Question:
    """The step `[2]` of p that makes the sum of squares of e - J step smallest.

    Given are twelve residuals `[12]` and their slopes `[12, 2]` by the numbers of p.
    """
    J = rng.normal(size=(12, 2)) @ np.array([[1.0, 0.6], [0.0, 0.5]])
    e = rng.normal(0.5, 1.0, 12)
    curved = J.T @ J
    downhill = J.T @ e
    truth = np.linalg.solve(curved, downhill)
    slips = {
        "the step goes the wrong way": -truth,
        "this is the downhill direction alone: solve the two equations": downhill,
        "each number has its own step here, as if the other stood still: what one does "
        "to a prediction, the other may undo": downhill / np.diag(curved),
        "the matrix stands on the other side of its equation": curved @ downhill,
    }
    return Question(
        (e, J),
        truth,
        slips,
        lambda found: (
            "after this step the misses have the sum of squares "
            f"{np.sum((e - J @ found) ** 2):.4g}; {np.sum((e - J @ truth) ** 2):.4g} "
            "is possible"
        ),
    )


@exercise("p after each step", 30, 2, rtol=1e-3, atol=1e-5)
def online(rng: np.random.Generator) -> Question:
    """The p `[30, 2]` of momentum SGD on the loss over a sliding window, from zero.

    Given are a run of 30 steps, the loss of states, commands and p, the rate, the
    momentum and the window. The first five predictions are waited for.
    """
    # A run, and the settings of a loop over it
    u = rng.uniform(-2, 2, (30, 2)).astype(np.float32)
    s = rng.normal(size=(30, 2)).astype(np.float32)
    rate = rng.uniform(0.02, 0.06)
    momentum = rng.uniform(0.5, 0.8)

    def loop(
        rate: float = rate, momentum: float = momentum, window: int = 12
    ) -> np.ndarray:
        """The p after each step `[T, 2]`, by the slope of a parabola."""
        p = np.zeros(2)
        b = np.zeros(2)
        path = []
        for t in range(len(s)):
            if t >= 5:
                first = max(0, t - window)
                seen = slice(first, t)
                after = slice(first + 1, t + 1)
                error = s[seen] + p * u[seen] - s[after]
                b = momentum * b + (2 * error * u[seen]).sum(axis=0) / error.size
                p = p - rate * b
            path.append(p)
        return np.array(path)

    slips = {
        "p stays where it was: let it move": np.zeros((30, 2)),
        "the buffer keeps a share of the old gradients: the momentum": loop(momentum=0),
        "p moves by the rate times the buffer, down and not up": loop(rate=-rate),
        "the loss is that of the window alone, from its first step on": loop(window=30),
    }
    given = (Run(s, u, "any"), _toy_loss, rate, momentum, 12)
    otherwise = "p differs from that of momentum SGD on the loss over the window"
    return Question(given, loop(), slips, otherwise)


def _toy_loss(s: torch.Tensor, u: torch.Tensor, p: torch.Tensor) -> torch.Tensor:
    """Loss of a model in which a state moves by p times the command."""
    error = s[:-1] + p * u[:-1] - s[1:]
    return error.square().mean()
