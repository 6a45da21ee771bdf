"""Checks of notebook 09."""

from collections.abc import Callable

import numpy as np
import torch
from scipy.special import ndtr, ndtri  # of a normal number, and its inverse

from clothlab.checks._check import CheckFailed, array, arrays, check, expect, number


@check(array("one price for each plan", None))
def jerk_price(answer: Callable, rng: np.random.Generator) -> None:
    """How much each of some plans jerks.

    Given are plans, a tensor `[B, T, 2]`; expected is one price each `[B]`: the sum of
    the squares of all changes from one command to the next.
    """
    for _ in range(2):
        # Some plans, and what is right
        count = int(rng.integers(3, 7))
        plans = rng.uniform(-1, 1, (count, 8, 2))
        found = answer(torch.tensor(plans, dtype=torch.float32))
        changes = np.diff(plans, axis=1)
        truth = (changes**2).sum(axis=(1, 2))

        # What usual slips give
        size = "a command that is far from 0 is no jerk: price the *changes*"
        signed = "changes up and down cancel: square them before you add them"
        other = "a change goes from one step to the next one: along the axis 1"
        slips = {
            size: (plans**2).sum(axis=(1, 2)),
            signed: changes.sum(axis=(1, 2)),
            "not their sizes: the squares": np.abs(changes).sum(axis=(1, 2)),
            "their sum, not their mean": (changes**2).mean(axis=(1, 2)),
            other: (np.diff(plans, axis=2) ** 2).sum(axis=(1, 2)),
        }

        # What the reader's function makes of them
        assert len(found) == count, (
            f"there are {count} plans, and not {len(found)}: one price for each"
        )
        otherwise = f"the first plan's price is {truth[0]:.3f}, not {found[0]:.3f}"
        expect(found, truth, otherwise, slips, rtol=1e-4)


@check(number("by how much the winner's score exceeds its own worth"))
def luck_of_best(answer: Callable, rng: np.random.Generator) -> None:
    """By how much the best score of several tries exceeds its own worth, on average.

    Given are how many tries there were, and the standard deviations of a score's miss
    and of what tries are worth. Expected is the mean miss of the winner, within a few
    per cent, so that it may be simulated.
    """
    # One try, equal ones, and some that differ; with one there is no choice
    for count in (1, int(rng.integers(4, 7)), int(rng.integers(20, 40))):
        spread = rng.uniform(2.0, 9.0)
        worth = 0.0 if count < 7 else spread * rng.uniform(0.8, 1.5)
        found = answer(count, spread, worth)
        both = np.hypot(spread, worth)
        largest = _mean_of_largest(count)
        truth = spread**2 / both * largest

        # What usual slips give
        slips: dict[str, float] = {}
        if count > 1:
            scatters = "a score misses by `spread`: where does it enter?"
            slips[scatters] = largest / np.hypot(1, worth)
            shown = "choose by the *score*: you don't know what tries are worth"
            slips[shown] = 0
        if worth:
            own = "the winner may be worth something: subtract its *own* worth"
            slips[own] = both * largest
            equal = "tries truly differ by `worth`: where does it enter?"
            slips[equal] = spread * largest
        otherwise = (
            f"of {count} tries that miss by {spread:.2f} and differ by {worth:.2f}, "
            f"the best shows {truth:.2f} too much, not {found:.2f}"
        )
        expect(found, truth, otherwise, slips, rtol=0.03, atol=0.03 * spread)


def _mean_of_largest(count: int) -> float:
    """Mean of the largest of some standard normal numbers."""
    x = np.linspace(-9, 9, 20_001)
    normal = np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)
    density = count * normal * ndtr(x) ** (count - 1)
    return float(np.trapezoid(x * density, x))


@check(array("the two ends of the interval", 2))
def score_interval(answer: Callable, rng: np.random.Generator) -> None:
    """Both ends of an interval for a mean score, by resampling.

    Given are scores `[tasks, throws]`, whose throws resemble each other within a task,
    the share of the resampled means that it holds, and a generator.
    """
    # Twelve tasks of eight throws
    own = rng.normal(0, 20, (12, 1))
    scores = rng.uniform(30, 60) + own + rng.normal(0, 5, (12, 8))
    for share in (0.5, 0.95):
        found = answer(scores.copy(), share, np.random.default_rng(rng.integers(2**32)))
        lower = float(found[0])
        upper = float(found[1])
        assert lower <= upper, "return the lower end first"
        tails = [0.5 - share / 2, 0.5 + share / 2]
        truth = np.quantile(_resampled_tasks(scores, rng), tails)
        half = ndtri(tails[1])
        sigma = (truth[1] - truth[0]) / (2 * half)

        # Each throw for itself: far too narrow
        if upper - lower < 0.6 * (truth[1] - truth[0]):
            raise CheckFailed(
                "the interval is too narrow: throws at one target resemble each "
                "other, so draw whole tasks anew"
            )
        if not np.isclose(found.mean(), scores.mean(), atol=0.35 * sigma):
            raise CheckFailed(
                "the interval has another middle than the mean of all throws"
            )
        otherwise = (
            f"the middle {share:.0%} of the resampled means lie between "
            f"{truth[0]:.1f} and {truth[1]:.1f}, not between {lower:.1f} and "
            f"{upper:.1f}"
        )
        expect(found, truth, otherwise, rtol=0, atol=0.35 * sigma)


