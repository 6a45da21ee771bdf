"""Checks of notebook 08."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check
from clothlab.control import ControlSettings, period_mask

__all__ = ["alternate", "my_mask", "steps_along"]


@check
def my_mask(answer: Callable) -> None:
    """The paper's example, then any horizon and period."""
    for t, wanted in ((2, [0, 1, 0, 0]), (3, [1, 0, 0, 0]), (4, [0, 0, 0, 1])):
        found = answer(t, 4, 4)
        assert found is not None, "my_mask returned None"
        assert list(found) == wanted, f"for t = {t} the paper's example has {wanted}, got {list(found)}"
    for t, horizon, period in ((0, 8, 3), (5, 8, 1), (7, 3, 8)):
        wanted = list(period_mask(t, ControlSettings(horizon=horizon, period=period)).astype(int))
        assert list(answer(t, horizon, period)) == wanted, f"wrong for t = {t}, horizon = {horizon}, period = {period}"


@check
def steps_along(answer: Callable) -> None:
    """Shape, length, direction, range."""
    rng = np.random.default_rng(0)
    u, g, gammas = rng.uniform(-0.5, 0.5, (8, 2)), rng.normal(size=(8, 2)), np.array([0.0, 0.01, 0.1])
    found = answer(u, g, gammas, -1.0, 1.0)
    assert found is not None, "steps_along returned None"
    message = f"one sequence of commands for each γ: shape (3, 8, 2), got {np.shape(found)}"
    assert np.shape(found) == (3, 8, 2), message
    longer = answer(u, 5 * g, gammas, -1.0, 1.0)
    assert np.allclose(found, longer), "the length of g must not matter, only its direction"
    moved = np.linalg.norm(found - u, axis=(1, 2))
    assert np.allclose(moved, gammas), f"a step must be as long as its γ, {gammas}; yours are {moved.round(3)}"
    assert np.sum((found[2] - u) * g) < 0, "the step goes uphill"
    far = answer(u, g, np.array([100.0]), -1.0, 1.0)
    assert np.abs(far).max() <= 1, "a command left its range: use numpy.clip"


class _Recorder:
    """Stands in for a controller: returns the reference it was given."""

    z_ref = None

    def __call__(self, observation: None) -> str | None:
        return self.z_ref


@check
def alternate(answer: Callable) -> None:
    """Seven solves of a period of three with two references."""
    policy = answer(_Recorder(), ["a", "b"], period=3)
    assert callable(policy), "alternate must return a policy, a function of the observation"
    found = "".join(str(policy(None)) for _ in range(7))
    assert found == "aaabbba", f"with a period of 3 the references are a a a b b b a, got {' '.join(found)}"
