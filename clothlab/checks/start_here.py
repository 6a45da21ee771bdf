"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("a time in seconds"))
def best_moment(answer: Callable) -> None:
    """A run of twelve steps, the largest overlaps among the first, which do not count."""
    overlap = np.array([0.9, 0.1, 0.2, 0.7, 0.6, 0.3, 0.0, 0.1, 0.2, 0.4, 0.5, 0.45])
    found = answer(overlap, skip=2)
    slips = {
        "the first two steps do not count with skip=2": 0.0,
        "count from the start of the run, not from the first step after the skipped ones": 0.2,
        "3 is the number of the step; a step lasts 0.2 s": 3,
        "that is the largest overlap; return its time": 0.7,
        "that is the smallest overlap": 1.2,
    }
    expect(found, 0.6, f"the best of these is step 3, at 0.6 s, not {found:g} s", slips)
    found = answer(overlap)
    expect(found, 2.0, f"without `skip`, eight steps are left out: the best is step 10, at 2 s, not {found:g} s")
