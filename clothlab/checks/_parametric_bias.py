"""Checks of notebook 05."""

from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from clothlab.checks.ask import (
    ROUNDS,
    CheckFailed,
    Question,
    as_check,
    as_numbers,
    ask,
    compare,
    exercise,
)
from clothlab.simulation.cloth import Cloth

# What makes a force, or needs one, and what is said where it has not grown
_GROWS = {
    "mass": "the twin is heavier: its mass is factor times that of the cloth",
    "damping": "the drag must keep its share of the weight: c/m stays as it was",
    "stiffness": "the heavier cloth stretches its springs more, or less: they don't "
    "pull factor times as hard",
    "bending": "it doesn't resist bending factor times as hard",
    "spring_damping": "the dampers of its springs don't brake factor times as hard",
}


@as_check
def heavier_twin(answer: Callable, rng: np.random.Generator) -> None:
    """The cloth of `factor` times the mass that moves as another one does.

    Given are a random cloth and a factor. Expected is that all forces grow with the
    mass, and that the grid of points stays.
    """
    for _ in range(ROUNDS):
        drawn = rng.uniform(0.5, 1.5, len(_GROWS)) * [0.1, 0.05, 100.0, 0.5, 0.2]
        cloth = Cloth("any", **dict(zip(_GROWS, drawn.tolist(), strict=True)))
        factor = float(rng.uniform(1.5, 3.0))
        (found,) = ask("heavier_twin", answer, (cloth, factor))
        if not isinstance(found, Cloth):
            raise CheckFailed(
                f"heavier_twin returned a {type(found).__name__}: "
                "return a Cloth, made by replace"
            )
        _compare(_measures(found), _measures(cloth), factor)


def _measures(cloth: Cloth) -> dict[str, float]:
    """All fields of a cloth that are numbers."""
    fields = asdict(cloth)
    del fields["name"], fields["foam"]
    return fields


def _compare(found: dict, before: dict, factor: float) -> None:
    """Raise CheckFailed for the first field that is not as it has to be."""
    truth = before | {name: factor * before[name] for name in _GROWS}
    cut = "the twin is cut alike: its size and its grid of points stay as they were"
    for name in (*_GROWS, *truth):
        value = as_numbers("heavier_twin", found[name], f"a Cloth with a {name}", ())
        question = Question((), truth[name], otherwise=_GROWS.get(name, cut))
        compare(value, question, rtol=1e-5, atol=1e-6)


@exercise("a distance for each of the five p", 5)
def try_each(rng: np.random.Generator) -> Question:
    """The mean distance `[5]` of predictions from a recording `[T, D_z]`, for each p.

    Given are a prediction of z by p, a random recording and five p `[5, 2]`. Expected
    is the mean over the steps of the length of the gap in z.
    """
    # A recording, and predictions of which each p makes another
    z = rng.normal(size=(12, 3))
    points = rng.normal(size=(5, 2))
    swing = rng.normal(size=(2, 12, 3))

    def predict_z(p: np.ndarray) -> np.ndarray:
        return np.tensordot(p, swing, axes=1)

    # The mean length, and what usual slips give
    gaps = np.array([predict_z(p) - z for p in points])
    lengths = np.linalg.norm(gaps, axis=2)
    squares = (lengths**2).mean(axis=1)
    slips = {
        "the sum over the steps: take the mean": lengths.sum(axis=1),
        "a mean of squares: take the root at each step": squares,
        "the root of a mean of squares: take the mean of the lengths": np.sqrt(squares),
        "this is one norm of the whole gap: take the length at each step, then the "
        "mean": np.linalg.norm(gaps.reshape(5, -1), axis=1),
        "this is the mean of each number's gap: a distance is a length in z": np.abs(
            gaps
        ).mean(axis=(1, 2)),
    }
    otherwise = "the distance at a step is the length of predict_z(p) - z there"
    return Question((predict_z, z, points), lengths.mean(axis=1), slips, otherwise)