def _resampled_tasks(scores: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Mean scores of 4,000 draws of as many tasks, `[4000]`."""
    drawn = rng.integers(len(scores), size=(4000, len(scores)))
    return scores.mean(axis=1)[drawn].mean(axis=1)


_THROWS = 300
_WORLDS = 6


@check(array("a plan of 8 commands", 8, 2))
def next_plan(answer: Callable, rng: np.random.Generator) -> None:
    """Which plan `[8, 2]` to throw next, from the outcomes of those before.

    Given are the plans thrown so far `[N, 8, 2]`, the distance of each `[N]`, the
    limits of a command `[2]`, and a generator. Some robots whose outcomes are smooth
    are thrown with, three hundred times each: the best distance must fall to about half
    of that of the first three, which chance alone doesn't reach.
    """
    left = []
    for _ in range(_WORLDS):
        robot = _SmoothRobot(rng)
        for _ in range(_THROWS):
            plan = answer(*robot.seen(), robot.lower, robot.upper, robot.chance)
            robot.throw(plan)
        left.append(robot.best / robot.first)
    _refuse_what_stands_still(robot)
    share = float(np.mean(left))
    assert share < 0.6, (
        f"after {_THROWS} throws the best distance is {share:.0%} of the first: are "
        "new plans near the best one so far, and smaller changes than a whole range?"
    )


class _SmoothRobot:
    """A robot whose distance grows smoothly around one plan that nobody knows."""

    def __init__(self, rng: np.random.Generator):
        self.lower = rng.uniform(-1.2, -0.9, 2)
        self.upper = rng.uniform(0.9, 1.2, 2)
        self.chance = np.random.default_rng(rng.integers(2**32))
        turn, _ = np.linalg.qr(rng.normal(size=(16, 16)))
        self._weights = turn * 0.8 ** np.arange(16)
        self._goal = rng.uniform(-0.6, 0.6, (8, 2))
        self.plans: list[np.ndarray] = []
        self.distances: list[float] = []
        for _ in range(3):
            self.throw(rng.uniform(-0.6, 0.6, (8, 2)))
        self.first = self.best

    @property
    def best(self) -> float:
        """The smallest distance so far."""
        return min(self.distances)

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """All plans thrown so far `[N, 8, 2]`, and their distances `[N]`."""
        return np.array(self.plans), np.array(self.distances)

    def throw(self, plan: np.ndarray) -> None:
        """Note a plan and where it led; a CheckFailed if the arm can't send it."""
        inside = (plan >= self.lower - 1e-9) & (plan <= self.upper + 1e-9)
        if not inside.all():
            raise CheckFailed(
                "a command left its range: clip the plan to the lower and upper that "
                "you are given"
            )
        self.plans.append(np.array(plan))
        gap = (plan - self._goal).ravel() @ self._weights
        self.distances.append(float(np.linalg.norm(gap)))


def _refuse_what_stands_still(robot: _SmoothRobot) -> None:
    """Raise CheckFailed where hardly any plan is new."""
    different = len(np.unique(np.round(robot.plans, 9), axis=0))
    assert different > _THROWS / 2, (
        f"of {_THROWS} plans only {different} differ: who throws the same again and "
        "again learns nothing"
    )


_INTERVAL = arrays(
    "two numbers, the lower and the upper end",
    number("the lower end"),
    number("the upper end"),
)
_SHARE = 0.8


@check(_INTERVAL)
def constant_interval(answer: Callable, rng: np.random.Generator) -> None:
    """An 80 % interval for the logarithm of a constant of a hidden cloth.

    Given are its estimated p `[2]` with covariance `[2, 2]`, the trained p of nine
    cloths `[9, 2]`, and the logarithm of the constant of each `[9]`. Judged are
    coverage and width over six hundred hidden cloths.
    """
    held = []
    widths = []
    ideal = []
    for _ in range(30):
        world = _LinearWorld(rng)
        for _ in range(20):
            p, truth = world.hide()
            lower, upper = answer(p, world.covariance, world.biases, world.logs)
            held.append(lower <= truth <= upper)
            widths.append(upper - lower)
            ideal.append(world.width)
    assert min(widths) >= 0, "return the lower end first"

    # How often, and how wide
    coverage = float(np.mean(held))
    ratio = float(np.mean(widths) / np.mean(ideal))
    said = f"of 600 hidden cloths {coverage:.0%} lie in your {_SHARE:.0%} intervals"
    assert coverage > 0.66, (
        f"{said}: too few. Two things are uncertain, p itself and the straight line "
        "that reads a constant off p"
    )
    assert ratio < 1.4, (
        f"{said}, but these are {ratio:.1f} times as wide as they need to be"
    )
    assert coverage < 0.93, f"{said}: that is another share than was asked for"


class _LinearWorld:
    """Nine cloths whose p a line reads, nearly, and hidden ones with a noisy p."""

    def __init__(self, rng: np.random.Generator):
        self._rng = rng
        self._slope = rng.normal(size=2)
        self._slope *= rng.uniform(0.8, 1.2) / np.linalg.norm(self._slope)
        self._offset = rng.uniform(-3, -1)

        # The line misses by about as much as the error of p moves it
        root = rng.normal(size=(2, 2))
        self.covariance = root @ root.T + 0.3 * np.eye(2)
        self.covariance *= 0.15**2 / (self._slope @ self.covariance @ self._slope)
        self._misses = rng.uniform(0.14, 0.17)
        self.biases = rng.normal(size=(9, 2))
        self.logs = self._log(self.biases)
        both = np.hypot(0.15, self._misses)
        self.width = 2 * float(ndtri(0.5 + _SHARE / 2) * both)

    def _log(self, p: np.ndarray) -> np.ndarray:
        noise = self._rng.normal(0, self._misses, len(p))
        return self._offset + p @ self._slope + noise

    def hide(self) -> tuple[np.ndarray, float]:
        """The estimated p `[2]` of another cloth, and the logarithm of its constant."""
        p = self._rng.normal(size=(1, 2))
        truth = float(self._log(p)[0])
        return self._rng.multivariate_normal(p[0], self.covariance), truth
