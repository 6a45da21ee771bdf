"""`make grades FOLDER=...`: the points of a class, and the checks' words for every student, as CSV.

FOLDER has a folder for each student, with notebooks under the names that they were handed out with, at any depth (such
as nbgrader's `submitted/STUDENT/ASSIGNMENT/NOTEBOOK.ipynb`). The checks of the installed package judge the functions in
them; what the notebooks' own cells print or say of themselves counts for nothing. An exercise that is left as it is
counts 0. Each exercise runs in a process of its own, with limits on time and memory (`docs/course/weeks.toml`).
"""

import argparse
import ast
import contextlib
import io
import json
import os
import pickle
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import tomllib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pandas as pd
from make_course import Lesson, read_lesson
from sandbox_worker import SETTABLE
from tqdm.auto import tqdm

from clothlab import checks

ROOT = Path(__file__).resolve().parents[1]
MESSAGE_BYTES = 20_000_000  # what an answer may return
ISOLATED = "answers run in bubblewrap: no network, no files but a temporary folder"
NOT_ISOLATED = "answers run with limits on time, memory and files only: install bubblewrap to keep them from your files"
NOTEBOOK_BYTES = 50_000_000  # a notebook that is larger is not read
DTYPES = {name: np.dtype(name) for name in ("bool", "float16", "float32", "float64")} | {
    f"{sign}int{bits}": np.dtype(f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)
}


@dataclass(frozen=True)
class Limits:
    """What a notebook's exercises may take together.

    Attributes:
        seconds: [s] of waiting for answers, shared evenly among its exercises.
        memory: [MB] beyond what the packages take.
    """

    seconds: int = 120
    memory: int = 1000


@dataclass(frozen=True)
class Grade:
    """A row of the table.

    Attributes:
        student: name of the folder.
        notebook: its name.
        exercise: the function's name.
        points: what it counted.
        most: what it could.
        words: of the check.
    """

    student: str
    notebook: str
    exercise: str
    points: int
    most: int
    words: str


class Odd:
    """Something that an answer returned and that is neither numbers nor a function; shown in its words."""

    def __init__(self, words: str):
        self.words = words[:80]

    def __repr__(self) -> str:
        return self.words


class Sandbox:
    """Starts processes in which answers run; to be used in a `with`.

    Where bubblewrap works, they see no network, can write into one temporary folder only, and find neither checks nor
    solutions. Elsewhere limits on time, memory and files are all there is, and `isolated` is False.

    Args:
        modules: what the server imports before it forks, so that no process has to.
    """

    def __init__(self, modules: list[str]):
        self._folder = tempfile.TemporaryDirectory(prefix="clothlab-")
        self._modules, self._prefix = json.dumps(modules), bubblewrap(self._folder.name)
        self.isolated = bool(self._prefix)
        self._start()

    def _start(self) -> None:
        self._here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        worker = str(ROOT / "scripts" / "sandbox_worker.py")
        command = [*self._prefix, sys.executable, worker, str(there.fileno()), self._modules]
        settings = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        settings["MPLCONFIGDIR"] = self._folder.name
        self._server = subprocess.Popen(command, pass_fds=[there.fileno()], env=os.environ | settings)
        there.close()
        if self._here.recv(16) != b"ready":
            raise RuntimeError("the process in which answers run did not start; it says above why")

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *_: object) -> None:
        self._here.close()
        self._server.wait()
        self._folder.cleanup()

    def judge(self, name: str, sources: list[str], seconds: int, memory: int) -> str:
        """What the check of this name says of the function in the sources; "correct" if nothing is wrong with it."""
        with tempfile.TemporaryDirectory(dir=self._folder.name) as folder:
            ours, theirs = socket.socketpair()
            request = {"folder": folder, "seconds": seconds, "memory": memory * 1_000_000}
            pid = self._fork(json.dumps(request).encode(), theirs)
            theirs.close()
            answer = Answer(Connection(ours.detach()), name, partial(self._end, pid), seconds)
            try:
                answer.define(sources)
                with contextlib.redirect_stdout(io.StringIO()) as said:
                    getattr(checks, name)(answer)
                return said.getvalue().strip()
            except checks.CheckFailed as failure:
                return str(failure)
            except Exception as error:
                return f"the check itself failed, tell your teacher: {type(error).__name__}: {error}"
            finally:
                answer.end()

    def _fork(self, request: bytes, theirs: socket.socket) -> int:
        """The process that a request started; an answer before it may have ended the server, which then starts anew."""
        for _ in range(2):
            with contextlib.suppress(OSError):
                socket.send_fds(self._here, [request], [theirs.fileno()])
                if pid := self._here.recv(16):
                    return int(pid)
            self._here.close()
            self._server.wait()
            self._start()
        raise RuntimeError("the process in which answers run ends at once")

    def _end(self, pid: int) -> None:
        with contextlib.suppress(OSError):
            self._here.sendall(json.dumps({"end": pid}).encode())


