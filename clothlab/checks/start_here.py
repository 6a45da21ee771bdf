"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("a time in seconds"))
def best_moment(answer: Callable) -> None:
    """A run of twelve steps, the smallest distances among the first, which do not count."""
    distance = np.array([0.1, 3.0, 2.0, 0.5, 1.0, 2.5, 4.0, 3.5, 3.0, 0.9, 0.7, 0.8])
    found = answer(distance, skip=2)
    slips = {
        "the first two steps do not count with skip=2": 0.0,
        "count from the start of the run, not from the first step after the skipped ones": 0.2,
        "3 is the number of the step; a step lasts 0.2 s": 3,
        "that is the smallest distance; return its time": 0.5,
    }
    expect(found, 0.6, f"the best of these is step 3, at 0.6 s, not {found:g} s", slips)
    found = answer(distance)
    expect(found, 2.0, f"without `skip`, eight steps are left out: the best is step 10, at 2 s, not {found:g} s")


@check(number("a share between 0 and 1"))
def share_won(answer: Callable) -> None:
    """Six periods of two steps, one of which nobody wins; then five and a half."""
    a = np.array([6, 9, 2, 1, 5, 7, 4, 0, 1, 3, 5, 1])
    b = np.array([2, 3, 1, 4, 4, 9, 1, 4, 4, 9, 6, 9])
    means = (x.reshape(6, 2).mean(axis=1) for x in (a, b))
    slips = {
        "nobody wins a period in which both come equally close": 4 / 6,
        "that is the share of periods that `b` wins": 2 / 6,
        "3 is the number of periods won: divide by how many there are": 3,
        "compare the smallest of each period, not the mean": np.less(*means).mean(),
        "that is the share of steps: compare the smallest of each period": (a < b).mean(),
    }
    found = answer(a, b, period=2)
    expect(found, 3 / 6, f"with period=2, `a` wins periods 4, 5 and 6 of six: 0.5, not {found:g}", slips)
    found = answer(a[:11], b[:11], period=2)
    slips = {"divide by the number of whole periods, here five": 2 / 6}
    expect(found, 2 / 5, f"in eleven steps, `a` wins two of the five whole periods: 0.4, not {found:g}", slips)
