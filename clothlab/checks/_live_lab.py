"""Checks of notebook 08."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("the points"))
def challenge_points(answer: Callable, rng: np.random.Generator) -> None:
    """Points of a recording: how far its best image is from a hanging cloth's distance.

    Given are the distance at each observation `[T]`, the first of them of the cloth
    that hangs still, how many throws count, and the steps of a throw. 100 are for the
    target itself, 0 for a throw that comes no nearer than the still cloth.
    """
    # In turn, the best image is that after the last command that counts, comes too
    # late, or is well within
    for place in ("last", "late", "within"):
        throws = int(rng.integers(2, 5))
        period = int(rng.integers(6, 10))
        end = throws * period
        at = {"last": end, "late": end + 1, "within": end // 2}[place]
        distances = rng.uniform(1.0, 2.2, end + 9)
        distances[0] = rng.uniform(2.3, 2.6)
        distances[at] = rng.uniform(0.2, 0.5)

        # What is right, and what slips would give
        truth = _points(distances, distances[1 : end + 1].min())
        slips = {}
        for words, value in _other_points(distances, end).items():
            if not np.isclose(value, truth):
                slips[words] = value
        otherwise = f"this recording gets {truth:.1f} points"
        expect(answer(distances, throws, period), truth, otherwise, slips, 1e-4)


def _points(distances: np.ndarray, nearest: float) -> float:
    return float(100 * (1 - nearest / distances[0]))


def _other_points(distances: np.ndarray, end: int) -> dict[str, float]:
    """What usual slips give, by what is said of each."""
    still = distances[0]
    counted = distances[1 : end + 1]
    best = counted.min()

    # What is said of each
    too_late = "only the first throws count: what comes after them is too late"
    early = (
        "an observation is made before its command: that after the last command of "
        "the last throw counts, too"
    )
    left = "that is the share of the distance that is left; points are for the rest"
    share = "100 is for the target itself, not 1"
    absolute = "compare with the still cloth, which the first observation shows"
    average = "the best image of all counts, not the mean"

    # What each gives
    return {
        too_late: _points(distances, distances[1:].min()),
        early: _points(distances, distances[1:end].min()),
        left: float(100 * best / still),
        share: float(1 - best / still),
        absolute: float(100 * (1 - best)),
        average: _points(distances, counted.mean()),
    }


@check(number("a whole number of steps"))
def steps_behind(answer: Callable, rng: np.random.Generator) -> None:
    """By how many control steps one series follows another.

    Given are a command at each step `[T]`, and what is seen then `[T]`: the command of
    some steps before, on another scale, perhaps upside down, with noise.
    """
    for sign in (1, -1):
        lag = int(rng.integers(1, 7))
        count = int(rng.integers(150, 250))
        smooth = np.convolve(rng.normal(size=count + 20), np.ones(3) / 3, "same")
        command = smooth[10 : 10 + count]
        noise = rng.normal(0, 0.2 * command.std(), count)
        before = smooth[10 - lag : 10 - lag + count]
        seen = rng.uniform(5, 9) + sign * rng.uniform(2, 4) * (before + noise)
        found = answer(command.copy(), seen.copy())
        slips = {"that is the other way round: what is seen comes later": -lag}
        otherwise = (
            f"what is seen follows by {lag} steps here, not by {found:g}: compare "
            "command[:-k] with seen[k:], without their means"
        )
        if sign < 0:
            otherwise += "; it may fall where the command rises"
        expect(found, lag, otherwise, slips)
