"""Checks of notebook 08."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("the points"))
def challenge_points(answer: Callable, rng: np.random.Generator) -> None:
    """Points of a recording: how near its throws end, for a hanging cloth's distance.

    Given are the distance at each observation `[T]`, the first of them of the cloth
    that hangs still, how many throws count, and the steps of a throw. 100 are for the
    target itself at each end, 0 for throws that end no nearer than the still cloth.
    """
    throws = int(rng.integers(2, 5))
    period = int(rng.integers(6, 10))
    distances = rng.uniform(0.4, 2.2, (throws + 2) * period)
    distances[0] = rng.uniform(2.3, 2.6)

    # What is right, and what slips would give
    ends = distances[period : throws * period + 1 : period]
    truth = _points(distances, ends)
    slips = {}
    for words, value in _other_points(distances, throws, period).items():
        if not np.isclose(value, truth):
            slips[words] = value
    otherwise = f"this recording gets {truth:.1f} points"
    expect(answer(distances, throws, period), truth, otherwise, slips, 1e-4)


def _points(distances: np.ndarray, counted: np.ndarray) -> float:
    return float(100 * (1 - counted.mean() / distances[0]))


def _other_points(distances: np.ndarray, throws: int, period: int) -> dict[str, float]:
    """What usual slips give, by what is said of each."""
    still = distances[0]
    last = throws * period
    ends = distances[period : last + 1 : period]

    # What is said of each
    too_late = "only the first throws count: what comes after them is too late"
    early = (
        "an observation is made before its command: that after the last command of "
        "a throw is its end"
    )
    start = "the first observation is the still cloth, and no throw's end"
    left = "that is the share of the distance that is left; points are for the rest"
    share = "100 is for the target itself, not 1"
    absolute = "compare with the still cloth, which the first observation shows"
    best = "the mean of the throws' ends counts, not the best image"
    every = "only the ends of the throws count, not each image"

    # What each gives
    return {
        too_late: _points(distances, distances[period::period]),
        early: _points(distances, distances[period - 1 : last : period]),
        start: _points(distances, distances[: last + 1 : period]),
        left: float(100 * ends.mean() / still),
        share: float(1 - ends.mean() / still),
        absolute: float(100 * (1 - ends.mean())),
        best: _points(distances, distances[1 : last + 1].min()),
        every: _points(distances, distances[1 : last + 1]),
    }


@check(number("a whole number of steps"))
def steps_behind(answer: Callable, rng: np.random.Generator) -> None:
    """By how many control steps one series follows another.

    Given are a command at each step `[T]`, and what is seen then `[T]`: the command of
    some steps before, on another scale, perhaps upside down, with noise, and not a
    number where nothing is seen.
    """
    for sign in (1, -1):
        # What is seen follows by some steps; now and then it is out of view
        lag = int(rng.integers(1, 7))
        count = int(rng.integers(150, 250))
        smooth = np.convolve(rng.normal(size=count + 20), np.ones(3) / 3, "same")
        command = smooth[10 : 10 + count]
        noise = rng.normal(0, 0.2 * command.std(), count)
        before = smooth[10 - lag : 10 - lag + count]
        seen = rng.uniform(5, 9) + sign * rng.uniform(2, 4) * (before + noise)
        seen[rng.random(count) < 0.1] = np.nan

        # What the reader's function makes of it
        found = answer(command.copy(), seen.copy())
        falls = "; it may fall where the command rises" if sign < 0 else ""
        slips = {
            "that is the other way round: what is seen comes later": -lag,
            "a step without cloth is not a number: leave its pair out of the "
            f"correlation{falls}": 0,
        }
        otherwise = (
            f"what is seen follows by {lag} steps here, not by {found:g}: compare "
            f"command[:-k] with seen[k:], without their means{falls}"
        )
        expect(found, lag, otherwise, slips)
