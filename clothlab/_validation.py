"""What public functions do with their input.

They refuse a wrong name, number, array or setting in one clear sentence.
"""

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

_T = TypeVar("_T")


def choose(
    kind: str, name: str, choices: Mapping[str, _T], none_yet: str = "(none)"
) -> _T:
    """Return `choices[name]`; an unknown name is a KeyError that lists the choices."""
    if not isinstance(name, str) or name not in choices:
        raise KeyError(
            f"unknown {kind} {name!r:.80}; choose from {', '.join(choices) or none_yet}"
        )
    return choices[name]


def check_name(kind: str, name: str) -> str:
    """Return a name for a new file; a ValueError if it would lead to another folder or
    not be found again.
    """
    if not isinstance(name, str) or not re.fullmatch(
        r"\w([\w-]|(?<=\d)\.(?=\d))*", name
    ):
        raise ValueError(
            f"the name of a {kind} has letters, digits, - and _ only, and points in numbers, got {name!r}"
        )
    return name


def check_array(
    what: str,
    value: ArrayLike,
    shape: Sequence[int | str | EllipsisType],
    dtype: DTypeLike = np.float64,
) -> np.ndarray:
    """Return a copy of `value` as an array of finite numbers; a ValueError if it is
    none, or has another shape.

    In `shape`, a number is a fixed size, a letter a free one, and `...` at the
    beginning any leading sizes.
    """
    wanted = f"{what} is [{', '.join('...' if n is ... else str(n) for n in shape)}] and finite"
    try:
        array = np.asarray(value)  # not np.array, which torch tensors do not know
    except (
        TypeError,
        ValueError,
        RuntimeError,
    ):  # rows of different lengths, a tensor that requires grad
        raise ValueError(f"{wanted}, got {_short(value)}") from None
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{wanted}, got {_short(value)}")
    if shape[:1] == (...,):
        shape = ("any",) * (array.ndim - len(shape) + 1) + tuple(shape[1:])
    if array.ndim != len(shape) or any(
        n != m for n, m in zip(shape, array.shape, strict=True) if isinstance(n, int)
    ):
        raise ValueError(f"{wanted}, got the shape {list(array.shape)}")
    with np.errstate(over="ignore"):
        array = array.astype(dtype, order="C")
    if not np.isfinite(array).all():
        raise ValueError(
            f"{wanted}, got {array.ravel()[~np.isfinite(array.ravel())][0]!s}"
        )
    return array


def check_number(what: str, value: Any, kind: type = float, **bounds: float) -> Any:
    """Return `value` as Python's own `float` or `int` (JSON has no NumPy numbers); a
    ValueError if it is none.

    `bounds` are `at_least`, `above` or `at_most`.
    """
    right = isinstance(
        value, numbers.Integral if kind is int else numbers.Real
    ) and not isinstance(value, bool)
    # NumPy takes no larger integers
    largest = 2**63 if isinstance(value, numbers.Integral) else math.inf
    if not (right and abs(value) < largest):
        raise ValueError(
            f"{what} is {'a whole' if kind is int else 'a finite'} number, got {_short(value)}"
        )
    for word, bound in bounds.items():
        if not {"at_least": operator.ge, "above": operator.gt, "at_most": operator.le}[
            word
        ](value, bound):
            raise ValueError(
                f"{what} must be {word.replace('_', ' ')} {bound:g}, got {value}"
            )
    return kind(value)


def check_seed(seed: Any) -> int:
    """Return a seed as Python's own `int`; a ValueError if it is no whole number from 0
    on.
    """
    return check_number("seed", seed, int, at_least=0)


def check_flag(what: str, value: Any) -> bool:
    """Return True or False; a ValueError for anything else: the word "no" would count
    as true.
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{what} is True or False, got {_short(value)}")
    return bool(value)


def check_kind(what: str, value: Any, kind: type[_T], advice: str = "") -> _T:
    """Return `value` if it is of this class; a ValueError names the class, and says
    what `advice` has to say.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise ValueError(
            f"{what} is {article} {kind.__name__}, got {type(value).__name__} {_short(value)}{advice}"
        )
    return value


def check_each(what: str, values: Any, kind: type[_T], advice: str = "") -> list[_T]:
    """Return `values` as a list if each is of this class; a ValueError says which is
    not.
    """
    if isinstance(values, kind) or not isinstance(values, Iterable):
        raise ValueError(
            f"{what} are a list of {kind.__name__}, got {type(values).__name__} {_short(values)}{advice}"
        )
    return [check_kind(f"each of {what}", value, kind, advice) for value in values]


def settings_or_default(value: _T | None, kind: type[_T]) -> _T:
    """Return these settings, or the default ones; a ValueError for what is no object of
    their class, such as a dict.
    """
    if value is None:
        return kind()
    return check_kind("settings", value, kind, f": write {kind.__name__}(name=value)")


def check_some(what: str, values: np.ndarray) -> np.ndarray:
    """Return an array that holds something; a ValueError for an empty one, whose mean
    would be NaN.
    """
    if not values.size:
        raise ValueError(
            f"{what} are empty, so that there is nothing to compute: shape {list(values.shape)}"
        )
    return values


def _short(value: Any) -> str:
    return " ".join(str(value).split())[:80]


def setting(
    default: Any = dataclasses.MISSING, unit: str = "-", **bounds: float
) -> Any:
    """A field of a `Checked` dataclass: its default, its unit, and its bounds as in
    `check_number`.
    """
    return dataclasses.field(default=default, metadata={"unit": unit, "bounds": bounds})


@dataclasses.dataclass(frozen=True)
class Checked:
    """Settings that check types and bounds of their fields when they are made; a
    ValueError names the field.
    """

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            name, bounds = (
                f"{type(self).__name__}.{field.name}",
                field.metadata.get("bounds", {}),
            )
            object.__setattr__(
                self,
                field.name,
                _as_declared(name, field.type, getattr(self, field.name), bounds),
            )


def _as_declared(name: str, kind: Any, value: Any, bounds: Mapping[str, float]) -> Any:
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        items = (
            tuple(value)
            if isinstance(value, Iterable) and not isinstance(value, str | bytes)
            else (value,)
        )
        kinds = kinds[:1] * len(items) if kinds[-1] is ... else kinds
        if len(items) != len(kinds):
            raise ValueError(f"{name} has {len(kinds)} entries, got {_short(value)}")
        return tuple(
            _as_declared(name, each, item, bounds)
            for each, item in zip(kinds, items, strict=True)
        )
    if kind in (int, float):
        return check_number(name, value, kind, **bounds)
    if isinstance(kind, type) and not isinstance(value, kind):
        raise ValueError(f"{name} is a {kind.__name__}, got {_short(value)}")
    return value
