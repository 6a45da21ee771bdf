"""What public functions do with their input: refuse what is wrong, in one sentence.

What is right they return, as the kind that the rest of the package reckons with.
"""

import math
import numbers
import operator
import re
from collections.abc import Mapping, Sequence
from types import EllipsisType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

# Of a cloth image [pixel]: the paper's 128×96.
HEIGHT = 96
WIDTH = 128

_T = TypeVar("_T")
_Shape = Sequence[int | str | EllipsisType]
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
    """Return a name for a new file; a ValueError if it would lead to another folder."""
    if not re.fullmatch(r"\w([\w-]|(?<=\d)\.(?=\d))*", name):
        raise ValueError(
            f"the name of a {kind} has letters, digits, - and _ only, and points in "
            f"numbers, got {name!r}"
        )
    return name


def check_number(what: str, value: Any, kind: type = float, **bounds: float) -> Any:
    """Return `value` as Python's own `float` or `int`: JSON has no NumPy numbers.

    A ValueError if it is none, or beyond its bounds: `at_least`, `above`, `at_most`.
    """
    right = numbers.Integral if kind is int else numbers.Real
    if not isinstance(value, right) or not math.isfinite(value):
        adjective = "a whole" if kind is int else "a finite"
        raise ValueError(f"{what} is {adjective} number, got {value!s:.80}")
    for word, bound in bounds.items():
        if not _COMPARE[word](value, bound):
            beyond = f"{word.replace('_', ' ')} {bound:g}"
            raise ValueError(f"{what} must be {beyond}, got {value}")
    return kind(value)


def check_array(
    what: str, value: ArrayLike, shape: _Shape, dtype: DTypeLike = np.float64
) -> np.ndarray:
    """Return a copy of `value` as an array of finite numbers of this shape.

    A ValueError if it is none, or has another shape. In `shape`, a number is a fixed
    size, a letter one of at least 1, and `...` at the beginning any leading sizes.
    """
    sizes = ", ".join("..." if n is ... else str(n) for n in shape)
    wanted = f"{what} is [{sizes}] and finite"
    array = _numbers(wanted, value, shape).astype(dtype, order="C")
    finite = np.isfinite(array)
    if not finite.all():
        raise ValueError(f"{wanted}, got {array[~finite][0]!s}")
    return array


def check_masks(images: ArrayLike) -> np.ndarray:
    """Return masks as bool `[..., H, W]`.

    A ValueError for another shape, or for a grey picture or reconstruction.
    """
    wanted = f"cloth images are [..., {HEIGHT}, {WIDTH}]"
    images = _numbers(wanted, images, (..., HEIGHT, WIDTH))
    if images.dtype != bool and not np.isin(images, (0, 1)).all():
        raise ValueError(
            "a cloth image holds 0 and 1 only: `picture > 127` makes one of a grey "
            "picture, `image > 0.5` of a reconstruction"
        )
    return images.astype(bool, copy=False)


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


def _numbers(wanted: str, value: ArrayLike, shape: _Shape) -> np.ndarray:
    """Numbers of a shape, whatever holds them, or a ValueError with what is wanted."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError):
        # Rows of different lengths, a tensor that requires grad
        array = np.array(None)
    if array.dtype.kind not in "biuf":
        beginning = " ".join(str(value).split())[:60]
        raise ValueError(f"{wanted}, got {type(value).__name__} {beginning}")

    # Any leading sizes, and behind them those of the shape
    sizes = array.shape
    if ... in shape:
        shape = shape[1:]
        sizes = sizes[len(sizes) - len(shape) :] if len(sizes) >= len(shape) else ()
    fits = len(sizes) == len(shape)
    for size, n in zip(sizes, shape, strict=False):
        fits = fits and (size == n if isinstance(n, int) else size > 0)
    if not fits:
        raise ValueError(f"{wanted}, got the shape {list(array.shape)}")
    return array
