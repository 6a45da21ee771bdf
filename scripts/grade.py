"""`make grade FOLDER=...`: a table of points for what a class handed in.

FOLDER has a folder for each student, with the student's notebooks in it at any depth.
Each notebook is run with the small parameters of CI. Behind each exercise stands a cell
of ours that calls its check of `clothlab.checks`, with a seed that no student has seen.
`build/grades` gets `grades.csv`, a row for each exercise with the words of its check,
`totals.csv`, a row for each student, and the notebooks as they ran.

A notebook runs with the rights of whoever calls this. Those of strangers are to be run
in the container: docs/course/README.md says how.
"""

import argparse
import ast
import re
import secrets
import sys
import tomllib
import unicodedata
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import nbformat
import pandas as pd
from editions import QUIET, write
from nbclient import NotebookClient
from nbclient.exceptions import DeadKernelError
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell
from repository import ROOT, number_of
from solutions import small, tags
from tqdm.auto import tqdm

FOLDER = ROOT / "build" / "grades"
POINTS = ROOT / "docs" / "course" / "points.toml"
SECONDS = 120  # [s] a cell may take; with CI's parameters none takes half of that
CHECK = """\
from clothlab import checks
checks.{name}(globals().get("{name}"), seed={seed})"""


def exercises(notebook: NotebookNode) -> list[str]:
    """Names of the functions that a notebook's stubs ask for, in order."""
    found = []
    for cell in notebook.cells:
        if "stub" in tags(cell):
            nodes = ast.parse(cell.source).body
            found += [node for node in nodes if isinstance(node, ast.FunctionDef)]
    return [function.name for function in found]


def place_of_check(notebook: NotebookNode, name: str) -> int:
    """Where a cell stands behind the last one that checks or defines an exercise."""
    about = re.compile(rf"\b(checks\.|def ){name}\(")
    place = len(notebook.cells)
    for k, cell in enumerate(notebook.cells):
        if cell.cell_type == "code" and about.search(cell.source):
            place = k + 1
    return place


def run(notebook: NotebookNode, names: list[str], seed: int) -> dict[str, str]:
    """Run a notebook, to which our checks of these exercises are added.

    Returned is what each check says; only of a right answer it is "correct".
    """
    cells = {}
    for name in names:
        cells[name] = new_code_cell(CHECK.format(name=name, seed=seed))
        notebook.cells.insert(place_of_check(notebook, name), cells[name])

    # An error stops nothing; what never ends is interrupted
    client = NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=SECONDS,
        allow_errors=True,
        interrupt_on_timeout=True,
        extra_arguments=QUIET,
        resources={"metadata": {"path": str(ROOT / "notebooks")}},
    )
    # Of an answer that ends its process, the checks behind it were not run
    with suppress(DeadKernelError):
        client.execute()
    return {name: words_of(cell) for name, cell in cells.items()}


def words_of(check: NotebookNode) -> str:
    """What came out of the cell of a check, in words."""
    for output in check.outputs:
        if output.output_type == "error":
            known = output.ename in ("CheckFailed", "Unanswered")
            return output.evalue if known else f"{output.ename}: {output.evalue}"
    if "shell.execute_reply" not in check.metadata.get("execution", {}):
        return "the run ended before this check"
    return "correct"


def students_in(folder: Path) -> list[Path]:
    """The folders of the students, without those that other programs leave there."""
    return [
        path
        for path in sorted(folder.glob("[!.]*"))
        if path.is_dir() and path.name != "__MACOSX"
    ]


def name_of(student: Path) -> str:
    """The student's name, its accents as keyboards write them: a Mac takes them off."""
    return unicodedata.normalize("NFC", student.name)


def handed_in(student: Path, stem: str) -> NotebookNode | str:
    """A student's notebook of a lesson, or words on why there is none to run.

    It is found by its name, such as `04_predictive_model (1).ipynb`.
    """
    found = [
        path
        for path in sorted(student.rglob(f"{stem}*.ipynb"))
        if not any(part.startswith(".") for part in path.relative_to(student).parts)
    ]
    if len(found) != 1:
        names = ", ".join(str(path.relative_to(student)) for path in found)
        return f"there are {len(found)}: {names}" if found else "not handed in"
    try:
        # Colab writes an older format, in which cells have no names
        return nbformat.v4.upgrade(nbformat.read(found[0], as_version=4))
    except Exception as error:  # whatever a file may be
        return f"it can't be read as a notebook: {type(error).__name__}"


def grade(
    students: list[Path], lesson: Path, weights: Mapping[str, int], seed: int
) -> list[dict]:
    """A row for each exercise of a lesson and student; those without weight count 1."""
    ours = nbformat.read(lesson, as_version=4)
    names = exercises(ours)
    rows = []
    for student in tqdm(students if names else [], desc=lesson.stem):
        who = name_of(student)
        notebook = handed_in(student, lesson.stem)
        if isinstance(notebook, str):
            words = dict.fromkeys(names, notebook)
        else:
            notebook = small(notebook, like=ours)
            words = run(notebook, names, seed)
            write(notebook, FOLDER / who / f"{lesson.stem}.ipynb")
        for name in names:
            most = weights.get(name, 1)
            points = most if words[name] == "correct" else 0
            row = {"student": who, "notebook": lesson.stem, "exercise": name}
            row |= {"points": points, "most": most, "words": words[name]}
            rows.append(row)
    return rows


def main() -> None:
    """Grade the class in a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="with a folder for each student")
    parser.add_argument("--only", nargs="+", help="numbers of notebooks, such as 00 01")
    arguments = parser.parse_args()
    students = students_in(arguments.folder)
    if not students:
        sys.exit(f"{arguments.folder} has no folder of a student in it")

    # One seed for all, so that everybody answers the same questions
    seed = secrets.randbelow(1_000_000)
    weights = tomllib.loads(POINTS.read_text("utf-8"))
    rows = []
    for lesson in sorted((ROOT / "notebooks").glob("*.ipynb")):
        if not arguments.only or number_of(lesson) in arguments.only:
            rows += grade(students, lesson, weights, seed)

    # For a spreadsheet
    FOLDER.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(rows)
    table.to_csv(FOLDER / "grades.csv", index=False)
    totals = table.pivot_table("points", "student", "notebook", "sum")
    totals["all"] = totals.sum(axis=1)
    totals.to_csv(FOLDER / "totals.csv")
    print(totals.to_string())


if __name__ == "__main__":
    main()
