"""How an exercise is asked: new inputs each time, the truth, and usual slips.

`checks.NAME(NAME)` puts a few questions to a reader's function, and prints "correct" or
raises CheckFailed with one sentence that says what is wrong. Whatever an answer does,
from an error to a string in place of a number, ends in such a sentence.

The inputs are drawn anew each time, so that outputs written down in one run are wrong
in the next. `checks.NAME(NAME, seed=123)` asks the same questions again, as does the
environment variable CLOTHLAB_CHECK_SEED for all checks.
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
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

ROUNDS = 3  # questions in a check
DRAWS = 1000  # after so many without a clear question, an exercise is wrong
FAR = 100.0  # times as much as an answer may, slips differ from the truth
SEED = "CLOTHLAB_CHECK_SEED"  # in the environment: the seed of every check


class CheckFailed(AssertionError):
    """The answer is wrong; the text says in what."""

    again = ""  # the call that asks the same again

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


@dataclass(frozen=True)
class Question:
    """What a function is given, what is right, and what usual slips give."""

    given: tuple
    truth: Any
    # What slips give, by the sentence that is said of each
    slips: Mapping[str, Any] = field(default_factory=dict)
    # Said of any other value, which a function of it can name
    otherwise: str | Callable[[Any], str] = "that is neither right nor a usual slip"

    def clear(self, rtol: float, atol: float) -> bool:
        """Whether the truth and all slips differ by more than these.

        A slip is then neither taken for the truth nor for another slip.
        """
        values = [
            np.asarray(each, float) for each in (self.truth, *self.slips.values())
        ]
        for k, a in enumerate(values):
            for b in values[:k]:
                if a.shape == b.shape and np.allclose(a, b, rtol, atol):
                    return False
        return True


def exercise(
    what: str,
    *shape: int | None,
    rtol: float = 1e-5,
    atol: float = 1e-6,
    moves: tuple[int, ...] = (),
    times: int = 1,
) -> Callable[[Callable[[np.random.Generator], Question]], Callable[..., None]]:
    """Turn a function that draws a question into a check of answers.

    Args:
        what: is to be returned, in words.
        shape: of it; None stands for any size, and no shape for one number.
        rtol: share of the truth by which an answer may differ; by default what single
            precision loses.
        atol: amount by which it may differ, in the unit of the truth.
        moves: positions of the arguments that an answer is to change in place.
        times: how often it is called with what it was given, as it has left it; if
            more than once, the truth has what is right of each call, one below the
            other.
    """

    def decorate(
        draw: Callable[[np.random.Generator], Question],
    ) -> Callable[..., None]:
        name = draw.__name__

        def judge(answer: Callable, rng: np.random.Generator) -> None:
            for _ in range(ROUNDS):
                question = clear_question(draw, rng, FAR * rtol, FAR * atol)
                returned = ask(name, answer, question.given, moves, times)
                values = [as_numbers(name, each, what, shape) for each in returned]
                found = values[0] if times == 1 else np.array(values)
                compare(found, question, rtol, atol)

        return as_check(functools.wraps(draw)(judge))

    return decorate


def as_check(
    judge: Callable[[Callable, np.random.Generator], None],
) -> Callable[..., None]:
    """The check that a reader calls, of a function that refuses wrong answers.

    Its stubs are refused first, and what fails can be asked again by its seed.
    """
    name = judge.__name__

    @functools.wraps(judge)
    def check(answer: Callable, seed: int | None = None) -> None:
        refuse_no_answer(name, answer)
        if seed is None:
            seed = int(os.environ.get(SEED) or secrets.randbelow(1_000_000))
        try:
            judge(answer, np.random.default_rng(seed))
        except CheckFailed as failure:
            failure.again = f"checks.{name}({name}, seed={seed})"
            raise
        print("correct")

    return check


def clear_question(
    draw: Callable[[np.random.Generator], Question],
    rng: np.random.Generator,
    rtol: float,
    atol: float,
) -> Question:
    """The first of many questions in which no slip looks like the truth."""
    for _ in range(DRAWS):
        question = draw(rng)
        if question.clear(rtol, atol):
            return question
    raise RuntimeError(f"none of {DRAWS} questions has slips that differ")


def compare(found: np.ndarray, question: Question, rtol: float, atol: float) -> None:
    """Raise CheckFailed unless an answer is the truth; a known slip is named."""
    if np.allclose(found, question.truth, rtol, atol):
        return
    for message, value in question.slips.items():
        if np.allclose(found, value, rtol, atol):
            raise CheckFailed(message)
    otherwise = question.otherwise
    raise CheckFailed(otherwise if isinstance(otherwise, str) else otherwise(found))


def refuse_no_answer(name: str, answer: Callable) -> None:
    """Raise CheckFailed for no function, Unanswered for a stub with its dots."""
    if not callable(answer):
        raise CheckFailed(
            f"this is no function: run the cell that defines {name}, and hand over "
            f"the function {name} itself, without calling it"
        )
    line = _first_dots(answer)
    if line:
        raise Unanswered(f"unanswered: the dots of {name} are still there, in `{line}`")


def if_open(answer: Callable, ours: Callable) -> Callable:
    """Ours while the dots of an exercise are there, so that what follows runs."""
    return ours if _first_dots(answer) else answer


def _first_dots(answer: Callable) -> str:
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


def ask(
    name: str,
    answer: Callable,
    given: tuple,
    moves: tuple[int, ...] = (),
    times: int = 1,
) -> list:
    """What a function returns each time; an error or a change is CheckFailed."""
    lent = copy.deepcopy(given)
    found = []
    try:
        for _ in range(times):
            found.append(answer(*lent))
    except CheckFailed:  # said by a function that is among what was given
        raise
    except Exception as error:
        raise CheckFailed(f"{name} raised {_described(error)}") from error

    # What it was given must be as it was
    arguments = inspect.signature(answer).parameters
    for n, argument in enumerate(arguments):
        if n < len(given) and n not in moves and not _same(given[n], lent[n]):
            if isinstance(given[n], torch.nn.Module):
                raise CheckFailed(
                    f"{name} moves the weights of `{argument}`: leave them as they are"
                )
            raise CheckFailed(
                f"{name} changes its argument `{argument}` in place: work on a copy"
            )
    return found


def _described(error: Exception) -> str:
    """An error in one line, with the line of the answer where it came up, if known."""
    words = [type(error).__name__, *str(error).strip().splitlines()[:1]]
    described = ": ".join(words)
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first is the call here
    if frames and frames[0].line:
        described += f", in the line `{frames[0].line}`"
    return described


def _same(a: Any, b: Any) -> bool:
    """Whether arrays, tensors, networks, and what holds them have equal contents."""
    if isinstance(a, torch.nn.Module):
        a, b = dict(a.state_dict()), dict(b.state_dict())
    if isinstance(a, dict):
        return list(a) == list(b) and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, torch.Tensor):
        return torch.equal(a.detach(), b)
    if isinstance(a, np.ndarray):
        # Where nothing was seen, an input has no number
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, int | float | str):
        return a == b or a != a
    return True  # a function, a frozen record


def as_numbers(
    name: str, found: Any, what: str, shape: tuple[int | None, ...]
) -> np.ndarray:
    """What was returned, as finite numbers of the shape that is asked for."""
    # Numbers: of a tensor, a list, or of objects such as fractions
    try:
        value = found.detach().numpy() if isinstance(found, torch.Tensor) else found
        value = np.asarray(value)
        if value.dtype.kind == "O":
            # By Python's float, which refuses None; NumPy would take it for nan
            parts = [float(part) for part in value.ravel()]
            value = np.array(parts).reshape(value.shape)
    except Exception:
        value = np.array("no numbers")  # NumPy's own words would not help
    if value.dtype.kind not in "biuf":
        raise CheckFailed(f"{name} returned {_shown(found)}: return {what}")

    # Of this shape
    fits = len(value.shape) == len(shape) and all(
        wanted in (None, size) for wanted, size in zip(shape, value.shape, strict=True)
    )
    if not fits:
        sizes = ", ".join("…" if size is None else str(size) for size in shape)
        wanted = f"of the shape ({sizes}{',' * (len(shape) == 1)})"
        wanted = f"{what}, {wanted}" if shape else f"one number, {what}"
        raise CheckFailed(f"{name} returned {_shown(found)}: return {wanted}")

    # And finite
    if not np.isfinite(value).all():
        bad = "inf" if np.isinf(value).any() else "nan"
        among = " among its numbers" if value.ndim else ""
        raise CheckFailed(f"{name} returned {bad}{among}: return {what}")
    return value.astype(float)


def _shown(found: object) -> str:
    """What was returned, short and in one line."""
    if isinstance(found, np.ndarray | np.generic | torch.Tensor):
        if found.ndim:
            return f"an array of shape {tuple(found.shape)}"
        return str(found.item())
    if inspect.isfunction(found):
        return "a function"
    return " ".join(reprlib.repr(found).split())
