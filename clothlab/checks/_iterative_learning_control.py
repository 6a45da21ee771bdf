"""Checks of notebook 10: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("the mean and the share of the variance", 2, None)
def one_outcome(rng: np.random.Generator) -> Question:
    """What one outcome teaches a Gaussian process of all other plans.

    Given are places `[N]` (the plan that was tried, a length to both sides of it, and
    far away), the plan, by how much it missed, and the noise, as a share of the
    variance. Expected are the mean `[N]` and the share of the variance that is left
    `[N]`.
    """
    tried = rng.uniform(1.0, 3.0)
    missed = rng.uniform(0.5, 0.8)
    noise = rng.uniform(0.2, 0.3)
    beside = [0.0, rng.uniform(0.8, 1.2), -rng.uniform(0.8, 1.2), 20.0]
    x = tried + np.array(beside)
    k = np.exp(-0.5 * (x - tried) ** 2)

    mean = k * missed / (1 + noise)
    left = 1 - k**2 / (1 + noise)
    slips = {
        "the mean is what was missed, weighted by k: where is what was missed?": (
            k / (1 + noise),
            left,
        ),
        "an outcome with noise teaches less: the noise is added to k of the tried plan "
        "with itself": (k * missed, 1 - k**2),
        "the kernel has a half in its exponent": (
            k**2 * missed / (1 + noise),
            1 - k**4 / (1 + noise),
        ),
        "the second is the share that is known: asked is what is left": (
            mean,
            1 - left,
        ),
        "k enters the variance twice": (mean, 1 - k / (1 + noise)),
        "the second is a standard deviation; asked is the variance": (mean, left**0.5),
    }
    otherwise = f"the mean is {mean.round(3)}, and {left.round(3)} of the variance left"
    return Question((x, tried, missed, noise), (mean, left), slips, otherwise)
