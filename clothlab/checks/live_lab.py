"""Checks of notebook 14."""

from collections.abc import Callable

from clothlab.checks._check import check, expect, number


@check(number("a share between 0 and 1"))
def in_time(answer: Callable) -> None:
    """Four steps, one of them late, one exactly in time; then none late, and another period."""
    found = answer([0.05, 0.2, 0.3, 0.1], 0.2)
    slips = {
        "3 is the number of steps in time: divide by how many there are": 3,
        "that is the share of late steps": 0.25,
        "a step that takes exactly the period is in time": 0.5,
    }
    expect(found, 0.75, f"three of four steps are in time, 0.75; got {found:g}", slips)
    expect(answer([0.05, 0.1, 0.15], 0.2), 1, "no step is late: the share is 1")
    expect(answer([0.05, 0.2, 0.3, 0.1, 0.09], 0.1), 0.6, "with a period of 0.1 s, three of five are in time: 0.6")


@check(number("the number of a step"))
def nearest_phase(answer: Callable) -> None:
    """Periods of five steps and what is left of one; then two whole periods of eight."""
    first, usual, last, rest = [1, 0.1, 2, 9, 0.9], [1, 3, 2, 5, 0.9], [1, 3, 0.5, 5, 0.9], [0, 3, 2]
    found = answer([*first, *usual * 5, *last, *rest], 5)
    slips = {
        "35 counts from the start of the run: count within the period": 35,
        "three steps are left over at the end: average over whole periods": 0,
        "one near step decides nothing: average over all whole periods": 1,
        "steps of a period count from 0": 5,
    }
    expect(found, 4, f"on average the last step of five, number 4, is nearest; got {found:g}", slips)
    found = answer([2, 2, 1, 2, 2, 1.1, 2, 2, 2, 2, 1, 2, 2, 0.8, 2, 2])
    message = f"two periods of eight are nearest on average at step 5, not {found:g}"
    expect(found, 5, message, {message + "; the last period is a whole one, too": 2})
