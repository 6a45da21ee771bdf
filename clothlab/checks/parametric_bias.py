"""Checks of notebook 06."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from clothlab.analysis import principal_axes
from clothlab.checks._check import CheckFailed, array, check, number
from clothlab.cloth import get_cloth

__all__ = ["chance", "gain_of_dimension", "shares_by_hand", "terminal_speed"]


@check(number("a speed in m/s"))
def terminal_speed(answer: Callable) -> None:
    """The middle one of the nine cloths, and one with twice its drag."""
    middle = get_cloth("damp0.05-mass0.10")
    value, truth = answer(middle), 0.1 / 18 * 9.81 / 0.05
    assert not np.isclose(value, 18 * truth), "use the mass of one point, not of the whole cloth"
    assert np.isclose(value, truth), f"m g / c of the middle cloth is {truth:.3f} m/s"
    assert np.isclose(answer(replace(middle, damping=0.1)), value / 2), "twice the drag must halve the speed"


@check(array("a share for each of the two axes", 2))
def shares_by_hand(answer: Callable) -> None:
    """Three points on a line, then nine random ones beside scikit-learn."""
    result = answer(np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]]))
    assert np.allclose(result, [1, 0], atol=1e-9), f"points on a line have all variance on one axis; got {result}"
    points = np.random.default_rng(0).normal(size=(9, 2)) * [2.0, 1.0]
    result, moved = answer(points), answer(points + 5)
    assert np.allclose(moved, result, atol=1e-5), "a shift of all points must not matter: subtract the mean"
    truth = principal_axes(dict(enumerate(points))).explained_variance_ratio_
    assert np.allclose(result, truth, atol=1e-5), f"scikit-learn finds {truth} for nine random points, not {result}"


@check(number("a share between 0 and 1"))
def chance(answer: Callable) -> None:
    """An orderly row of nine numbers, a loose one, and a falling one."""
    rng, x = np.random.default_rng(0), np.arange(9.0)
    result = answer(x, x**2, rng, 500)
    assert 0 <= result <= 1, f"a share lies between 0 and 1, got {result}"
    assert result < 0.02, f"an orderly row of nine is very unlikely by chance, got {result}"
    middling = answer(x, np.array([3.0, 1, 4, 1, 5, 9, 2, 6, 5]), rng, 2000)
    message = f"a loose order comes about by chance more often: got {middling}, expected about 0.21"
    assert 0.16 < middling < 0.26, message + "; compare absolute values, also of the shuffled"
    assert answer(x, -x, rng, 500) < 0.02, "a falling order is as orderly as a rising one: compare absolute values"


@check(array("the mean and the standard deviation of the gains", 2))
def gain_of_dimension(answer: Callable) -> None:
    """Made-up errors: seeds differ in size far more than in their gains."""
    size, gain = {2: 1.0, 5: 4.0, 7: 20.0, 11: 2.0}, {2: 0.10, 5: 0.06, 7: 0.01, 11: 0.03}
    asked = []

    def error(dimensions: int, seed: int) -> float:
        asked.append((dimensions, seed))
        if seed not in size:
            raise CheckFailed(f"error was asked for seed {seed}, which is none of {list(size)}")
        return size[seed] * (1 - gain[seed]) ** dimensions

    found = answer(3, error, list(size))
    assert {n for n, _ in asked} == {2, 3}, (
        f"compare 3 dimensions with 2; you asked for {sorted({n for n, _ in asked})}"
    )
    pairs = {(n, seed) for n in (2, 3) for seed in size}
    assert set(asked) == pairs, "train both with each of the seeds, or the comparison is not paired"
    mean, deviation = found
    gains = 100 * np.array(list(gain.values()))
    few, more = (np.array([error(n, seed) for seed in size]) for n in (2, 3))
    for told, value in {
        "the sign: a lower error is a positive gain": -gains.mean(),
        "a share; in per cent it is a hundred times as much": gains.mean() / 100,
        "that is in units of the error: divide by the error with one dimension fewer": (few - more).mean(),
        "divide by the error with one dimension fewer, not with one more": (100 * (few / more - 1)).mean(),
        "take each seed's gain first, then their mean: large errors must not count more": 100
        * (1 - more.sum() / few.sum()),
    }.items():
        assert not np.isclose(mean, value), told
    assert np.isclose(mean, gains.mean()), f"gains of 10, 6, 1 and 3 % have the mean {gains.mean():g} %, not {mean:.4g}"
    true = gains.std(ddof=1)
    assert not np.isclose(deviation, gains.std()), "divide by one less than the number of seeds: ddof=1"
    assert not np.isclose(deviation, true / 2), "that is the standard error of the mean: do not divide by √4"
    assert np.isclose(deviation, true), f"the four gains have the standard deviation {true:.2f} %, not {deviation:.4g}"
