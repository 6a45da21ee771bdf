"""Checks of notebook 11: what is drawn, what is right, and what usual slips give."""

from itertools import product

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("a share between 0 and 1")
def sign_flip_share(rng: np.random.Generator) -> Question:
    """The share of all choices of signs whose mean is as large as the measured one.

    Given is a list of four to six paired differences, in tenths, so that means are
    equal that differ by rounding alone.
    """
    differences = rng.integers(-4, 10, int(rng.integers(4, 7))) / 10
    choices = np.array([*product((1, -1), repeat=len(differences))])
    means = np.array([np.mean(signs * differences) for signs in choices])
    measured = means[0]  # all signs as they are
    at_least = means >= measured - 1e-12
    truth = np.mean(at_least)
    slips = {
        "the measured signs are one of the choices: count them too, at least as large "
        "is not larger": np.mean(means > measured + 1e-12),
        "count means that are at least as large, not those that are as far from 0": (
            np.mean(np.abs(means) >= abs(measured) - 1e-12)
        ),
        "that is the number of choices: divide by how many there are": at_least.sum(),
        "means that are equal but for rounding are as large, too: compare within "
        "1e-12": np.mean(means >= measured),
    }
    given = differences.tolist()
    otherwise = f"{truth:.4g} of all choices of signs for {given} have such a mean"
    return Question((given,), truth, slips, otherwise)
