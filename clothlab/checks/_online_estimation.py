"""Checks of notebook 06."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from clothlab.checks._check import apart, array, check, drawn, expect

Loss = Callable[[np.ndarray], float]


class _NudgeCase(NamedTuple):
    loss_at: Loss
    p: np.ndarray  # [2]
    nudge: float


@check(array("a slope along each of the two axes", 2))
def gradient_by_nudges(answer: Callable, rng: np.random.Generator) -> None:
    """The gradient `[2]` of a loss by central differences.

    Given are a loss of p, a place p `[2]` and a nudge ε so large that forward
    differences are seen to differ.
    """
    for _ in range(2):
        case = drawn(
            lambda: _NudgeCase(*_loss_and_place(rng), rng.uniform(0.15, 0.4)),
            lambda case: apart(*_slopes(case)),
        )
        truth, slips = _slopes(case)
        found = answer(case.loss_at, case.p.copy(), case.nudge)
        otherwise = (
            f"a polynomial has the slopes {truth.round(4)}, not {found.round(4)}"
        )
        expect(found, truth, otherwise, slips)


def _slopes(case: _NudgeCase) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The central differences [2], and what usual slips give, by what is said."""
    loss_at, p, nudge = case
    axes = np.eye(2)
    here = loss_at(p)
    ahead = np.array([loss_at(p + nudge * axis) for axis in axes])
    behind = np.array([loss_at(p - nudge * axis) for axis in axes])

    truth = (ahead - behind) / (2 * nudge)
    not_divided = ahead - behind
    return truth, {
        "the two places are 2 ε apart: divide by that": truth * 2,
        "divide the difference of the loss by the distance of the two "
        "places": not_divided,
        "nudge p both ways, not forwards alone": (ahead - here) / nudge,
        "the sign is wrong: ahead minus behind": -truth,
    }


class _MomentumCase(NamedTuple):
    """A step of gradient descent with momentum."""

    p: np.ndarray  # [2]
    v: np.ndarray  # [2]
    g: np.ndarray  # [2], the gradient
    rate: float
    momentum: float

    @property
    def new_v(self) -> np.ndarray:
        return self.momentum * self.v + self.g

    @property
    def new_p(self) -> np.ndarray:
        return self.p - self.rate * self.new_v


@check(array("the new p and the new v", 2, 2))
def momentum_step(answer: Callable, rng: np.random.Generator) -> None:
    """The new p and the new v, `[2]` each, after a step with momentum.

    Given are p, v and the gradient, first with a rate and a momentum of their own, then
    without: they are 0.1 and 0.9 by default.
    """
    own = {"rate": rng.uniform(0.02, 0.04), "momentum": rng.uniform(0.7, 0.85)}
    for given in (own, {}):
        rate = given.get("rate", 0.1)
        momentum = given.get("momentum", 0.9)
        draw = partial(_momentum_case, rng, rate, momentum)
        case = drawn(draw, _slips_differ)
        found_p, found_v = answer(case.p.copy(), case.v.copy(), case.g.copy(), **given)

        # Both right, in the wrong order
        swapped = np.allclose(found_p, case.new_v) and np.allclose(found_v, case.new_p)
        assert not swapped, "return the new p first, then the new v"

        # v first: a wrong one makes a wrong p
        otherwise = (
            "the new v is wrong: it is the old v, times the momentum, and the "
            "gradient as it is, added up"
        )
        expect(found_v, case.new_v, otherwise, _slips_of_v(case))
        otherwise = (
            "v is right, and the new p is wrong: from p, go downhill by the rate "
            "times the new v"
        )
        expect(found_p, case.new_p, otherwise, _slips_of_p(case))


def _momentum_case(
    rng: np.random.Generator, rate: float, momentum: float
) -> _MomentumCase:
    p = rng.uniform(-3, 3, 2)
    v = rng.uniform(-2, 2, 2)
    g = rng.uniform(-10, 10, 2)
    return _MomentumCase(p, v, g, rate, momentum)


def _slips_differ(case: _MomentumCase) -> bool:
    """Whether each slip in the step of p and v can be told from the others."""
    of_v = apart(case.new_v, _slips_of_v(case))
    return of_v and apart(case.new_p, _slips_of_p(case))


