"""Checks of notebook 15."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clothlab.checks._check import check, number


class _Case(NamedTuple):
    """Numbers of which the verdict is known, and what is said of another one."""

    t: float  # their mean over its standard error
    n: int  # how many
    margin: float  # over the same
    truth: int
    otherwise: str


_CASES = (
    _Case(
        t=12.0,
        n=5,
        margin=1.0,
        truth=1,
        otherwise="an interval that is all above zero is as the paper says: return 1",
    ),
    _Case(
        t=-12.0,
        n=5,
        margin=1.0,
        truth=-1,
        otherwise="an interval that is all below zero is against the paper: return -1",
    ),
    _Case(
        t=0.3,
        n=5,
        margin=0.1,
        truth=0,
        otherwise="the interval holds zero and reaches beyond the margin, so nothing "
        "is known: return 0",
    ),
    _Case(
        t=4.0,
        n=5,
        margin=1.0,
        truth=1,
        otherwise="the mean scatters less than the values: divide their deviation by "
        "the root of their number",
    ),
    _Case(
        t=2.3,
        n=5,
        margin=1.0,
        truth=0,
        otherwise="1.96 is too small for five values: take Student's t with 4 degrees "
        "of freedom",
    ),
    _Case(
        t=2.6,
        n=5,
        margin=1.0,
        truth=0,
        otherwise="the deviation of five values from their own mean is too small: "
        "divide by n - 1, not by n",
    ),
    _Case(
        t=2.3,
        n=20,
        margin=1.0,
        truth=1,
        otherwise="with twenty values 2.776 is too much: the degrees of freedom are "
        "one less than the values",
    ),
    _Case(
        t=0.3,
        n=5,
        margin=5.0,
        truth=2,
        otherwise="the whole interval is within the margin, so there is no difference "
        "that matters: return 2",
    ),
    _Case(
        t=0.3,
        n=5,
        margin=2.0,
        truth=0,
        otherwise="that the mean is within the margin is not enough: the whole "
        "interval has to be",
    ),
    _Case(
        t=4.0,
        n=5,
        margin=9.0,
        truth=2,
        otherwise="an interval without zero may still be within the margin: such a "
        "difference is sure, but too small to matter, so look at the margin first",
    ),
    _Case(
        t=-4.0,
        n=5,
        margin=9.0,
        truth=2,
        otherwise="the margin counts on both sides of zero",
    ),
)


@check(number("1, -1, 2 or 0"))
def verdict(answer: Callable, rng: np.random.Generator) -> None:
    """Whether numbers are as the paper says (1), against it (-1), or equal (2); else 0.

    Given are numbers `[N]` and a margin: first the cases in which a usual slip gives
    another verdict, then any that are clear.
    """
    size = rng.uniform(0.5, 2.0)
    for case in _CASES:
        near = rng.uniform(0.98, 1.02)  # within which each case stays what it is
        numbers = size * _numbers(near * case.t, case.n)
        margin = size * _error(case.n) * case.margin
        assert answer(numbers, margin) == case.truth, case.otherwise

    for _ in range(20):
        # Clear or not, few or many, on either side of zero, with a small margin
        clear = bool(rng.integers(2))
        count = int(rng.integers(6, 12))
        above = int(rng.choice([-1, 1]))
        t = above * (rng.uniform(5.0, 7.0) if clear else rng.uniform(0.3, 0.6))
        truth = above if clear else 0
        numbers = size * _numbers(t, count)
        assert answer(numbers, size * _error(count)) == truth, (
            f"{count} numbers, their mean {t:.1f} of its standard errors from zero, "
            f"a margin of one: return {truth}"
        )


def _numbers(t: float, count: int) -> np.ndarray:
    """So many, not in order, whose mean is `t` of its standard errors from zero."""
    spread = np.roll(np.arange(count) - (count - 1) / 2, 2) ** 3
    return 0.1 * spread / spread.std(ddof=1) + t * _error(count)


def _error(count: int) -> float:
    """Standard error of the mean of so many of these numbers."""
    return 0.1 / np.sqrt(count)
