"""Checks of notebook 12."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import apart, check, drawn, expect, number


@check(number("a share"))
def share_held(answer: Callable, rng: np.random.Generator) -> None:
    """Estimates that scatter as they say, in a long and slanted region."""

    def draw() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count, wide, narrow = (
            int(rng.integers(300, 500)),
            rng.uniform(1.8, 2.2),
            rng.uniform(0.9, 1.1),
        )
        covariance = np.array(
            [[wide**2, 0.95 * wide * narrow], [0.95 * wide * narrow, narrow**2]]
        )
        truths = rng.normal(size=(count, 2))
        estimates = truths + rng.multivariate_normal(
            np.zeros(2), covariance, size=count
        )
        return truths, estimates, np.tile(covariance, (count, 1, 1))

    for _ in range(3):
        truths, estimates, covariances = drawn(
            draw, lambda runs: apart(*_share_and_slips(*runs))
        )
        truth, slips = _share_and_slips(truths, estimates, covariances)
        found = answer(truths.copy(), estimates.copy(), covariances.copy())
        expect(
            found,
            truth,
            f"the regions hold {truth:.4f} of the right ones, not {found:.4f}",
            slips,
        )
    narrow = answer(truths, estimates, covariances * 1e-8)
    expect(
        narrow,
        0,
        "regions that are next to points hold nothing: does each run have its own covariance?",
    )


def _share_and_slips(
    truths: np.ndarray, estimates: np.ndarray, covariances: np.ndarray
) -> tuple[float, dict[str, float]]:
    """The share that is asked for, and what usual slips give: what the reader is told,
    and the value.
    """
    gaps = estimates - truths
    far = np.einsum("ni,nij,nj->n", gaps, np.linalg.inv(covariances), gaps)
    limit = -2 * np.log(0.1)
    truth = float(np.mean(far <= limit))
    squared = np.mean(far <= limit**2)
    straight = np.mean(np.einsum("ni,nij,nj->n", gaps, covariances, gaps) <= limit)
    return truth, {
        "1.645 deviations hold 90 % of one number; of two in a plane, the radius is larger": np.mean(
            far <= 1.645**2
        ),
        "compare the squared distance with -2 log 0.1: the one has no root, the other is not squared again": squared,
        "the inverse of the covariance stands between the gaps": straight,
        "that is the share of those outside": 1 - truth,
    }
