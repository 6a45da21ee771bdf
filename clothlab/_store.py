"""The files of `data/`: which folder they lie in, and whether each is what it was.

Three folders are possible. One is named, by an argument or by `CLOTHLAB_DATA`. Else it
is that of the clone that the package runs from. Who has no clone gets the files from
the network, each when it is first asked for, into a folder of the user's cache.

`SHA256SUMS` has the hash of every file, in the format of the command `sha256sum`. A
wheel carries a copy of it, by which pooch judges what it downloads.
"""

import os
from collections.abc import Mapping
from enum import StrEnum
from importlib.metadata import metadata
from pathlib import Path, PurePosixPath

import clothlab
from clothlab._files import reading, sha256, write_bytes
from clothlab._validation import check_name, choose

Folder = str | Path | None  # None: wherever `data_folder` finds it

CHECKSUMS = "SHA256SUMS"
# What a user records: not part of the repository, so without a hash
OWN_TRIALS = Path("trials") / "mine"
# Beyond the paper's amount: the repository has only their hashes
LEFT_OUT = "trials/*-more/*"
SUFFIXES = {".npz", ".safetensors", ".png", ".json", ".csv"}  # whose hash is recorded
_CLONE = Path(__file__).resolve().parents[1] / "data"
_PACKAGED = Path(__file__).with_name(CHECKSUMS)  # in a wheel only


class Verdict(StrEnum):
    """What is to be said of a file of `data/`."""

    OK = "ok"
    MISSING = "missing"
    ALTERED = "altered"
    NOT_RECORDED = "not recorded"
    # Not there, which is no fault
    LEFT_TO_MAKE = "left to `make data`"
    LEFT_TO_FETCH = "left to fetch"


def data_folder(data: Folder = None) -> Path:
    """The folder given, or the one that `CLOTHLAB_DATA` names, or that of the clone.

    Without all of these it is a folder of the cache, and files are fetched into it.
    """
    if data is None:
        data = os.environ.get("CLOTHLAB_DATA") or _own_folder()
    if not str(data) or not Path(data).is_dir():
        raise FileNotFoundError(
            f"no data in {str(data)!r}: clone the repository, which has a folder data/,"
            " and run from there, or set CLOTHLAB_DATA to that folder"
        )
    return Path(data)


def own_trials(data: Folder = None) -> Path:
    """Where a user's recordings are.

    It is the folder that `CLOTHLAB_RECORDINGS` names, or `trials/mine` of the data.
    """
    named = os.environ.get("CLOTHLAB_RECORDINGS")
    if named and data is None:
        return Path(named).expanduser()
    return data_folder(data) / OWN_TRIALS


def _own_folder() -> Path:
    """The clone's folder, or the cache's where the package came without a clone."""
    if _CLONE.is_dir() or not _PACKAGED.is_file():
        return _CLONE
    _cache().mkdir(parents=True, exist_ok=True)
    return _cache()


def _cache() -> Path:
    """Where fetched files are kept; another version may have other files."""
    import pooch  # only who has no clone waits for it

    return Path(pooch.os_cache("clothlab")) / clothlab.__version__


def is_cache(data: Path) -> bool:
    """Whether files of this folder are fetched when they are asked for."""
    return not _CLONE.is_dir() and _PACKAGED.is_file() and data == _cache()


def address() -> str:
    """Where files are fetched from: `CLOTHLAB_DATA_URL`, or the repository.

    The repository's address is the one under `[project.urls]` in `pyproject.toml`.
    """
    named = os.environ.get("CLOTHLAB_DATA_URL")
    if not named:
        lines = metadata("clothlab").get_all("Project-URL") or []
        urls = dict(line.split(", ", 1) for line in lines)
        named = f"{urls['Repository']}/raw/v{clothlab.__version__}/data"
    return named.rstrip("/") + "/"


def fetch(name: str, data: Path) -> None:
    """Bring a file into the cache, unless it lies there as it should.

    An altered file is a ValueError, no network a ConnectionError.
    """
    import pooch

    # pooch compares hashes before it downloads anything, and again afterwards.
    files = pooch.create(path=data, base_url=address(), registry=recorded(data))
    try:
        files.fetch(name)
    except OSError as error:
        raise ConnectionError(
            f"cannot fetch {name} from {address()} ({type(error).__name__}): go online,"
            " or set CLOTHLAB_DATA to the folder data/ of a clone"
        ) from error


def fetchable(part: str = "") -> list[str]:
    """Names of the files that can be fetched, or of those in a part of `data/`.

    A part is a folder or a file; a ValueError if there is nothing in it.
    """
    below = part.rstrip("/") + "/" if part else ""
    names = [
        name
        for name in recorded(data_folder())
        if f"{name}/".startswith(below) and not is_left_out(name)
    ]
    if not names:
        raise ValueError(f"nothing to fetch in {part!r}: name a part such as weights")
    return names


def recorded(data: Path) -> dict[str, str]:
    """Recorded hashes, `{file: hash}`."""
    path = _PACKAGED if is_cache(data) else data / CHECKSUMS
    hashes = {}
    with reading(path, "list of hashes"):
        lines = path.read_text().splitlines() if path.exists() else []
        for line in lines:
            digest, name = line.split("  ")
            hashes[name] = digest
    return hashes


