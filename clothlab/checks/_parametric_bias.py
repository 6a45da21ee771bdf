"""Checks of notebook 05."""

from collections.abc import Callable

import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import cross_val_predict

from clothlab.analysis import principal_axes
from clothlab.checks._check import apart, array, check, drawn, expect


@check(array("a share for each of the two axes", 2))
def shares_by_hand(answer: Callable, rng: np.random.Generator) -> None:
    """Nine random points beside scikit-learn, then three on a line."""

    def draw() -> np.ndarray:
        return rng.normal(0.3, 1.0, (9, 2)) @ np.array([[2.0, 1.0], [0.0, 1.0]])

    points = drawn(draw, lambda points: apart(*_shares(points)))
    truth, slips = _shares(points)
    result = answer(points)
    otherwise = f"scikit-learn finds {truth.round(4)} for nine random points, not {result.round(4)}"
    if not np.isclose(result.sum(), 1):
        otherwise = f"shares add up to 1, yours to {result.sum():.4g}"
    expect(result, truth, otherwise, slips)
    result = answer(np.outer([0.0, 1.0, 2.0], rng.uniform(1.0, 3.0, 2)))
    expect(
        result,
        [1, 0],
        f"points on a line have all variance along one axis; got {result}",
    )


def _shares(points: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The shares [2] of points [N, 2], and what usual slips give: what the reader is
    told, and the value.
    """
    truth = principal_axes(
        {str(k): each for k, each in enumerate(points)}
    ).explained_variance_ratio_
    moments, columns = (
        np.linalg.eigvalsh(points.T @ points)[::-1],
        np.var(points, axis=0),
    )
    return truth, {
        "the right shares in the wrong order: the larger one first": truth[::-1],
        "these are the variances: divide by their sum": truth
        * columns.sum()
        * len(points)
        / (len(points) - 1),
        "a share of the variance, not of its root": np.sqrt(truth)
        / np.sqrt(truth).sum(),
        "subtract the mean of the points first": moments / moments.sum(),
        "these are shares of the two columns: the principal axes lie across them": columns
        / columns.sum(),
    }


@check(array("a value for each of the cloths", None))
def left_out(answer: Callable, rng: np.random.Generator) -> None:
    """Nine random points and values beside scikit-learn, then another number of them."""
    for count in (9, int(rng.integers(6, 9))):
        p, y = rng.normal(size=(count, 2)), rng.normal(2.0, 1.0, count)
        line = LinearRegression()
        result, truth = answer(p, y), cross_val_predict(line, p, y, cv=count)
        assert len(result) == count, (
            f"return a value for each of the {count} cloths, not {len(result)}"
        )
        slips = {
            "cloth k is among those of the fit: leave it out": line.fit(p, y).predict(
                p
            ),
            "this is the mean of the others: p is not used": (y.sum() - y)
            / (count - 1),
        }
        expect(
            result,
            truth,
            "for random points and values, scikit-learn predicts other values",
            slips,
        )
