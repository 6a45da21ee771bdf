"""What public functions do with their input: refuse what is wrong, in one sentence.

What is right they return, as the kind that the rest of the package reckons with.
"""

import math
import numbers
import operator
import re
from collections.abc import Iterable, Mapping, Sequence
from types import EllipsisType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

# Of a cloth image [pixel]: the paper's 128×96.
HEIGHT = 96
WIDTH = 128

_T = TypeVar("_T")
# How a number is compared with a bound, by the bound's name
_COMPARE = {"at_least": operator.ge, "above": operator.gt, "at_most": operator.le}


def choose(
    kind: str, name: str, choices: Mapping[str, _T], none_yet: str = "(none)"
) -> _T:
    """Return `choices[name]`; an unknown name is a KeyError that lists the choices."""
    if not isinstance(name, str) or name not in choices:
        listed = ", ".join(choices) or none_yet
        raise KeyError(f"unknown {kind} {name!r:.80}; choose from {listed}")
    return choices[name]


def check_name(kind: str, name: str) -> str:
    """Return a name for a new file.

    A ValueError if it would lead to another folder or not be found again.
    """
    allowed = r"\w([\w-]|(?<=\d)\.(?=\d))*"
    if not isinstance(name, str) or not re.fullmatch(allowed, name):
        raise ValueError(
            f"the name of a {kind} has letters, digits, - and _ only, and points in "
            f"numbers, got {name!r}"
        )
    return name


def check_array(
    what: str,
    value: ArrayLike,
    shape: Sequence[int | str | EllipsisType],
    dtype: DTypeLike = np.float64,
) -> np.ndarray:
    """Return a copy of `value` as an array of finite numbers of this shape.

    A ValueError if it is none, or has another shape. In `shape`, a number is a fixed
    size, a letter a free one, and `...` at the beginning any leading sizes.
    """
    sizes = ", ".join("..." if n is ... else str(n) for n in shape)
    wanted = f"{what} is [{sizes}] and finite"

    # Numbers, whatever holds them
    try:
        array = np.asarray(value)  # not np.array, which torch tensors do not know
    except (TypeError, ValueError, RuntimeError):
        # Rows of different lengths, a tensor that requires grad
        raise ValueError(f"{wanted}, got {_short(value)}") from None
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{wanted}, got {_short(value)}")

    # Of this shape, and finite also as this dtype
    if not _has_shape(array, shape):
        raise ValueError(f"{wanted}, got the shape {list(array.shape)}")
    with np.errstate(over="ignore"):
        array = array.astype(dtype, order="C")
    finite = np.isfinite(array)
    if not finite.all():
        raise ValueError(f"{wanted}, got {array[~finite][0]!s}")
    return array


def _has_shape(array: np.ndarray, shape: Sequence[int | str | EllipsisType]) -> bool:
    sizes = array.shape
    if shape[:1] == (...,):
        shape = shape[1:]
        leading = array.ndim - len(shape)
        if leading < 0:
            return False
        sizes = sizes[leading:]
    if len(sizes) != len(shape):
        return False
    pairs = zip(shape, sizes, strict=True)
    return all(size == n for n, size in pairs if isinstance(n, int))


def check_number(what: str, value: Any, kind: type = float, **bounds: float) -> Any:
    """Return `value` as Python's own `float` or `int`: JSON has no NumPy numbers.

    A ValueError if it is none, or beyond its bounds: `at_least`, `above`, `at_most`.
    """
    # A number of this kind, which is neither a bool nor larger than NumPy's integers
    numbers_of_kind = numbers.Integral if kind is int else numbers.Real
    right = isinstance(value, numbers_of_kind) and not isinstance(value, bool)
    largest = 2**63 if isinstance(value, numbers.Integral) else math.inf
    if not (right and abs(value) < largest):
        adjective = "a whole" if kind is int else "a finite"
        raise ValueError(f"{what} is {adjective} number, got {_short(value)}")

    # Within its bounds
    for word, bound in bounds.items():
        if not _COMPARE[word](value, bound):
            beyond = f"{word.replace('_', ' ')} {bound:g}"
            raise ValueError(f"{what} must be {beyond}, got {value}")
    return kind(value)


