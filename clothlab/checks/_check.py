"""How an exercise is asked that compares more than numbers with numbers.

`check` turns a function that asserts what is true of an answer into a check, where
`ask.exercise` needs only a question with its truth.
"""

import copy
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from clothlab.checks.ask import (
    DRAWS,
    CheckFailed,
    Question,
    _described,
    _same,
    _shown,
    as_check,
    as_numbers,
    compare,
)

# (who returned it, what was returned) -> the same as a check wants it
Read = Callable[[str, object], object]
# Asserts what is true of the reader's function, with inputs from the generator
Compare = Callable[[Callable, np.random.Generator], None]


def check(
    read: Read, moves: tuple[str, ...] = ()
) -> Callable[[Compare], Callable[..., None]]:
    """Turn a function that asserts what is true of an answer into a check.

    The function takes the reader's function, whose results `read` has made sure of, and
    a generator for the inputs; it asserts, each time with a sentence that says what is
    wrong. The check takes the reader's function, and a seed; it prints "correct" or
    raises CheckFailed. An answer may change the arguments that `moves` names, and no
    others.
    """

    def decorate(judged: Compare) -> Callable[..., None]:
        name = judged.__name__

        @functools.wraps(judged)
        def judge(answer: Callable, rng: np.random.Generator) -> None:
            try:
                judged(_careful(answer, name, read, moves), rng)
            except AssertionError as failure:
                if isinstance(failure, CheckFailed):
                    raise
                raise CheckFailed(str(failure)) from failure.__cause__

        return as_check(judge)

    return decorate


def drawn(draw: Callable[[], Any], holds: Callable[[Any], bool]) -> Any:
    """The first of many draws of which something holds.

    A check asks so for inputs with which slips have other results than the truth.
    """
    for _ in range(DRAWS):
        found = draw()
        if holds(found):
            return found
    raise RuntimeError(f"none of {DRAWS} draws of inputs will do")


def apart(
    truth: ArrayLike,
    slips: Mapping[str, ArrayLike],
    rtol: float = 1e-3,
    atol: float = 1e-4,
) -> bool:
    """Whether the truth and what slips give differ from each other.

    They differ by much more than `expect` lets through: a slip is then neither taken
    for the truth nor for another slip.
    """
    return Question((), truth, slips).clear(rtol, atol)


def expect(
    found: ArrayLike,
    truth: ArrayLike,
    otherwise: str,
    slips: Mapping[str, ArrayLike] | None = None,
    rtol: float = 1e-5,
    atol: float = 1e-6,
) -> None:
    """Raise CheckFailed unless an answer is the truth.

    Args:
        found: what the answer returned.
        truth: what is right, of the same shape.
        otherwise: said of a value that is neither the truth nor a known slip.
        slips: what usual slips give, by what is said of each.
        rtol: share of the truth by which an answer may differ; by default what single
            precision loses.
        atol: amount by which it may differ, in the unit of the truth.
    """
    question = Question((), truth, slips or {}, otherwise)
    compare(np.asarray(found), question, rtol, atol)


def number(what: str) -> Read:
    """Read one real number."""
    return lambda name, found: float(as_numbers(name, found, what, ()))


def array(what: str, *shape: int | None) -> Read:
    """Read an array, or lists that make one, of real numbers and of this shape.

    None in the shape stands for any size.
    """
    return lambda name, found: as_numbers(name, found, what, shape)


def arrays(what: str, *reads: Read) -> Read:
    """Read a tuple or a list, each part in its own way."""

    def read(name: str, found: object) -> tuple:
        if not isinstance(found, tuple | list) or len(found) != len(reads):
            raise CheckFailed(f"{name} returned {_shown(found)}: return {what}")
        parts = zip(reads, found, strict=True)
        return tuple(read_part(name, value) for read_part, value in parts)

    return read


def _careful(
    answer: Callable, name: str, read: Read, moves: tuple[str, ...]
) -> Callable:
    """The answer, so called that whatever goes wrong in it is a CheckFailed.

    So is what is wrong with its result, and a change of what it may not move.
    """

    def call(*args: object, **kwargs: object) -> object:
        given = _data(answer, args, kwargs)
        before = copy.deepcopy(given)

        # Let it answer
        try:
            found = answer(*args, **kwargs)
        except CheckFailed:  # said by a function that the check lent to the answer
            raise
        except Exception as error:
            raise CheckFailed(f"{name} raised {_described(error)}") from error

        # What it was given must be as it was
        for argument, value in given.items():
            if argument not in moves and not _same(value, before[argument]):
                raise CheckFailed(
                    f"{name} changes its argument `{argument}` in place: work on a copy"
                )
        return read(name, found)

    return call


def _data(answer: Callable, args: tuple, kwargs: dict) -> dict[str, object]:
    """What a call hands over that could be changed in place, by arguments."""
    try:
        arguments = inspect.signature(answer).bind(*args, **kwargs).arguments
    except (TypeError, ValueError):
        # Another number of arguments, of which the call itself will tell; a built-in
        return {}
    kinds = np.ndarray | torch.Tensor | list | tuple | dict  # a tuple is `*args`
    return {
        name: value for name, value in arguments.items() if isinstance(value, kinds)
    }
