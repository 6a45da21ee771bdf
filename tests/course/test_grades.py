"""A made-up class, graded by nbgrader: who is right gets the points, who is wrong a
sentence, and nobody stops it.
"""

import copy
import json
import os
import re
import sys
from importlib.machinery import PathFinder

import nbformat
import pandas as pd
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from course import grades, solutions
from course.editions import ROOT, student_edition
from course.grades import Lesson

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
WEIGHTS = {"overlap": 3}


def lesson(stem):
    (path,) = (path for path in NOTEBOOKS if path.stem.startswith(stem))
    return Lesson.read(path, {})


def test_tools_of_the_grading_are_pinned_beside_the_environment():
    pinned, asked, common = (
        {
            line.strip().lower()
            for line in (ROOT / name).read_text().splitlines()
            if "==" in line
        }
        for name in (
            "docs/course/requirements.txt",
            "docs/course/requirements.in",
            "environment.txt",
        )
    )
    assert asked <= pinned
    names = {each.split("==")[0] for each in common}
    assert not names & {each.split("==")[0] for each in pinned}, (
        "one version of everything"
    )


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_each_exercise_has_one_cell_of_nbgraders_behind_its_check(path):
    read = Lesson.read(path, WEIGHTS)
    edition = grades.with_tests(read.edition, read.points)
    nbformat.validate(edition)
    graded = [k for k, cell in enumerate(edition.cells) if "nbgrader" in cell.metadata]
    assert [edition.cells[k].metadata.nbgrader.grade_id for k in graded] == list(
        read.points
    )
    for k, (name, most) in zip(graded, read.points.items(), strict=True):
        assert f"checks.{name}({name})" in edition.cells[k - 1].source
        assert edition.cells[k].metadata.nbgrader.points == most == WEIGHTS.get(name, 1)
        assert list(edition.cells[k].metadata) == ["nbgrader"]
    again = grades.with_tests(edition, read.points)
    assert [cell.source for cell in again.cells] == [
        cell.source for cell in edition.cells
    ]


def test_a_student_adds_no_test_and_keeps_none():
    mine = new_code_cell(
        "pass",
        metadata={"nbgrader": {"grade": True, "grade_id": "overlap", "points": 9}},
    )
    notebook = new_notebook(cells=[new_code_cell("def overlap(images): pass"), mine])
    edition = grades.with_tests(notebook, {"overlap": 1})
    (graded,) = [cell for cell in edition.cells if "nbgrader" in cell.metadata]
    assert "checks.overlap" in graded.source
    assert edition.cells.index(graded) == 1


def written(path, notebook):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        notebook if isinstance(notebook, str) else nbformat.writes(notebook),
        errors="surrogateescape",
    )


def test_renamed_notebooks_are_found_and_all_others_are_named(tmp_path):
    first, other = lesson("00"), lesson("04")
    written(tmp_path / "ann" / "04_predictive_model (1).ipynb", other.edition)
    written(tmp_path / "bob" / "homework.ipynb", other.edition)
    written(tmp_path / "cem" / "a" / "04_predictive_model.ipynb", other.edition)
    written(tmp_path / "cem" / "b" / "04_predictive_model-Copy1.ipynb", other.edition)
    written(
        tmp_path / "dia" / "04_predictive_model.ipynb",
        json.dumps({"cells": [{"source": 3}]}),
    )
    surrogate = json.dumps(first.edition).replace("# 00", "\\ud800")
    written(tmp_path / "dia" / "00_start_here.ipynb", surrogate)
    (tmp_path / "eve").mkdir()
    (tmp_path / "eve" / "00_start_here.ipynb").symlink_to(
        ROOT / "notebooks" / "00_start_here.ipynb"
    )
    found = {
        each: grades.handed_in(tmp_path / each, [first, other])
        for each in ("ann", "bob", "cem", "dia", "eve")
    }
    missing = {first.stem: "not handed in"}
    assert found["ann"] == (
        {other.stem: other.edition},
        missing | {other.stem: "found as 04_predictive_model (1).ipynb"},
    )
    assert found["bob"] == (
        {other.stem: other.edition},
        missing | {other.stem: "found as homework.ipynb"},
    )
    assert found["cem"][0] == {}
    assert found["cem"][1][other.stem].startswith("there are 2: ")
    assert found["dia"][0] == {}
    assert "can't be read as a notebook" in found["dia"][1][other.stem]
    assert "can't be read as a notebook" in found["dia"][1][first.stem]
    assert found["eve"] == (
        {},
        dict.fromkeys([first.stem, other.stem], "not handed in"),
    )


