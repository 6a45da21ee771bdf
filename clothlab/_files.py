"""Writing files so that an interruption loses nothing, and knowing whether a file is the one that was written."""

import hashlib
import os
import tempfile
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


def sha256(path: str | Path) -> str:
    """Hash of a file's content, 64 hexadecimal digits."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
