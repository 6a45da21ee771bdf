"""Checks of notebook 10."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, arrays, check, expect


@check(
    arrays(
        "the mean and the share of the variance",
        array("the mean", None),
        array("the share", None),
    )
)
def one_outcome(answer: Callable, rng: np.random.Generator) -> None:
    """At the plan that was tried, at a length from it, and far away; with noise and
    without.
    """
    tried, missed = rng.uniform(1.0, 3.0), rng.uniform(0.5, 0.8)
    x = tried + np.array([0.0, rng.uniform(0.8, 1.2), -rng.uniform(0.8, 1.2), 20.0])
    k = np.exp(-0.5 * (x - tried) ** 2)
    for noise in (0.0, rng.uniform(0.2, 0.3)):
        mean, left = answer(x, tried, missed, noise)
        wanted = k * missed / (1 + noise)
        slips = {
            "the mean is what was missed, weighted by k: where is what was missed?": k
            / (1 + noise),
            "an outcome with noise teaches less: the noise is added to k of the tried plan with itself": k
            * missed,
            "the kernel has a half in its exponent": k**2 * missed / (1 + noise),
        }
        expect(
            mean,
            wanted,
            f"the mean is {wanted.round(3)} here, got {mean.round(3)}",
            slips,
        )
        share = 1 - k**2 / (1 + noise)
        slips = {
            "that is the share that is known: asked is what is left": 1 - share,
            "k enters twice": 1 - k / (1 + noise),
            "that is a standard deviation; asked is the variance": share**0.5,
        }
        expect(
            left,
            share,
            f"of the variance, {share.round(3)} are left here, got {left.round(3)}",
            slips,
        )
    mean, left = answer(np.array([-tried]), -tried, -3 * missed, 0.0)
    expect(
        [*mean, *left],
        [-3 * missed, 0],
        "where a plan was tried without noise, its outcome is known",
    )