@pytest.mark.parametrize(
    ("folder", "words"),
    [
        ("", "say which folder"),
        ("no/such/folder", "is no folder"),
        (str(ROOT), "name the folder of a class"),
        (str(ROOT.parent), "name the folder of a class"),
        (str(ROOT / "docs" / "gallery"), "no folder of a student"),
        (str(ROOT / "tests"), "has a notebook that is asked for"),
    ],
)
def test_a_wrong_folder_is_one_sentence_and_nothing_is_written(
    folder, words, monkeypatch
):
    before = (
        sorted(os.listdir(ROOT)),
        sorted(os.listdir(ROOT / "build")) if (ROOT / "build").exists() else [],
    )
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", ["grades.py", folder, "--only", "00"])
    with pytest.raises(SystemExit) as ended:
        grades.main()
    assert words in ended.value.code
    assert len(ended.value.code.splitlines()) == 1
    assert (
        sorted(os.listdir(ROOT)),
        sorted(os.listdir(ROOT / "build")) if (ROOT / "build").exists() else [],
    ) == before


def test_names_and_words_are_plain_for_a_spreadsheet(tmp_path):
    for name in ("ann", "=bob()", os.fsdecode(b"c\xe4m"), ".hidden"):
        (tmp_path / name).mkdir()
    assert list(grades.students(tmp_path, tmp_path.parent / "course")) == [
        "_bob__",
        "ann",
        "c_m",
    ]
    assert grades.plain("=1\n+ 2") == "'=1 + 2"
    (tmp_path / "_bob()").mkdir()
    with pytest.raises(ValueError, match="two students would both be called _bob__"):
        grades.students(tmp_path, tmp_path.parent / "course")


STUBS = {
    "my_mask": "def my_mask(t, horizon, period):\n    return ...",
    "largest_rate": "def largest_rate(curvature, momentum):\n    return ...",
}
RIGHT = {
    "my_mask": STUBS["my_mask"].replace(
        "...", "[int(k % period == 0) for k in range(t + 1, t + horizon + 1)]"
    ),
    "largest_rate": STUBS["largest_rate"].replace(
        "...", "2 * (1 + momentum) / curvature"
    ),
}
CHEAT = """
import numpy as np
class checks:
    def __getattr__(self, name):
        return lambda answer: print("correct")
checks = checks()
print("correct")
"""


def short_lesson():
    """A notebook as it is committed, with two exercises and a parameter that CI makes
    smaller.
    """
    cells = [
        new_markdown_cell("# 90 Short"),
        new_code_cell("import time\nfrom clothlab import checks"),
    ]
    mock = {"nbmake": {"mock": {"SECONDS": 0}}, "tags": ["parameters"]}
    cells += [
        new_code_cell("SECONDS = 1000", metadata=mock),
        new_code_cell("time.sleep(SECONDS)"),
    ]
    for name, stub in STUBS.items():
        cells += [new_code_cell(stub, metadata={"tags": ["stub"]})]
        cells += [
            new_code_cell(RIGHT[name], metadata={"tags": ["solution"]}),
            new_code_cell(f"checks.{name}({name})"),
        ]
    kernel = {
        "kernelspec": {
            "name": "python3",
            "display_name": "Python 3",
            "language": "python",
        }
    }
    return solutions.unsolved(new_notebook(cells=cells, metadata=kernel))


def answered(edition, answers):
    """An edition whose stubs are replaced."""
    edition = copy.deepcopy(edition)
    for cell in edition.cells:
        if "stub" in solutions.tags(cell):
            name = re.search(r"def (\w+)", cell.source)[1]
            cell.source = answers.get(name, cell.source)
    return edition


def with_cell(edition, source):
    edition.cells.insert(2, new_code_cell(source))
    return edition


def tool_is_there():
    """Looked for, and not asked for its version: its imports take some seconds."""
    places = [*sys.path, str(grades.TOOLS)]
    if PathFinder.find_spec("nbgrader", places) is None:
        pytest.skip("NO nbgrader: `make test` installs docs/course/requirements.txt")


def submissions(committed, points):
    """What a class hands in, by the names of its students."""
    student = student_edition(committed)
    skipped = answered(student, {})
    for cell in (
        skipped.cells
    ):  # which keeps nbclient from running a cell, and so nbgrader from seeing an error
        cell.metadata["tags"] = [*solutions.tags(cell), "skip-execution"]
    warning = RIGHT["my_mask"].replace(
        "    return", "    warnings.warn('!')\n    return"
    )
    return {
        "perfect": answered(student, RIGHT),
        "solved": solutions.solved(committed),
        "empty": student,
        "repository": committed,
        "half": answered(student, {"my_mask": RIGHT["my_mask"]}),
        "syntax": answered(
            student, RIGHT | {"my_mask": "def my_mask(t:\n    return 1"}
        ),
        "renamed": answered(student, RIGHT),
        "warns": answered(student, RIGHT | {"my_mask": "import warnings\n" + warning}),
        "skips": grades.with_tests(skipped, points),
        "cheats": with_cell(answered(student, {}), CHEAT),
        "endless": answered(
            student,
            RIGHT | {"my_mask": "def my_mask(t, h, p):\n    while True:\n        pass"},
        ),
        "stops": answered(
            student,
            RIGHT | {"my_mask": "import os\n\ndef my_mask(t, h, p):\n    os._exit(0)"},
        ),
        "absent": None,
    }


