"""`make grades FOLDER=...`: nbgrader runs what a class handed in.

The checks of `clothlab.checks` give the points. FOLDER has a folder for each student,
with the student's notebooks in it at any depth. They are only read. All that is written
goes to `build/grading`, a course of nbgrader that begins anew with each run:

- `source`, `release`: the student edition with a locked cell of nbgrader's behind each
  exercise, which calls its check,
- `submitted`: what was found in FOLDER, with the same locked cells and the small
  parameters of CI,
- `autograded`, `feedback`: after the run, as notebooks and as pages for the students,
- `grades.csv`, `totals.csv`: a row for each exercise, with the words of its check, and
  a row for each student.

nbgrader runs a notebook with the rights of whoever calls it: docs/course/grading.md
says how to do that in a container.
"""

import argparse
import ast
import copy
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import nbformat
import pandas as pd
from nbformat import NotebookNode
from tqdm.auto import tqdm

from clothlab._files import write_bytes
from course.editions import ROOT, student_edition
from course.repository import number_of
from course.solutions import small, tags

# Where `make grades` installs nbgrader; a container has it among its packages
TOOLS = Path(sys.prefix) / "grading"
COURSE = ROOT / "build" / "grading"
POINTS = ROOT / "docs" / "course" / "points.toml"
SECONDS = 120  # [s] a cell may take; with CI's parameters none takes half of that
TEST = """\
# The points of {name}: whoever changes this cell finds it unchanged in the grading.
import contextlib, sys
from clothlab import checks

with contextlib.redirect_stderr(sys.stdout):  # or a mere warning would cost the points
    checks.{name}(globals().get("{name}"))"""
CONFIG = """\
c = get_config()
c.CourseDirectory.course_id = "clothlab"
c.NbGrader.logfile = "nbgrader.log"
c.Execute.timeout = {seconds}
c.Execute.iopub_timeout = 60  # after an interrupt on a busy machine
c.Execute.startup_timeout = 300
c.Execute.extra_arguments = [
    "--HistoryManager.hist_file=:memory:",
    "--IPKernelApp.log_level=ERROR",
]
"""
SCORES = """
import json
from nbgrader.api import Gradebook

with Gradebook("sqlite:///gradebook.db") as book:
    found = [
        (handed.student.id, assignment.name, grade.name, grade.auto_score)
        for assignment in book.assignments
        for handed in book.assignment_submissions(assignment.name)
        for notebook in handed.notebooks
        for grade in notebook.grades
    ]
print(json.dumps(found))
"""
STOPPED = (
    "the run ended before its end: an answer stopped its process, "
    "or used up the memory (see nbgrader.log)"
)
COLUMNS = ("student", "notebook", "exercise", "points", "most", "words")


@dataclass(frozen=True)
class Lesson:
    """A notebook of the series: its exercises, and how it is handed out."""

    stem: str  # of its file's name
    points: Mapping[str, int]  # of each exercise, in order
    edition: NotebookNode

    @classmethod
    def read(cls, path: Path, weights: Mapping[str, int]) -> "Lesson":
        """The lesson at `path`; exercises that are not in `weights` count 1."""
        notebook = nbformat.read(path, as_version=4)
        points = {name: weights.get(name, 1) for name in exercises(notebook.cells)}
        return cls(path.stem, points, student_edition(notebook))

    @property
    def title(self) -> str:
        """The heading of the notebook."""
        return title(self.edition)


def exercises(cells: Iterable[NotebookNode]) -> list[str]:
    """Names of the functions that a notebook's stubs ask for, in order."""
    found = []
    for cell in cells:
        if "stub" in tags(cell):
            nodes = ast.parse(cell.source).body
            found += [node for node in nodes if isinstance(node, ast.FunctionDef)]
    return [function.name for function in found]


