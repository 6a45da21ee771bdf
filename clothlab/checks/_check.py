"""What all checks have in common: how an answer is called, what it may return, and how
its reader hears of it.

An answer may do anything: raise an error, return None, a string or an array of any
shape, change what it was given. All that ends here, in one sentence, so that a check
compares numbers only. An error in a check itself stays what it is.

Each run of a check draws its inputs anew, so that outputs written down in one run are
wrong in the next. What fails is repeated by its seed: `checks.NAME(NAME, seed=123)`, or
the environment variable CLOTHLAB_CHECK_SEED for all checks.
"""

import ast
import copy
import functools
import inspect
import os
import reprlib
import secrets
import textwrap
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

# (who returned it, what was returned) -> the same as a check wants it
Read = Callable[[str, object], object]
# In the environment: the seed of every check that is not given one
SEED = "CLOTHLAB_CHECK_SEED"
DRAWS = 1000  # after so many a check that finds no inputs for itself is wrong


class CheckFailed(AssertionError):
    """The answer is wrong; the text says in what."""

    again = ""  # the call that repeats it with the same inputs

    def _render_traceback_(self) -> list[str]:
        """Show a notebook's reader this sentence alone: the lines of the check would
        give the answer away.
        """
        return [
            f"Not yet: {self}",
            *([f"(the same inputs again: {self.again})"] if self.again else []),
        ]


class Unanswered(CheckFailed):
    """The dots of the stub are still there."""

    def _render_traceback_(self) -> list[str]:
        return [str(self)]


def check(
    read: Read,
) -> Callable[[Callable[[Callable, np.random.Generator], None]], Callable[..., None]]:
    """Turn a function that asserts what is true of an answer into a check: it prints
    "correct" or raises CheckFailed.

    The function takes the reader's function, whose results `read` has made sure of, and
    a generator for the inputs; it asserts, each time with a sentence that says what is
    wrong. The check takes the reader's function, and a seed.
    """

    def decorate(
        compare: Callable[[Callable, np.random.Generator], None],
    ) -> Callable[..., None]:
        @functools.wraps(compare)
        def run(answer: Callable, seed: int | None = None) -> None:
            name = compare.__name__
            if not callable(answer):
                words = f"this is no function: run the cell that defines {name}, and hand over the function {name} itself"
                raise CheckFailed(f"{words}, without calling it")
            if blank := _blank(answer):
                raise Unanswered(
                    f"unanswered: the dots of {name} are still there, in `{blank}`"
                )
            if seed is None:
                seed = int(os.environ.get(SEED) or secrets.randbelow(1_000_000))
            try:
                compare(_careful(answer, name, read), np.random.default_rng(seed))
            except AssertionError as failure:
                failed = (
                    failure
                    if isinstance(failure, CheckFailed)
                    else CheckFailed(str(failure))
                )
                failed.again = f"checks.{name}({name}, seed={seed})"
                raise failed from failed.__cause__
            print("correct")

        return run

    return decorate


def _blank(answer: Callable) -> str:
    """The first line of a function in which dots stand for what is asked for; empty if
    there is none.

    Dots in brackets, such as in `x[..., 0]`, are an index.
    """
    try:
        lines = textwrap.dedent(inspect.getsource(answer)).splitlines()
        nodes = list(ast.walk(ast.parse("\n".join(lines))))
    except (
        OSError,
        TypeError,
        SyntaxError,
    ):  # a built-in, or a lambda in the middle of a line
        return ""
    indices = {
        id(part)
        for node in nodes
        if isinstance(node, ast.Subscript)
        for part in ast.walk(node.slice)
    }
    dots = [
        node
        for node in nodes
        if isinstance(node, ast.Constant)
        and node.value is ...
        and id(node) not in indices
    ]
    return (
        lines[min(node.lineno for node in dots) - 1].split("#")[0].strip()
        if dots
        else ""
    )


def drawn(draw: Callable[[], Any], holds: Callable[[Any], bool]) -> Any:
    """The first of many draws of which something holds, such as that slips have other
    results than the truth.
    """
    for _ in range(DRAWS):
        if holds(found := draw()):
            return found
    raise RuntimeError(f"none of {DRAWS} draws of inputs will do")


def apart(
    truth: ArrayLike,
    slips: Mapping[str, ArrayLike],
    rtol: float = 1e-3,
    atol: float = 1e-4,
) -> bool:
    """Whether the truth and what slips give differ from each other by much more than
    `expect` lets through.
    """
    values = [np.asarray(each, dtype=float) for each in (truth, *slips.values())]
    pairs = [(a, b) for k, a in enumerate(values) for b in values[:k]]
    return not any(
        a.shape == b.shape and np.allclose(a, b, rtol, atol) for a, b in pairs
    )


