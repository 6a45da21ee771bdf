"""What lies in `data/`, by its name: trials, weights, targets and tables of results.

`load("torque-0")` gives all that belongs together. Each file is compared with its hash
in `data/SHA256SUMS` before it is read; one that is missing is fetched from the
repository, where that can be reached. An unknown name is a KeyError that lists the
choices; a file that is missing or altered is a ValueError that names it, and what
brings it back.
"""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import metadata
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd
import pooch

import clothlab
from clothlab import weights
from clothlab._files import reading, write_bytes
from clothlab._validation import choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.simulation.vision import mask_from_file
from clothlab.trials import Trial, load_trial
from clothlab.weights import SUFFIX, Checkpoint, ClothCheckpoint

Folder = str | Path | None  # None: wherever `data_folder` finds it

CHECKSUMS = "SHA256SUMS"
# What a user records: not part of the repository, so without a hash
OWN_TRIALS = "trials/mine"
# Beyond the paper's amount: the repository has only their hashes
LEFT_OUT = "trials/*-more/*"
_MODELS = f"weights/model-*{SUFFIX}"
_AUTOENCODERS = f"weights/autoencoder-*{SUFFIX}"
_TABLES = "results/*.csv"
# All that has a hash
_RECORDED = [_MODELS, _AUTOENCODERS, _TABLES]
_RECORDED += ["trials/*/*.npz", "targets/*.png", "targets/*/*.png"]
_CLONE = Path(__file__).resolve().parents[1] / "data"
_PACKAGED = Path(__file__).with_name(CHECKSUMS)  # in a wheel only


def load(name: str | Path = "torque-0") -> ClothCheckpoint:
    """Load arm, autoencoder, model and p of each cloth together.

    Either by name from `data/`, where `torque-0` to `torque-4` differ in their seed, or
    by the path of a file that `ClothCheckpoint.save` wrote, which ends in
    `.safetensors`.
    """
    if isinstance(name, Path) or str(name).endswith(SUFFIX):
        return ClothCheckpoint.load(name)

    # A model is nothing without the autoencoder whose z it was trained on
    about, tensors = weights.read_tensors(_find("model weights", _MODELS, name))
    if "autoencoder" not in about:
        raise ValueError(f"{name} is no model of a cloth: `load_model` reads it")
    shared = about["autoencoder_name"]
    _, layers = weights.read_tensors(
        _find("autoencoder weights", _AUTOENCODERS, shared)
    )
    loaded = ClothCheckpoint.from_contents(about, layers | tensors)
    if weights.fingerprint(loaded.autoencoder) != about["autoencoder"]:
        raise ValueError(
            f"the weights {name!r} were trained with another autoencoder than the"
            f" {shared!r} that lies here: train them again with `make train`, or "
            f"{_remedy(_AUTOENCODERS.replace('*', shared), data_folder())}"
        )
    return loaded


def load_model(name: str) -> Checkpoint:
    """Load a model without arm and autoencoder, and p of each material."""
    return Checkpoint.load(_find("model weights", _MODELS, name))


def load_autoencoder(name: str = "torque") -> tuple[Autoencoder, np.ndarray]:
    """Load an autoencoder, in evaluation mode, and its loss curve.

    The curve is the training's loss of each epoch `[epochs]` [nat per pixel].
    """
    return weights.load_autoencoder(_find("autoencoder weights", _AUTOENCODERS, name))


def load_trials(name: str) -> list[Trial]:
    """Load a set of recorded trials, in the order of their file names.

    `"train"` and `"evaluation"` are the torque arm's; `"mine"` is what you recorded in
    the live lab, perhaps nothing yet. Sets that end in `-more` are not part of the
    repository: `make data` records them.
    """
    if name == "mine":
        # Without what a Mac writes beside the files of a ZIP, such as ._swing.npz
        return [load_trial(path) for path in sorted(own_trials().glob("[!.]*.npz"))]
    data = data_folder()
    sets = [*_sets("trials", data), "mine"]
    choose("trials", name, dict.fromkeys(sets))
    files = _by_name(f"trials/{name}/*.npz", data).values()
    return [load_trial(_checked(file, data)) for file in files]


def own_trials() -> Path:
    """Where your recordings are.

    It is the folder that `CLOTHLAB_RECORDINGS` names, or `trials/mine` of the data.
    """
    named = os.environ.get("CLOTHLAB_RECORDINGS")
    return Path(named).expanduser() if named else data_folder() / OWN_TRIALS


