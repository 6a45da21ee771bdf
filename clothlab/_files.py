"""Writing files so that an interruption loses nothing, and knowing whether a file is the one that was written."""

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LEFT_OVER = ".part"  # ending of a temporary file, which no loader looks for


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


def sha256(path: str | Path) -> str:
    """Hash of a file's content, 64 hexadecimal digits."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