def expect(
    found: ArrayLike,
    truth: ArrayLike,
    otherwise: str,
    slips: Mapping[str, ArrayLike] | None = None,
    rtol: float = 1e-5,
    atol: float = 1e-6,
) -> None:
    """Raise CheckFailed unless `found` is the truth, within what single precision
    loses.

    `slips` are the values that usual slips give, by what is said of them; `otherwise`
    is said of all other values.
    """
    if np.allclose(found, truth, rtol, atol):
        return
    for message, value in (slips or {}).items():
        if np.allclose(found, value, rtol, atol):
            raise CheckFailed(message)
    raise CheckFailed(otherwise)


def number(what: str, *, none: bool = False) -> Read:
    """Read one real number. None is let through where `none` is set."""

    def read(name: str, found: object) -> float | None:
        if found is None and none:
            return None
        value = _real(name, found, what)
        if value.ndim:
            raise CheckFailed(
                f"{name} returned {_shown(found)}: return one number, {what}"
            )
        return float(value)

    return read


def array(what: str, *shape: int | None) -> Read:
    """Read an array, or lists that make one, of real numbers and of this shape; None
    stands for any size.
    """

    def read(name: str, found: object) -> np.ndarray:
        value = _real(name, found, what)
        if len(value.shape) != len(shape) or any(
            n not in (None, m) for n, m in zip(shape, value.shape, strict=True)
        ):
            wanted = str(tuple("…" if n is None else n for n in shape)).replace("'", "")
            raise CheckFailed(
                f"{name} returned {_shown(value)}: return {what}, of the shape {wanted}"
            )
        return value

    return read


def arrays(what: str, *reads: Read) -> Read:
    """Read a tuple or a list, each part in its own way."""

    def read(name: str, found: object) -> tuple:
        if not isinstance(found, tuple | list) or len(found) != len(reads):
            raise CheckFailed(f"{name} returned {_shown(found)}: return {what}")
        return tuple(
            part(name, value) for part, value in zip(reads, found, strict=True)
        )

    return read


def _careful(answer: Callable, name: str, read: Read) -> Callable:
    """Call the answer so that whatever goes wrong within it, or with what it returns,
    is a CheckFailed.
    """

    def call(*args: object, **kwargs: object) -> object:
        given = _data(answer, args, kwargs)
        before = copy.deepcopy(given)
        try:
            found = answer(*args, **kwargs)
        except CheckFailed:  # said by a function that the check lent to the answer
            raise
        except Exception as error:
            raise CheckFailed(f"{name} raised {_described(error)}") from error
        for argument, value in given.items():
            if not _same(value, before[argument]):
                raise CheckFailed(
                    f"{name} changes its argument `{argument}` in place: work on a copy"
                )
        return read(name, found)

    return call


def _data(answer: Callable, args: tuple, kwargs: dict) -> dict[str, object]:
    """What a call hands over that could be changed in place, by the names of the
    arguments.
    """
    try:
        arguments = inspect.signature(answer).bind(*args, **kwargs).arguments
    except (
        TypeError,
        ValueError,
    ):  # another number of arguments, of which the call itself will tell; a built-in
        return {}
    kinds = np.ndarray | torch.Tensor | list | dict
    return {
        name: value for name, value in arguments.items() if isinstance(value, kinds)
    }


def _same(a: Any, b: Any) -> bool:
    """Whether nothing has changed: both of one kind, with equal contents."""
    if isinstance(a, dict):
        return list(a) == list(b) and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, torch.Tensor):
        return torch.equal(a.detach(), b)
    return np.array_equal(a, b)


def _real(name: str, found: object, what: str) -> np.ndarray:
    """What was returned, as an array of finite numbers."""
    failure = CheckFailed(f"{name} returned {_shown(found)}: return {what}")
    try:
        value = np.asarray(
            found.detach().numpy() if isinstance(found, torch.Tensor) else found
        )
        if (
            value.dtype.kind == "O"
        ):  # such as of fractions; numpy would take None for nan
            value = np.array([float(part) for part in value.ravel()]).reshape(
                value.shape
            )
    except Exception:
        raise failure from None  # numpy's own words would not help
    if value.dtype.kind not in "biuf":
        raise failure
    if not np.isfinite(value).all():
        among = " among its numbers" if value.ndim else ""
        raise CheckFailed(
            f"{name} returned {'inf' if np.isinf(value).any() else 'nan'}{among}: return {what}"
        )
    return value.astype(float)


def _described(error: Exception) -> str:
    """An error in one line, with the line of the answer in which it came up, where that
    is known.
    """
    first = str(error).strip().splitlines()[:1]
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first is the call here
    line = f", in the line `{frames[0].line}`" if frames and frames[0].line else ""
    return ": ".join([type(error).__name__, *first]) + line


def _shown(found: object) -> str:
    """What was returned, short and in one line."""
    if isinstance(found, np.ndarray | np.generic | torch.Tensor):
        return (
            f"an array of shape {tuple(found.shape)}"
            if found.ndim
            else str(found.item())
        )
    return (
        "a function"
        if inspect.isfunction(found)
        else " ".join(reprlib.repr(found).split())
    )
