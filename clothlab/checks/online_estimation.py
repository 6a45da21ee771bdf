"""Checks of notebook 06."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, expect, number


@check(array("a slope along each of the two axes", 2))
def gradient_by_nudges(answer: Callable) -> None:
    """A polynomial in two variables, with two nudges so large that forward differences are seen."""
    p = np.array([0.5, -1.0])
    for nudge in (0.2, 0.4):

        def slopes(up: float, down: float, divisor: float) -> np.ndarray:
            """Differences of the loss at p + up and p - down along each axis, divided."""
            return np.array([_polynomial(p + up * d) - _polynomial(p - down * d) for d in np.eye(2)]) / divisor

        truth = slopes(nudge, nudge, 2 * nudge)
        slips = {
            "the two places are 2 ε apart: divide by that": truth * 2,
            "these are the differences of the loss: divide by the distance of the two places": truth * 2 * nudge,
            "nudge p both ways, not forwards alone": slopes(nudge, 0, nudge),
            "the sign is wrong: ahead minus behind": -truth,
            "each axis has a slope of its own: nudge one number of p at a time": np.full(
                2, (_polynomial(p + nudge) - _polynomial(p - nudge)) / (2 * nudge)
            ),
        }
        found = answer(_polynomial, p.copy(), nudge)
        message = f"with ε = {nudge:g}, a polynomial has the differences {truth.round(4)}, not {found.round(4)}"
        expect(found, truth, message, slips)


@check(array("the new p and the new v", 2, 2))
def momentum_step(answer: Callable) -> None:
    """A step with a rate and a momentum of their own, then one with the usual ones."""
    p, v, g = np.array([3.0, -1.0]), np.array([0.5, -2.0]), np.array([6.0, -10.0])
    for given in ({"rate": 0.02, "momentum": 0.8}, {}):
        rate, momentum = given.get("rate", 0.1), given.get("momentum", 0.9)
        new_v = momentum * v + g
        new_p = p - rate * new_v
        found_p, found_v = answer(p.copy(), v.copy(), g.copy(), **given)
        swapped = np.allclose(found_p, new_v) and np.allclose(found_v, new_p)
        assert not swapped, "return the new p first, then the new v"
        slips = {
            "the rate belongs to the step of p: v collects the gradients as they are": momentum * v + rate * g,
            "the old v must be kept, times the momentum": g,
            "the old v counts only momentum times": v + g,
        }
        expect(found_v, new_v, f"the new v is wrong; from v = {v}, gradient {g} you made {found_v}", slips)
        slips = {
            "v is right; p moves by the new v, not by the old one": p - rate * v,
            "v is right; p goes uphill": p + rate * new_v,
            "v is right; p moves by rate times v, not by all of it": p - new_v,
        }
        expect(found_p, new_p, f"v is right; the new p is wrong: with rate {rate:g}, got {found_p}", slips)


@check(number("a second derivative"))
def curvature(answer: Callable) -> None:
    """A polynomial in two variables, off its bottom, with directions of several lengths."""
    p, loss = np.array([0.5, -1.0]), _polynomial
    for direction in ([1.0, 0.0], [0.0, 4.0], [3.0, 4.0]):
        d, length = np.array(direction), np.linalg.norm(direction)
        found, (x, y) = answer(loss, p.copy(), d), d / length
        truth = (6 + 6 * p[0]) * x**2 + 2 * x * y + y**2
        message = f"along {direction} a polynomial has the second derivative {truth:.4g}, not {found:.4g}"
        slips = {
            message + "; divide the direction by its length": truth * length**2,
            message + "; what is it divided by?": truth * 0.1,
            message + "; the loss at p itself counts twice": truth + loss(p) / 0.1**2,
            message + "; the loss at p itself is subtracted, not added": truth + 4 * loss(p) / 0.1**2,
        }
        expect(found, truth, message, slips, rtol=1e-4)
    found = answer(lambda q: q[0] ** 4, np.zeros(2), np.array([2.0, 0.0]), 0.5)
    expect(found, 0.5, "look one ε to each side, as far as you are told, not always the same", rtol=1e-4)


def _polynomial(q: np.ndarray) -> float:
    """A loss without symmetry, whose slopes and curvatures are known."""
    x, y = np.asarray(q, dtype=float)
    return 3 * x**2 + x * y + 0.5 * y**2 + 2 * x + x**3
