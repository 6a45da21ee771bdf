"""Where input enters: names, numbers, arrays and settings are refused here, in a sentence that says what would do."""

import dataclasses
import math
import numbers
import operator
import re
import typing
from collections.abc import Iterable, Mapping, Sequence
from types import EllipsisType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

T = TypeVar("T")


def choose(kind: str, name: str, choices: Mapping[str, T], none_yet: str = "(none)") -> T:
    """Return `choices[name]`.

    Args:
        kind: what the choices are, for the message.
        name: which one.
        choices: all there are.
        none_yet: what to say where there are none.

    Raises:
        KeyError: unknown name; the message lists the choices.
    """
    if not isinstance(name, str) or name not in choices:
        raise KeyError(f"unknown {kind} {name!r:.80}; choose from {', '.join(choices) or none_yet}")
    return choices[name]


def choose_all(kind: str, names: Iterable[str], choices: Mapping[str, T]) -> list[T]:
    """`choose` for several names.

    Raises:
        KeyError: an unknown name; the message lists the choices.
    """
    return [choose(kind, name, choices) for name in names]


def check_name(kind: str, name: str) -> str:
    """Return a name that is to become a file's.

    Raises:
        ValueError: a name that would lead into another folder, be hidden, or not be found again.
    """
    if not isinstance(name, str) or not re.fullmatch(r"\w([\w-]|(?<=\d)\.(?=\d))*", name):
        raise ValueError(f"the name of a {kind} has letters, digits, - and _ only, and points in numbers, got {name!r}")
    return name


def check_array(
    what: str, value: ArrayLike, shape: Sequence[int | str | EllipsisType], dtype: DTypeLike = np.float64
) -> np.ndarray:
    """Return `value` as an array of finite numbers: a copy, so that what its owner does with it later changes nothing.

    Args:
        what: its name, for the message.
        value: anything that NumPy reads as an array.
        shape: a number for a size that is fixed, a letter for one that is free, `...` at its beginning for any others.
        dtype: of the result; numbers too large for it are not finite.

    Raises:
        ValueError: no numbers, another shape, or numbers that are not finite.
    """
    wanted = f"{what} is [{', '.join('...' if n is ... else str(n) for n in shape)}] and finite"
    try:
        with np.errstate(over="ignore"):
            array = np.asarray(value, dtype=dtype).copy()  # not np.array, which torch has not learned yet
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise ValueError(f"{wanted}, got {value!s:.80}") from None
    if shape[:1] == (...,):
        shape = ("any",) * (array.ndim - len(shape) + 1) + tuple(shape[1:])
    if array.ndim != len(shape) or any(n != m for n, m in zip(shape, array.shape, strict=True) if isinstance(n, int)):
        raise ValueError(f"{wanted}, got the shape {list(array.shape)}")
    if not np.isfinite(array).all():
        raise ValueError(f"{wanted}, got {array.ravel()[~np.isfinite(array.ravel())][0]!s}")
    return array


def check_number(what: str, value: Any, kind: type = float, **bounds: float) -> Any:
    """Return `value` as one of Python's own numbers, since NumPy's cannot be written as JSON.

    Args:
        what: its name, for the message.
        value: a number of Python's or NumPy's.
        kind: `float` or `int`.
        bounds: `at_least`, `above` or `at_most`.

    Raises:
        ValueError: no number of that kind, not finite, or out of bounds.
    """
    right = isinstance(value, numbers.Integral if kind is int else numbers.Real) and not isinstance(value, bool)
    whole = isinstance(value, numbers.Integral)
    if not (right and abs(value) < (2**63 if whole else math.inf)):  # NumPy takes no larger ones
        raise ValueError(f"{what} is {'a whole' if kind is int else 'a finite'} number, got {value!s:.80}")
    for word, bound in bounds.items():
        if not {"at_least": operator.ge, "above": operator.gt, "at_most": operator.le}[word](value, bound):
            raise ValueError(f"{what} must be {word.replace('_', ' ')} {bound:g}, got {value}")
    return kind(value)


def dimensions(value: ArrayLike) -> int:
    """How many dimensions a value has as an array; none where its rows are of several lengths."""
    try:
        return np.ndim(value)
    except (TypeError, ValueError, RuntimeError):
        return 0


def check_finite(what: str, answer: np.ndarray) -> np.ndarray:
    """Return `answer`, where what went in was finite and too large to reckon with.

    Raises:
        ValueError: numbers that are not finite.
    """
    if not np.isfinite(answer).all():
        raise ValueError(f"{what} is not finite: what it follows from is too large, or too small")
    return answer


def check_mapping(what: str, value: Any) -> Mapping:
    """Return what has names for its parts.

    Raises:
        ValueError: something else.
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"{what} have names: they come in a dict, got {value!r:.80}")
    return value


def setting(default: Any = dataclasses.MISSING, unit: str = "-", **bounds: float) -> Any:
    """A field of a `Checked` dataclass: its default, its unit, and the bounds that `check_number` holds it to."""
    return dataclasses.field(default=default, metadata={"unit": unit, "bounds": bounds})


@dataclasses.dataclass(frozen=True)
class Checked:
    """Settings that check themselves when they are made: values are of the types they claim, numbers in range."""

    def __post_init__(self) -> None:
        """Refuse what the fields do not allow.

        Raises:
            ValueError: a number out of range or not finite, or a value of another type; the message names the field.
        """
        for field in dataclasses.fields(self):
            name, bounds = f"{type(self).__name__}.{field.name}", field.metadata.get("bounds", {})
            object.__setattr__(self, field.name, _as_declared(name, field.type, getattr(self, field.name), bounds))


def _as_declared(name: str, kind: Any, value: Any, bounds: Mapping[str, float]) -> Any:
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        items = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str | bytes) else (value,)
        kinds = kinds[:1] * len(items) if kinds[-1] is ... else kinds
        if len(items) != len(kinds):
            raise ValueError(f"{name} has {len(kinds)} entries, got {value}")
        return tuple(_as_declared(name, each, item, bounds) for each, item in zip(kinds, items, strict=True))
    if kind in (int, float):
        return check_number(name, value, kind, **bounds)
    if isinstance(kind, type) and not isinstance(value, kind):
        raise ValueError(f"{name} is a {kind.__name__}, got {value!s:.80}")
    return value
