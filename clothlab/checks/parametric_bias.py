"""Checks of notebook 06."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from clothlab.analysis import principal_axes
from clothlab.checks._check import CheckFailed, array, check, expect, number
from clothlab.simulation.cloth import get_cloth

__all__ = ["chance", "gain_of_dimension", "matching_drag", "shares_by_hand"]


@check(number("a drag in N s/m"))
def matching_drag(answer: Callable) -> None:
    """The middle one of the nine cloths with another mass, then cloths with another drag and other points."""
    middle = get_cloth("damp0.05-mass0.10")
    cloths = (middle, replace(middle, damping=0.1), replace(middle, mass=0.15), replace(middle, rows=8))
    for cloth, mass in ((cloth, mass) for cloth in cloths for mass in (0.04, 0.30)):
        found, truth = answer(cloth, mass), cloth.damping * mass / cloth.mass
        slips = {
            "the same drag makes the heavier cloth fall faster": cloth.damping,
            "upside down: the heavier cloth needs more drag, not less": cloth.damping * cloth.mass / mass,
            "one mass is a point's, the other the whole cloth's: compare like with like": truth
            * cloth.mass
            / cloth.point_mass,
            "that is a speed: which drag brings it about?": cloth.terminal_speed,
            "that is how many times as much drag it needs": mass / cloth.mass,
            "that is drag over mass: equal for both cloths, and not yet a drag": cloth.damping / cloth.mass,
        }
        otherwise = f"with your drag of {found:.4f} N s/m, a cloth of {mass:g} kg falls at "
        speed = replace(cloth, mass=mass, damping=abs(found)).terminal_speed
        otherwise += f"{speed:.3f} m/s, the other at {cloth.terminal_speed:.3f} m/s"
        expect(found, truth, otherwise, slips)


@check(array("a share for each of the two axes", 2))
def shares_by_hand(answer: Callable) -> None:
    """Nine random points beside scikit-learn, then three on a line."""
    points = np.random.default_rng(0).normal(size=(9, 2)) @ [[2.0, 1.0], [0.0, 1.0]]
    truth = principal_axes({str(k): each for k, each in enumerate(points)}).explained_variance_ratio_
    moments, columns = np.linalg.eigvalsh(points.T @ points)[::-1], np.var(points, axis=0)
    slips = {
        "the right shares in the wrong order: the larger one first": truth[::-1],
        "these are the variances: divide by their sum": truth * columns.sum() * 9 / 8,
        "per cent; shares add up to 1": 100 * truth,
        "a share of the variance, not of its root": np.sqrt(truth) / np.sqrt(truth).sum(),
        "these are shares of the squares: an eigenvalue is a variance already": truth**2 / (truth**2).sum(),
        "subtract the mean of the points first": moments / moments.sum(),
        "these are shares of the two columns: the principal axes lie across them": columns / columns.sum(),
    }
    result = answer(points)
    otherwise = f"scikit-learn finds {truth.round(4)} for nine random points, not {result.round(4)}"
    if not np.isclose(result.sum(), 1):
        otherwise = f"shares add up to 1, yours to {result.sum():.4g}"
    expect(result, truth, otherwise, slips)
    expect(answer(points + 5), truth, "a shift of all points must not matter: subtract the mean")
    result = answer(np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]]))
    expect(result, [1, 0], f"points on a line have all variance along one axis; got {result}")


@check(number("a share between 0 and 1"))
def chance(answer: Callable) -> None:
    """Four numbers, of whose orders a third is as good, then nine in an orderly row, a falling one and a loose one."""
    four, x, loose = np.array([0.0, 0, 1, 1]), np.arange(9.0), np.array([3.0, 1, 4, 1, 5, 9, 2, 6, 5])

    def ask(y: np.ndarray, n: int, seed: int = 0) -> float:
        return answer(x, y.copy(), np.random.default_rng(seed), n)

    _expect_third(answer(four, four.copy(), np.random.default_rng(0), 2000))
    found = ask(x**2, 500)
    assert found < 0.02, f"an orderly row of nine is very unlikely by chance, got {found:g}"
    assert ask(-x, 500) < 0.02, "a falling order is as orderly as a rising one: take absolute values of both"
    found = ask(loose, 2000)
    told = f"a loose order comes about by chance more often: got {found:g}, expected about 0.21"
    assert 0.16 < found < 0.26, f"{told}; take absolute values, also of the shuffled"
    found = ask(loose, 7)
    told = (
        f"with n = 7, the share is a whole number of sevenths, not {found:g}: make n permutations, count, divide by n"
    )
    assert np.isclose(7 * found, round(7 * found), atol=1e-4), told
    # Four shares each: one alone comes out the same by luck in one of twenty trials.
    first, again = ([ask(loose, 200, seed) for seed in range(4)] for _ in range(2))
    assert first == again, "the same rng must give the same share: use it, and no other"
    assert len(set(first)) > 1, "another rng must shuffle in another way: use the one that is handed over"


def _expect_third(found: float) -> None:
    """The share for 0, 0, 1, 1, by 2000 permutations: usual slips give other shares, farther off than chance is."""
    assert 0 <= found <= 1, f"a share lies between 0 and 1, got {found:g}: divide by the number of permutations"
    told = f"of the orders of four numbers, a third is as good as the true one, got {found:g}"
    assert found > 0, told + "; as good counts, too: at least as large, not larger"
    assert not 0.1 < found < 0.147, told + "; shuffle, so that each number stays in, and only once"
    assert not 0.147 < found < 0.2, told + "; a falling order is as good as a rising one: take absolute values"
    assert not 0.6 < found < 0.73, told + "; that is the share of worse orders"
    assert 0.28 < found < 0.39, told


class _Errors:
    """Made-up errors: seeds differ in size far more than in their gains. Remembers what it was asked."""

    def __init__(self) -> None:
        self.size = {2: 1.0, 5: 4.0, 7: 20.0, 11: 2.0}
        self.gain = {2: 0.10, 5: 0.06, 7: 0.01, 11: 0.03}
        self.asked: set[tuple[int, int]] = set()

    def __call__(self, dimensions: int, seed: int) -> float:
        self.asked.add((dimensions, seed))
        if seed not in self.size:
            raise CheckFailed(f"error was asked for seed {seed}, which is none of {list(self.size)}")
        return self.size[seed] * (1 - self.gain[seed]) ** dimensions


@check(array("the mean and the standard deviation of the gains", 2))
def gain_of_dimension(answer: Callable) -> None:
    """Three dimensions, then five."""
    for dimensions in (3, 5):
        error = _Errors()
        mean, deviation = answer(dimensions, error, list(error.size))
        asked, pair = sorted({n for n, _ in error.asked}), [dimensions - 1, dimensions]
        assert asked == pair, f"compare {dimensions} dimensions with {dimensions - 1}; you asked for {asked}"
        pairs = {(n, seed) for n in pair for seed in error.size}
        assert error.asked == pairs, "train both with each of the seeds, or the comparison is not paired"
        few, more = (np.array([error(n, seed) for seed in error.size]) for n in pair)
        _expect_gains(mean, deviation, few, more)


def _expect_gains(mean: float, deviation: float, few: np.ndarray, more: np.ndarray) -> None:
    """Mean and deviation of the gains that these errors make, by one dimension fewer and one more."""
    gains, together = 100 * (1 - more / few), 100 * (1 - more.sum() / few.sum())
    slips = {
        "the sign: a lower error is a positive gain": -gains.mean(),
        "a share; in per cent it is a hundred times as much": gains.mean() / 100,
        "that is in units of the error: divide by the error with one dimension fewer": (few - more).mean(),
        "divide by the error with one dimension fewer, not with one more": (100 * (few / more - 1)).mean(),
        "take each seed's gain first, then their mean: large errors must not count more": together,
        "that is the median of the gains: take the mean": np.median(gains),
        "that is the error that is left, not what is gained": 100 - gains.mean(),
    }
    expect(mean, gains.mean(), f"gains of 10, 6, 1 and 3 % have the mean {gains.mean():g} %, not {mean:.4g}", slips)
    true = gains.std(ddof=1)
    slips = {
        "divide by one less than the number of seeds: ddof=1": gains.std(),
        "that is the standard error of the mean: do not divide by √4": true / 2,
        "that is the variance: take its root": true**2,
        "that is the deviation of shares, the mean is in per cent": true / 100,
    }
    told = f"the four gains have the standard deviation {true:.2f} %, not {deviation:.4g}"
    expect(deviation, true, told, slips)