@contextmanager
def recording_into(folder: Path) -> Iterator[None]:
    """Make a folder for recordings, and write into it.

    An OSError says which variable names another one.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except FileExistsError:
        raise
    except OSError as error:
        raise OSError(
            f"cannot write into {folder} ({error.strerror}): set CLOTHLAB_RECORDINGS "
            "to a folder of yours, as in `CLOTHLAB_RECORDINGS=~/recordings make lab`"
        ) from error


def load_targets(name: str | None = None) -> dict[str, np.ndarray]:
    """Load a set of target masks `[H, W]`, bool, by their names.

    The set is `"held-out"`, `"drawn"` or `"development"`; without a name, the targets
    that are in none.
    """
    data = data_folder()
    within = ""
    if name is not None:
        choose("set of targets", name, dict.fromkeys(_sets("targets", data)))
        within = f"{name}/"
    names = _by_name(f"targets/{within}*.png", data)
    return {within + own: load_target(within + own) for own in names}


def load_target(name: str) -> np.ndarray:
    """Load a target mask `[H, W]`, bool: `"target-1"`, or of a set, `"drawn/bar"`."""
    within, slash, own = name.rpartition("/")
    path = _find("target", f"targets/{within}{slash}*.png", own)
    with reading(path, "target"):
        return mask_from_file(path.read_bytes())


def load_table(name: str, *, data: Folder = None) -> pd.DataFrame:
    """Load a stored table of results: one row a case, arrays as NumPy arrays.

    It lies in `data/results`, of another folder than `data_folder()` if one is given.
    """
    path = _find("results", _TABLES, name, data)
    table = pd.read_csv(path, keep_default_na=False, na_values=[""])
    for column in table.columns[table.dtypes == "str"]:
        if table[column].str.startswith("[").any():
            table[column] = table[column].map(_as_array, na_action="ignore")
    return table


def save_table(table: pd.DataFrame, name: str, *, data: Folder = None) -> None:
    """Write a table as `data/results/NAME.csv`, with arrays as JSON."""
    text = table.map(_as_text).to_csv(index=False)
    write_bytes(data_folder(data) / "results" / f"{name}.csv", text.encode())


def data_folder(data: Folder = None) -> Path:
    """The folder given, or the one that `CLOTHLAB_DATA` names, or that of the clone.

    Without all of these it is one of the user's cache, into which files are fetched.
    """
    data = Path(data or os.environ.get("CLOTHLAB_DATA") or _usual_folder())
    if not data.is_dir():
        raise FileNotFoundError(
            f"no data in {str(data)!r}: clone the repository, which has a folder data/,"
            " and run from there, or set CLOTHLAB_DATA to that folder"
        )
    return data


def _usual_folder() -> Path:
    if not _PACKAGED.is_file():
        return _CLONE
    # Another version may have other files
    cache = Path(pooch.os_cache("clothlab")) / clothlab.__version__
    cache.mkdir(parents=True, exist_ok=True)
    return cache


def recorded(data: Path) -> dict[str, str]:
    """Recorded hashes, `{file: hash}`, as the command `sha256sum` writes them."""
    path = data / CHECKSUMS
    if not path.is_file():
        path = _PACKAGED
    lines = path.read_text("utf-8").splitlines() if path.is_file() else []
    pairs = [line.split("  ", 1) for line in lines]
    return {name: digest for digest, name in pairs}


def write_checksums(data: Folder = None) -> None:
    """Record the hash of every file in `data/`.

    What is left to `make data` keeps its own where it is not there.
    """
    data = data_folder(data)
    hashes = {name: each for name, each in recorded(data).items() if _is_left_out(name)}
    for pattern in _RECORDED:
        for name in _present(pattern, data):
            if not name.startswith(OWN_TRIALS):
                hashes[name] = pooch.file_hash(str(data / name))
    lines = [f"{hashes[name]}  {name}\n" for name in sorted(hashes)]
    write_bytes(data / CHECKSUMS, "".join(lines).encode())


def faults() -> list[str]:
    """A sentence for each file of `data/` that is not there as it was recorded.

    What `make data` makes, or what is fetched when it is asked for, may be missing.
    """
    data = data_folder()
    found = []
    for name in recorded(data):
        expected = not (_PACKAGED.is_file() or _is_left_out(name))
        if expected or (data / name).is_file():
            found.append(_fault(name, data))
    return [sentence for sentence in found if sentence]


def _find(kind: str, pattern: str, name: str, data: Folder = None) -> Path:
    """The file that fits a pattern with this name for its `*`, as it was recorded."""
    data = data_folder(data)
    file = choose(
        kind, name, _by_name(pattern, data), "(none yet: run `make data train`)"
    )
    return _checked(file, data)


def _checked(name: str, data: Path) -> Path:
    """The path of a file, once its content is the one whose hash was recorded."""
    error = None if (data / name).is_file() else _fetch(name, data)
    fault = _fault(name, data)
    if fault:
        raise ValueError(fault) from error
    return data / name


def _fault(name: str, data: Path) -> str:
    """What is wrong with a file, and what to do; nothing if it is as recorded."""
    if not (data / name).is_file():
        return f"data/{name} is missing: {_remedy(name, data)}"
    digest = recorded(data).get(name)
    if digest is None or pooch.file_hash(str(data / name)) == digest:
        return ""
    return (
        f"data/{name} is damaged or was altered: {_remedy(name, data)}, or record a "
        "change that you made by `make checksums`"
    )


def _remedy(name: str, data: Path) -> str:
    """What brings back a file here, as an imperative."""
    if _is_left_out(name):
        return "record it with `make data`"
    if (data.parent / ".git").exists():
        return f"restore it with `git checkout data/{name}`"
    if not _address():
        return "copy it from a clone, or set CLOTHLAB_DATA to its folder data/"
    return f"download it from {_address()}{name}"


def _fetch(name: str, data: Path) -> Exception | None:
    """Download a file, if the repository is known; return what went wrong."""
    if _is_left_out(name) or not _address():
        return None
    # Pooch compares its hash before it lies there under its name
    files = pooch.create(path=data, base_url=_address(), registry=recorded(data))
    try:
        files.fetch(name)
    except (OSError, ValueError) as error:
        return error
    return None


def _address() -> str:
    """Where files are fetched from: `CLOTHLAB_DATA_URL`, or the repository's release.

    The repository's address is the one under `[project.urls]` in `pyproject.toml`.
    """
    address = os.environ.get("CLOTHLAB_DATA_URL", "")
    if not address:
        lines = metadata("clothlab").get_all("Project-URL") or []
        urls = dict(line.split(", ", 1) for line in lines)
        if urls.get("Repository"):  # empty until it is published
            address = f"{urls['Repository']}/raw/v{clothlab.__version__}/data"
    return f"{address.rstrip('/')}/" if address else ""


def _is_left_out(name: str) -> bool:
    """Whether the repository leaves this file to `make data`."""
    return PurePosixPath(name).match(LEFT_OUT)


def _present(pattern: str, data: Path) -> list[str]:
    """The files that fit a pattern, but those in hidden folders of other programs."""
    names = [path.relative_to(data).as_posix() for path in data.glob(pattern)]
    return [name for name in names if "/." not in name]


def _by_name(pattern: str, data: Path) -> dict[str, str]:
    """The files that fit a pattern, those that are there and those that should be.

    Their names are what stands for the pattern's `*`.
    """
    there = {*_present(pattern, data)}
    there |= {name for name in recorded(data) if PurePosixPath(name).match(pattern)}
    start, end = pattern.split("*")
    return {file.removeprefix(start).removesuffix(end): file for file in sorted(there)}


def _sets(kind: str, data: Path) -> list[str]:
    """The folders in `data/KIND`, those that are there and those that should be."""
    files = {*_present(f"{kind}/*/*", data), *recorded(data)}
    parts = [file.split("/") for file in files]
    return sorted({each[1] for each in parts if each[0] == kind and len(each) == 3})


def _as_text(value: Any) -> Any:
    """An array, or a list of numbers, as JSON; all else as it is."""
    if not isinstance(value, np.ndarray | list | tuple):
        return value
    array = np.asarray(value)
    if array.dtype == np.float32:
        # By way of text, it keeps the few digits that it has: 0.1, not 0.10000000149
        array = array.astype(str).astype(float)
    return json.dumps(array.tolist())


def _as_array(text: str) -> np.ndarray:
    return np.asarray(json.loads(text))