def bubblewrap(folder: str) -> list[str]:
    """The beginning of a command that runs in bubblewrap and writes into one folder; empty where that does not work."""
    package = Path(checks.__file__).parents[1]
    hidden = [package / "checks", ROOT / "notebooks", ROOT / "build"]
    prefix = ["bwrap", "--unshare-all", "--die-with-parent", "--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc"]
    prefix += ["--tmpfs", "/tmp"]
    for each in (package, Path(sys.prefix), ROOT):  # a tree below /tmp is hidden with it
        prefix += ["--ro-bind", str(each), str(each)]
    for each in filter(Path.exists, hidden):
        prefix += ["--tmpfs", str(each)]
    common = str(package / "checks" / "_check.py")
    prefix += ["--ro-bind", common, common, "--bind", folder, folder]
    works = shutil.which("bwrap") and not subprocess.run([*prefix, "true"], capture_output=True).returncode
    return prefix if works else []


class Answer:
    """A function that runs elsewhere. It may say what it likes: only numbers, arrays, words and functions get through.

    Args:
        connection: to the process.
        name: of the function.
        end_process: ends the process.
        seconds: [s] until the process is ended.
    """

    def __init__(self, connection: Connection, name: str, end_process: Callable[[], None], seconds: int):
        self._connection, self._name, self._end_process, self._seconds = connection, name, end_process, seconds
        self._lent: list[Any] = []
        self._late = False
        self._clock = threading.Timer(seconds, self._stop)
        self._clock.daemon = True
        self._clock.start()

    def define(self, sources: list[str]) -> None:
        """Let the process define its functions.

        Raises:
            CheckFailed: this one is not among them.
        """
        self._send((sources, self._name))
        kind, words = self._receive()
        if kind != "ready":
            raise checks.CheckFailed(str(words))

    def end(self) -> None:
        """End the process."""
        self._clock.cancel()
        self._clock.join()
        if not self._late:
            self._end_process()
        self._connection.close()

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._ask(0, self._name, args, kwargs)

    def _ask(self, place: int, name: str, args: tuple, kwargs: dict) -> Any:
        self._send((place, args, kwargs))
        while True:
            kind, *said = self._receive()
            if kind == "result":
                return self._decode(said[0])
            if kind == "error":
                raise checks.CheckFailed(f"{name} raised {said[0]}")
            if kind == "changed":
                raise checks.CheckFailed(f"{name} changes its argument `{said[0]}` in place: work on a copy")
            self._serve(kind, said)

    def _serve(self, kind: str, said: list[Any]) -> None:
        """Do what the answer asks of something that the check lent it."""
        try:
            thing = self._lent[said[0]]
            if kind == "set" and said[1] in SETTABLE and hasattr(thing, said[1]):
                self._send(("done", setattr(thing, said[1], self._decode(said[2]))))
                return
            args, kwargs = map(self._decode, said[1]), {key: self._decode(value) for key, value in said[2].items()}
            found = thing(*args, **kwargs)
        except checks.CheckFailed:
            raise
        except Exception as error:
            self._send(("raised", (type(error).__name__, str(error))))
        else:
            self._send(("done", found))

    def _send(self, message: Any) -> None:
        buffer = io.BytesIO()
        writer = pickle.Pickler(buffer)
        writer.persistent_id = self._lend  # type: ignore[method-assign]
        writer.dump(message)
        try:
            self._connection.send_bytes(buffer.getvalue())
        except OSError:
            raise checks.CheckFailed(self._why()) from None

    def _lend(self, thing: Any) -> int | None:
        """The place of a function or of a check's own object, which stays here; None for what is sent as it is."""
        made_by = thing.__module__ if hasattr(thing, "__code__") else type(thing).__module__
        if isinstance(thing, type) or not callable(thing) or not str(made_by).startswith(checks.__name__):
            return None
        self._lent.append(thing)
        return len(self._lent) - 1

    def _receive(self) -> list[Any]:
        try:
            message = json.loads(self._connection.recv_bytes(MESSAGE_BYTES))
        except (EOFError, OSError):
            raise checks.CheckFailed(self._why()) from None
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, list) or len(message) < 2 or not isinstance(message[0], str):
            raise checks.CheckFailed(f"{self._name} returned something that can't be read")
        return message

    def _decode(self, value: Any) -> Any:
        try:
            if not isinstance(value, dict):
                return value
            if "array" in value:
                return np.array(value["array"], DTYPES[value["dtype"]]).reshape(value["shape"])
            for kind in (list, tuple):
                if kind.__name__ in value:
                    return kind(map(self._decode, value[kind.__name__]))
            if "lent" in value:
                return self._lent[value["lent"]]
            if "function" in value:
                place, name = int(value["function"]), f"the policy of {self._name}"
                return lambda *args, **kwargs: self._ask(place, name, args, kwargs)
            return Odd(str(value["odd"]))
        except (KeyError, ValueError, TypeError, IndexError, OverflowError, RecursionError):
            raise checks.CheckFailed(f"{self._name} returned something that can't be read") from None

    def _stop(self) -> None:
        self._late = True
        self._end_process()

    def _why(self) -> str:
        if self._late:
            return f"{self._name} took longer than the {self._seconds} s that it has"
        return f"{self._name} ended its process: too much memory or time, or it asked for the end"


