"""Checks of notebook 08."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import CheckFailed, array, check, expect
from clothlab.learning.control import ControlSettings, period_mask


@check(array("a list of 0 and 1", None))
def my_mask(answer: Callable) -> None:
    """The paper's example, then any horizon and period."""
    for t, wanted in ((2, [0, 1, 0, 0]), (3, [1, 0, 0, 0]), (4, [0, 0, 0, 1])):
        found = answer(t, 4, 4)
        assert len(found) == 4, f"one number for each of the 4 predicted steps, not {len(found)}"
        now = np.roll(wanted, 1).tolist()
        message = f"for t = {t} the paper's example has {wanted}, got {_integers(found)}"
        expect(found, wanted, message, {message + "; the first number is that of step t + 1, not of step t": now})
    for t, horizon, period in ((0, 8, 3), (5, 8, 1), (7, 3, 8), (21, 8, 8)):
        found, case = answer(t, horizon, period), f"t = {t}, horizon = {horizon}, period = {period}"
        assert len(found) == horizon, f"{case}: one number for each of the {horizon} predicted steps, not {len(found)}"
        wanted = period_mask(t, ControlSettings(horizon=horizon, period=period)).tolist()
        message = f"{case}: 1 is where the step is a multiple of {period}; got {_integers(found)}"
        expect(found, wanted, message)


def _integers(found: np.ndarray) -> list[float]:
    return [int(value) if value == int(value) else value for value in found.tolist()]


@check(array("one sequence of commands for each γ", None, 8, 2))
def steps_along(answer: Callable) -> None:
    """Shape, length, direction, range."""
    rng = np.random.default_rng(0)
    u, g, gammas = rng.uniform(-0.2, 0.2, (8, 2)), rng.normal(size=(8, 2)), np.array([0.0, 0.01, 0.1])
    lower, upper = np.array([-1.0, -0.4]), np.array([0.5, 0.6])

    def step(g: np.ndarray, gammas: np.ndarray) -> np.ndarray:
        return answer(u.copy(), g.copy(), gammas.copy(), lower, upper)

    found, way = step(g, gammas), gammas[:, None, None]
    assert len(found) == 3, f"one sequence of commands for each γ: three, not {len(found)}"
    assert not np.allclose(found, u + way * g / np.linalg.norm(g)), "the step goes uphill"
    moved = np.linalg.norm(found - u, axis=(1, 2))
    assert not np.allclose(moved, gammas * np.linalg.norm(g)), "the length of g must not matter, only its direction"
    message = f"a step must be as long as its γ, {gammas}; yours are {moved.round(3)}"
    assert np.allclose(moved, gammas, atol=1e-6), message
    truth = u - way * g / np.linalg.norm(g)
    expect(found, truth, "the steps have the right lengths, but another direction than straight down along g")
    expect(step(5 * g, gammas), truth, "the length of g must not matter, only its direction")
    far, clipped = step(g, np.array([3.0]))[0], np.clip(u - 3 * g / np.linalg.norm(g), lower, upper)
    outside = "a command left its range: use numpy.clip, with the lower and the upper that you are given"
    assert np.all((far >= lower - 1e-6) & (far <= upper + 1e-6)), outside
    expect(far, clipped, "only the commands that leave their range are changed: use numpy.clip")


class _Bowl:
    """A loss with its minimum at `bottom`, which remembers the sequences that it was asked about."""

    def __init__(self, bottom: np.ndarray):
        self.bottom, self.asked, self.calls = bottom, np.empty((0, 4, 2)), 0

    def __call__(self, u: np.ndarray) -> np.ndarray:
        u = np.asarray(u, dtype=float)
        if u.ndim != 3 or u.shape[1:] != (4, 2):
            raise CheckFailed(f"predict_loss takes a batch of sequences, here of shape (…, 4, 2); yours has {u.shape}")
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
    is_start = np.isclose(asked, start).all(axis=(1, 2))
    assert is_start.any(), "the start is a sequence to try, too: without it, the answer can be worse than the start"
    _expect_uniform(asked[~is_start], lower, upper)
    losses = bowl(asked)
    slips = {"that is the sequence with the largest loss": asked[losses.argmax()]}
    expect(found, asked[losses.argmin()], "among the sequences tried, another one has a lower loss", slips)
    expect(shoot(start)[0], start, "where nothing is better than the start, return the start")
    again, other = shoot(upper + 0.2)[1].asked, shoot(upper + 0.2, seed=1)[1].asked
    assert np.array_equal(asked, again), "the same rng must draw the same sequences: use it, and no other"
    assert not np.array_equal(asked, other), "another rng must draw other sequences: use the one that is handed over"


def _expect_uniform(drawn: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    """Sequences `[N, 4, 2]`, each command of which is drawn from its whole range, for itself."""
    outside = "a command left its range: each of the two has its own lower and upper"
    assert np.all((drawn >= lower) & (drawn <= upper)), outside
    assert len(drawn) > 1, "draw the others at random: yours are all the start"
    reach = np.ptp(drawn, axis=(0, 1)) / (upper - lower)
    assert reach.min() > 0.9, f"draw from the whole range; yours fills {reach.min():.0%} of it"
    share = (drawn - lower) / (upper - lower)
    inner = ((share > 0.25) & (share < 0.75)).mean(axis=(0, 1))
    message = "half of all commands lie in the middle half of their range, yours {:.0%}: draw uniformly, without a peak"
    assert np.all(abs(inner - 0.5) < 0.1), message.format(inner[abs(inner - 0.5).argmax()])
    assert np.ptp(drawn, axis=1).min() > 0, "each step gets a command of its own: yours repeat one"
