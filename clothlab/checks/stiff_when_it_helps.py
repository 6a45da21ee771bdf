"""Checks of notebook 10."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, number
from clothlab.cloth import FOAMS, SHEETS

__all__ = ["falling_speed", "place", "sign_flip_share"]


@check(number("a speed in m/s"))
def falling_speed(answer: Callable) -> None:
    """All five foams, by the numbers of the simulated cloth."""
    for name, cloth in FOAMS.items():
        kind, sheets = name.split("-")
        found = answer(SHEETS[kind], int(sheets), cloth.damping * cloth.rows * cloth.columns)
        wanted = cloth.point_mass * 9.81 / cloth.damping
        ratio = found / wanted
        assert not np.isclose(ratio, 1 / 9.81), f"{name}: mass over drag is not yet a speed: where is g?"
        assert not (np.isclose(ratio, 1 / int(sheets)) and sheets != "1"), f"{name}: the number of sheets is left out"
        assert np.isclose(ratio, 1, rtol=1e-2), f"{name} falls at {wanted:.2f} m/s, yours at {found:.2f} m/s"


@check(number("a place along the way"))
def place(answer: Callable) -> None:
    """A line of length 5 that doesn't pass through the origin."""
    start, end, across = np.array([1.0, 1.0]), np.array([4.0, 5.0]), np.array([-4.0, 3.0])
    for wanted in (0.0, 1.0, 0.25, -0.5):
        p = start + wanted * (end - start)
        found = answer(p, start, end)
        assert not (wanted and np.isclose(found, 5 * wanted)), "that is a distance; divide by the length of the way"
        assert not (wanted < 0 and np.isclose(found, -wanted)), "a point before the start has a place below 0"
        assert np.isclose(found, wanted), f"a point at {wanted} of the way got {found:.3f}"
        assert np.isclose(answer(p + across, start, end), wanted), "what is off the line must not count: project first"


@check(number("a share between 0 and 1"))
def sign_flip_share(answer: Callable) -> None:
    """Cases that can be counted by hand."""
    found = answer([1.0, 2.0, 3.0])
    assert found != 0, "the measured signs are one of the choices: count them too"
    assert not np.isclose(found, 2 / 8), "count means that are at least as large, not those that are as far from 0"
    assert np.isclose(found, 1 / 8), f"three positive differences: 1 choice of 8 is as large, got {found}"
    assert np.isclose(answer([1.0, -1.0]), 3 / 4), "for +1 and -1 the mean is 0, which 3 of 4 choices reach"
    assert np.isclose(answer([0.0, 0.0, 2.0]), 1 / 2), "differences of 0 stay 0 under either sign: 1/2 here"
    assert np.isclose(answer([0.1] * 5), 1 / 32), "five equal differences: 1 of 32"
