"""Files in which logs lie."""

import csv
import importlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np


def log_files(files: str | Path | Iterable[str | Path]) -> list[Path]:
    """The files of a folder or a pattern, in order of names, or of a list, in its own.

    A FileNotFoundError if there are none, a ValueError names one of another kind.
    """
    # What was asked for
    if not isinstance(files, str | Path):
        paths = [Path(each) for each in files]
    elif Path(files).is_dir():
        every = sorted(Path(files).rglob("*"))
        paths = [path for path in every if path.suffix in _READERS]
    else:
        pattern = Path(files)
        root = Path(pattern.anchor or ".")
        paths = sorted(root.glob(str(pattern.relative_to(pattern.anchor))))

    # Whether it can be read
    kinds = " or ".join(_READERS)
    if not paths:
        raise FileNotFoundError(f"no {kinds} file is there: {str(files)!r}")
    for path in paths:
        if path.suffix not in _READERS:
            raise ValueError(
                f"{path} is no log that can be read here, whose name ends in {kinds}: "
                "read it yourself, and give the table to runs_from_dataframe"
            )
    return paths


def read_file(path: Path) -> Any:
    """The columns of a file; a ValueError names one that can't be read."""
    try:
        return _READERS[path.suffix](path)
    except (FileNotFoundError, ModuleNotFoundError):
        raise
    except Exception as error:
        raise ValueError(f"{path} is damaged or holds no table: {error}") from error


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    """Columns of a file with names in its first line, as the words that it has."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        # Of what can stand between columns, the first line has one kind.
        first = file.readline()
        between = max(",;\t", key=first.count)
        file.seek(0)
        lines = [line for line in csv.reader(file, delimiter=between) if line]
    if not lines:
        raise ValueError("it is empty")
    names = [name.strip() for name in lines[0]]
    for row, line in enumerate(lines[1:]):
        if len(line) != len(names):
            raise ValueError(
                f"row {row} (counted from 0) has {len(line)} values, the first line "
                f"names {len(names)} columns"
            )

    # Nothing between two commas is a number that is missing.
    words = np.array(lines[1:], dtype=object).reshape(-1, len(names))
    words[words == ""] = "nan"
    return {name: words[:, k].astype(str) for k, name in enumerate(names)}


def read_parquet(path: Path, columns: list[str] | None = None) -> Any:
    """A PyArrow table, of all columns or of some.

    A ModuleNotFoundError says what to install.
    """
    try:
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"reading {path.name} needs pyarrow: pip install pyarrow", name="pyarrow"
        ) from error
    return parquet.read_table(path, columns=columns)


_READERS: dict[str, Callable[[Path], Any]] = {
    ".csv": _read_csv,
    ".parquet": read_parquet,
}