def hand_in(folder, names):
    """Write a lesson, and what students of these names hand in; its folder and theirs."""
    tool_is_there()
    committed, path = short_lesson(), folder / "notebooks" / "90_short.ipynb"
    written(path, committed)
    handed = submissions(committed, Lesson.read(path, {}).points)
    for name in names:
        file = "90_short (1).ipynb" if name == "renamed" else "90_short.ipynb"
        (folder / "class" / name).mkdir(parents=True)
        if handed[name] is not None:
            written(folder / "class" / name / file, handed[name])
    return path, folder / "class"


@pytest.fixture
def patient(monkeypatch):
    """A cell may take 40 s: of that, a busy machine takes half for its imports."""
    monkeypatch.setattr(grades, "SECONDS", 40)


DESERVED = {  # points and words of both exercises, which count 1 and 2
    "perfect": ([1, 2], ["^correct$", "^correct$"]),
    "solved": ([1, 2], ["^correct$", "^correct$"]),
    "renamed": ([1, 2], [r"^correct \(found as 90_short \(1\)\.ipynb\)$"] * 2),
    "empty": (
        [0, 0],
        ["^unanswered: the dots of my_mask", "^unanswered: the dots of largest_rate"],
    ),
    "repository": (
        [0, 0],
        ["^unanswered: the dots of my_mask", "^unanswered: the dots of largest_rate"],
    ),
    "half": ([1, 0], ["^correct$", "^unanswered"]),
    "syntax": (
        [0, 2],
        [
            "^Not yet: this is no function: run the cell that defines my_mask",
            "^correct$",
        ],
    ),
    "warns": ([1, 2], ["correct", "^correct$"]),
    "skips": ([0, 0], ["^Not yet|^unanswered", "^Not yet|^unanswered"]),
    "cheats": ([0, 0], ["^unanswered", "^unanswered"]),
    "endless": ([0, 2], ["takes too long", "^correct$"]),
    "stops": (
        [0, 0],
        ["^the run ended before its end", "^the run ended before its end"],
    ),
    "absent": ([0, 0], ["^not handed in$", "^not handed in$"]),
}
# Each has something that no other has, and costs a kernel
USUAL = ("half", "syntax", "renamed", "cheats")


def gets_what_it_deserves(table, names):
    for name in names:
        points, words = DESERVED[name]
        rows = table[table["student"] == name]
        assert rows["points"].tolist() == points, (name, rows["words"].tolist())
        assert rows["most"].tolist() == [1, 2]
        for said, wanted in zip(rows["words"], words, strict=True):
            assert re.search(wanted, said), (name, said)


@pytest.mark.slow
def test_a_class_gets_what_it_deserves_with_the_words_of_the_checks(
    tmp_path, monkeypatch, patient
):
    _, folder = hand_in(tmp_path, USUAL)
    course, weights = tmp_path / "course", tmp_path / "points.toml"
    weights.write_text("largest_rate = 2")
    for name, value in (("ROOT", tmp_path), ("COURSE", course), ("POINTS", weights)):
        monkeypatch.setattr(grades, name, value)
    monkeypatch.setattr(sys, "argv", ["grades.py", str(folder), "--only", "90"])
    grades.main()

    # Tables
    gets_what_it_deserves(pd.read_csv(course / "grades.csv"), USUAL)
    totals = pd.read_csv(course / "totals.csv", index_col="student")
    assert totals.loc["half", ["90_short", "points", "most"]].tolist() == [1, 1, 3]

    # And pages
    page = (course / "feedback" / "half" / "90_short" / "90_short.html").read_text()
    assert "unanswered: the dots of largest_rate are still there" in re.sub(
        "<[^>]*>", "", page
    )
    assert (course / "release" / "90_short" / "90_short.ipynb").exists()


@pytest.mark.nightly
def test_stranger_submissions_get_what_they_deserve_too(tmp_path, patient):
    others = [name for name in DESERVED if name not in USUAL]
    path, folder = hand_in(tmp_path, others)
    read = Lesson.read(path, {"largest_rate": 2})
    table = grades.grade(folder, [read], tmp_path / "course")
    gets_what_it_deserves(table, others)


@pytest.mark.nightly
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_solved_notebook_gets_all_points(path, tmp_path):
    read = Lesson.read(path, WEIGHTS)
    if not read.points:
        pytest.skip("no exercise with a check")
    written(
        tmp_path / "class" / "ann" / path.name,
        solutions.solved(nbformat.read(path, as_version=4)),
    )
    written(tmp_path / "class" / "bob" / path.name, nbformat.read(path, as_version=4))
    table = grades.grade(tmp_path / "class", [read], tmp_path / "course")
    ann, bob = (table[table["student"] == each] for each in ("ann", "bob"))
    assert (ann["points"] == ann["most"]).all(), ann["words"].tolist()
    assert not bob["points"].any()
    assert bob["words"].str.startswith("unanswered").all(), bob["words"].tolist()
