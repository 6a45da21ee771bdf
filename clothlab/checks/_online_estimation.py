"""Checks of notebook 06."""

from collections.abc import Callable
from functools import partial

import numpy as np

from clothlab.checks._check import apart, array, check, drawn, expect


@check(array("a slope along each of the two axes", 2))
def gradient_by_nudges(answer: Callable, rng: np.random.Generator) -> None:
    """A polynomial in two variables, with two nudges so large that forward differences
    are seen.
    """

    def draw() -> tuple[Callable, np.ndarray, float]:
        return *_polynomial_and_place(rng), rng.uniform(0.15, 0.4)

    for _ in range(2):
        loss_at, p, nudge = drawn(draw, lambda case: apart(*_slopes(*case)))
        truth, slips = _slopes(loss_at, p, nudge)
        found = answer(loss_at, p.copy(), nudge)
        expect(
            found,
            truth,
            f"a polynomial has the slopes {truth.round(4)}, not {found.round(4)}",
            slips,
        )


def _slopes(
    loss_at: Callable, p: np.ndarray, nudge: float
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The central differences [2], and what usual slips give: what the reader is told,
    and the value.
    """
    ahead, behind = (
        np.array([loss_at(p + way * d) for d in np.eye(2)]) for way in (nudge, -nudge)
    )
    truth = (ahead - behind) / (2 * nudge)
    return truth, {
        "the two places are 2 ε apart: divide by that": truth * 2,
        "divide the difference of the loss by the distance of the two places": ahead
        - behind,
        "nudge p both ways, not forwards alone": (ahead - loss_at(p)) / nudge,
        "the sign is wrong: ahead minus behind": -truth,
    }


@check(array("the new p and the new v", 2, 2))
def momentum_step(answer: Callable, rng: np.random.Generator) -> None:
    """A step with a rate and a momentum of their own, then one with the usual ones."""
    own = {"rate": rng.uniform(0.02, 0.04), "momentum": rng.uniform(0.7, 0.85)}

    for given in (own, {}):
        rate, momentum = given.get("rate", 0.1), given.get("momentum", 0.9)
        p, v, g, *_ = drawn(
            partial(_step, rng, rate, momentum), lambda case: _steps_are_apart(*case)
        )
        new_v = momentum * v + g
        new_p = p - rate * new_v
        found_p, found_v = answer(p.copy(), v.copy(), g.copy(), **given)
        swapped = np.allclose(found_p, new_v) and np.allclose(found_v, new_p)
        assert not swapped, "return the new p first, then the new v"
        otherwise = "the new v is wrong: it is the old v, times the momentum, and the gradient as it is, added up"
        expect(found_v, new_v, otherwise, _slips_of_v(v, g, rate, momentum))
        otherwise = "v is right, and the new p is wrong: from p, go downhill by the rate times the new v"
        expect(found_p, new_p, otherwise, _slips_of_p(p, v, new_v, rate))


def _step(rng: np.random.Generator, rate: float, momentum: float) -> tuple:
    """A p, a v and a gradient, with the rate and the momentum that are given."""
    return (
        rng.uniform(-3, 3, 2),
        rng.uniform(-2, 2, 2),
        rng.uniform(-10, 10, 2),
        rate,
        momentum,
    )


def _slips_of_v(
    v: np.ndarray, g: np.ndarray, rate: float, momentum: float
) -> dict[str, np.ndarray]:
    """What is easily written in place of the new v: what the reader is told, and the
    value.
    """
    slips = {
        "the rate belongs to the step of p: v collects the gradients as they are": momentum
        * v
        + rate * g,
        "v = μ v - η g is another way to write momentum, with p + v. Here v collects the gradients as they are, "
        "without rate and sign, and p moves by -η v": momentum * v - rate * g,
        "v points uphill, as the gradient does: the sign belongs to the step of p": momentum
        * v
        - g,
        "the old v must be kept, times the momentum": g,
        "the old v counts only momentum times": v + g,
    }
    if not np.isclose(rate, 1 - momentum):  # or it is the first one
        slips["v is a sum here, not an average: the gradient counts fully"] = (
            momentum * v + (1 - momentum) * g
        )
    return slips


def _slips_of_p(
    p: np.ndarray, v: np.ndarray, new_v: np.ndarray, rate: float
) -> dict[str, np.ndarray]:
    """What is easily written in place of the new p, where v is right."""
    return {
        "v is right; p moves by the new v, not by the old one": p - rate * v,
        "v is right; p goes uphill": p + rate * new_v,
        "v is right; p moves by rate times v, not by all of it": p - new_v,
    }


def _steps_are_apart(
    p: np.ndarray, v: np.ndarray, g: np.ndarray, rate: float, momentum: float
) -> bool:
    """Whether each slip in the step of p and v can be told from the others."""
    new_v = momentum * v + g
    far_v = apart(new_v, _slips_of_v(v, g, rate, momentum))
    return far_v and apart(p - rate * new_v, _slips_of_p(p, v, new_v, rate))


@check(array("a second derivative along each of the axes", 3))
def curvature(answer: Callable, rng: np.random.Generator) -> None:
    """A polynomial in two variables, off its bottom, along three axes and at two
    distances.
    """

    def draw() -> tuple[Callable, np.ndarray, np.ndarray, float]:
        angle = rng.uniform(0.5, 1.1)  # [rad]
        axes = np.array([[1.0, 0.0], [0.0, 1.0], [np.cos(angle), np.sin(angle)]])
        return *_polynomial_and_place(rng), axes, rng.uniform(0.1, 0.5)

    for _ in range(2):
        loss_at, p, axes, epsilon = drawn(draw, lambda case: apart(*_curvatures(*case)))
        truth, slips = _curvatures(loss_at, p, axes, epsilon)
        found = answer(loss_at, p.copy(), axes.copy(), epsilon)
        otherwise = (
            "that is not how the slope changes: compare the loss a step ahead and a step behind with the loss at p "
            f"itself; with a polynomial, {truth.round(4)} comes out, not {found.round(4)}"
        )
        expect(found, truth, otherwise, slips)


def _curvatures(
    loss_at: Callable, p: np.ndarray, axes: np.ndarray, epsilon: float
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The second derivatives [K], and what usual slips give: what the reader is told,
    and the value.
    """
    here = loss_at(p)
    ahead, behind = (
        np.array([loss_at(p + way * axis) for axis in axes])
        for way in (epsilon, -epsilon)
    )
    truth = (ahead - 2 * here + behind) / epsilon**2
    return truth, {
        "a curvature is divided by the square of the step: what is yours divided by?": truth
        * epsilon,
        "it is not divided by anything: a curvature is divided by the square of the step": truth
        * epsilon**2,
        "the two places are 2 ε apart, but each step is ε: divide by ε², not by (2 ε)²": truth
        / 4,
        "that is half of it: a parabola's factor is half of its second derivative": truth
        / 2,
        "the loss at p itself counts twice": truth + here / epsilon**2,
        "the loss at p itself is subtracted, not added": truth + 4 * here / epsilon**2,
        "that is the slope along the axis; asked is how the slope changes": (
            ahead - behind
        )
        / (2 * epsilon),
        "that is a change of the loss to one side only: take a step ahead and a step behind": (
            ahead - here
        )
        / epsilon**2,
        "the sign is wrong: where the loss rises to both sides, the curvature is positive": -truth,
    }


def _polynomial_and_place(
    rng: np.random.Generator,
) -> tuple[Callable[[np.ndarray], float], np.ndarray]:
    """A loss without symmetry, whose curvature a central difference finds exactly, and
    a place off its bottom.
    """
    a, b, c, d, e = rng.uniform((2.0, 0.5, 0.3, 1.0, 0.8), (4.0, 1.5, 0.7, 3.0, 1.2))

    def loss_at(q: np.ndarray) -> float:
        x, y = np.asarray(q, dtype=float)
        return a * x**2 + b * x * y + c * y**2 + d * x + e * x**3 + e * y**3

    return loss_at, np.array([rng.uniform(0.3, 0.7), rng.uniform(-1.2, -0.8)])