def modules_of(paths: list[Path]) -> list[str]:
    """What the notebooks import, without the checks."""
    found: set[str] = set()
    for path in paths:
        for cell in nbformat.read(path, as_version=4).cells:
            for node in ast.parse(cell.source).body if cell.cell_type == "code" else []:
                if isinstance(node, ast.Import):
                    found |= {alias.name for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module:
                    package = node.module == "clothlab"
                    found |= {f"clothlab.{each.name}" for each in node.names} if package else {node.module}
    return sorted(each for each in found if not each.startswith("clothlab.checks"))


def cells_of(path: Path) -> list[str]:
    """Sources of a submission's code cells.

    Raises:
        ValueError: it is no notebook.
    """
    try:
        if path.stat().st_size > NOTEBOOK_BYTES:
            raise ValueError("too large")
        cells = json.loads(path.read_text("utf-8"))["cells"]
        sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"{path.name} is no notebook that can be read: {type(error).__name__}") from None
    return ["\n".join("" if line.startswith(("%", "!")) else line for line in each.splitlines()) for each in sources]


def grade(sandbox: Sandbox, folder: Path, lessons: dict[str, Path], plan: dict, progress: bool = False) -> list[Grade]:
    """Grade a class.

    Args:
        sandbox: where answers run.
        folder: with a folder for each student.
        lessons: the notebooks to grade, as they were written, by their names.
        plan: of `weeks.toml`: `points` and `limits`.
        progress: show a bar.

    Raises:
        ValueError: there is no submission.
    """
    students = sorted(each for each in folder.iterdir() if each.is_dir() and not each.name.startswith("."))
    if not students:
        raise ValueError(f"{folder} has no folder of a student")
    read = {name: read_lesson(path, plan.get("points", {})) for name, path in lessons.items()}
    grades = []
    for student in tqdm(students, unit="student", disable=not progress):
        for name, lesson in read.items():
            limits = Limits(**plan.get("limits", {}).get(name[:2], {}))
            grades += _of_notebook(sandbox, student, name, lesson, limits)
    return grades


