"""Checks of notebook 09: what is drawn, what is right, and what usual slips give."""

import numpy as np
import torch
from scipy.special import ndtr  # share of normal numbers below one

from clothlab.checks.ask import Question, exercise


@exercise("one price for each plan", 5, rtol=1e-4)
def jerk_price(rng: np.random.Generator) -> Question:
    """How much each of five plans jerks `[5]`.

    Given are plans, a tensor `[5, 8, 2]`. The price is the sum of the squares of all
    changes from one command to the next.
    """
    plans = rng.uniform(-1, 1, (5, 8, 2))
    changes = np.diff(plans, axis=1)
    truth = (changes**2).sum(axis=(1, 2))
    slips = {
        "a command that is far from 0 is no jerk: price the *changes*": (
            (plans**2).sum(axis=(1, 2))
        ),
        "changes up and down cancel: square them before you add them": changes.sum(
            axis=(1, 2)
        ),
        "not their sizes: the squares": np.abs(changes).sum(axis=(1, 2)),
        "their sum, not their mean": (changes**2).mean(axis=(1, 2)),
        "a change goes from one step to the next one: along the axis 1": (
            (np.diff(plans, axis=2) ** 2).sum(axis=(1, 2))
        ),
    }
    return Question(
        (torch.tensor(plans, dtype=torch.float32),),
        truth,
        slips,
        lambda found: (
            f"the prices of these plans are {truth.round(3)}, not {found.round(3)}"
        ),
    )


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
