"""Checks of notebook 09: what is drawn, what is right, and what usual slips give."""

import numpy as np
from scipy.special import ndtr  # share of normal numbers below one

from clothlab.checks.ask import Question, exercise


@exercise("by how much the winner's score exceeds its own worth", rtol=0.05, far=3)
def luck_of_best(rng: np.random.Generator) -> Question:
    """By how much the best score of several tries exceeds its own worth, on average.

    Given are how many tries there were, and the standard deviations of a score's miss
    and of what tries are worth. It may be simulated.
    """
    count = int(rng.integers(4, 40))
    spread = rng.uniform(2.0, 9.0)
    worth = spread * rng.uniform(0.7, 1.5)
    both = np.hypot(spread, worth)  # how far scores scatter
    largest = _mean_of_largest(count)
    truth = spread**2 / both * largest
    slips = {
        "a score misses by `spread`: where does it enter?": (
            largest / np.hypot(1, worth)
        ),
        "choose by the *score*: you don't know what tries are worth": 0.0,
        "the winner may be worth something: subtract its *own* worth": both * largest,
        "tries truly differ by `worth`: where does it enter?": spread * largest,
        "that is what the winner is worth: how much did its score exceed that?": (
            worth**2 / both * largest
        ),
    }
    return Question(
        (count, spread, worth),
        truth,
        slips,
        lambda found: (
            f"of {count} tries that miss by {spread:.2f} and differ by {worth:.2f}, "
            f"the best shows {truth:.2f} too much, not {found:.2f}"
        ),
    )


def _mean_of_largest(count: int) -> float:
    """Mean of the largest of some standard normal numbers."""
    x = np.linspace(-9, 9, 20_001)
    normal = np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)
    density = count * normal * ndtr(x) ** (count - 1)
    return float(np.trapezoid(x * density, x))
