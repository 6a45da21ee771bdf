"""Checks of notebook 11."""

from collections.abc import Callable
from itertools import product

import numpy as np

from clothlab.checks._check import check, expect, number

# Differences, and the share of the choices of signs that can be counted by hand
_COUNTED: dict[tuple[float, ...], float] = {
    (1.0, -1.0): 3 / 4,
    (-1.0, -2.0): 1,
    (0.0, 0.0, 2.0): 1 / 2,
    (0.1, 0.1, 0.1, 0.1, 0.1): 1 / 32,
}


@check(number("a share between 0 and 1"))
def sign_flip_share(answer: Callable, rng: np.random.Generator) -> None:
    """The share of all choices of signs whose mean is as large as the measured one.

    Given is a list of paired differences: three positive ones, others that can be
    counted by hand, one in which rounding decides, then random ones.
    """
    _three_positive_ones(answer, rng)

    # Others that are counted by hand
    for case, share in _COUNTED.items():
        found = answer(list(case))
        otherwise = (
            f"{share:g} of all choices of signs for {list(case)} have a mean of at "
            f"least {np.mean(case):.2g}, not {found:.4g}"
        )
        expect(found, share, otherwise)

    # Means that are equal but for rounding
    found = answer([0.1, 0.2, -0.3])
    otherwise = (
        f"5 of 8 choices, not {8 * found:g}; the mean of 0.1, 0.2, -0.3 is 0 but for "
        "rounding, as with other signs: compare within 1e-12"
    )
    expect(found, 5 / 8, otherwise)

    # Any
    for _ in range(5):
        differences = rng.normal(0.3, 1.0, int(rng.integers(4, 7)))
        share = _share(differences)
        found = answer(differences.tolist())
        otherwise = (
            f"{share:.4g} of all choices of signs for {differences.round(2).tolist()} "
            f"have a mean as large, not {found:.4g}"
        )
        expect(found, share, otherwise)


def _three_positive_ones(answer: Callable, rng: np.random.Generator) -> None:
    """Raise CheckFailed for a usual slip, which three positive differences show."""
    found = answer(rng.uniform(1.0, 3.0, 3).tolist())
    slips = {
        "the measured signs are one of the choices: count them too, at least as large "
        "is not larger": 0,
        "count means that are at least as large, not those that are as far from 0": 2
        / 8,
        "1 is the number of choices: divide by how many there are": 1,
    }
    otherwise = (
        f"three positive differences: 1 choice of 8 is as large, 0.125, not {found:.4g}"
    )
    expect(found, 1 / 8, otherwise, slips)


def _share(differences: np.ndarray) -> float:
    """The share that is asked for, over all choices."""
    choices = product((1, -1), repeat=len(differences))
    means = np.array([np.mean(np.array(signs) * differences) for signs in choices])
    return float(np.mean(means >= np.mean(differences) - 1e-12))
