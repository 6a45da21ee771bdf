"""Work that takes hours is kept piece by piece, so that an interrupted experiment goes on where it stopped."""

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import clothlab
from clothlab import artifacts
from clothlab._files import sha256
from clothlab.experiments._record import converter

T = TypeVar("T")


def once(
    name: str, made_with: Mapping[str, Any], make: Callable[[], Any], *, folder: Path, files: Iterable[str] = ()
) -> Any:
    """Return what `make()` returned before, where that is kept and was made with the same; else call and keep.

    Args:
        name: of this piece of work, which is kept as `FOLDER/results/NAME.json`.
        made_with: whatever the answer depends on, as JSON has it; code is not known.
        make: does the work and returns what JSON has a word for.
        folder: where to keep; made where there is none.
        files: what `make` writes there beside its answer, by name or by pattern (`trials/train/*.npz`). If one of them
            is gone or altered, or another fits the pattern, the work is done again.

    Raises:
        TypeError: an answer, or something that it depends on, that JSON has no word for.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made_with = json.loads(json.dumps(made_with))
    kept = _read(name, folder)
    files = list(files)
    if kept.get("made_with") == made_with and kept.get("files") == hashes(folder, files):
        return kept["answer"]
    answer = json.loads(json.dumps(make()))  # the same now as when it is read again
    artifacts.save_results(
        {"made_with": made_with, "files": hashes(folder, files), "answer": answer}, name, data=folder
    )
    return answer


def piece(about: Iterable[Any], made_with: Mapping[str, Any], make: Callable[[], T], kind: type[T], folder: Path) -> T:
    """A part of a record, or what it was found to be before by the same code.

    Args:
        about: what tells it from the other parts, in words and numbers, from which it has its name.
        made_with: settings that it depends on.
        make: finds it.
        kind: class of the part.
        folder: where to keep.
    """
    name = re.sub(r"\W+", "-", " ".join(map(str, about))).strip("-")
    known = {**made_with, "version": version()}
    return converter.structure(once(name, known, lambda: converter.unstructure(make()), folder=folder), kind)


def _read(name: str, folder: Path) -> dict[str, Any]:
    try:
        return artifacts.load_results(name, data=folder)
    except (KeyError, ValueError):  # never made, or damaged: to be made
        return {}


def hashes(folder: Path, files: Iterable[str]) -> dict[str, str | None]:
    """Hash of each file of a folder, by name or by pattern; None for what is not there, or for what nothing fits."""
    found: dict[str, str | None] = {}
    for name in files:
        paths = sorted(path for path in folder.glob(name) if path.is_file())
        found |= {path.relative_to(folder).as_posix(): sha256(path) for path in paths}
        if not paths:
            found[name] = None
    return found


@cache
def code() -> str:
    """Hash of the package, as it is when somebody first asks."""
    digest = hashlib.sha256()
    for path in sorted(Path(clothlab.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def version() -> str:
    """Hash of the package and of the data's hashes, for work that must be done again when either changes."""
    recorded = artifacts.data_folder() / artifacts.CHECKSUMS
    hashed = recorded.read_bytes() if recorded.exists() else b""
    return hashlib.sha256(code().encode() + hashed).hexdigest()
