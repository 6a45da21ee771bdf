"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number

_STEP = 0.2  # seconds a control step lasts
_SKIP = 8  # steps that the exercise leaves out unless told otherwise


@check(number("a time in seconds"))
def best_moment(answer: Callable, rng: np.random.Generator) -> None:
    """When the overlap of a run is largest, its first steps left out [s].

    Given are the overlaps `[T]` of some twelve steps, one every 0.2 s, of which the
    largest is among those that do not count; with `skip`, and then without it.
    """
    for _ in range(5):
        overlap, first, skip, best = _overlaps(rng)

        # With `skip`
        found = answer(overlap, skip=skip)
        least = skip + np.argmin(overlap[skip:])
        slips = {
            f"the first {skip} steps do not count with skip={skip}": _STEP * first,
            "count from the start of the run, not from the first step after the "
            "skipped ones": _STEP * (best - skip),
            f"{best} is the number of the step; a step lasts 0.2 s": best,
            "that is the largest overlap; return its time": overlap[best],
            "that is the smallest overlap": _STEP * least,
        }
        time = _STEP * best
        otherwise = (
            f"the best of these is step {best}, at {time:.1f} s, not {found:g} s"
        )
        expect(found, time, otherwise, slips)

        # Without it
        found = answer(overlap)
        late = _SKIP + int(np.argmax(overlap[_SKIP:]))
        time = _STEP * late
        otherwise = (
            f"without `skip`, eight steps are left out: the best is step {late}, "
            f"at {time:.1f} s, not {found:g} s"
        )
        expect(found, time, otherwise)


def _overlaps(rng: np.random.Generator) -> tuple[np.ndarray, int, int, int]:
    """Overlaps [T], the step of the largest, how many to skip, the best step then.

    No overlap is a multiple of 0.2, and no time is the number of a step, so that one
    can't be taken for another.
    """
    count = int(rng.integers(11, 16))
    skip = int(rng.integers(2, 4))
    best = int(rng.integers(4, 8))
    first = int(rng.choice([k for k in range(skip) if k != best - skip]))
    least = int(rng.integers(8, count))
    others = [k for k in range(count) if k not in (first, best, least)]

    # Ranks 0 (least) to count - 1 (first), spread over 0 to 1
    overlap = np.zeros(count)
    overlap[others] = 1 + rng.permutation(count - 3)
    overlap[best] = count - 2
    overlap[first] = count - 1
    return (overlap + 0.37) / (count + 1), first, skip, best