def check_seed(seed: Any) -> int:
    """Return a seed as `int`; a ValueError if it is no whole number from 0 on."""
    return check_number("seed", seed, int, at_least=0)


def check_kind(what: str, value: Any, kind: type[_T], advice: str = "") -> _T:
    """Return `value` if it is of this class.

    A ValueError names the class, and says what `advice` has to say.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        got = f"{type(value).__name__} {_short(value)}"
        raise ValueError(f"{what} is {article} {kind.__name__}, got {got}{advice}")
    return value


def check_each(what: str, values: Any, kind: type[_T], advice: str = "") -> list[_T]:
    """Return `values` as a list if each is of this class.

    A ValueError says which is not.
    """
    if isinstance(values, kind) or not isinstance(values, Iterable):
        got = f"{type(values).__name__} {_short(values)}"
        raise ValueError(f"{what} are a list of {kind.__name__}, got {got}{advice}")
    return [check_kind(f"each of {what}", value, kind, advice) for value in values]


def settings_or_default(value: _T | None, kind: type[_T], what: str = "settings") -> _T:
    """Return these settings, or the default ones.

    A ValueError for what is no object of their class, such as a dict.
    """
    if value is None:
        return kind()
    return check_kind(what, value, kind, f": write {kind.__name__}(name=value)")


def check_some(what: str, values: np.ndarray) -> np.ndarray:
    """Return an array that holds something.

    A ValueError for an empty one, whose mean would be NaN.
    """
    if not values.size:
        raise ValueError(
            f"{what} are empty, so that there is nothing to compute: "
            f"shape {list(values.shape)}"
        )
    return values


def check_names(what: str, names: Sequence[str], size: int) -> None:
    """A ValueError unless each number has a name, or none has."""
    if names and len(names) != size:
        raise ValueError(
            f"{size} {what} need as many names, or none, got {len(names)}: "
            f"{', '.join(names)}"
        )


def check_masks(images: ArrayLike) -> np.ndarray:
    """Return masks as bool `[..., H, W]`.

    A ValueError for another shape, or for a grey picture or reconstruction.
    """
    what = f"cloth images are [..., {HEIGHT}, {WIDTH}]"
    try:
        images = np.asarray(images)
    except (TypeError, ValueError, RuntimeError):
        # Rows of different lengths, or a tensor that requires grad.
        kind = type(images).__name__
        raise ValueError(f"{what} of 0 and 1, got {kind}") from None

    # Another size, or numbers between 0 and 1.
    if images.shape[-2:] != (HEIGHT, WIDTH):
        raise ValueError(f"{what}, got the shape {list(images.shape)}")
    if images.dtype == bool:
        return images
    if images.dtype.kind not in "iuf" or not np.isin(images, (0, 1)).all():
        raise ValueError(
            "a cloth image holds 0 and 1 only: `picture > 127` makes one of a grey "
            "picture, `image > 0.5` of a reconstruction"
        )
    return images.astype(bool)


def check_mask(mask: ArrayLike) -> np.ndarray:
    """Return one mask as bool `[H, W]`.

    A ValueError as in `check_masks`, or if there is no cloth in it.
    """
    mask = check_masks(mask)
    if mask.ndim != 2:
        raise ValueError(
            f"one cloth image is [{HEIGHT}, {WIDTH}], got the shape {list(mask.shape)}"
        )
    if not mask.any():
        raise ValueError("no cloth in the image: the mask is empty")
    return mask


def _short(value: Any) -> str:
    """The beginning of what was given, on one line."""
    return " ".join(str(value).split())[:80]
