"""The conditions of a notebook's findings, in its last cell.

A finding is a sentence of the text. Its condition is a number with its bounds, so that
a run in which the sentence is no longer true stops with an error.
"""

import os
from operator import ge, gt, le, lt

import numpy as np
from numpy.typing import ArrayLike

# In the environment: notebooks run with CI's small sizes, at which nothing can be found
SMALL = "CLOTHLAB_SMALL"
_BOUNDS = {
    "at_least": ("≥", ge),
    "above": (">", gt),
    "at_most": ("≤", le),
    "below": ("<", lt),
}


class FindingError(AssertionError):
    """A finding that does not hold; the text says which, with its numbers."""


def finding(
    claim: str, value: ArrayLike, *, live: bool = False, **bounds: float
) -> None:
    """Print a condition that holds.

    Args:
        claim: what is found, in a few words.
        value: a number, or several of which each must lie within the bounds.
        live: whether it was measured by this notebook, rather than read from a stored
            table: such a condition is not judged at CI's small sizes.
        bounds: one or two of `at_least`, `above`, `at_most` and `below`.

    Raises:
        FindingError: it does not hold.
    """
    unknown = [name for name in bounds if name not in _BOUNDS]
    if unknown or not bounds:
        raise TypeError(f"a finding is bounded by {', '.join(_BOUNDS)}, got {unknown}")
    if live and os.environ.get(SMALL):
        print(f"- {claim}: not judged at a small size")
        return

    # All numbers within all bounds; what is no number lies within none
    values = np.asarray(value, float)
    holds = values.size > 0
    wanted = []
    for name, bound in bounds.items():
        symbol, compare = _BOUNDS[name]
        holds = holds and bool(compare(values, bound).all())
        wanted.append(f"{symbol} {bound:.4g}")
    found = f"{values:.3g}" if values.ndim == 0 else _range(values)
    text = f"{claim}: {found} ({' and '.join(wanted)})"
    if not holds:
        raise FindingError(f"this does not hold: {text}")
    print(f"✓ {text}")


def _range(values: np.ndarray) -> str:
    if not values.size:
        return "nothing"
    return f"{values.min():.3g} to {values.max():.3g}"