def _of_notebook(sandbox: Sandbox, student: Path, name: str, lesson: Lesson, limits: Limits) -> list[Grade]:
    found = sorted(path for path in student.rglob(f"{name}.ipynb") if ".ipynb_checkpoints" not in path.parts)
    words, sources = "", None
    try:
        sources = cells_of(found[0]) if len(found) == 1 and not found[0].is_symlink() else None
        words = f"there are {len(found)} of {name}.ipynb" if len(found) > 1 else "not handed in"
    except ValueError as error:
        words = str(error)
    share = max(1, limits.seconds // len(lesson.functions))
    grades = []
    for exercise, most in zip(lesson.functions, lesson.points, strict=True):
        if sources is not None:
            words = sandbox.judge(exercise, sources, share, limits.memory)
        grades.append(Grade(student.name, name, exercise, most * (words == "correct"), most, words))
    return grades


def table(grades: list[Grade]) -> pd.DataFrame:
    """Every exercise of every student."""
    return pd.DataFrame([asdict(each) for each in grades]).map(_plain)


def totals(grades: list[Grade]) -> pd.DataFrame:
    """A row for each student, with the points of each notebook and their sum."""
    rows = pd.DataFrame([asdict(each) for each in grades])
    points = rows.pivot_table(index="student", columns="notebook", values="points", aggfunc="sum")
    both = rows.groupby("student")[["points", "most"]].sum()
    return points.join(both).rename(index=_plain).rename_axis("student")


def _plain(value: Any) -> Any:
    """A cell that no spreadsheet takes for a formula."""
    if not isinstance(value, str):
        return value
    value = " ".join(value.split())[:500]
    return f"'{value}" if value.startswith(("=", "+", "-", "@")) else value


def keep_in_gradebook(grades: list[Grade], database: str, open_gradebook: Callable) -> None:
    """Write the points into nbgrader's gradebook, where its Formgrader and `nbgrader export` find them.

    Args:
        grades: of a class.
        database: its address, such as `sqlite:///gradebook.db`.
        open_gradebook: `nbgrader.api.Gradebook`.
    """
    with open_gradebook(database) as book, book.db.no_autoflush:
        for each in grades:
            name = each.notebook
            book.update_or_create_assignment(name)
            book.update_or_create_notebook(name, name)
            book.update_or_create_grade_cell(each.exercise, name, name, max_score=each.most, cell_type="code")
        for each in grades:
            book.update_or_create_student(each.student)
            book.update_or_create_submission(each.notebook, each.student)
            found = book.find_grade(each.exercise, each.notebook, each.notebook, each.student)
            found.auto_score, found.needs_manual_grade = each.points, False
        book.db.commit()


def main() -> None:
    """Grade the class in a folder, and write `grades.csv` and `totals.csv` beside its students."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="with a folder for each student")
    parser.add_argument("--only", nargs="+", choices=notebooks, default=list(notebooks), help="numbers of notebooks")
    parser.add_argument(
        "--gradebook", help="nbgrader's, too, such as sqlite:///gradebook.db; nbgrader must be installed"
    )
    arguments = parser.parse_args()
    plan = tomllib.loads((ROOT / "docs" / "course" / "weeks.toml").read_text("utf-8"))
    chosen = {notebooks[number].stem: notebooks[number] for number in arguments.only}
    with Sandbox(modules_of(list(chosen.values()))) as sandbox:
        print(ISOLATED if sandbox.isolated else NOT_ISOLATED)
        grades = grade(sandbox, arguments.folder, chosen, plan, progress=True)
    table(grades).to_csv(arguments.folder / "grades.csv", index=False)
    totals(grades).to_csv(arguments.folder / "totals.csv")
    print(f"{arguments.folder}: grades.csv, totals.csv")
    if arguments.gradebook:
        from nbgrader.api import Gradebook

        keep_in_gradebook(grades, arguments.gradebook, Gradebook)


if __name__ == "__main__":
    main()
