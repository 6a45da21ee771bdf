"""Checks of notebook 15."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, number


def _differences(t: float, count: int) -> np.ndarray:
    """So many, not in order, whose mean is `t` of its standard errors from zero."""
    spread = np.roll(np.arange(count) - (count - 1) / 2, 2) ** 3
    return 0.1 * (spread / spread.std(ddof=1) + t / np.sqrt(count))


@check(number("1, 0 or -1"))
def verdict(answer: Callable, rng: np.random.Generator) -> None:
    """Differences whose mean is clearly away from zero, and hardly; few and many; then
    any, with any sign.
    """
    size = rng.uniform(0.5, 2.0)
    for t, count, sign, truth, message in (
        (
            12.0,
            5,
            1,
            1,
            "differences far above zero are as the paper says, where its sign is +1: return 1",
        ),
        (
            -12.0,
            5,
            -1,
            1,
            "differences far below zero are as the paper says, where its sign is -1: return 1",
        ),
        (
            -12.0,
            5,
            1,
            -1,
            "that differs significantly from zero, but with the other sign than the paper's: return -1",
        ),
        (
            0.3,
            5,
            1,
            0,
            "the interval holds zero, so the difference is not significant: return 0",
        ),
        (
            4.0,
            5,
            1,
            1,
            "the mean scatters less than the values: divide their deviation by the root of their number",
        ),
        (
            2.3,
            5,
            1,
            0,
            "1.96 is too small for five values: take Student's t with 4 degrees of freedom",
        ),
        (
            2.6,
            5,
            -1,
            0,
            "the deviation of five values from their own mean is too small: divide by n - 1, not by n",
        ),
        (
            2.3,
            20,
            1,
            1,
            "with twenty values 2.776 is too much: the degrees of freedom are one less than the values",
        ),
    ):
        near = rng.uniform(0.98, 1.02)  # within which each case stays what it is
        assert answer(size * _differences(near * t, count), sign) == truth, message
    for _ in range(20):
        clearly, count, sign = (
            bool(rng.integers(2)),
            int(rng.integers(6, 12)),
            int(rng.choice([-1, 1])),
        )
        above = int(rng.choice([-1, 1]))
        t = above * rng.uniform(5.0, 7.0) if clearly else above * rng.uniform(0.3, 0.6)
        truth = sign * above if clearly else 0
        message = f"{count} differences, their mean {t:.1f} of its standard errors from zero, sign {sign}: return {truth}"
        assert answer(size * _differences(t, count), sign) == truth, message