def _slips_of_v(case: _MomentumCase) -> dict[str, np.ndarray]:
    """What is easily written in place of the new v, by what is said of it."""
    _, v, g, rate, momentum = case
    kept = momentum * v
    slips = {
        "the rate belongs to the step of p: v collects the gradients as they are": kept
        + rate * g,
        "v = μ v - η g is another way to write momentum, with p + v. Here v collects "
        "the gradients as they are, without rate and sign, and p moves by "
        "-η v": kept - rate * g,
        "v points uphill, as the gradient does: the sign belongs to the step of p": kept
        - g,
        "the old v must be kept, times the momentum": g,
        "the old v counts only momentum times": v + g,
    }
    if not np.isclose(rate, 1 - momentum):  # or it is the first one
        average = kept + (1 - momentum) * g
        slips["v is a sum here, not an average: the gradient counts fully"] = average
    return slips


def _slips_of_p(case: _MomentumCase) -> dict[str, np.ndarray]:
    """What is easily written in place of the new p, where v is right."""
    p, v, _, rate, _ = case
    return {
        "v is right; p moves by the new v, not by the old one": p - rate * v,
        "v is right; p goes uphill": p + rate * case.new_v,
        "v is right; p moves by rate times v, not by all of it": p - case.new_v,
    }


class _CurvatureCase(NamedTuple):
    loss_at: Loss
    p: np.ndarray  # [2]
    axes: np.ndarray  # [K, 2], of length 1
    epsilon: float


@check(array("a second derivative along each of the axes", 3))
def curvature(answer: Callable, rng: np.random.Generator) -> None:
    """The second derivatives `[3]` of a loss along three axes.

    Given are a loss of p, a place off its bottom `[2]`, axes of length 1 `[3, 2]`, one
    of them slanted, and the length of a step ε.
    """
    for _ in range(2):
        case = drawn(
            lambda: _curvature_case(rng), lambda case: apart(*_curvatures(case))
        )
        truth, slips = _curvatures(case)
        found = answer(case.loss_at, case.p.copy(), case.axes.copy(), case.epsilon)
        otherwise = (
            "that is not how the slope changes: compare the loss a step ahead and a "
            "step behind with the loss at p itself; with a polynomial, "
            f"{truth.round(4)} comes out, not {found.round(4)}"
        )
        expect(found, truth, otherwise, slips)


def _curvature_case(rng: np.random.Generator) -> _CurvatureCase:
    angle = rng.uniform(0.5, 1.1)  # [rad]
    axes = np.array([[1.0, 0.0], [0.0, 1.0], [np.cos(angle), np.sin(angle)]])
    loss_at, p = _loss_and_place(rng)
    return _CurvatureCase(loss_at, p, axes, rng.uniform(0.1, 0.5))


def _curvatures(case: _CurvatureCase) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The second derivatives [K], and what usual slips give, by what is said."""
    # The loss at p, and a step ahead and behind along each axis
    loss_at, p, axes, epsilon = case
    here = loss_at(p)
    ahead = np.array([loss_at(p + epsilon * axis) for axis in axes])
    behind = np.array([loss_at(p - epsilon * axis) for axis in axes])

    # The truth, and other ways to put the three together
    truth = (ahead - 2 * here + behind) / epsilon**2
    slope = (ahead - behind) / (2 * epsilon)
    one_sided = (ahead - here) / epsilon**2
    return truth, {
        "a curvature is divided by the square of the step: what is yours divided "
        "by?": truth * epsilon,
        "it is not divided by anything: a curvature is divided by the square of the "
        "step": truth * epsilon**2,
        "the two places are 2 ε apart, but each step is ε: divide by ε², not by "
        "(2 ε)²": truth / 4,
        "that is half of it: a parabola's factor is half of its second "
        "derivative": truth / 2,
        "the loss at p itself counts twice": truth + here / epsilon**2,
        "the loss at p itself is subtracted, not added": truth + 4 * here / epsilon**2,
        "that is the slope along the axis; asked is how the slope changes": slope,
        "that is a change of the loss to one side only: take a step ahead and a step "
        "behind": one_sided,
        "the sign is wrong: where the loss rises to both sides, the curvature is "
        "positive": -truth,
    }


def _loss_and_place(rng: np.random.Generator) -> tuple[Loss, np.ndarray]:
    """A loss without symmetry, and a place off its bottom `[2]`.

    A central difference finds the curvature of the loss exactly.
    """
    least = (2.0, 0.5, 0.3, 1.0, 0.8)
    most = (4.0, 1.5, 0.7, 3.0, 1.2)
    a, b, c, d, e = rng.uniform(least, most)

    def loss_at(q: np.ndarray) -> float:
        x, y = np.asarray(q, dtype=float)
        return a * x**2 + b * x * y + c * y**2 + d * x + e * x**3 + e * y**3

    return loss_at, np.array([rng.uniform(0.3, 0.7), rng.uniform(-1.2, -0.8)])