def write_checksums(data: Folder = None) -> None:
    """Record the hash of every file in `data/`, in `data/SHA256SUMS`.

    What is left to `make data` keeps its own.
    """
    data = data_folder(data)
    hashes = {
        name: digest for name, digest in recorded(data).items() if is_left_out(name)
    }
    for name in _present(data):
        hashes[name] = sha256(data / name)
    _write_hashes(hashes, data)


def record_again(path: Path, data: Path) -> None:
    """Give a file that was overwritten its new hash, where it had one."""
    hashes = recorded(data)
    name = path.relative_to(data).as_posix()
    if name in hashes:
        hashes[name] = sha256(path)
        _write_hashes(hashes, data)


def _write_hashes(hashes: Mapping[str, str], data: Path) -> None:
    if is_cache(data):
        raise ValueError("fetched files keep their hashes: record new ones in a clone")
    lines = [f"{hashes[name]}  {name}\n" for name in sorted(hashes)]
    write_bytes(data / CHECKSUMS, "".join(lines).encode())


def check_data(data: Folder = None) -> dict[str, Verdict]:
    """Compare each file in `data/` with its hash, `{file: verdict}`."""
    data = data_folder(data)
    hashes = recorded(data)
    names = sorted({*hashes, *_present(data)})
    return {name: _verdict(data / name, hashes.get(name), data) for name in names}


def cure(name: str) -> str:
    """What brings back a file of `data/`, as an imperative."""
    if is_left_out(name):
        return "record it with `make data`"
    return f"restore it with `git checkout data/{name}`"


def is_left_out(name: str) -> bool:
    """Whether the repository leaves this file to `make data`."""
    return PurePosixPath(name).match(LEFT_OUT)


def checked(path: Path, data: Path) -> Path:
    """The path, if the file's content is the one whose hash was recorded.

    Where files are fetched, it is fetched first.
    """
    name = path.relative_to(data).as_posix()
    hashes = recorded(data)
    if is_cache(data) and name in hashes and not is_left_out(name):
        fetch(name, data)
        return path

    verdict = _verdict(path, hashes.get(name), data)
    if verdict in (Verdict.MISSING, Verdict.LEFT_TO_MAKE):
        raise ValueError(f"data/{name} is missing: {cure(name)}")
    if verdict is Verdict.ALTERED:
        raise ValueError(
            f"data/{name} is damaged or was altered: {cure(name)}, or record a change"
            " you made with `python -m clothlab checksums`"
        )
    return path


def _verdict(path: Path, digest: str | None, data: Path) -> Verdict:
    if not path.is_file():
        if is_left_out(path.relative_to(data).as_posix()):
            return Verdict.LEFT_TO_MAKE
        return Verdict.LEFT_TO_FETCH if is_cache(data) else Verdict.MISSING
    if digest is None:
        return Verdict.NOT_RECORDED
    return Verdict.OK if sha256(path) == digest else Verdict.ALTERED


def _present(data: Path) -> list[str]:
    """Files of the repository that are there."""
    own = data / OWN_TRIALS
    return [
        path.relative_to(data).as_posix()
        for path in data.rglob("*")
        if path.suffix in SUFFIXES and own not in path.parents and path.is_file()
    ]


def sets(kind: str, data: Path) -> dict[str, Path]:
    """The folders in `data/KIND`, those that are there and those that should be."""
    names = {path.name for path in (data / kind).glob("*") if path.is_dir()}
    for file in recorded(data):
        parts = file.split("/")
        if parts[0] == kind and len(parts) == 3:
            names.add(parts[1])
    return {name: data / kind / name for name in sorted(names)}


def listed(pattern: str, data: Path) -> dict[str, Path]:
    """The files that fit a pattern, those that are there and those that should be.

    Their names are what stands for the pattern's `*`.
    """
    start, end = pattern.split("*")
    there = [path for path in data.glob(pattern) if path.is_file()]
    files = {path.relative_to(data).as_posix() for path in there}
    for name in recorded(data):
        if name.startswith(start) and name.endswith(end):
            files.add(name)

    found = {}
    for name in sorted(files):
        inner = name[len(start) : len(name) - len(end)]
        if "/" not in inner:
            found[inner] = data / name
    return found


def find(kind: str, pattern: str, name: str, data: Folder) -> Path:
    """The file that fits a pattern with this name for its `*`."""
    data = data_folder(data)
    files = listed(pattern, data)
    path = choose(kind, name, files, "(none yet: run `make data train`)")
    return checked(path, data)


def save_results(
    content: bytes, name: str, suffix: str, *, data: Folder = None
) -> None:
    """Write `data/results/NAME SUFFIX`."""
    if suffix not in SUFFIXES:
        known = ", ".join(sorted(SUFFIXES))
        raise ValueError(f"results end in {known}, got {suffix!r}")
    data = data_folder(data)
    path = data / "results" / f"{check_name('result', name)}{suffix}"
    write_bytes(path, content)


def load_results(name: str, suffix: str, *, data: Folder = None) -> bytes:
    """The content of `data/results/NAME SUFFIX`."""
    return find("results", f"results/*{suffix}", name, data).read_bytes()
