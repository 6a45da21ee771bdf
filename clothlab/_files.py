"""Writing files so that an interruption loses nothing, and reading those of strangers, who may mean harm.

A file is data: nothing in it is ever run. How much it holds is bounded before memory is taken for it, since a few bytes
can claim to stand for terabytes.
"""

import hashlib
import io
import json
import math
import os
import tempfile
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from PIL import Image, UnidentifiedImageError
from safetensors import safe_open

if TYPE_CHECKING:
    import torch

LEFT_OVER = ".part"  # ending of a temporary file, which no loader looks for
LARGEST_ARRAYS = 32 << 20  # [byte] of a file of arrays, and of the arrays in it: an hour of a trial has 30 MB
LARGEST_TENSORS = 64 << 20  # [byte] of a file of weights; the models here have less than 3 MB
LARGEST_HEADER = 1 << 20  # [byte] of the list of its tensors
LARGEST_TEXT = 8 << 20  # [byte] of a JSON file, which takes twenty times as much memory when it is read
LARGEST_PICTURE = 1 << 20  # [byte] of a picture of 128×96 pixels, which needs a twentieth


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all: an interruption leaves what was there before."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The same folder, because a rename is atomic only within one file system.
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-", suffix=LEFT_OVER)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def reading(path: str | Path, kind: str) -> Iterator[None]:
    """Say that a file is damaged in one sentence, whatever zip, JSON or the constructors of its content say.

    Raises:
        FileNotFoundError: no such file.
        ValueError: anything else that goes wrong.
    """
    try:
        yield
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path} is damaged or holds no {kind}: {error}") from error


def read_bytes(path: str | Path, at_most: int) -> bytes:
    """Content of a file.

    Args:
        path: of a file, not of a pipe or a device, which might never end.
        at_most: how long it may be [byte].

    Raises:
        FileNotFoundError: no such file.
        ValueError: no file, or a longer one.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ValueError("it is a folder, a pipe or a device, not a file")
    with path.open("rb") as file:
        content = file.read(at_most + 1)
    _check_size(len(content), at_most)
    return content


def _check_size(size: int, at_most: int) -> None:
    if size > at_most:
        raise ValueError(f"it has more than the {at_most / 2**20:.0f} MiB that such a file has at most")


def read_arrays(path: str | Path, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Arrays of an `.npz` file, `{name: array}`.

    Each must have the size that its header says before memory is taken for it, and no more than `LARGEST_ARRAYS`
    together.

    Raises:
        ValueError: arrays of other sizes, of objects, or too many of them.
        zipfile.BadZipFile, KeyError: no such file, or without one of the arrays.
    """
    content = read_bytes(path, LARGEST_ARRAYS)
    if content.count(b"PK\x01\x02") > 100:  # entries, each of which takes memory as soon as the list is read
        raise ValueError("it has more than 100 entries")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [archive.getinfo(f"{name}.npy") for name in names]
        _check_size(sum(member.file_size for member in members), LARGEST_ARRAYS)
        return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others unpack without a bound
        raise ValueError("it is packed in a way that NumPy does not use")
    with archive.open(member) as packed:
        content = io.BytesIO(packed.read(member.file_size))  # with a number, or all that the list denies comes too
    version = np.lib.format.read_magic(content)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if read is None:
        raise ValueError(f"its arrays are of a version {version} that is not known")
    shape, _, dtype = read(content)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content.getbuffer()) - content.tell():
        raise ValueError(f"{member.filename} does not hold the {list(shape)} of {dtype} that its header says")
    content.seek(0)
    return np.lib.format.read_array(content, allow_pickle=False)


def read_tensors(path: str | Path) -> tuple[dict[str, str], dict[str, "torch.Tensor"]]:
    """What is said about the tensors of a `.safetensors` file, and the tensors.

    Raises:
        ValueError: a larger file, or a longer list of tensors, than weights have.
        safetensors.SafetensorError: no such file.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"no file {path}")
    _check_size(Path(path).stat().st_size, LARGEST_TENSORS)
    with Path(path).open("rb") as raw:
        if int.from_bytes(raw.read(8), "little") > LARGEST_HEADER:
            raise ValueError(f"its list of tensors has more than {LARGEST_HEADER >> 20} MiB")
    with safe_open(path, "pt") as file:
        return file.metadata() or {}, {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118


def read_json(text: str | bytes) -> Any:
    """What a text in JSON says.

    Raises:
        ValueError: no JSON, one that is nested without end, or numbers that are not finite.
    """
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except RecursionError:
        raise ValueError("its lists are nested too deeply") from None


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def picture_size(content: bytes) -> tuple[int, int]:
    """Height and width that a PNG or JPEG file says it has [pixel]; the picture itself is not read.

    Raises:
        ValueError: no such file, or more bytes than a small picture has.
    """
    _check_size(len(content), LARGEST_PICTURE)
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(content), formats=["PNG", "JPEG"]) as file:
            return file.height, file.width
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError, ValueError):
        raise ValueError("this file is not a picture: use PNG or JPEG, of a few pixels") from None


def sha256(path: str | Path) -> str:
    """Hash of a file's content, 64 hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
