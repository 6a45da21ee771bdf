"""Checks of notebook 11."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number
from clothlab.simulation.cloth import FOAMS, SHEETS


@check(number("a speed in m/s"))
def falling_speed(answer: Callable) -> None:
    """All five foams, by the numbers of the simulated cloth, then half of one."""
    for name, cloth in FOAMS.items():
        kind, sheets = name.split("-")
        drag = cloth.damping * cloth.rows * cloth.columns
        found, wanted = answer(SHEETS[kind], int(sheets), drag), cloth.point_mass * 9.81 / cloth.damping
        slips = {
            "mass over drag is not yet a speed: where is g?": wanted / 9.81,
            "the number of sheets is left out": wanted / int(sheets),
            "density times thickness is the mass of a square metre: how many are there?": wanted / 0.2,
            "density times area is not a mass: how thick is the sheet?": wanted / SHEETS[kind].thickness,
            "the drag given is that of the whole cloth, not of one point": wanted / 18,
            "a heavy cloth falls faster, a strong drag makes it slower: yours is upside down": 1 / wanted,
        }
        expect(found, wanted, f"{name} falls at {wanted:.2f} m/s, yours at {found:.2f} m/s", slips, rtol=1e-2)
    half = answer(SHEETS[kind], int(sheets), drag, area=0.1)
    expect(half, wanted / 2, "half the area weighs half as much: take the area that is given", rtol=1e-2)


@check(number("a place along the way"))
def place(answer: Callable) -> None:
    """A line of length 5 that doesn't pass through the origin, and points on it and off it."""
    start, end, across = np.array([1.0, 1.0]), np.array([4.0, 5.0]), np.array([-4.0, 3.0])
    for wanted in (0.0, 1.0, 0.25, 1.5, -0.5):
        p = start + wanted * (end - start)
        found = answer(p, start.copy(), end.copy())
        slips = {
            "that is a distance; divide by the length of the way": 5 * wanted,
            "points before the start and beyond the end have places, too, below 0 and above 1": np.clip(wanted, 0, 1),
            "0 is at the start, 1 at the end": 1 - wanted,
        }
        expect(found, wanted, f"a point at {wanted} of the way got {found:.3f}", slips)
        for side in (across, -across, 0.1 * across):
            message = "what is off the line must not count: project first"
            expect(answer(p + side, start.copy(), end.copy()), wanted, message)


@check(number("a share between 0 and 1"))
def sign_flip_share(answer: Callable) -> None:
    """Cases that can be counted by hand."""
    found = answer([1.0, 2.0, 3.0])
    slips = {
        "the measured signs are one of the choices: count them too, at least as large is not larger": 0,
        "count means that are at least as large, not those that are as far from 0": 2 / 8,
        "1 is the number of choices: divide by how many there are": 1,
    }
    expect(found, 1 / 8, f"three positive differences: 1 choice of 8 is as large, 0.125, not {found:.4g}", slips)
    for case, share in {(1.0, -1.0): 3 / 4, (-1.0, -2.0): 1, (0.0, 0.0, 2.0): 1 / 2, (0.1,) * 5: 1 / 32}.items():
        found, mean = answer(list(case)), np.mean(case)
        message = (
            f"{share:g} of all choices of signs for {list(case)} have a mean of at least {mean:.2g}, not {found:.4g}"
        )
        expect(found, share, message)
    message = "the mean of 0.1, 0.2, -0.3 is 0 but for rounding, as with other signs: compare within 1e-12"
    found = answer([0.1, 0.2, -0.3])
    expect(found, 5 / 8, f"5 of 8 choices, not {8 * found:g}; {message}")
