"""Where input enters: names, numbers, arrays and settings are refused here, in a sentence that says what would do."""

import dataclasses
import math
import numbers
import re
import typing
from collections.abc import Iterable, Mapping, Sequence
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
        raise KeyError(f"unknown {kind} {name!r}; choose from {', '.join(choices) or none_yet}")
    return choices[name]


def check_name(kind: str, name: str) -> str:
    """Return a name that is to become a file's.

    Raises:
        ValueError: a name that would lead into another folder, be hidden, or not be found again.
    """
    if not isinstance(name, str) or not re.fullmatch(r"\w[\w-]*", name):
        raise ValueError(f"the name of a {kind} has letters, digits, - and _ only, got {name!r}")
    return name


def check_array(what: str, value: ArrayLike, shape: Sequence[int | str], dtype: DTypeLike = np.float64) -> np.ndarray:
    """Return `value` as an array of finite numbers.

    Args:
        what: its name, for the message.
        value: anything that NumPy reads as an array.
        shape: a number for a size that is fixed, a letter for one that is free.
        dtype: of the result; numbers too large for it are not finite.

    Raises:
        ValueError: no numbers, another shape, or numbers that are not finite.
    """
    wanted = f"{what} is [{', '.join(map(str, shape))}] and finite"
    try:
        with np.errstate(over="ignore"):
            array = np.asarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise ValueError(f"{wanted}, got {str(value)[:80]}") from None
    if array.ndim != len(shape) or any(n != m for n, m in zip(shape, array.shape, strict=True) if isinstance(n, int)):
        raise ValueError(f"{wanted}, got the shape {list(array.shape)}")
    if not np.isfinite(array).all():
        raise ValueError(f"{wanted}, got {array.ravel()[~np.isfinite(array.ravel())][0]!s}")
    return array


def setting(
    default: Any = dataclasses.MISSING,
    unit: str = "-",
    *,
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
) -> Any:
    """A field of a `Checked` dataclass: its default, its unit, and the range of its numbers."""
    bounds = {"at least": at_least, "above": above, "at most": at_most}
    return dataclasses.field(default=default, metadata={"unit": unit, "bounds": bounds})


@dataclasses.dataclass(frozen=True)
class Checked:
    """Settings that check themselves when they are made: numbers are finite, in range, and of the type they claim."""

    def __post_init__(self) -> None:
        """Refuse what the fields do not allow.

        Raises:
            ValueError: a number out of range, not finite or of another type; the message names the field.
        """
        for field in dataclasses.fields(self):
            value = _as_declared(f"{type(self).__name__}.{field.name}", field.type, getattr(self, field.name))
            object.__setattr__(self, field.name, value)
            for number in value if isinstance(value, tuple) else (value,):
                _check_bounds(self, field, number)


def _as_declared(name: str, kind: Any, value: Any) -> Any:
    """Numbers as Python's own, since NumPy's cannot be written as JSON."""
    inner = typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        items = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else (value,)
        kinds = inner[:1] * len(items) if inner[-1] is ... else inner
        if len(items) != len(kinds):
            raise ValueError(f"{name} has {len(kinds)} entries, got {value}")
        return tuple(_as_declared(name, each, item) for each, item in zip(kinds, items, strict=True))
    if kind is str and not isinstance(value, str):
        raise ValueError(f"{name} is a string, got {value!r}")
    if kind not in (int, float):
        return value
    right = isinstance(value, numbers.Integral if kind is int else numbers.Real) and not isinstance(value, bool)
    if not right or not math.isfinite(value):
        raise ValueError(f"{name} is {'a whole number' if kind is int else 'a finite number'}, got {value!r}")
    return kind(value)


def _check_bounds(owner: Checked, field: dataclasses.Field, number: Any) -> None:
    for word, bound in field.metadata.get("bounds", {}).items():
        if bound is None:
            continue
        held = {"at least": number >= bound, "above": number > bound, "at most": number <= bound}[word]
        if not held:
            raise ValueError(f"{type(owner).__name__}.{field.name} must be {word} {bound:g}, got {number}")
