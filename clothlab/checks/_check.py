"""What all checks have in common: how an answer is called, read and refused.

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
from typing import Any, NoReturn

import numpy as np
import torch
from numpy.typing import ArrayLike

# (who returned it, what was returned) -> the same as a check wants it
Read = Callable[[str, object], object]
# Asserts what is true of the reader's function, with inputs from the generator
Compare = Callable[[Callable, np.random.Generator], None]
# In the environment: the seed of every check that is not given one
SEED = "CLOTHLAB_CHECK_SEED"
DRAWS = 1000  # after so many a check that finds no inputs for itself is wrong


class CheckFailed(AssertionError):
    """The answer is wrong; the text says in what."""

    again = ""  # the call that repeats it with the same inputs

    def _render_traceback_(self) -> list[str]:
        """Show a notebook's reader this sentence alone.

        The lines of the check would give the answer away.
        """
        shown = [f"Not yet: {self}"]
        if self.again:
            shown.append(f"(the same inputs again: {self.again})")
        return shown


class Unanswered(CheckFailed):
    """The dots of the stub are still there."""

    def _render_traceback_(self) -> list[str]:
        return [str(self)]


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

    def decorate(compare: Compare) -> Callable[..., None]:
        name = compare.__name__

        @functools.wraps(compare)
        def run(answer: Callable, seed: int | None = None) -> None:
            _refuse_what_is_no_answer(name, answer)
            if seed is None:
                seed = int(os.environ.get(SEED) or secrets.randbelow(1_000_000))
            rng = np.random.default_rng(seed)
            try:
                compare(_careful(answer, name, read, moves), rng)
            except AssertionError as failure:
                again = f"checks.{name}({name}, seed={seed})"
                _refuse(failure, again)
            print("correct")

        return run

    return decorate


def _refuse_what_is_no_answer(name: str, answer: Callable) -> None:
    """Raise CheckFailed for no function, Unanswered for a stub with its dots."""
    if not callable(answer):
        raise CheckFailed(
            f"this is no function: run the cell that defines {name}, and hand over "
            f"the function {name} itself, without calling it"
        )
    line = _blank(answer)
    if line:
        raise Unanswered(f"unanswered: the dots of {name} are still there, in `{line}`")


def _refuse(failure: AssertionError, again: str) -> NoReturn:
    """Raise a failure as a CheckFailed that knows the call which repeats it."""
    if not isinstance(failure, CheckFailed):
        failure = CheckFailed(str(failure))
    failure.again = again
    raise failure from failure.__cause__


def _blank(answer: Callable) -> str:
    """The first line of a function in which dots stand for what is asked for, or "".

    Dots in brackets, such as in `x[..., 0]`, are an index.
    """
    try:
        lines = textwrap.dedent(inspect.getsource(answer)).splitlines()
        nodes = list(ast.walk(ast.parse("\n".join(lines))))
    except (OSError, TypeError, SyntaxError):
        return ""  # a built-in, or a lambda in the middle of a line

    # Every node within the brackets of an index
    indices: set[int] = set()
    for node in nodes:
        if isinstance(node, ast.Subscript):
            indices.update(id(part) for part in ast.walk(node.slice))

    # The other dots
    constants = [node for node in nodes if isinstance(node, ast.Constant)]
    dots = [each for each in constants if each.value is ... and id(each) not in indices]
    if not dots:
        return ""
    first = lines[min(each.lineno for each in dots) - 1]
    return first.split("#")[0].strip()


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
    values = [np.asarray(each, dtype=float) for each in (truth, *slips.values())]
    for k, a in enumerate(values):
        for b in values[:k]:
            if a.shape == b.shape and np.allclose(a, b, rtol, atol):
                return False
    return True


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
    """Read an array, or lists that make one, of real numbers and of this shape.

    None in the shape stands for any size.
    """

    def read(name: str, found: object) -> np.ndarray:
        value = _real(name, found, what)
        if not _has_shape(value, shape):
            sizes = ["…" if size is None else str(size) for size in shape]
            wanted = ", ".join(sizes) + ("," if len(sizes) == 1 else "")
            raise CheckFailed(
                f"{name} returned {_shown(value)}: return {what}, "
                f"of the shape ({wanted})"
            )
        return value

    return read


def _has_shape(value: np.ndarray, shape: tuple[int | None, ...]) -> bool:
    if value.ndim != len(shape):
        return False
    pairs = zip(shape, value.shape, strict=True)
    return all(wanted in (None, size) for wanted, size in pairs)


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
    # Where nothing was seen, an input has no number
    gaps = np.asarray(a).dtype.kind == "f"
    return np.array_equal(a, b, equal_nan=gaps)


def _real(name: str, found: object, what: str) -> np.ndarray:
    """What was returned, as an array of finite numbers."""
    try:
        value = _as_array(found)
    except Exception:
        value = None  # numpy's own words would not help
    if value is None or value.dtype.kind not in "biuf":
        raise CheckFailed(f"{name} returned {_shown(found)}: return {what}")

    if not np.isfinite(value).all():
        bad = "inf" if np.isinf(value).any() else "nan"
        among = " among its numbers" if value.ndim else ""
        raise CheckFailed(f"{name} returned {bad}{among}: return {what}")
    return value.astype(float)


def _as_array(found: Any) -> np.ndarray:
    """An array of what may be a tensor, a list, or objects such as fractions."""
    if isinstance(found, torch.Tensor):
        return found.detach().numpy()
    value = np.asarray(found)
    if value.dtype.kind != "O":
        return value
    # By Python's float, which refuses None; numpy would take it for nan
    numbers = [float(part) for part in value.ravel()]
    return np.array(numbers).reshape(value.shape)


def _described(error: Exception) -> str:
    """An error in one line, with the line of the answer where it came up, if known."""
    words = [type(error).__name__, *str(error).strip().splitlines()[:1]]
    described = ": ".join(words)
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first is the call here
    if frames and frames[0].line:
        described += f", in the line `{frames[0].line}`"
    return described


def _shown(found: object) -> str:
    """What was returned, short and in one line."""
    if isinstance(found, np.ndarray | np.generic | torch.Tensor):
        if found.ndim:
            return f"an array of shape {tuple(found.shape)}"
        return str(found.item())
    if inspect.isfunction(found):
        return "a function"
    return " ".join(reprlib.repr(found).split())
