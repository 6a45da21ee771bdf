"""Checks of notebook 15."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clothlab.checks._check import check, number


class _Case(NamedTuple):
    """Differences of which the verdict is known, and what is said of another one."""

    t: float  # their mean over its standard error
    n: int  # how many
    sign: int  # of the paper's difference
    truth: int
    otherwise: str


_CASES = (
    _Case(
        t=12.0,
        n=5,
        sign=1,
        truth=1,
        otherwise="differences far above zero are as the paper says, where its sign "
        "is +1: return 1",
    ),
    _Case(
        t=-12.0,
        n=5,
        sign=-1,
        truth=1,
        otherwise="differences far below zero are as the paper says, where its sign "
        "is -1: return 1",
    ),
    _Case(
        t=-12.0,
        n=5,
        sign=1,
        truth=-1,
        otherwise="that differs significantly from zero, but with the other sign than "
        "the paper's: return -1",
    ),
    _Case(
        t=0.3,
        n=5,
        sign=1,
        truth=0,
        otherwise="the interval holds zero, so the difference is not significant: "
        "return 0",
    ),
    _Case(
        t=4.0,
        n=5,
        sign=1,
        truth=1,
        otherwise="the mean scatters less than the values: divide their deviation by "
        "the root of their number",
    ),
    _Case(
        t=2.3,
        n=5,
        sign=1,
        truth=0,
        otherwise="1.96 is too small for five values: take Student's t with 4 degrees "
        "of freedom",
    ),
    _Case(
        t=2.6,
        n=5,
        sign=-1,
        truth=0,
        otherwise="the deviation of five values from their own mean is too small: "
        "divide by n - 1, not by n",
    ),
    _Case(
        t=2.3,
        n=20,
        sign=1,
        truth=1,
        otherwise="with twenty values 2.776 is too much: the degrees of freedom are "
        "one less than the values",
    ),
)


@check(number("1, 0 or -1"))
def verdict(answer: Callable, rng: np.random.Generator) -> None:
    """Whether differences agree with the paper (1), contradict it (-1), or neither (0).

    Given are differences `[N]` and the sign of the paper's, 1 or -1: first the cases in
    which a usual slip gives another verdict, then any that are clear.
    """
    size = rng.uniform(0.5, 2.0)
    for case in _CASES:
        near = rng.uniform(0.98, 1.02)  # within which each case stays what it is
        differences = size * _differences(near * case.t, case.n)
        assert answer(differences, case.sign) == case.truth, case.otherwise

    for _ in range(20):
        # Significant or not, few or many, of either sign and either side of zero
        significant = bool(rng.integers(2))
        count = int(rng.integers(6, 12))
        sign = int(rng.choice([-1, 1]))
        above = int(rng.choice([-1, 1]))
        t = above * (rng.uniform(5.0, 7.0) if significant else rng.uniform(0.3, 0.6))
        truth = sign * above if significant else 0
        assert answer(size * _differences(t, count), sign) == truth, (
            f"{count} differences, their mean {t:.1f} of its standard errors from "
            f"zero, sign {sign}: return {truth}"
        )


def _differences(t: float, count: int) -> np.ndarray:
    """So many, not in order, whose mean is `t` of its standard errors from zero."""
    spread = np.roll(np.arange(count) - (count - 1) / 2, 2) ** 3
    return 0.1 * (spread / spread.std(ddof=1) + t / np.sqrt(count))
