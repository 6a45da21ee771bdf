"""`make grades FOLDER=...`: nbgrader runs what a class handed in, and the checks of
`clothlab.checks` give the points.

FOLDER has a folder for each student, with the student's notebooks in it at any depth.
They are only read. All that is written goes to `build/grading`, a course of nbgrader
that begins anew with each run:

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

import nbformat
import pandas as pd
from nbformat import NotebookNode
from tqdm.auto import tqdm

from clothlab._files import write_bytes
from course.editions import ROOT, student_edition
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
c.Execute.extra_arguments = ["--HistoryManager.hist_file=:memory:", "--IPKernelApp.log_level=ERROR"]
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
STOPPED = "the run ended before its end: an answer stopped its process, or used up the memory (see nbgrader.log)"


@dataclass(frozen=True)
class Lesson:
    """A notebook of the series: its file's name without the ending, its exercises, and
    how it is handed out.
    """

    stem: str
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
    stubs = [ast.parse(cell.source).body for cell in cells if "stub" in tags(cell)]
    return [
        node.name
        for body in stubs
        for node in body
        if isinstance(node, ast.FunctionDef)
    ]


def title(notebook: NotebookNode) -> str:
    """The first line of a notebook's first text."""
    texts = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    return texts[0].strip().splitlines()[0] if texts and texts[0].strip() else ""


def with_tests(notebook: NotebookNode, points: Mapping[str, int]) -> NotebookNode:
    """A copy with a locked cell for each exercise, behind its check; nothing else in it
    counts for nbgrader.
    """
    edition = copy.deepcopy(notebook)
    for cell in edition.cells:
        cell.metadata.pop("nbgrader", None)
    edition.cells = [
        cell
        for cell in edition.cells
        if cell.get("id") not in {_test_id(name) for name in points}
    ]
    for name, most in points.items():
        place = len(edition.cells)
        for k, cell in enumerate(edition.cells):
            if cell.cell_type == "code" and re.search(
                rf"\b(checks\.|def ){name}\(", cell.source
            ):
                place = k + 1
        edition.cells.insert(place, _test(name, most))
    # From which on cells have names
    edition.nbformat_minor = max(5, edition.get("nbformat_minor", 0))
    return edition


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
    return nbformat.v4.new_code_cell(
        TEST.format(name=name), id=_test_id(name), metadata=metadata
    )


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
    here, there = folder.resolve(), course.resolve()
    if here in (there, *there.parents) or there in here.parents:
        raise ValueError(
            f"FOLDER={folder} holds {course}, or lies in it: name the folder of a class"
        )
    found = [
        path
        for path in sorted(folder.glob("[!.]*"))
        if path.is_dir() and not path.is_symlink()
    ]
    if not found:
        raise ValueError(f"{folder} has no folder of a student in it")
    names = [
        re.sub(r"[^\w.@-]", "_", str(path.name).encode("utf-8", "replace").decode())
        for path in found
    ]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(
            f"the folders of two students would both be called {', '.join(sorted(twice))}"
        )
    return dict(zip(names, found, strict=True))


def handed_in(
    student: Path, lessons: list[Lesson]
) -> tuple[dict[str, NotebookNode], dict[str, str]]:
    """Notebooks of a student by lesson, and what is said of a lesson that has none or
    was found elsewhere.

    A notebook belongs to a lesson by its name, such as `04_predictive_model (1).ipynb`,
    or else by its heading.
    """
    read: dict[str, dict[str, NotebookNode]] = {lesson.stem: {} for lesson in lessons}
    said: dict[str, str] = {}
    for path in sorted(student.rglob("*.ipynb")):
        if (
            ".ipynb_checkpoints" in path.parts
            or path.is_symlink()
            or not path.is_file()
        ):
            continue
        by_name = [
            lesson.stem for lesson in lessons if path.name.startswith(lesson.stem)
        ]
        try:
            notebook = readable(path)
        except Exception as error:  # whatever a file may be
            said |= {
                stem: f"{_shown(path)} can't be read as a notebook: {type(error).__name__}"
                for stem in by_name
            }
            continue
        by_title = [
            lesson.stem
            for lesson in lessons
            if lesson.title and title(notebook) == lesson.title
        ]
        for stem in by_name or by_title:
            read[stem][_shown(path)] = notebook
    for stem, found in read.items():
        if len(found) > 1:
            said[stem] = f"there are {len(found)}: {', '.join(found)}. Keep one"
        elif not found:
            said.setdefault(stem, "not handed in")
        elif f"{stem}.ipynb" not in found:
            said[stem] = f"found as {next(iter(found))}"
        else:
            said.pop(stem, None)
    return {
        stem: next(iter(found.values()))
        for stem, found in read.items()
        if len(found) == 1
    }, said


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
    """Begin a course of nbgrader anew in a folder: its settings, and an assignment for
    each lesson.
    """
    course.mkdir(parents=True, exist_ok=True)
    for old in course.iterdir():
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    (course / "nbgrader_config.py").write_text(CONFIG.format(seconds=SECONDS))
    for lesson in lessons:
        text = nbformat.writes(with_tests(lesson.edition, lesson.points))
        write_bytes(
            course / "source" / lesson.stem / f"{lesson.stem}.ipynb", text.encode()
        )
        nbgrader(course, "generate_assignment", lesson.stem, "--create", check=True)


