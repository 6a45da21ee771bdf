"""Checks of notebook 08."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import CheckFailed, array, check, policy
from clothlab.control import ControlSettings, period_mask

__all__ = ["alternate", "my_mask", "random_shooting", "steps_along"]


@check(array("a list of 0 and 1", None))
def my_mask(answer: Callable) -> None:
    """The paper's example, then any horizon and period."""
    for t, wanted in ((2, [0, 1, 0, 0]), (3, [1, 0, 0, 0]), (4, [0, 0, 0, 1])):
        found = answer(t, 4, 4)
        assert list(found) == wanted, f"for t = {t} the paper's example has {wanted}, got {list(found)}"
    for t, horizon, period in ((0, 8, 3), (5, 8, 1), (7, 3, 8)):
        wanted = list(period_mask(t, ControlSettings(horizon=horizon, period=period)).astype(int))
        assert list(answer(t, horizon, period)) == wanted, f"wrong for t = {t}, horizon = {horizon}, period = {period}"


@check(array("one sequence of commands for each γ", None, 8, 2))
def steps_along(answer: Callable) -> None:
    """Shape, length, direction, range."""
    rng = np.random.default_rng(0)
    u, g, gammas = rng.uniform(-0.5, 0.5, (8, 2)), rng.normal(size=(8, 2)), np.array([0.0, 0.01, 0.1])
    found = answer(u, g, gammas, -1.0, 1.0)
    assert len(found) == 3, f"one sequence of commands for each γ: three, not {len(found)}"
    longer = answer(u, 5 * g, gammas, -1.0, 1.0)
    assert np.allclose(found, longer), "the length of g must not matter, only its direction"
    moved = np.linalg.norm(found - u, axis=(1, 2))
    assert np.allclose(moved, gammas), f"a step must be as long as its γ, {gammas}; yours are {moved.round(3)}"
    assert np.sum((found[2] - u) * g) < 0, "the step goes uphill"
    far = answer(u, g, np.array([100.0]), -1.0, 1.0)
    assert np.abs(far).max() <= 1, "a command left its range: use numpy.clip"


class _Recorder:
    """Stands in for a controller: its commands tell which reference it was given."""

    z_ref = None

    def __call__(self, observation: None) -> list[float]:
        return [ord(self.z_ref or "?"), 0.0]


@check(policy(2))
def alternate(answer: Callable) -> None:
    """Seven solves of a period of three with two references."""
    policy = answer(_Recorder(), ["a", "b"], period=3)
    found = "".join(chr(int(policy(None)[0])) for _ in range(7))
    assert found == "aaabbba", f"with a period of 3 the references are a a a b b b a, got {' '.join(found)}"


class _Bowl:
    """A loss with its minimum at `bottom`, which remembers the sequences that it was asked about."""

    def __init__(self, bottom: np.ndarray):
        self.bottom, self.asked, self.calls = bottom, np.empty((0, 4, 2)), 0

    def __call__(self, u: np.ndarray) -> np.ndarray:
        if np.shape(u)[1:] != (4, 2):
            told = "predict_loss takes a batch of sequences, here of shape (…, 4, 2); yours has"
            raise CheckFailed(f"{told} {np.shape(u)}")
        self.asked, self.calls = np.concatenate([self.asked, u]), self.calls + 1
        return np.square(u - self.bottom).sum(axis=(1, 2))


@check(array("the best sequence of commands", 4, 2))
def random_shooting(answer: Callable) -> None:
    """What is tried: how many, from where, the start; what is returned: the best of it."""
    lower, upper, start, count = np.array([-1.0, -0.2]), np.array([0.5, 0.3]), np.full((4, 2), -0.1), 200

    def shoot(bottom: np.ndarray, seed: int = 0) -> tuple[np.ndarray, _Bowl]:
        bowl = _Bowl(bottom)
        return answer(bowl, start.copy(), lower, upper, np.random.default_rng(seed), count), bowl

    found, bowl = shoot(upper + 0.2)
    asked = bowl.asked
    tried = f"of {count} sequences, the start among them, predict_loss was asked about {len(asked)}"
    assert len(asked) == count, tried
    assert bowl.calls < 10, f"ask about all sequences at once: {bowl.calls} calls take far longer than one"
    outside = "a command left its range: each of the two has its own lower and upper"
    assert np.all((asked >= lower) & (asked <= upper)), outside
    is_start = np.isclose(asked, start).all(axis=(1, 2))
    assert is_start.any(), "the start is a sequence to try, too: without it, the answer can be worse than the start"
    drawn = asked[~is_start]
    reach = np.ptp(drawn, axis=(0, 1)) / (upper - lower)
    assert reach.min() > 0.9, f"draw from the whole range; yours fills {reach.min():.0%} of it"
    assert np.ptp(drawn, axis=1).min() > 0, "each step gets a command of its own: yours repeat one"
    losses = bowl(asked)
    assert not np.allclose(found, asked[losses.argmax()]), "that is the sequence with the largest loss"
    assert not np.allclose(found, asked[-1]), "that is the last sequence tried, not the best"
    assert np.allclose(found, asked[losses.argmin()]), "among the sequences tried, another one has a lower loss"
    assert np.allclose(shoot(start)[0], start), "where nothing is better than the start, return the start"
    again, other = shoot(upper + 0.2)[1].asked, shoot(upper + 0.2, seed=1)[1].asked
    assert np.array_equal(asked, again), "the same rng must draw the same sequences: use it, and no other"
    assert not np.array_equal(asked, other), "another rng must draw other sequences: use the one that is handed over"
