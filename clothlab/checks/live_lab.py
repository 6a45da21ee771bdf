"""Checks of notebook 12."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, number

__all__ = ["in_time", "nearest_phase"]


@check(number("a share between 0 and 1"))
def in_time(answer: Callable) -> None:
    """Four steps, one of them late, one exactly in time."""
    found = answer([0.05, 0.2, 0.3, 0.1], 0.2)
    assert not np.isclose(found, 3), "3 is the number of steps in time: divide by how many there are"
    assert not np.isclose(found, 0.25), "that is the share of late steps"
    assert not np.isclose(found, 0.5), "a step that takes exactly the period is in time"
    assert np.isclose(found, 0.75), f"three of four steps are in time, 0.75; got {found}"


@check(number("the number of a step"))
def nearest_phase(answer: Callable) -> None:
    """Periods of four steps that are nearest in the last one, and one odd period."""
    distances = [3, 2, 1, 0.5] * 3 + [0.1, 2, 1, 2] + [0.0]
    found = answer(distances, 4)
    assert not np.isclose(found, 16), "16 counts from the start of the run: count within the period"
    assert found != 0, "one period, or what is left of one at the end, decides nothing: average over whole periods"
    assert found != 4, "steps of a period count from 0"
    assert found == 3, f"on average the last step of four, number 3, is nearest; got {found}"
