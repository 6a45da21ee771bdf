"""Checks of notebook 13: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("a share")
def share_held(rng: np.random.Generator) -> Question:
    """The share of runs whose 90 % region holds the right p.

    Given are the right p `[N, 2]`, estimates `[N, 2]` and their covariances
    `[N, 2, 2]`: long and slanted, and of another size in each run.
    """
    # One covariance, which grows from run to run
    count = int(rng.integers(300, 500))
    wide = rng.uniform(1.8, 2.2)
    narrow = rng.uniform(0.9, 1.1)
    across = 0.95 * wide * narrow
    covariance = np.array([[wide**2, across], [across, narrow**2]])
    sizes = np.linspace(0.3, 3.0, count)

    # Estimates that scatter as their covariances say
    truths = rng.normal(size=(count, 2))
    errors = rng.multivariate_normal(np.zeros(2), covariance, size=count)
    estimates = truths + np.sqrt(sizes)[:, None] * errors
    covariances = sizes[:, None, None] * covariance

    def squared(matrices: np.ndarray) -> np.ndarray:
        """Squared distances `[N]` of the estimates by some matrices `[N, 2, 2]`."""
        gaps = estimates - truths
        return np.einsum("ni,nij,nj->n", gaps, matrices, gaps)

    inverses = np.linalg.inv(covariances)
    limit = -2 * np.log(0.1)  # 90 % of a normal distribution in a plane
    truth = np.mean(squared(inverses) <= limit)
    first = np.broadcast_to(inverses[0], inverses.shape)
    slips = {
        "1.645 deviations hold 90 % of one number; of two in a plane, the radius is "
        "larger": np.mean(squared(inverses) <= 1.645**2),
        "compare the squared distance with -2 log 0.1: the one has no root, the "
        "other is not squared again": np.mean(squared(inverses) <= limit**2),
        "the inverse of the covariance stands between the gaps": np.mean(
            squared(covariances) <= limit
        ),
        "each run has its own covariance": np.mean(squared(first) <= limit),
        "that is the share of those outside": 1 - truth,
    }
    otherwise = f"the regions hold {truth:.4f} of the right ones"
    return Question((truths, estimates, covariances), truth, slips, otherwise)
