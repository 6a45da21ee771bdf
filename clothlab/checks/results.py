"""Checks of notebook 15."""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from clothlab.checks._check import check, expect, number


def _differences(t: float, count: int) -> np.ndarray:
    """So many, not in order, whose mean is `t` of its standard errors from zero."""
    spread = np.roll(np.arange(count) - (count - 1) / 2, 2) ** 3
    return 0.1 * (spread / spread.std(ddof=1) + t / np.sqrt(count))


@check(number("1, 0 or -1"))
def verdict(answer: Callable) -> None:
    """Differences whose mean is clearly away from zero, and hardly; few and many."""
    for t, count, sign, truth, message in (
        (12.0, 5, 1, 1, "differences far above zero are as the paper says, where its sign is +1: return 1"),
        (-12.0, 5, -1, 1, "differences far below zero are as the paper says, where its sign is -1: return 1"),
        (-12.0, 5, 1, -1, "that is told apart from zero, but with the other sign than the paper's: return -1"),
        (0.3, 5, 1, 0, "the interval holds zero, so the two are not told apart: return 0"),
        (4.0, 5, 1, 1, "the mean scatters less than the values: divide their deviation by the root of their number"),
        (2.3, 5, 1, 0, "1.96 is too small for five values: take Student's t with 4 degrees of freedom"),
        (2.6, 5, -1, 0, "the deviation of five values from their own mean is too small: divide by n - 1, not by n"),
        (2.3, 20, 1, 1, "with twenty values 2.776 is too much: the degrees of freedom are one less than the values"),
    ):
        assert answer(_differences(t, count), sign) == truth, message


@check(number("a mean of largest values"))
def best_of(answer: Callable) -> None:
    """All of them, one of them, and some; with values that are equal, and negative ones."""
    for values, count in (
        ([0.1, 0.3, 0.4, 0.9, 0.2], 2),
        ([0.1, 0.4, 0.2, 0.9, 0.3], 4),
        ([-3.0, -1.0, -2.0], 2),
        ([0.5, 0.5, 0.0, 1.0], 3),
        ([0.2, 0.8], 1),
        ([0.2, 0.8, 0.3], 3),
    ):
        n, ordered = len(values), np.sort(values)
        truth = np.mean([max(each) for each in combinations(values, count)])
        again = np.diff(np.arange(n + 1) ** count) / n**count
        slips = {
            "each repeat is made once: draw without putting back": again @ ordered,
            "that is the mean over single repeats": np.mean(values),
            "that is the best of all repeats: only so many are looked at": np.max(values),
            "the first of them are one choice among all": np.max(values[:count]),
        }
        found = answer(np.array(values), count)
        expect(found, truth, f"the best {count} of {values} have the mean {truth:.4g}, not {found:.4g}", slips)


@check(number("the number of a step, or None", none=True))
def when_apart(answer: Callable) -> None:
    """Runs that part early, late, only for a while, in either direction, and never."""
    one = np.array([1.0, 2.0, 3.0, 2.0, 1.0, 0.0])
    for other, tolerance, truth, message in (
        (one + np.array([0, 0, 0, 0.5, 0.6, 0.7]), 0.1, 3, "the first step at which they differ counts, from 0 on"),
        (one - np.array([0, 0, 0.5, 0, 0, 0.9]), 0.1, 2, "the other run may be below: take the absolute difference"),
        (one + np.array([0, 0.3, 0, 0, 0, 0.9]), 0.1, 1, "neither the last nor the largest difference is asked for"),
        (one + np.array([0, 0.3, 0, 0, 0.9, 0]), 0.4, 4, "use `tolerance`"),
        (one + np.array([0.25, 0, 0, 0.5, 0, 0]), 0.25, 3, "a difference as large as the tolerance is still within it"),
        (one + np.array([0.3, 0, 0, 0, 0, 0]), 0.1, 0, "two runs may be apart from the first step on: 0, not None"),
        (one.copy(), 0.1, None, "these two never part: return None"),
        (one + 0.01, 0.1, None, "these two never part by more than the tolerance: return None"),
    ):
        assert answer(one.copy(), other.copy(), tolerance) == truth, message
