"""Checks of notebook 12."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clothlab.checks._check import apart, check, drawn, expect, number


class _Runs(NamedTuple):
    """Estimates of p that scatter as their covariances say."""

    truths: np.ndarray  # [N, D_p]
    estimates: np.ndarray  # [N, D_p]
    covariances: np.ndarray  # [N, D_p, D_p]


@check(number("a share"))
def share_held(answer: Callable, rng: np.random.Generator) -> None:
    """The share of runs whose 90 % region holds the right p.

    Given are the right p `[N, 2]`, estimates `[N, 2]` and their covariances
    `[N, 2, 2]`, long and slanted; then covariances so small that they hold nothing.
    """
    for _ in range(3):
        runs = drawn(lambda: _runs(rng), lambda runs: apart(*_share_and_slips(runs)))
        truth, slips = _share_and_slips(runs)
        found = answer(*(each.copy() for each in runs))
        otherwise = f"the regions hold {truth:.4f} of the right ones, not {found:.4f}"
        expect(found, truth, otherwise, slips)

    narrow = answer(runs.truths, runs.estimates, runs.covariances * 1e-8)
    otherwise = (
        "regions that are next to points hold nothing: does each run have its own "
        "covariance?"
    )
    expect(narrow, 0, otherwise)


def _runs(rng: np.random.Generator) -> _Runs:
    """Some hundred runs of one covariance."""
    count = int(rng.integers(300, 500))
    wide = rng.uniform(1.8, 2.2)
    narrow = rng.uniform(0.9, 1.1)
    across = 0.95 * wide * narrow
    covariance = np.array([[wide**2, across], [across, narrow**2]])

    truths = rng.normal(size=(count, 2))
    errors = rng.multivariate_normal(np.zeros(2), covariance, size=count)
    covariances = np.tile(covariance, (count, 1, 1))
    return _Runs(truths, truths + errors, covariances)


def _share_and_slips(runs: _Runs) -> tuple[float, dict[str, float]]:
    """The share that is asked for, and what usual slips give, by what is said."""
    gaps = runs.estimates - runs.truths
    inverses = np.linalg.inv(runs.covariances)
    squared = np.einsum("ni,nij,nj->n", gaps, inverses, gaps)
    not_inverted = np.einsum("ni,nij,nj->n", gaps, runs.covariances, gaps)

    limit = -2 * np.log(0.1)  # 90 % of a normal distribution in a plane
    truth = float(np.mean(squared <= limit))
    return truth, {
        "1.645 deviations hold 90 % of one number; of two in a plane, the radius is "
        "larger": np.mean(squared <= 1.645**2),
        "compare the squared distance with -2 log 0.1: the one has no root, the "
        "other is not squared again": np.mean(squared <= limit**2),
        "the inverse of the covariance stands between the gaps": np.mean(
            not_inverted <= limit
        ),
        "that is the share of those outside": 1 - truth,
    }
