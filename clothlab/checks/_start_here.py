"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("a time in seconds"))
def best_moment(answer: Callable, rng: np.random.Generator) -> None:
    """Runs of some twelve steps, the largest overlap among the first, which do not
    count.
    """
    for _ in range(5):
        overlap, first, skip, best = _overlaps(rng)
        found = answer(overlap, skip=skip)
        slips = {
            f"the first {skip} steps do not count with skip={skip}": 0.2 * first,
            "count from the start of the run, not from the first step after the skipped ones": 0.2
            * (best - skip),
            f"{best} is the number of the step; a step lasts 0.2 s": best,
            "that is the largest overlap; return its time": overlap[best],
            "that is the smallest overlap": 0.2 * (skip + np.argmin(overlap[skip:])),
        }
        message = (
            f"the best of these is step {best}, at {0.2 * best:.1f} s, not {found:g} s"
        )
        expect(found, 0.2 * best, message, slips)
        found, late = answer(overlap), 8 + int(np.argmax(overlap[8:]))
        message = f"without `skip`, eight steps are left out: the best is step {late}, at {0.2 * late:.1f} s, not {found:g} s"
        expect(found, 0.2 * late, message)


def _overlaps(rng: np.random.Generator) -> tuple[np.ndarray, int, int, int]:
    """Overlaps [T], the step of the largest, the steps to skip, and the step of the
    largest after those.

    No overlap is a multiple of 0.2, and no time is the number of a step, so that one
    can't be taken for another.
    """
    count, skip = int(rng.integers(11, 16)), int(rng.integers(2, 4))
    best = int(rng.integers(4, 8))
    first = int(rng.choice([k for k in range(skip) if k != best - skip]))
    least = int(rng.integers(8, count))
    others = [k for k in range(count) if k not in (first, best, least)]
    overlap = np.zeros(count)
    overlap[others] = 1 + rng.permutation(count - 3)
    overlap[[best, first]] = count - 2, count - 1
    return (overlap + 0.37) / (count + 1), first, skip, best