def title(notebook: NotebookNode) -> str:
    """The first line of a notebook's first text."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            lines = cell.source.strip().splitlines()
            return lines[0] if lines else ""
    return ""


def with_tests(notebook: NotebookNode, points: Mapping[str, int]) -> NotebookNode:
    """A copy with a locked cell for each exercise, behind its check.

    Nothing else in it counts for nbgrader.
    """
    edition = copy.deepcopy(notebook)
    for cell in edition.cells:
        cell.metadata.pop("nbgrader", None)

    # Those that came back with a student's notebook may have been changed
    ours = {_test_id(name) for name in points}
    edition.cells = [cell for cell in edition.cells if cell.get("id") not in ours]
    for name, most in points.items():
        edition.cells.insert(_behind_check(edition, name), _test(name, most))

    # From which on cells have names
    edition.nbformat_minor = max(5, edition.get("nbformat_minor", 0))
    return edition


def _behind_check(notebook: NotebookNode, name: str) -> int:
    """Where a cell stands behind the last one that checks or defines an exercise."""
    about = re.compile(rf"\b(checks\.|def ){name}\(")
    place = len(notebook.cells)
    for k, cell in enumerate(notebook.cells):
        if cell.cell_type == "code" and about.search(cell.source):
            place = k + 1
    return place


def _test_id(name: str) -> str:
    return f"points-of-{name}"[:64]


def _test(name: str, most: int) -> NotebookNode:
    """The cell in which nbgrader calls a check.

    Its metadata is ours alone: a tag could keep it from being run.
    """
    settings = {
        "grade": True,
        "locked": True,
        "solution": False,
        "task": False,
        "schema_version": 3,
    }
    metadata = {"nbgrader": settings | {"grade_id": name, "points": most}}
    code = TEST.format(name=name)
    return nbformat.v4.new_code_cell(code, id=_test_id(name), metadata=metadata)


def students(folder: Path, course: Path) -> dict[str, Path]:
    """The students' folders by name.

    Raises:
        ValueError: there is no folder of a student, or it is in or around the course,
            which begins anew.
    """
    if not folder.is_dir():
        raise ValueError(
            f"FOLDER={folder} is no folder: it must have a folder for each student"
        )
    here = folder.resolve()
    there = course.resolve()
    if here in (there, *there.parents) or there in here.parents:
        raise ValueError(
            f"FOLDER={folder} holds {course}, or lies in it: name the folder of a class"
        )

    # A link could lead anywhere
    visible = sorted(folder.glob("[!.]*"))
    found = [path for path in visible if path.is_dir() and not path.is_symlink()]
    if not found:
        raise ValueError(f"{folder} has no folder of a student in it")

    # Names that nbgrader takes, of which no two may be the same
    names = [re.sub(r"[^\w.@-]", "_", _shown(path)) for path in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        listed = ", ".join(sorted(twice))
        raise ValueError(f"the folders of two students would both be called {listed}")
    return dict(zip(names, found, strict=True))


class HandedIn(NamedTuple):
    """What a student handed in."""

    notebooks: dict[str, NotebookNode]  # by lesson
    # Of a lesson that has none, or was found elsewhere: what there is to say
    notes: dict[str, str]


def handed_in(student: Path, lessons: list[Lesson]) -> HandedIn:
    """The notebooks in a student's folder, at any depth.

    A notebook belongs to a lesson by its name, such as `04_predictive_model (1).ipynb`,
    or else by its heading.
    """
    read: dict[str, dict[str, NotebookNode]] = {lesson.stem: {} for lesson in lessons}
    notes: dict[str, str] = {}
    for path in _notebooks_in(student):
        name = _shown(path)
        stems = [each.stem for each in lessons if path.name.startswith(each.stem)]
        try:
            notebook = readable(path)
        except Exception as error:  # whatever a file may be
            kind = type(error).__name__
            note = f"{name} can't be read as a notebook: {kind}"
            notes |= dict.fromkeys(stems, note)
            continue
        for stem in stems or _lessons_called(title(notebook), lessons):
            read[stem][name] = notebook

    # Of each lesson exactly one counts
    notebooks = {}
    for stem, found in read.items():
        if len(found) == 1:
            (name,) = found
            notebooks[stem] = found[name]
            notes.pop(stem, None)
            if name != f"{stem}.ipynb":
                notes[stem] = f"found as {name}"
        elif found:
            notes[stem] = f"there are {len(found)}: {', '.join(found)}. Keep one"
        else:
            notes.setdefault(stem, "not handed in")
    return HandedIn(notebooks, notes)


def _notebooks_in(folder: Path) -> list[Path]:
    """Files of notebooks at any depth; neither links nor JupyterLab's own copies."""
    found = []
    for path in sorted(folder.rglob("*.ipynb")):
        copied = ".ipynb_checkpoints" in path.parts
        if path.is_file() and not path.is_symlink() and not copied:
            found.append(path)
    return found


