"""Checks of notebook 06."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, expect


@check(array("a slope along each of the two axes", 2))
def gradient_by_nudges(answer: Callable) -> None:
    """A polynomial in two variables, with two nudges so large that forward differences are seen."""
    p = np.array([0.5, -1.0])
    for nudge in (0.2, 0.4):
        ahead, behind = (np.array([_polynomial(p + way * d) for d in np.eye(2)]) for way in (nudge, -nudge))
        truth = (ahead - behind) / (2 * nudge)
        slips = {
            "the two places are 2 ε apart: divide by that": truth * 2,
            "divide the difference of the loss by the distance of the two places": ahead - behind,
            "nudge p both ways, not forwards alone": (ahead - _polynomial(p)) / nudge,
            "the sign is wrong: ahead minus behind": -truth,
        }
        found = answer(_polynomial, p.copy(), nudge)
        expect(found, truth, f"a polynomial has the slopes {truth.round(4)}, not {found.round(4)}", slips)


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


@check(array("a second derivative along each of the axes", 3))
def curvature(answer: Callable) -> None:
    """A polynomial in two variables, off its bottom, along three axes and at two distances."""
    p, axes = np.array([0.5, -1.0]), np.array([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]])
    here, (x, y) = _polynomial(p), axes.T
    truth = (6 + 6 * p[0]) * x**2 + 2 * x * y + y**2
    for epsilon in (0.1, 0.5):
        found = answer(_polynomial, p.copy(), axes.copy(), epsilon)
        slips = {
            "what is it divided by?": truth * epsilon,
            "the loss at p itself counts twice": truth + here / epsilon**2,
            "the loss at p itself is subtracted, not added": truth + 4 * here / epsilon**2,
        }
        expect(found, truth, f"a polynomial has the curvatures {truth.round(4)}, not {found.round(4)}", slips)


def _polynomial(q: np.ndarray) -> float:
    """A loss without symmetry, whose slopes and curvatures are known."""
    x, y = np.asarray(q, dtype=float)
    return 3 * x**2 + x * y + 0.5 * y**2 + 2 * x + x**3