def nbgrader(course: Path, *words: str, check: bool = False) -> bool:
    """Run a command of nbgrader in a course, as a teacher would by hand; whether it
    went well.
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
    """The environment in which nbgrader is found, and finds its own tools by their
    names.
    """
    added = {
        "PATH": [TOOLS / "bin", Path(sys.executable).parent],
        "PYTHONPATH": [TOOLS],
    }
    paths = {
        name: [*map(str, folders), os.environ.get(name, "")]
        for name, folders in added.items()
    }
    return os.environ | {
        name: os.pathsep.join(filter(None, each)) for name, each in paths.items()
    }


def grade(folder: Path, lessons: list[Lesson], course: Path) -> pd.DataFrame:
    """A row for each exercise of each student, after nbgrader has run everything and
    written its feedback.

    Raises:
        ValueError: there is no folder of a student, or no notebook in any.
    """
    handed, said = {}, {}
    for student, path in students(folder, course).items():
        handed[student], said[student] = handed_in(path, lessons)
    if not any(handed.values()):
        raise ValueError(
            f"none of the {len(handed)} folders in {folder} has a notebook that is asked for"
        )
    lay_out(lessons, course)
    for student, notebooks in handed.items():
        for lesson in lessons:
            if lesson.stem in notebooks:
                ready = with_tests(
                    small(notebooks[lesson.stem], like=lesson.edition), lesson.points
                )
                path = (
                    course
                    / "submitted"
                    / student
                    / lesson.stem
                    / f"{lesson.stem}.ipynb"
                )
                write_bytes(path, nbformat.writes(ready).encode())
    for lesson in tqdm(
        [lesson for lesson in lessons if lesson.points], unit="notebook"
    ):
        if any(lesson.stem in notebooks for notebooks in handed.values()):
            # Not well where one student's run has ended it
            nbgrader(course, "autograde", lesson.stem, "--create")
            nbgrader(course, "generate_feedback", lesson.stem)
    scores = auto_scores(course)
    pairs = [(student, lesson) for student in handed for lesson in lessons]
    rows = [
        row
        for student, lesson in pairs
        for row in judged(course, student, lesson, said[student], scores)
    ]
    return pd.DataFrame(
        rows, columns=["student", "notebook", "exercise", "points", "most", "words"]
    )


def judged(
    course: Path,
    student: str,
    lesson: Lesson,
    said: Mapping[str, str],
    scores: Mapping[tuple[str, str, str], float],
) -> list[tuple]:
    """What nbgrader made of a student's lesson: a row for each exercise."""
    path = course / "autograded" / student / lesson.stem / f"{lesson.stem}.ipynb"
    note = said.get(lesson.stem, "")
    if not path.exists():
        submitted = (course / "submitted" / student / lesson.stem).exists()
        words = dict.fromkeys(lesson.points, STOPPED if submitted else note)
        points = dict.fromkeys(lesson.points, 0.0)
    else:
        cells = nbformat.read(path, as_version=4).cells
        graded = {
            cell.metadata.nbgrader.grade_id: cell
            for cell in cells
            if cell.metadata.get("nbgrader")
        }
        points = {
            name: scores.get((student, lesson.stem, name), 0.0)
            for name in lesson.points
        }
        words = {name: words_of(graded[name]) for name in lesson.points}
        words = {
            name: f"{each} ({note})" if note else each for name, each in words.items()
        }
    return [
        (plain(student), lesson.stem, name, points[name], most, plain(words[name]))
        for name, most in lesson.points.items()
    ]


def auto_scores(course: Path) -> dict[tuple[str, str, str], float]:
    """The points in nbgrader's gradebook, by student, notebook and exercise."""
    command = [sys.executable, "-c", SCORES]
    rows = json.loads(
        subprocess.check_output(command, cwd=course, env=settings(), text=True)
    )
    return {
        (student, stem, name): float(score or 0) for student, stem, name, score in rows
    }


def words_of(cell: NotebookNode) -> str:
    """What came out of the cell of a check, in words."""
    errors = [output for output in cell.outputs if output.output_type == "error"]
    if any(error.ename == "CellTimeoutError" for error in errors):
        return "Not yet: it takes too long"
    for error in errors:
        if error.ename == "Unanswered":
            return error.evalue
        return f"{'Not yet' if error.ename == 'CheckFailed' else error.ename}: {error.evalue}"
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
    notebooks = {
        path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))
    }
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
    weights = tomllib.loads(POINTS.read_text("utf-8"))
    lessons = [Lesson.read(notebooks[number], weights) for number in arguments.only]
    try:
        if not arguments.folder:
            raise ValueError("say which folder: make grades FOLDER=path/to/the/class")
        grades = grade(
            Path(arguments.folder),
            [lesson for lesson in lessons if lesson.points],
            COURSE,
        )
    except ValueError as error:
        sys.exit(str(error))
    grades.to_csv(COURSE / "grades.csv", index=False)
    totals(grades).to_csv(COURSE / "totals.csv")
    print(f"{COURSE}: grades.csv, totals.csv, feedback/")


if __name__ == "__main__":
    main()
