"""Files that an interruption does not spoil, and that say so if something else did."""

import hashlib
import io
import math
import os
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

_LEFT_OVER = ".part"  # ending of a temporary file, which no loader looks for


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all.

    An OSError names the file that could not be written.
    """
    path = Path(path)
    temporary = None
    try:
        # The same folder, because a rename is atomic only within one file system.
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.name}-", suffix=_LEFT_OVER
        )

        # On the disk, not on its way there, before it takes the other's name.
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        reason = f"cannot write this file ({error.strerror})"
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


class OtherKindError(ValueError):
    """A file is whole, and not what was asked for.

    It is of another kind, of another version, or too large to be read.
    """


@contextmanager
def reading(path: str | Path, kind: str) -> Iterator[None]:
    """Turn whatever goes wrong while a file is read into a ValueError that names it.

    A missing one stays missing. `OtherKindError` inside says that the file is whole:
    then nothing is said of damage.
    """
    try:
        yield
    except FileNotFoundError:
        raise
    except OtherKindError as error:
        raise OtherKindError(
            f"{path} is no {kind} that can be read here: {error}"
        ) from error
    except Exception as error:
        raise ValueError(f"{path} is damaged or holds no {kind}: {error}") from error


def load_arrays(path: str | Path, most_bytes: int) -> dict[str, np.ndarray]:
    """Arrays of an `.npz` by name, without pickles.

    They are refused before they are unpacked if they take more memory than that. A few
    megabytes of zeros unpack to gigabytes, and a header may ask for more than its file
    holds: so what a member unpacks to counts, or what its header says, if that is more.
    """
    content = io.BytesIO(Path(path).read_bytes())

    # What would it take?
    needed = 0
    with zipfile.ZipFile(content) as archive:
        for member in archive.infolist():
            needed += max(member.file_size, _announced(archive, member))
    if needed > most_bytes:
        raise OtherKindError(
            f"it unpacks to {needed / 1e6:,.0f} MB,"
            f" and {most_bytes / 1e6:,.0f} MB are the most"
        )

    content.seek(0)
    with np.load(content, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def _announced(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> int:
    """Bytes that the header of an array asks for."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read_header = np.lib.format.read_array_header_2_0
        if version == (1, 0):
            read_header = np.lib.format.read_array_header_1_0
        shape, _, dtype = read_header(file)
    return math.prod(shape) * dtype.itemsize


def sha256(path: str | Path) -> str:
    """Hash of a file's content, 64 hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
