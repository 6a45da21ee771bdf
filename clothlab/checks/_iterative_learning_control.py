"""Checks of notebook 10."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, arrays, check, expect

_MEAN_AND_SHARE = arrays(
    "the mean and the share of the variance",
    array("the mean", None),
    array("the share", None),
)


@check(_MEAN_AND_SHARE)
def one_outcome(answer: Callable, rng: np.random.Generator) -> None:
    """What one outcome teaches a Gaussian process of all other plans.

    Given are places `[N]` (the plan that was tried, a length to both sides of it, and
    far away), the plan, by how much it missed, and the noise, as a share of the
    variance. Expected are the mean `[N]` and the share of the variance that is left
    `[N]`, without noise and with it.
    """
    tried = rng.uniform(1.0, 3.0)
    missed = rng.uniform(0.5, 0.8)
    beside = [0.0, rng.uniform(0.8, 1.2), -rng.uniform(0.8, 1.2), 20.0]
    x = tried + np.array(beside)
    k = np.exp(-0.5 * (x - tried) ** 2)
    for noise in (0.0, rng.uniform(0.2, 0.3)):
        mean, left = answer(x, tried, missed, noise)

        # The mean
        truth = k * missed / (1 + noise)
        slips = {
            "the mean is what was missed, weighted by k: where is what was missed?": k
            / (1 + noise),
            "an outcome with noise teaches less: the noise is added to k of the "
            "tried plan with itself": k * missed,
            "the kernel has a half in its exponent": k**2 * missed / (1 + noise),
        }
        otherwise = f"the mean is {truth.round(3)} here, got {mean.round(3)}"
        expect(mean, truth, otherwise, slips)

        # The variance
        truth = 1 - k**2 / (1 + noise)
        slips = {
            "that is the share that is known: asked is what is left": 1 - truth,
            "k enters twice": 1 - k / (1 + noise),
            "that is a standard deviation; asked is the variance": truth**0.5,
        }
        otherwise = (
            f"of the variance, {truth.round(3)} are left here, got {left.round(3)}"
        )
        expect(left, truth, otherwise, slips)

    # Elsewhere, at the tried plan itself
    mean, left = answer(np.array([-tried]), -tried, -3 * missed, 0.0)
    otherwise = "where a plan was tried without noise, its outcome is known"
    expect([*mean, *left], [-3 * missed, 0], otherwise)
