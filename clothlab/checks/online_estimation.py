"""Checks of notebook 07."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import array, check, number

__all__ = ["curvature", "momentum_step", "steps_until_right"]


@check(array("the new p and the new v", 2, 2))
def momentum_step(answer: Callable) -> None:
    """Compare with torch on the bowl x² + 5 y², for ten steps."""
    scale = torch.tensor([1.0, 5.0])
    wanted = torch.tensor([3.0, -1.0], requires_grad=True)
    optimizer = torch.optim.SGD([wanted], lr=0.02, momentum=0.9)
    p, v = wanted.detach().numpy().copy(), np.zeros(2)
    for step in range(1, 11):
        optimizer.zero_grad()
        (scale * wanted**2).sum().backward()
        optimizer.step()
        found = answer(p, v, 2 * scale.numpy() * p, rate=0.02, momentum=0.9)
        p, v = found
        hint = "p moves by the new v, not by the old one" if step == 1 else "the old v must be kept, times the momentum"
        assert np.allclose(p, wanted.detach().numpy(), atol=1e-4), f"wrong after step {step}: {hint}"


@check(number("a second derivative"))
def curvature(answer: Callable) -> None:
    """A bowl of known curvature, off its bottom, with a direction that is not of length 1."""

    def bowl(p: np.ndarray) -> float:
        return 3 * (p[0] - 1) ** 2 + 0.5 * p[1] ** 2 + p[0]

    found = answer(bowl, np.zeros(2), np.array([1.0, 0.0]))
    assert np.isclose(found, 6), f"3 x² has the second derivative 6 everywhere, got {found:.3f}"
    found = answer(bowl, np.zeros(2), np.array([0.0, 4.0]))
    message = f"0.5 y² has the second derivative 1, got {found:.3f}: divide the direction by its length"
    assert np.isclose(found, 1), message


@check(number("a number of steps, or None", none=True))
def steps_until_right(answer: Callable) -> None:
    """A made-up map of two cloths."""
    two = {"left": np.array([-1.0, 0.0]), "right": np.array([1.0, 0.0])}
    path = np.array([[-1.0, 0], [0.5, 0], [-0.5, 0], [0.2, 0], [0.9, 0]])
    found = answer(path, "right", two)
    assert found != 1, "it was right at step 1, but not for good"
    assert found == 3, f"the path is right for good from step 3, got {found}"
    assert answer(path, "left", two) is None, "a path that ends wrong must give None"
    assert answer(path[3:], "right", two) == 0, "a path that is right from the start must give 0"
