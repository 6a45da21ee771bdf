"""A made-up class of five: who is right gets the points, who is wrong a sentence, and
nobody stops it.
"""

import copy
import re
import sys

import grade
import nbformat
import pandas as pd
import pytest
import solutions
from editions import ROOT, student_edition
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
STUBS = {
    "my_mask": "def my_mask(t, settings):\n    return ...",
    "largest_rate": "def largest_rate(curvature, momentum):\n    return ...",
}
MASK = "[(t + k) % settings.period == 0 for k in range(1, settings.horizon + 1)]"
RATE = "2 * (1 + momentum) / curvature"
RIGHT = {
    "my_mask": STUBS["my_mask"].replace("...", MASK),
    "largest_rate": STUBS["largest_rate"].replace("...", RATE),
}
# Checks of one's own, and printed words, get nothing
WRONG = {
    "my_mask": STUBS["my_mask"].replace("...", "[0] * (settings.horizon - 1) + [1]"),
    "largest_rate": "class checks:\n    largest_rate = print\n\n"
    + STUBS["largest_rate"].replace("...", "print('correct') or 0.5"),
}
CRASHING = RIGHT | {"largest_rate": "import os\n\nos._exit(0)"}
DESERVED = {  # points and words of both exercises, which count 1 and 2
    "right": ([1, 2], ["^correct$", "^correct$"]),
    "wrong": ([0, 0], ["^(?!correct)", "^(?!correct)"]),
    "unfinished": ([1, 0], ["^correct$", "^unanswered: the dots of largest_rate"]),
    "crashing": ([1, 0], ["^correct$", "^the run ended before this check"]),
    "missing": ([0, 0], ["^not handed in$", "^not handed in$"]),
}


def lesson():
    """A notebook as it is committed, with two exercises and a parameter that CI makes
    smaller.
    """
    mock = {"nbmake": {"mock": {"SECONDS": 0}}, "tags": ["parameters"]}
    cells = [
        new_markdown_cell("# 90 Short"),
        new_code_cell("import time\nfrom clothlab import checks"),
        new_code_cell("SECONDS = 1000", metadata=mock),
        new_code_cell("time.sleep(SECONDS)"),
    ]
    for name, stub in STUBS.items():
        cells += [
            new_code_cell(stub, metadata={"tags": ["stub"]}),
            new_code_cell(RIGHT[name], metadata={"tags": ["solution"]}),
            new_code_cell(f"checks.{name}({name})"),
        ]
    return solutions.unsolved(new_notebook(cells=cells))


def answered(edition, answers):
    """An edition whose stubs are replaced."""
    edition = copy.deepcopy(edition)
    for cell in edition.cells:
        if "stub" in solutions.tags(cell):
            name = re.search(r"def (\w+)", cell.source)[1]
            cell.source = answers.get(name, cell.source)
    return edition


def hand_in(folder):
    """Write what a class hands in, each in a folder of the student's name."""
    student = student_edition(lesson())
    handed = {
        "right": answered(student, RIGHT),
        "wrong": answered(student, WRONG),
        "unfinished": answered(student, {"my_mask": RIGHT["my_mask"]}),
        "crashing": answered(student, CRASHING),
    }
    for name, notebook in handed.items():
        path = folder / name / "week 1" / "90_short (1).ipynb"
        path.parent.mkdir(parents=True)
        nbformat.write(notebook, path)
    (folder / "missing").mkdir()


@pytest.mark.slow
def test_a_class_gets_what_it_deserves_with_the_words_of_the_checks(
    tmp_path, monkeypatch
):
    root = tmp_path / "root"
    (root / "notebooks").mkdir(parents=True)
    nbformat.write(lesson(), root / "notebooks" / "90_short.ipynb")
    hand_in(tmp_path / "class")
    weights = tmp_path / "points.toml"
    weights.write_text("largest_rate = 2")
    made = tmp_path / "grades"
    for name, value in (("ROOT", root), ("FOLDER", made), ("POINTS", weights)):
        monkeypatch.setattr(grade, name, value)
    monkeypatch.setattr(sys, "argv", ["grade.py", str(tmp_path / "class")])
    grade.main()

    # Tables
    table = pd.read_csv(made / "grades.csv")
    for name, (points, words) in DESERVED.items():
        rows = table[table["student"] == name]
        assert rows["points"].tolist() == points, (name, rows["words"].tolist())
        assert rows["most"].tolist() == [1, 2]
        for said, wanted in zip(rows["words"], words, strict=True):
            assert re.search(wanted, said), (name, said)
    totals = pd.read_csv(made / "totals.csv", index_col="student")
    assert totals["all"].to_dict() == {
        name: sum(points) for name, (points, _) in DESERVED.items()
    }

    # All answered the same questions
    seeds = set()
    for path in made.rglob("90_short.ipynb"):
        for cell in nbformat.read(path, as_version=4).cells:
            seeds.update(re.findall(r"seed=(\d+)", cell.source))
    assert len(seeds) == 1
    assert (made / "right" / "90_short.ipynb").exists()


def test_each_grading_asks_other_questions_than_a_student_saw(tmp_path, monkeypatch):
    (tmp_path / "ann").mkdir()
    seeds = []
    monkeypatch.setattr(grade, "FOLDER", tmp_path / "grades")
    monkeypatch.setattr(grade, "grade", lambda *given: seeds.append(given[-1]) or ROWS)
    monkeypatch.setattr(sys, "argv", ["grade.py", str(tmp_path), "--only", "00"])
    grade.main()
    grade.main()
    assert len(set(seeds)) == 2


ROWS = [{"student": "ann", "notebook": "00_start_here", "points": 1}]


def test_of_two_notebooks_of_a_lesson_none_counts_and_a_damaged_one_is_named(tmp_path):
    for name in ("90_short.ipynb", "90_short-Copy1.ipynb", "91_other.ipynb"):
        (tmp_path / name).write_text("{}")
    assert grade.handed_in(tmp_path, "90_short").startswith("there are 2: ")
    assert "can't be read as a notebook" in grade.handed_in(tmp_path, "91_other")


def test_what_other_programs_leave_is_no_student_and_no_notebook(tmp_path):
    zoe = "Zoe\u0308"  # as a Mac writes an accent: a letter of its own
    for name in (zoe, "__MACOSX", ".ipynb_checkpoints", ".Trashes"):
        (tmp_path / name / ".ipynb_checkpoints").mkdir(parents=True)
    (student,) = grade.students_in(tmp_path)
    assert grade.name_of(student) == "Zo\u00eb"
    for name in ("._90_short.ipynb", ".ipynb_checkpoints/90_short-checkpoint.ipynb"):
        (student / name).write_text("{}")
    assert grade.handed_in(student, "90_short") == "not handed in"


def test_a_folder_without_a_student_is_refused_in_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["grade.py", str(tmp_path)])
    with pytest.raises(SystemExit, match="has no folder of a student in it"):
        grade.main()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_each_exercise_has_its_check_in_the_notebook(path):
    notebook = nbformat.read(path, as_version=4)
    for name in grade.exercises(notebook):
        place = grade.place_of_check(notebook, name)
        assert f"checks.{name}({name})" in notebook.cells[place - 1].source
