"""Checks of notebook 12."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, expect, number


@check(number("a share"))
def share_held(answer: Callable) -> None:
    """Estimates that scatter as they say, in a long and slanted region."""
    rng = np.random.default_rng(1)
    covariance = np.array([[4.0, 1.9], [1.9, 1.0]])
    truths = rng.normal(size=(400, 2))
    estimates = truths + rng.multivariate_normal(np.zeros(2), covariance, size=400)
    covariances = np.tile(covariance, (400, 1, 1))
    gaps = estimates - truths
    far = np.einsum("ni,nij,nj->n", gaps, np.linalg.inv(covariances), gaps)
    limit = -2 * np.log(0.1)
    truth = float(np.mean(far <= limit))
    squared = np.mean(far <= limit**2)
    straight = np.mean(np.einsum("ni,nij,nj->n", gaps, covariances, gaps) <= limit)
    slips = {
        "1.645 deviations hold 90 % of one number; of two in a plane, the radius is larger": np.mean(far <= 1.645**2),
        "compare the squared distance with -2 log 0.1: the one has no root, the other is not squared again": squared,
        "the inverse of the covariance stands between the gaps": straight,
        "that is the share of those outside": 1 - truth,
    }
    found = answer(truths.copy(), estimates.copy(), covariances.copy())
    expect(found, truth, f"the regions hold {truth:.4f} of the right ones, not {found:.4f}", slips)
    narrow = answer(truths, estimates, covariances * 1e-8)
    expect(narrow, 0, "regions that are next to points hold nothing: does each run have its own covariance?")
