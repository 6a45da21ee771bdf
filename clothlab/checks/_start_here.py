"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import apart, check, drawn, expect, number

_STEP = 0.2  # seconds a control step lasts


@check(number("a shift in pixels"))
def shift_for_iou(answer: Callable, rng: np.random.Generator) -> None:
    """How far a rectangle is shifted when its IoU with itself is a given share.

    Given are its width [pixel], along which it is shifted, and the share.
    """
    for _ in range(5):
        width, share = drawn(
            lambda: (rng.uniform(8, 60), rng.uniform(0.1, 0.9)),
            lambda pair: apart(_shift(*pair), _wrong_shifts(*pair), 0.02),
        )
        shift = _shift(width, share)
        otherwise = (
            f"shifted by {shift:.2f} pixels, a rectangle of {width:.2f} has IoU "
            f"{share:.2f}: draw both, and say what lies in both and what in either"
        )
        expect(answer(width, share), shift, otherwise, _wrong_shifts(width, share))


def _shift(width: float, share: float) -> float:
    """Where (width - shift) / (width + shift) is the share."""
    return width * (1 - share) / (1 + share)


def _wrong_shifts(width: float, share: float) -> dict[str, float]:
    """What usual slips give, by what is said of each."""
    shift = _shift(width, share)
    return {
        "IoU divides by what either covers, not by one of the rectangles": width
        * (1 - share),
        "what lies in both counts once in what either covers": width * (1 - 2 * share),
        "that is a share of the width: multiply by the width": shift / width,
        "that is how much still overlaps, not the shift": width - shift,
    }


@check(number("a number of steps"))
def rhythm(answer: Callable, rng: np.random.Generator) -> None:
    """How many steps there are from one best moment to the next.

    Given are overlaps `[T]`, one a step, of five periods. Once in each the overlap is
    high, always in the same step of it, though not equally high; in the step before it
    is already above that of most moments.
    """
    for _ in range(5):
        period = int(rng.integers(6, 12))
        first = int(rng.integers(1, period - 2))
        overlap = _overlaps(rng, period, first)
        slips = {
            "these two belong to one throw: the step before its best one is near, "
            "too": 1,
            f"{_STEP * period:g} are seconds: count in steps": _STEP * period,
            "that is when the first best moment comes, not how many steps lie from "
            "one to the next": first,
            "that is how many best moments there are": 5,
            "from step 3 to step 11 are eight steps, not seven": period - 1,
            "there is a best moment between these two": 2 * period,
        }
        moments = ", ".join(str(first + k * period) for k in range(3))
        otherwise = f"here the best moments are the steps {moments}, …"
        expect(answer(overlap), period, otherwise, _distinct(slips, period))


def _overlaps(rng: np.random.Generator, period: int, first: int) -> np.ndarray:
    """Overlaps [T] of five periods, high once in each, and in part the step before."""
    count = 5 * period
    overlap = rng.uniform(0.0, 0.05, count)
    overlap[first - 1 :: period] = rng.uniform(0.28, 0.36, 5)
    best = rng.uniform(0.55, 0.9, 5)  # the poorest throw still beats the step before
    best[rng.integers(5)] = 0.9
    overlap[first::period] = best
    return overlap


def _distinct(slips: dict[str, float], truth: float) -> dict[str, float]:
    """Those that give something else than the truth and than the ones before them."""
    found: dict[str, float] = {}
    for words, value in slips.items():
        if value != truth and value not in found.values():
            found[words] = value
    return found
