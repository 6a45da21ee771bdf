"""Checks of notebook 05."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from clothlab.analysis import principal_axes
from clothlab.checks._check import apart, array, arrays, check, drawn, expect, number
from clothlab.simulation.cloth import Cloth


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
    from sklearn.linear_model import LinearRegression  # slow to import
    from sklearn.model_selection import cross_val_predict

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


# What makes a force, or needs one, and what is said where it has not grown
_GROWS = {
    "mass": "the twin is heavier: its mass is factor times that of the cloth",
    "damping": "the drag must keep its share of the weight: c/m stays as it was",
    "stiffness": "the heavier cloth stretches its springs more, or less: they don't "
    "pull factor times as hard",
    "bending": "it doesn't resist bending factor times as hard",
    "spring_damping": "the dampers of its springs don't brake factor times as hard",
}


def _a_cloth(name: str, found: object) -> Cloth:
    """Read a cloth."""
    assert isinstance(found, Cloth), (
        f"{name} returned a {type(found).__name__}: return a Cloth, made by replace"
    )
    return found


@check(_a_cloth)
def heavier_twin(answer: Callable, rng: np.random.Generator) -> None:
    """The cloth of `factor` times the mass that moves as another one does.

    Given are a random cloth and a factor. Expected is that all forces grow with the
    mass, and that the grid of points stays.
    """
    drawn_values = rng.uniform(0.5, 1.5, len(_GROWS)) * [0.1, 0.05, 100.0, 0.5, 0.2]
    cloth = Cloth("any", **dict(zip(_GROWS, drawn_values.tolist(), strict=True)))
    factor = float(rng.uniform(1.5, 3.0))
    found = answer(cloth, factor)
    before = {}
    for field, otherwise in _GROWS.items():
        before[field] = getattr(cloth, field)
        expect(getattr(found, field), factor * before[field], otherwise)
    assert replace(found, name=cloth.name, **before) == cloth, (
        "the twin is cut alike: its size and its grid of points stay as they were"
    )


class _StringCase(NamedTuple):
    """A point on a string, in SI units; all vectors are `[2]`."""

    r: np.ndarray  # from hand to point
    v: np.ndarray  # of the point, so that the string keeps its length
    v_hand: np.ndarray
    a: np.ndarray  # of the hand
    c_over_m: float


@check(number("q, one number"))
def string_pull(answer: Callable, rng: np.random.Generator) -> None:
    """The pull q [1/s²] of a string that does not stretch.

    Given are places and velocities of hand and point that fit the string, the hand's
    acceleration, and drag over mass. Expected is the q with which the second derivative
    of the squared length is zero.
    """
    for _ in range(3):
        case = drawn(lambda: _string_case(rng), lambda case: apart(*_pulls(case)))
        truth, slips = _pulls(case)
        given = (case.r, case.v, case.v_hand, case.a)
        found = answer(*(each.copy() for each in given), case.c_over_m)
        otherwise = (
            "with this q the string does not keep its length: the second derivative of "
            f"r · r is {_stretching(case, found):.3g} m²/s², not 0"
        )
        expect(found, truth, otherwise, slips)


def _string_case(rng: np.random.Generator) -> _StringCase:
    r = rng.uniform(0.3, 0.8, 2) * rng.choice([-1, 1], 2)
    v_hand = rng.uniform(-1.5, 1.5, 2)
    across = np.array([-r[1], r[0]]) / np.linalg.norm(r)
    v = v_hand + rng.uniform(0.5, 2.0) * across
    return _StringCase(r, v, v_hand, rng.uniform(-5, 5, 2), rng.uniform(3.0, 20.0))


_GRAVITY = np.array([0.0, -9.81])  # [m/s²]


def _stretching(case: _StringCase, q: float) -> float:
    """Half the second derivative of the squared length, with a pull q [m²/s²]."""
    swing = case.v - case.v_hand
    acceleration = _GRAVITY - case.c_over_m * case.v - q * case.r
    return float(swing @ swing + case.r @ (acceleration - case.a))


def _pulls(case: _StringCase) -> tuple[float, dict[str, float]]:
    """q, and what usual slips give, by what is said of them."""
    r, v, v_hand, a, c_over_m = case
    swing = v - v_hand
    squared = r @ r
    pushed = r @ (_GRAVITY - a - c_over_m * v)
    truth = (swing @ swing + pushed) / squared
    return truth, {
        "the sign is wrong: F/m is -q r, so a string under tension has q > 0": -truth,
        "divide by r · r": truth * squared,
        "divide by r · r, the length squared": truth * np.sqrt(squared),
        "the first derivative of r is v - v_hand; its square is missing": pushed
        / squared,
        "the string turns by v - v_hand, not by v": (v @ v + pushed) / squared,
        "the hand accelerates: the second derivative of r is dv/dt - a": truth
        + r @ a / squared,
        "the hand's acceleration has the wrong sign": truth + 2 * (r @ a) / squared,
        "gravity pulls the point, too": truth - r @ _GRAVITY / squared,
        "the drag of still air is c/m times v: neither left out nor c/m times "
        "(v - v_hand)": truth + c_over_m * (r @ v) / squared,
    }


@check(
    arrays(
        "new weights and new points, two arrays",
        array("the new weights", None, None),
        array("the new points", None, None),
    )
)
def same_predictions(answer: Callable, rng: np.random.Generator) -> None:
    """Weights `[N, D_p]` and points `[K, D_p]` after each p has become A p.

    Given are random weights, points and A. Weights times points must stay as they are.
    """
    for size in (2, 3):
        case = drawn(partial(_map_case, rng, size), _map_slips_differ)
        weights, points, A = case
        found_weights, found_points = answer(weights.copy(), points.copy(), A.copy())

        otherwise = "the points are wrong: each row p becomes A p"
        _expect_shape(found_points, points, "points")
        expect(found_points, points @ A.T, otherwise, _moved_wrongly(case))

        _expect_shape(found_weights, weights, "weights")
        truth = weights @ np.linalg.inv(A)
        otherwise = (
            "the points are right, but the new weights times the new points are not "
            "the old weights times the old points"
        )
        expect(found_weights, truth, otherwise, _weighed_wrongly(case))


def _expect_shape(found: np.ndarray, like: np.ndarray, what: str) -> None:
    """Raise unless an array has the shape of another."""
    assert found.shape == like.shape, (
        f"the new {what} have the shape {found.shape}, the old ones {like.shape}"
    )


class _MapCase(NamedTuple):
    weights: np.ndarray  # [N, D_p]
    points: np.ndarray  # [K, D_p]
    A: np.ndarray  # [D_p, D_p]


def _map_case(rng: np.random.Generator, size: int) -> _MapCase:
    A = 1.5 * np.eye(size) + rng.uniform(-0.6, 0.6, (size, size))
    return _MapCase(rng.normal(size=(5, size)), rng.normal(size=(4, size)), A)


def _map_slips_differ(case: _MapCase) -> bool:
    if abs(np.linalg.det(case.A)) < 0.3:
        return False
    moved = apart(case.points @ case.A.T, _moved_wrongly(case))
    truth = case.weights @ np.linalg.inv(case.A)
    return moved and apart(truth, _weighed_wrongly(case))


def _moved_wrongly(case: _MapCase) -> dict[str, np.ndarray]:
    return {
        "points @ A multiplies by the transposed A: each row p becomes A p": case.points
        @ case.A,
        "the points must move: each p becomes A p": case.points,
        "the points move by A, the weights by its inverse": case.points
        @ np.linalg.inv(case.A).T,
    }


def _weighed_wrongly(case: _MapCase) -> dict[str, np.ndarray]:
    inverse = np.linalg.inv(case.A)
    return {
        "the points are right; the weights must undo A, not do it again": case.weights
        @ case.A,
        "the points are right; the weights are to be changed, too": case.weights,
        "the points are right; the inverse of A is transposed here": case.weights
        @ inverse.T,
        "the points are right; the transpose of A is no inverse": case.weights
        @ case.A.T,
    }


@check(number("a share, one number"))
def share_by_luck(answer: Callable, rng: np.random.Generator) -> None:
    """The share of orders in which values score at least as high as they are.

    Given are points, values, a score and random orders, the unchanged one among them.
    """
    for _ in range(2):
        case = drawn(lambda: _luck_case(rng), lambda case: apart(*_lucky(case)))
        truth, slips = _lucky(case)
        found = answer(case.p.copy(), case.y.copy(), _agreement, case.orders.copy())
        otherwise = (
            f"of {len(case.orders)} orders, "
            f"{round(truth * len(case.orders))} score as high as the truth: that is "
            f"{truth:.4g}, not {found:.4g}"
        )
        expect(found, truth, otherwise, slips)


class _LuckCase(NamedTuple):
    p: np.ndarray  # [K, 2]
    y: np.ndarray  # [K]
    orders: np.ndarray  # [N, K]


def _luck_case(rng: np.random.Generator) -> _LuckCase:
    p = rng.normal(size=(5, 2))
    y = p[:, 0] + rng.normal(0, 0.8, 5)
    shuffled = [rng.permutation(5) for _ in range(22)]
    orders = np.array([np.arange(5), *shuffled, np.arange(5)])
    return _LuckCase(p, y, orders)


def _agreement(p: np.ndarray, y: np.ndarray) -> float:
    """A score that depends on which value belongs to which point."""
    p = np.asarray(p, dtype=float)
    return float(np.round(p[:, 0] @ np.asarray(y, dtype=float), 9))


def _lucky(case: _LuckCase) -> tuple[float, dict[str, float]]:
    """The share, and what usual slips give, by what is said of them."""
    scores = np.array([_agreement(case.p, case.y[order]) for order in case.orders])
    truth = _agreement(case.p, case.y)
    share = float(np.mean(scores >= truth))
    return share, {
        "as high counts, too: at least the score of y as it is": float(
            np.mean(scores > truth)
        ),
        "that is the share that scores less": float(np.mean(scores < truth)),
        "that is the share that scores at most as high": float(
            np.mean(scores <= truth)
        ),
        "a share, not a count: divide by the number of orders": share * len(scores),
        "shuffle y alone: where p is shuffled along, nothing has changed": 1.0,
    }


@check(array("a distance for each p", None))
def try_each(answer: Callable, rng: np.random.Generator) -> None:
    """The mean distance `[K]` of predictions from a recording `[T, D_z]`, for each p.

    Given are a prediction of z by p, a random recording and points `[K, 2]`. Expected
    is the mean over the steps of the length of the gap in z.
    """
    for count in (5, 3):
        # A recording, and predictions of which each p makes another
        z = rng.normal(size=(12, 3))
        points = rng.normal(size=(count, 2))
        swing = rng.normal(size=(2, 12, 3))

        def predict_z(p: np.ndarray, swing: np.ndarray = swing) -> np.ndarray:
            return np.tensordot(p, swing, axes=1)

        found = answer(predict_z, z.copy(), points.copy())
        assert len(found) == count, (
            f"return a distance for each of the {count} p, not {len(found)}"
        )

        # The mean length, and what usual slips give
        gaps = np.array([predict_z(p) - z for p in points])
        lengths = np.linalg.norm(gaps, axis=2)
        slips = {
            "the sum over the steps: take the mean": lengths.sum(axis=1),
            "a mean of squares: take the root at each step": (lengths**2).mean(axis=1),
            "the root of a mean of squares: take the mean of the lengths": np.sqrt(
                (lengths**2).mean(axis=1)
            ),
            "this is one norm of the whole gap: take the length at each step, "
            "then the mean": np.linalg.norm(gaps.reshape(count, -1), axis=1),
            "this is the mean of each number's gap: a distance is a length "
            "in z": np.abs(gaps).mean(axis=(1, 2)),
        }
        otherwise = "the distance at a step is the length of predict_z(p) - z there"
        expect(found, lengths.mean(axis=1), otherwise, slips)
