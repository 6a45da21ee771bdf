"""Files that an interruption does not spoil, and that say so if something else did."""

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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

    It is of another kind, or of another version.
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


def sha256(path: str | Path) -> str:
    """Hash of a file's content, 64 hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
