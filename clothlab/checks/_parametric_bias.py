"""Checks of notebook 05."""

from collections.abc import Callable

import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import cross_val_predict

from clothlab.analysis import principal_axes
from clothlab.checks._check import apart, array, check, drawn, expect


@check(array("a share for each of the two axes", 2))
def shares_by_hand(answer: Callable, rng: np.random.Generator) -> None:
    """Shares of the variance `[2]` along the principal axes, the larger first.

    Given are nine random points `[9, 2]`, of which scikit-learn knows the shares, then
    three on a line.
    """

    def draw() -> np.ndarray:
        return rng.normal(0.3, 1.0, (9, 2)) @ np.array([[2.0, 1.0], [0.0, 1.0]])

    # Random points
    points = drawn(draw, lambda points: apart(*_shares(points)))
    truth, slips = _shares(points)
    found = answer(points)
    otherwise = (
        f"scikit-learn finds {truth.round(4)} for nine random points, "
        f"not {found.round(4)}"
    )
    if not np.isclose(found.sum(), 1):
        otherwise = f"shares add up to 1, yours to {found.sum():.4g}"
    expect(found, truth, otherwise, slips)

    # Points on a line
    found = answer(np.outer([0.0, 1.0, 2.0], rng.uniform(1.0, 3.0, 2)))
    otherwise = f"points on a line have all variance along one axis; got {found}"
    expect(found, [1, 0], otherwise)


def _shares(points: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The shares [2] of points [N, 2], and what usual slips give, by what is said."""
    # The truth, by scikit-learn
    named = {str(k): point for k, point in enumerate(points)}
    truth = principal_axes(named).explained_variance_ratio_

    # Other shares that are near at hand
    columns = np.var(points, axis=0)
    sample = len(points) / (len(points) - 1)
    variances = truth * columns.sum() * sample
    roots = np.sqrt(truth)
    moments = np.linalg.eigvalsh(points.T @ points)[::-1]
    across_columns = columns / columns.sum()
    return truth, {
        "the right shares in the wrong order: the larger one first": truth[::-1],
        "these are the variances: divide by their sum": variances,
        "a share of the variance, not of its root": roots / roots.sum(),
        "subtract the mean of the points first": moments / moments.sum(),
        "these are shares of the two columns: the principal axes lie across "
        "them": across_columns,
    }


@check(array("a value for each of the cloths", None))
def left_out(answer: Callable, rng: np.random.Generator) -> None:
    """A value for each cloth, predicted by a linear fit to all the others `[K]`.

    Given are random p `[K, 2]` and values `[K]` of nine cloths, then of fewer; expected
    is what scikit-learn's cross-validation predicts.
    """
    for count in (9, int(rng.integers(6, 9))):
        p = rng.normal(size=(count, 2))
        y = rng.normal(2.0, 1.0, count)
        found = answer(p, y)
        assert len(found) == count, (
            f"return a value for each of the {count} cloths, not {len(found)}"
        )

        # Each cloth left out in turn, and not
        truth = cross_val_predict(LinearRegression(), p, y, cv=count)
        fitted_to_all = LinearRegression().fit(p, y).predict(p)
        mean_of_others = (y.sum() - y) / (count - 1)
        slips = {
            "cloth k is among those of the fit: leave it out": fitted_to_all,
            "this is the mean of the others: p is not used": mean_of_others,
        }
        otherwise = "for random points and values, scikit-learn predicts other values"
        expect(found, truth, otherwise, slips)
