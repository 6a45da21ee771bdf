"""Runs that stay on the disk: read-only memory maps, looked at block by block.

    Run(np.load("s.npy", mmap_mode="r"), np.load("u.npy", mmap_mode="r"), "heavy")

What was looked at is given back, so that a run may be larger than the memory.
"""

import mmap
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from clothlab._validation import check_array

_BLOCK = 2**24  # bytes that are looked at together


def is_on_disk(array: Any) -> bool:
    """Whether an array can stay where it is: float32, mapped, and only to be read."""
    return (
        isinstance(array, np.memmap)
        and getattr(array, "_mmap", None) is not None
        and array.mode == "r"
        and array.dtype == np.float32
        and array.flags.c_contiguous
    )


def check_record(what: str, value: Any, shape: tuple[str, str]) -> np.ndarray:
    """Return finite numbers `[T, D]` in single precision.

    They are copied, but for those on the disk. A ValueError as of `check_array`.
    """
    if not is_on_disk(value) or value.ndim != len(shape):
        return _checked(what, value, shape)
    first = 0
    for block in blocks(value):
        _checked(what, block, shape, first)
        first += len(block)
    return value


def _checked(
    what: str, value: Any, shape: tuple[str, str], first: int = 0
) -> np.ndarray:
    """The same of rows in memory, which are steps from `first` on."""
    try:
        return check_array(what, value, shape, np.float32)
    except ValueError:
        _check_holes(what, value, first)  # which says more
        raise


def _check_holes(what: str, value: Any, first: int) -> None:
    """A ValueError that says where numbers are missing, from step `first` on."""
    if not isinstance(value, np.ndarray) or value.ndim != 2 or value.dtype.kind != "f":
        return
    holes = ~np.isfinite(value)
    if not holes.any():
        return
    step, number = np.argwhere(holes)[0]
    raise ValueError(
        f"{what} is {value[step, number]} in step {first + step}, number {number} "
        "(both counted from 0): a log with holes goes through runs_from_dataframe("
        '..., missing="hold"), or "split"'
    )


def blocks(array: np.ndarray) -> Iterator[np.ndarray]:
    """Copies of some rows after the other."""
    rows = max(1, _BLOCK // max(1, array[:1].nbytes))
    for start in range(0, len(array), rows):
        block = np.array(array[start : start + rows])
        give_back(array)
        yield block


def give_back(array: np.ndarray) -> None:
    """Take what was looked at out of this process' memory; it is read again if needed.

    Nothing happens to an array in memory, nor where the system doesn't know how.
    """
    mapped: Any = getattr(array, "_mmap", None)
    if is_on_disk(array) and hasattr(mapped, "madvise"):
        mapped.madvise(mmap.MADV_DONTNEED)


class Summary(NamedTuple):
    """What a normalisation has to know of a record `[T, D]`, each `[D]`."""

    first: Tensor
    mean: Tensor
    std: Tensor
    low: Tensor
    high: Tensor


def summary_of(arrays: Sequence[np.ndarray]) -> Summary:
    """Of all rows of several arrays: at once, or block by block if any is on disk."""
    if any(map(is_on_disk, arrays)):
        return _summary_of_blocks(arrays)
    values = torch.as_tensor(np.concatenate(arrays))
    return Summary(
        values[0], values.mean(0), values.std(0), values.amin(0), values.amax(0)
    )


def _summary_of_blocks(arrays: Sequence[np.ndarray]) -> Summary:
    """The same in double precision, each block joined to those before it."""
    width = arrays[0].shape[1]
    count = 0
    mean = np.zeros(width)
    squares = np.zeros(width)  # of the distances to the mean, summed
    low = np.full(width, np.inf)
    high = np.full(width, -np.inf)
    for array in arrays:
        for block in blocks(array):
            rows = block.astype(np.float64)
            low = np.minimum(low, rows.min(0))
            high = np.maximum(high, rows.max(0))

            # Chan, Golub and LeVeque, 1979
            total = count + len(rows)
            gap = rows.mean(0) - mean
            squares += ((rows - rows.mean(0)) ** 2).sum(0)
            squares += gap**2 * count * len(rows) / total
            mean += gap * len(rows) / total
            count = total

    std = np.sqrt(squares / (count - 1))
    parts = (arrays[0][0], mean, std, low, high)
    return Summary(*(torch.tensor(part, dtype=torch.float32) for part in parts))


class _Place(NamedTuple):
    """Where an array lies on the disk."""

    filename: str
    offset: int  # [byte]
    shape: tuple[int, ...]


def told(array: np.ndarray) -> np.ndarray | _Place:
    """What another process is told of an array: itself, or where it lies."""
    if not is_on_disk(array) or getattr(array, "filename", None) is None:
        return array

    # A slice of a map has the map's own offset, and an address of its own.
    mapped: Any = array
    whole = np.frombuffer(mapped._mmap, np.uint8)
    begin = mapped.offset - mapped.offset % mmap.ALLOCATIONGRANULARITY
    within = array.ctypes.data - whole.ctypes.data
    return _Place(str(mapped.filename), begin + within, array.shape)


def taken(value: Any) -> Any:
    """What was told: an array that lies on the disk is mapped again."""
    if not isinstance(value, _Place):
        return value
    return np.memmap(value.filename, np.float32, "r", value.offset, value.shape)