def _lessons_called(heading: str, lessons: list[Lesson]) -> list[str]:
    """Lessons with this heading; none has an empty one."""
    return [lesson.stem for lesson in lessons if heading and lesson.title == heading]


def readable(path: Path) -> NotebookNode:
    """The notebook at `path`, which is one to write again.

    Raises:
        Exception: of any kind; nothing is known of the file.
    """
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    nbformat.writes(notebook).encode()  # a lone surrogate can be read and not written
    return notebook


def _shown(path: Path) -> str:
    return path.name.encode("utf-8", "replace").decode()


def lay_out(lessons: list[Lesson], course: Path) -> None:
    """Begin a course of nbgrader anew in a folder.

    With its settings, and an assignment for each lesson.
    """
    course.mkdir(parents=True, exist_ok=True)
    for old in course.iterdir():
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    (course / "nbgrader_config.py").write_text(CONFIG.format(seconds=SECONDS))
    for lesson in lessons:
        text = nbformat.writes(with_tests(lesson.edition, lesson.points))
        folder = course / "source" / lesson.stem
        write_bytes(folder / f"{lesson.stem}.ipynb", text.encode())
        nbgrader(course, "generate_assignment", lesson.stem, "--create", check=True)


def nbgrader(course: Path, *words: str, check: bool = False) -> bool:
    """Run a command of nbgrader in a course, as a teacher would by hand.

    Returned is whether it went well; a RuntimeError if it did not and `check` is set.
    """
    command = [sys.executable, "-m", "nbgrader", *words]
    ended = subprocess.run(
        command,
        cwd=course,
        env=settings(),
        capture_output=True,
        text=True,
        errors="replace",
    )
    if ended.returncode and check:
        raise RuntimeError(
            f"nbgrader {' '.join(words)} failed:\n{ended.stderr[-2000:]}"
        )
    return not ended.returncode


def settings() -> dict[str, str]:
    """The environment in which nbgrader is found, and finds its own tools."""
    added = {
        "PATH": [TOOLS / "bin", Path(sys.executable).parent],
        "PYTHONPATH": [TOOLS],
    }
    environment = dict(os.environ)
    for name, folders in added.items():
        paths = [*map(str, folders), environment.get(name, "")]
        environment[name] = os.pathsep.join(filter(None, paths))
    return environment


def grade(folder: Path, lessons: list[Lesson], course: Path) -> pd.DataFrame:
    """A row for each exercise of each student, after nbgrader has run everything.

    It has written its feedback, too.

    Raises:
        ValueError: there is no folder of a student, or no notebook in any.
    """
    # What was handed in
    folders = students(folder, course)
    handed = {name: handed_in(path, lessons) for name, path in folders.items()}
    if not any(each.notebooks for each in handed.values()):
        raise ValueError(
            f"none of the {len(handed)} folders in {folder} has a notebook "
            "that is asked for"
        )

    # Into a course of nbgrader, which runs it
    lay_out(lessons, course)
    for student, each in handed.items():
        submit(course, student, each.notebooks, lessons)
    for lesson in tqdm([each for each in lessons if each.points], unit="notebook"):
        if any(lesson.stem in each.notebooks for each in handed.values()):
            # Not well where one student's run has ended it
            nbgrader(course, "autograde", lesson.stem, "--create")
            nbgrader(course, "generate_feedback", lesson.stem)

    # And what came out of it
    scores = auto_scores(course)
    rows = []
    for student, each in handed.items():
        for lesson in lessons:
            note = each.notes.get(lesson.stem, "")
            rows += judged(course, student, lesson, note, scores)
    return pd.DataFrame(rows, columns=COLUMNS)


