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
