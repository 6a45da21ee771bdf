"""`make grades FOLDER=...`: the points of a class, and the checks' words for every student, as CSV.

FOLDER has a folder for each student, with notebooks under the names that they were handed out with, at any depth (such
as nbgrader's `submitted/STUDENT/ASSIGNMENT/NOTEBOOK.ipynb`). The checks of the installed package judge the functions in
them; what the notebooks' own cells print or say of themselves counts for nothing. Each exercise runs in a process of
its own, with limits on processor time and memory.
"""

import argparse
import ast
import contextlib
import io
import json
import os
import pickle
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping
from itertools import product
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from clothlab import checks

ROOT = Path(__file__).resolve().parents[1]
POINTS = ROOT / "docs" / "course" / "points.toml"
MESSAGE_BYTES = 20_000_000  # what an answer may return
SETTABLE = ("z_ref", "exploring")  # what exercises ask to set on an object that a check lends to an answer
WAIT = 10  # how many times its processor time an exercise may take by the clock, on a busy machine


class Sandbox:
    """Starts a process for each exercise, with limits; what the notebooks import is imported once.

    Where bubblewrap works (`isolated`), answers see no network, checks or solutions, and write into memory only.
    """

    def __init__(self, notebooks: list[Path], seconds: int = 60, megabytes: int = 1500):
        self.seconds, self.megabytes = seconds, megabytes
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        prefix, self._control = bubblewrap(), here
        self.isolated = bool(prefix)
        settings = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        settings["MPLCONFIGDIR"] = tempfile.gettempdir()
        worker = [sys.executable, str(ROOT / "scripts" / "sandbox_worker.py"), str(there.fileno()), imports(notebooks)]
        self._server = subprocess.Popen([*prefix, *worker], pass_fds=[there.fileno()], env=os.environ | settings)
        there.close()
        if self._control.recv(16) != b"ready":
            raise RuntimeError("the process in which answers run did not start; it says above why")

    def close(self) -> None:
        """End all processes."""
        self._control.close()
        self._server.wait()

    def judge(self, name: str, sources: list[str]) -> str:
        """What the check of this name says of the function in the sources; "correct" if nothing is wrong with it."""
        ours, theirs = socket.socketpair()
        socket.send_fds(self._control, [b"x"], [theirs.fileno()])
        theirs.close()
        try:
            with Connection(ours.detach()) as connection, contextlib.redirect_stdout(io.StringIO()):
                limits = self.seconds, self.megabytes
                getattr(checks, name)(Answer(connection, self.seconds).exchange((sources, name, *limits)))
        except checks.CheckFailed as failure:
            return f"Not yet: {failure}"
        finally:
            self._control.sendall(b"x")
            self._control.recv(16)
        return "correct"


def bubblewrap() -> list[str]:
    """The beginning of a command that runs in bubblewrap; empty where that does not work."""
    package = Path(checks.__file__).parents[1]
    hidden = [package / "checks", ROOT / "notebooks", ROOT / "build"]
    prefix = ["bwrap", "--unshare-all", "--as-pid-1", "--die-with-parent", "--ro-bind", "/", "/"]
    prefix += ["--dev", "/dev", "--proc", "/proc", "--tmpfs", tempfile.gettempdir()]
    for each in (package, Path(sys.prefix), ROOT):  # a tree below the temporary folder is hidden with it
        prefix += ["--ro-bind", str(each), str(each)]
    for each in filter(Path.exists, hidden):
        prefix += ["--tmpfs", str(each)]
    common = str(package / "checks" / "_check.py")
    prefix += ["--ro-bind", common, common]
    works = shutil.which("bwrap") and not subprocess.run([*prefix, "true"], capture_output=True).returncode
    return prefix if works else []


class Answer:
    """Functions that run elsewhere. Only numbers, arrays, words and functions get through."""

    def __init__(self, connection: Connection, seconds: int):
        self._connection, self._seconds, self._end = connection, seconds, time.monotonic() + WAIT * seconds
        self._lent: list[Any] = []

    def exchange(self, message: Any) -> Any:
        """What comes back, first the function itself, after all that it asks of what the check lent it."""
        try:
            self._send(message)
            while True:
                if not self._connection.poll(max(0, self._end - time.monotonic())):
                    raise EOFError
                kind, *said = json.loads(self._connection.recv_bytes(MESSAGE_BYTES))
                if kind == "result":
                    return self._decode(said[0])
                if kind == "failed":
                    raise checks.CheckFailed(str(said[0]))
                self._send(self._serve(kind, *said))
        except checks.CheckFailed:
            raise
        except (EOFError, OSError):
            words = f"no answer: it took more than {self._seconds} s or too much memory, or ended its process"
            raise checks.CheckFailed(words) from None
        except Exception as error:
            words = f"what it returned or called for can't be read: {type(error).__name__}: {error}"
            raise checks.CheckFailed(words) from None

    def _serve(self, kind: str, place: int, *said: Any) -> Any:
        if kind == "set" and said[0] in SETTABLE:
            return setattr(self._lent[place], said[0], self._decode(said[1]))
        args, kwargs = said
        return self._lent[place](*map(self._decode, args), **{name: self._decode(kwargs[name]) for name in kwargs})

    def _send(self, message: Any) -> None:
        buffer = io.BytesIO()
        writer = pickle.Pickler(buffer)
        writer.persistent_id = self._lend  # type: ignore[method-assign]
        writer.dump(message)
        self._connection.send_bytes(buffer.getvalue())

    def _lend(self, thing: Any) -> int | None:
        """The place of a function or of a check's own object, which stays here; None for what is sent as it is."""
        made_by = thing.__module__ if hasattr(thing, "__code__") else type(thing).__module__
        if isinstance(thing, type) or not callable(thing) or not str(made_by).startswith(checks.__name__):
            return None
        self._lent.append(thing)
        return len(self._lent) - 1

    def _decode(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._decode(part) for part in value]
        if not isinstance(value, dict):
            return value
        if "array" in value:
            return np.array(value["array"]).reshape(value["shape"])
        if "dict" in value:
            return {key: self._decode(part) for key, part in value["dict"]}
        if "lent" in value:
            return self._lent[value["lent"]]
        place = int(value["function"])
        return lambda *args, **kwargs: self.exchange((place, args, kwargs))