def submit(
    course: Path,
    student: str,
    notebooks: Mapping[str, NotebookNode],
    lessons: list[Lesson],
) -> None:
    """Put a student's notebooks where nbgrader looks for them, ready to be run."""
    for lesson in lessons:
        if lesson.stem in notebooks:
            short = small(notebooks[lesson.stem], like=lesson.edition)
            text = nbformat.writes(with_tests(short, lesson.points))
            folder = course / "submitted" / student / lesson.stem
            write_bytes(folder / f"{lesson.stem}.ipynb", text.encode())


def judged(
    course: Path,
    student: str,
    lesson: Lesson,
    note: str,
    scores: Mapping[tuple[str, str, str], float],
) -> list[tuple]:
    """What nbgrader made of a student's lesson: a row for each exercise.

    Args:
        course: nbgrader's folder.
        student: the student's name there.
        lesson: the lesson.
        note: what there is to say of how it was handed in.
        scores: points by student, notebook and exercise.
    """
    stem = lesson.stem
    path = course / "autograded" / student / stem / f"{stem}.ipynb"
    if path.exists():
        graded = {}
        for cell in nbformat.read(path, as_version=4).cells:
            if cell.metadata.get("nbgrader"):
                graded[cell.metadata.nbgrader.grade_id] = cell
        end = f" ({note})" if note else ""
        words = {name: words_of(graded[name]) + end for name in lesson.points}
        points = {name: scores.get((student, stem, name), 0.0) for name in words}
    else:
        # Nothing came out, or nothing went in
        submitted = (course / "submitted" / student / stem).exists()
        words = dict.fromkeys(lesson.points, STOPPED if submitted else note)
        points = dict.fromkeys(lesson.points, 0.0)

    # In the order of COLUMNS
    return [
        (plain(student), stem, name, points[name], most, plain(words[name]))
        for name, most in lesson.points.items()
    ]


def auto_scores(course: Path) -> dict[tuple[str, str, str], float]:
    """The points in nbgrader's gradebook, by student, notebook and exercise."""
    command = [sys.executable, "-c", SCORES]
    said = subprocess.check_output(command, cwd=course, env=settings(), text=True)
    scores = {}
    for student, stem, name, score in json.loads(said):
        scores[student, stem, name] = float(score or 0)
    return scores


def words_of(cell: NotebookNode) -> str:
    """What came out of the cell of a check, in words."""
    errors = [output for output in cell.outputs if output.output_type == "error"]
    if any(error.ename == "CellTimeoutError" for error in errors):
        return "Not yet: it takes too long"
    for error in errors:
        if error.ename == "Unanswered":
            return error.evalue
        kind = "Not yet" if error.ename == "CheckFailed" else error.ename
        return f"{kind}: {error.evalue}"
    return "".join(output.get("text", "") for output in cell.outputs) or "no answer"


def plain(text: str) -> str:
    """A text on one line, which no spreadsheet takes for a formula."""
    line = " ".join(text.split())[:500]
    return f"'{line}" if line.startswith(("=", "+", "-", "@")) else line


def totals(grades: pd.DataFrame) -> pd.DataFrame:
    """A row for each student, with the points of each notebook and their sum."""
    points = grades.pivot_table(
        index="student", columns="notebook", values="points", aggfunc="sum"
    )
    return points.join(grades.groupby("student")[["points", "most"]].sum())


def main() -> None:
    """Grade the class in a folder."""
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    notebooks = {number_of(path): path for path in paths}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", help="with a folder for each student")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=notebooks,
        default=list(notebooks),
        help="numbers of notebooks",
    )
    arguments = parser.parse_args()

    # Notebooks without exercises have no points
    weights = tomllib.loads(POINTS.read_text("utf-8"))
    chosen = [Lesson.read(notebooks[number], weights) for number in arguments.only]
    lessons = [lesson for lesson in chosen if lesson.points]
    try:
        if not arguments.folder:
            raise ValueError("say which folder: make grades FOLDER=path/to/the/class")
        grades = grade(Path(arguments.folder), lessons, COURSE)
    except ValueError as error:
        sys.exit(str(error))

    # For a spreadsheet
    grades.to_csv(COURSE / "grades.csv", index=False)
    totals(grades).to_csv(COURSE / "totals.csv")
    print(f"{COURSE}: grades.csv, totals.csv, feedback/")


if __name__ == "__main__":
    main()
