"""Checks of notebook 07b."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clothlab.checks._check import array, check, drawn, expect, number


class _Table(NamedTuple):
    """What explanations foresee of experiments, and what is said of a slip."""

    chosen: list[list[int]]  # of the chosen experiments [explanations, some]
    others: list[list[int]]  # of the rest [explanations, others]
    truth: bool  # whether the chosen ones separate all
    otherwise: str


_TABLES = (
    _Table(
        chosen=[[0, 0], [0, 1], [1, 0]],
        others=[[1], [1], [1]],
        truth=True,
        otherwise="no experiment has to do it alone: each two explanations need one of "
        "the chosen experiments, and other two may need another one",
    ),
    _Table(
        chosen=[[1], [1], [1]],
        others=[[0, 0], [0, 1], [1, 0]],
        truth=False,
        otherwise="only the chosen experiments are made: the others separate nothing",
    ),
    _Table(
        chosen=[[0, 1], [0, 1], [1, 0]],
        others=[[0], [1], [0]],
        truth=False,
        otherwise="that some two are separated is not enough: every two have to be",
    ),
    _Table(
        chosen=[[0, 1], [1, 1], [0, 1]],
        others=[[0], [0], [1]],
        truth=False,
        otherwise="compare every two explanations, not only neighbours in the table",
    ),
    _Table(
        chosen=[[0, 1], [1, 1], [1, 1]],
        others=[[0], [0], [1]],
        truth=False,
        otherwise="compare every two explanations, not only the first with the others",
    ),
)


@check(number("True or False"))
def separates_all(answer: Callable, rng: np.random.Generator) -> None:
    """Whether some chosen experiments separate every two explanations.

    Given are what each explanation foresees of each experiment, 0 or 1, and which
    experiments are chosen: first tables in which a usual slip has another result, then
    any.
    """
    for table in _TABLES:
        columns = np.hstack([table.chosen, table.others])
        order = rng.permutation(columns.shape[1])
        foreseen = (columns ^ rng.integers(2, size=len(order)))[:, order]
        chosen = np.flatnonzero(order < len(table.chosen[0])).tolist()
        assert answer(foreseen, chosen) == table.truth, table.otherwise

    for _ in range(20):
        foreseen = rng.integers(2, size=(4, 5))
        chosen = rng.choice(5, 3, replace=False).tolist()
        outcomes = {tuple(row) for row in foreseen[:, chosen].tolist()}
        assert answer(foreseen, chosen) == (len(outcomes) == len(foreseen)), (
            "for every two explanations, at least one of the chosen experiments has to "
            "come out differently"
        )


@check(number("the mean part of the errors away from the target"))
def optimism(answer: Callable, rng: np.random.Generator) -> None:
    """How much farther from the target than predicted, along the line to it.

    Given are predicted and seen z `[N, 3]`, and that of the target `[3]`. The error of
    each prediction has a part that points away from the target; expected is its mean.
    """

    # Random predictions, what was seen, and the target
    def draw() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z_ref = rng.normal(size=3)
        predicted = z_ref + rng.normal(size=(6, 3))
        return predicted, predicted + rng.normal(size=(6, 3)), z_ref

    def parts(predicted: np.ndarray, seen: np.ndarray, z_ref: np.ndarray) -> tuple:
        error = seen - predicted
        away = predicted - z_ref
        length = np.linalg.norm(away, axis=1)
        farther = np.linalg.norm(seen - z_ref, axis=1) - length
        products = (error * away).sum(axis=1)
        return (products / length).mean(), error, products, farther

    # Such as have a part away, and what goes wrong easily
    given = drawn(draw, lambda each: abs(parts(*each)[0]) > 0.2)
    truth, error, products, farther = parts(*given)
    slips = {
        "the difference of both distances is above 0 for a prediction at the target, "
        "whatever the error; take the error's part along the line from the target": (
            farther.mean()
        ),
        "the size of the error is not its part away from the target": (
            np.linalg.norm(error, axis=1).mean()
        ),
        "divide by the length of the way from the target: only its direction "
        "counts": products.mean(),
        "the error is what was seen minus what was predicted": -truth,
    }
    otherwise = (
        "project each error on the unit vector from the target to the prediction"
    )
    expect(answer(*given), truth, otherwise, slips)


@check(array("one number for each training", None))
def beyond_time(answer: Callable, rng: np.random.Generator) -> None:
    """What estimation gains beyond what time gains, for each training `[K]`.

    Given are distances in the first and the last third of runs `[K, 2]`: with p
    estimated, and with a wrong p that stays.
    """
    count = int(rng.integers(4, 7))
    estimated = rng.uniform(0.3, 1.0, (count, 2))
    wrong = rng.uniform(0.3, 1.0, (count, 2))
    gained = estimated[:, 0] - estimated[:, 1]
    by_time = wrong[:, 0] - wrong[:, 1]
    truth = gained - by_time
    slips = {
        "this is the gain with time and with p: take away the gain of the runs whose "
        "p stays wrong": gained,
        "a gain is a distance that falls: first third minus last": -truth,
        "the last thirds differ by where both began, too: compare the gains": (
            wrong[:, 1] - estimated[:, 1]
        ),
    }
    found = answer(estimated, wrong)
    assert len(found) == count, f"one number for each of the {count} trainings"
    otherwise = "from each gain, first third minus last, take that of the wrong p"
    expect(found, truth, otherwise, slips)