def exercises(cells: list[nbformat.NotebookNode]) -> list[str]:
    """Names of the functions that a notebook's stubs ask for, in order."""
    stubs = [ast.parse(cell.source).body for cell in cells if "stub" in cell.metadata.get("tags", [])]
    return [node.name for body in stubs for node in body if isinstance(node, ast.FunctionDef)]


def imports(notebooks: list[Path]) -> str:
    """The imports in the notebooks' cells."""
    cells = [cell for path in notebooks for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    nodes = [node for cell in cells for node in ast.parse(cell.source).body]
    return "\n".join({ast.unparse(node): None for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)})


def handed_in(student: Path, name: str) -> list[str]:
    """Sources of the code cells of the notebook of this name in a student's folder, without magics.

    Raises:
        ValueError: there is not exactly one, or it can't be read.
    """
    found = [path for path in student.rglob(name) if ".ipynb_checkpoints" not in path.parts and not path.is_symlink()]
    if len(found) != 1:
        raise ValueError(f"there are {len(found)} of {name}" if found else "not handed in")
    try:
        cells = nbformat.read(found[0], as_version=4).cells
        sources = [cell.source for cell in cells if cell.cell_type == "code"]
    except Exception as error:
        raise ValueError(f"{name} is no notebook that can be read: {type(error).__name__}") from None
    return [re.sub(r"^[%!].*", "", source, flags=re.MULTILINE) for source in sources]


def grade(sandbox: Sandbox, folder: Path, notebooks: list[Path], points: Mapping[str, int]) -> pd.DataFrame:
    """A row for each exercise of each student; exercises that are not in `points` count 1.

    Raises:
        ValueError: there is no folder of a student.
    """
    if not (students := sorted(path for path in folder.glob("[!.]*") if path.is_dir())):
        raise ValueError(f"{folder} has no folder of a student")
    asked = {path: exercises(nbformat.read(path, as_version=4).cells) for path in notebooks}
    rows = []
    for student, (path, names) in tqdm(list(product(students, asked.items())), unit="notebook"):
        try:
            sources = handed_in(student, path.name)
            words = [sandbox.judge(name, sources) for name in names]
        except ValueError as error:
            words = [str(error)] * len(names)
        for name, said in zip(names, words, strict=True):
            most = points.get(name, 1)
            rows.append((plain(student.name), path.stem, name, most * (said == "correct"), most, plain(said)))
    return pd.DataFrame(rows, columns=["student", "notebook", "exercise", "points", "most", "words"])


def plain(text: str) -> str:
    """A text on one line, which no spreadsheet takes for a formula."""
    line = " ".join(text.split())[:500]
    return f"'{line}" if line.startswith(("=", "+", "-", "@")) else line


def totals(grades: pd.DataFrame) -> pd.DataFrame:
    """A row for each student, with the points of each notebook and their sum."""
    points = grades.pivot_table(index="student", columns="notebook", values="points", aggfunc="sum")
    return points.join(grades.groupby("student")[["points", "most"]].sum())


def main() -> None:
    """Grade the class in a folder, and write `grades.csv` and `totals.csv` beside its students."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="with a folder for each student")
    parser.add_argument("--only", nargs="+", choices=notebooks, default=list(notebooks), help="numbers of notebooks")
    arguments = parser.parse_args()
    chosen = [notebooks[number] for number in arguments.only]
    with contextlib.closing(Sandbox(chosen)) as sandbox:
        if not sandbox.isolated:
            print("answers run with limits on time and memory only: install bubblewrap to keep them from your files")
        grades = grade(sandbox, arguments.folder, chosen, tomllib.loads(POINTS.read_text("utf-8")))
    grades.to_csv(arguments.folder / "grades.csv", index=False)
    totals(grades).to_csv(arguments.folder / "totals.csv")
    print(f"{arguments.folder}: grades.csv, totals.csv")


if __name__ == "__main__":
    main()
