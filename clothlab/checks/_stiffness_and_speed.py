"""Checks of notebook 11."""

from collections.abc import Callable
from itertools import product

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("a share between 0 and 1"))
def sign_flip_share(answer: Callable, rng: np.random.Generator) -> None:
    """Cases that can be counted by hand."""
    found = answer(rng.uniform(1.0, 3.0, 3).tolist())
    slips = {
        "the measured signs are one of the choices: count them too, at least as large is not larger": 0,
        "count means that are at least as large, not those that are as far from 0": 2
        / 8,
        "1 is the number of choices: divide by how many there are": 1,
    }
    expect(
        found,
        1 / 8,
        f"three positive differences: 1 choice of 8 is as large, 0.125, not {found:.4g}",
        slips,
    )
    for case, share in {
        (1.0, -1.0): 3 / 4,
        (-1.0, -2.0): 1,
        (0.0, 0.0, 2.0): 1 / 2,
        (0.1,) * 5: 1 / 32,
    }.items():
        found, mean = answer(list(case)), np.mean(case)
        message = f"{share:g} of all choices of signs for {list(case)} have a mean of at least {mean:.2g}, not {found:.4g}"
        expect(found, share, message)
    message = "the mean of 0.1, 0.2, -0.3 is 0 but for rounding, as with other signs: compare within 1e-12"
    found = answer([0.1, 0.2, -0.3])
    expect(found, 5 / 8, f"5 of 8 choices, not {8 * found:g}; {message}")
    for _ in range(5):
        any_case = rng.normal(0.3, 1.0, int(rng.integers(4, 7)))
        means = [
            np.mean(np.array(signs) * any_case)
            for signs in product((1, -1), repeat=len(any_case))
        ]
        share = float(np.mean(np.array(means) >= np.mean(any_case) - 1e-12))
        found = answer(any_case.tolist())
        shown = any_case.round(2).tolist()
        message = f"{share:.4g} of all choices of signs for {shown} have a mean as large, not {found:.4g}"
        expect(found, share, message)
