"""Files that an interruption does not spoil, and that say so if something else did."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def write_bytes(path: str | Path, content: bytes, *, new: bool = False) -> None:
    """Write a file whole or not at all.

    An OSError names the file that could not be written. A `new` one is a
    FileExistsError where there is a file of this name: of two who write it at the same
    time, one gets it.
    """
    # A link stays one: what it leads to is written
    path = Path(path).resolve()
    # In the same folder, because a rename is atomic only within one file system; with
    # an ending that no loader looks for
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)

        # On the disk, not on its way there, before it takes the other's name
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())

        # With the other's permissions, where there is one and the file system has any
        with contextlib.suppress(OSError):
            shutil.copymode(path, temporary)
        if new:
            path.touch(exist_ok=False)
        temporary.replace(path)
    except OSError as error:
        reason = f"cannot write this file ({error.strerror})"
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


@contextmanager
def reading(path: str | Path, kind: str) -> Iterator[None]:
    """Turn whatever goes wrong while a file is read into a ValueError that names it.

    A missing one stays missing.
    """
    try:
        yield
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path} is damaged or holds no {kind}: {error}") from error
