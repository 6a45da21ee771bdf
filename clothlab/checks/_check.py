"""What all checks have in common: how an answer is called, what it may return, and how its reader hears of it.

An answer may do anything: raise an error, return None, a string or an array of any shape, change what it was given. All
that ends here, in one sentence, so that a check compares numbers only. An error in a check itself stays what it is.
"""

import copy
import functools
import inspect
import reprlib
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

Read = Callable[[str, object], object]  # (who returned it, what was returned) -> the same as a check wants it


class CheckFailed(AssertionError):
    """The answer is wrong; the text says in what."""

    def _render_traceback_(self) -> list[str]:
        """Show a notebook's reader this sentence alone: the lines of the check would give the answer away."""
        return [f"Not yet: {self}"]


def check(read: Read) -> Callable[[Callable[[Callable], None]], Callable[[Callable], None]]:
    """Turn a function that asserts what is true of an answer into a check: it prints "correct" or raises CheckFailed.

    The function takes the reader's function, whose results `read` has made sure of, and asserts, each time with a
    sentence that says what is wrong.
    """

    def decorate(compare: Callable[[Callable], None]) -> Callable[[Callable], None]:
        @functools.wraps(compare)
        def run(answer: Callable) -> None:
            name = compare.__name__
            if not callable(answer):
                raise CheckFailed(f"hand over the function {name} itself, without calling it")
            try:
                compare(_careful(answer, name, read))
            except CheckFailed:
                raise
            except AssertionError as failure:
                raise CheckFailed(str(failure)) from None
            print("correct")

        return run

    return decorate


def expect(
    found: ArrayLike,
    truth: ArrayLike,
    otherwise: str,
    slips: Mapping[str, ArrayLike] | None = None,
    rtol: float = 1e-5,
    atol: float = 1e-6,
) -> None:
    """Raise CheckFailed unless `found` is the truth, within what single precision loses.

    `slips` are the values that usual slips give, by what is said of them; `otherwise` is said of all other values.
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
            raise CheckFailed(f"{name} returned {_shown(found)}: return one number, {what}")
        return float(value)

    return read


def array(what: str, *shape: int | None) -> Read:
    """Read an array, or lists that make one, of real numbers and of this shape; None stands for any size."""

    def read(name: str, found: object) -> np.ndarray:
        value = _real(name, found, what)
        if len(value.shape) != len(shape) or any(n not in (None, m) for n, m in zip(shape, value.shape, strict=True)):
            wanted = str(tuple("…" if n is None else n for n in shape)).replace("'", "")
            raise CheckFailed(f"{name} returned {_shown(value)}: return {what}, of the shape {wanted}")
        return value

    return read


def arrays(what: str, *reads: Read) -> Read:
    """Read a tuple or a list, each part in its own way."""

    def read(name: str, found: object) -> tuple:
        if not isinstance(found, tuple | list) or len(found) != len(reads):
            raise CheckFailed(f"{name} returned {_shown(found)}: return {what}")
        return tuple(part(name, value) for part, value in zip(reads, found, strict=True))

    return read


def _careful(answer: Callable, name: str, read: Read) -> Callable:
    """Call the answer so that whatever goes wrong within it, or with what it returns, is a CheckFailed."""

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
                raise CheckFailed(f"{name} changes its argument `{argument}` in place: work on a copy")
        return read(name, found)

    return call


def _data(answer: Callable, args: tuple, kwargs: dict) -> dict[str, object]:
    """What a call hands over that could be changed in place, by the names of the arguments."""
    try:
        arguments = inspect.signature(answer).bind(*args, **kwargs).arguments
    except (TypeError, ValueError):  # another number of arguments, of which the call itself will tell; a built-in
        return {}
    kinds = np.ndarray | torch.Tensor | list | dict
    return {name: value for name, value in arguments.items() if isinstance(value, kinds)}


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
        value = np.asarray(found.detach().numpy() if isinstance(found, torch.Tensor) else found)
        if value.dtype.kind == "O":  # such as of fractions; numpy would take None for nan
            value = np.array([float(part) for part in value.ravel()]).reshape(value.shape)
    except Exception:
        raise failure from None  # numpy's own words would not help
    if value.dtype.kind not in "biuf":
        raise failure
    if not np.isfinite(value).all():
        among = " among its numbers" if value.ndim else ""
        raise CheckFailed(f"{name} returned {'inf' if np.isinf(value).any() else 'nan'}{among}: return {what}")
    return value.astype(float)


def _described(error: Exception) -> str:
    """An error in one line, with the line of the answer in which it came up, where that is known."""
    first = str(error).strip().splitlines()[:1]
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first is the call here
    line = f", in the line `{frames[0].line}`" if frames and frames[0].line else ""
    return ": ".join([type(error).__name__, *first]) + line


def _shown(found: object) -> str:
    """What was returned, short and in one line."""
    if isinstance(found, np.ndarray | np.generic | torch.Tensor):
        return f"an array of shape {tuple(found.shape)}" if found.ndim else str(found.item())
    return "a function" if inspect.isfunction(found) else " ".join(reprlib.repr(found).split())
