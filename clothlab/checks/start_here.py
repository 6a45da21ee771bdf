"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, number

__all__ = ["best_moment", "share_won"]


@check(number("a time in seconds"))
def best_moment(answer: Callable) -> None:
    """A run of six steps, of which the first two, with the smallest distance of all, do not count."""
    distance = np.array([0.1, 3.0, 2.0, 0.5, 1.0, 4.0])
    found = answer(distance, skip=2)
    assert not np.isclose(found, 0.0), "the first two steps do not count with skip=2"
    assert not np.isclose(found, 0.2), "count from the start of the run, not from the first step after the skipped ones"
    assert np.isclose(found, 0.6), f"the best of these is step 3, at 0.6 s, not {found:g} s"


@check(number("a share between 0 and 1"))
def share_won(answer: Callable) -> None:
    """Four periods of two steps, then three and a half."""
    a, b = np.array([5, 1, 4, 4, 2, 9, 0, 9]), np.array([2, 2, 3, 3, 3, 3, 7, 7])
    found = answer(a, b, period=2)
    assert np.isclose(found, 0.75), f"with period=2, `a` wins periods 1, 3 and 4 of four: 0.75, not {found:g}"
    found = answer(a[:7], b[:7], period=2)
    assert np.isclose(found, 2 / 3), f"seven steps are three whole periods of two: 2/3, not {found:g}"
