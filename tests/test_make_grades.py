"""Three made-up classes: who is right gets the points, who is wrong a sentence, and who is hostile nothing."""

import json
import os
import sqlite3
import sys
import tomllib
from pathlib import Path

import make_grades
import nbformat
import pytest
import sandbox_worker
from make_course import functions, read_lesson
from make_editions import student_edition
from nbformat.v4 import new_code_cell

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
CLASSES = ("00", "06", "08")
PLAN = {"limits": {number: {"seconds": 40, "memory": 400} for number in CLASSES}}


def given(student, points, most=1, words="correct", notebook="00_start_here", exercise="f"):
    return make_grades.Grade(student, notebook, exercise, points, most, words)


def test_every_exercise_is_a_row_and_every_student_a_sum():
    grades = [given("ann", 1), given("ann", 0, 2, "not yet", "01_cloth"), given("bob", 1)]
    table, totals = make_grades.table(grades), make_grades.totals(grades)
    assert table["words"].tolist() == ["correct", "not yet", "correct"]
    assert totals.loc["ann", ["00_start_here", "01_cloth", "points", "most"]].tolist() == [1, 0, 1, 3]
    assert totals.loc["bob", "points"] == 1


def test_a_spreadsheet_finds_no_formula_in_a_students_words():
    table = make_grades.table([given("=cmd()", 0, words="@f\nraised   an error")])
    assert table.loc[0, ["student", "words"]].tolist() == ["'=cmd()", "'@f raised an error"]


def test_what_is_no_notebook_is_told(tmp_path):
    for k, text in enumerate(("", "[]", '{"cells": 3}', "{" * 100_000, "\0")):
        path = tmp_path / f"{k}.ipynb"
        path.write_text(text)
        with pytest.raises(ValueError, match=f"{k}.ipynb is no notebook"):
            make_grades.cells_of(path)


def test_magics_are_left_out(tmp_path):
    nbformat.write(nbformat.v4.new_notebook(cells=[new_code_cell("%matplotlib inline\n!ls\nx = 1")]), tmp_path / "a")
    assert make_grades.cells_of(tmp_path / "a") == ["\n\nx = 1"]


def test_only_definitions_of_a_submission_run():
    sources = ["import math, no_such_module\nf = 1\nfail_1()\n", "A = 2 * math.pi\n\ndef f():\n    return A\n\n1 / 0\n"]
    found, problem = sandbox_worker.defined(sources, "f")
    assert (found(), problem) == (pytest.approx(6.283185), "")


def test_values_that_a_function_needs_are_computed_and_no_others():
    sources = [
        "import sys\nnames = list('ab')\nplaces = {name: k for k, name in enumerate(names)}\n",
        "unused = sys.modules.__setitem__('unused', 1)\n\ndef place(name):\n    return places[name]\n",
        "def f(name):\n    names = 3\n    return place(name) + names\n",
    ]
    found, _ = sandbox_worker.defined(sources, "f")
    assert found("b") == 4
    assert "unused" not in sys.modules


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("g = 1", "there is no function f"),
        ("def f(:\n    return 1", "the cell of f is not Python: SyntaxError"),
        ("@nothing\ndef f():\n    return 1", "f could not be defined: NameError"),
        ("f = 3", "there is no function f"),
    ],
)
def test_a_function_that_is_not_there_is_told(source, told):
    found, problem = sandbox_worker.defined([source], "f")
    assert found is None
    assert problem.startswith(told)


def test_points_and_limits_are_of_exercises_and_notebooks_that_exist():
    plan = tomllib.loads((ROOT / "docs" / "course" / "weeks.toml").read_text())
    assert set(plan["limits"]) <= set(NOTEBOOKS)
    names = {name for path in NOTEBOOKS.values() for name in read_lesson(path).functions}
    assert set(plan["points"]) <= names
    for each in plan["limits"].values():
        make_grades.Limits(**each)


def test_a_folder_without_students_is_told(tmp_path):
    with pytest.raises(ValueError, match="has no folder of a student"):
        make_grades.grade(None, tmp_path, {}, {})


class School:
    """Makes submissions of one notebook, and knows its solutions."""

    def __init__(self, number):
        self.path = NOTEBOOKS[number]
        self.notebook = nbformat.read(self.path, as_version=4)
        self.names = functions(self.notebook.cells)
        self.solutions = dict(
            zip(self.names, (c.source for c in self.notebook.cells if "solution" in self.tags(c)), strict=True)
        )

    @staticmethod
    def tags(cell):
        return cell.metadata.get("tags", [])

    def hand_in(self, folder, answers, before=""):
        """A student edition whose stubs are replaced by answers, with a cell before everything."""
        edition = student_edition(self.notebook)
        stubs = iter(self.names)
        for cell in edition.cells:
            if "stub" in self.tags(cell):
                cell.source = answers.get(next(stubs), cell.source)
        edition.cells.insert(1, new_code_cell(before))
        folder.mkdir(parents=True)
        nbformat.write(edition, folder / self.path.name)

    def first(self, body):
        """The first exercise with a body that ends with its solution; the others are solved."""
        name = self.names[0]
        head = next(line for line in self.solutions[name].splitlines() if line.startswith("def "))
        hostile = f"{self.solutions[name]}\n\n_right = {name}\n\n{head}\n"
        return self.solutions | {name: hostile + "".join(f"    {line}\n" for line in body.splitlines())}


EVERY_WAY = """
import ctypes, os, pathlib, shutil, subprocess
for way in (
    lambda: shutil.rmtree(VICTIM),
    lambda: os.system(f"rm -r {VICTIM}"),
    lambda: subprocess.run(["rm", "-r", VICTIM]),
    lambda: os.remove(VICTIM + "/kept.txt"),
    lambda: os.rename(VICTIM + "/kept.txt", "mine.txt"),
    lambda: os.truncate(VICTIM + "/kept.txt", 0),
    lambda: open(VICTIM + "/kept.txt", "w").close(),
    lambda: pathlib.Path(VICTIM, "kept.txt").unlink(),
    lambda: os.unlink("kept.txt", dir_fd=os.open(VICTIM, os.O_RDONLY)),
    lambda: os.symlink(VICTIM, "link") or os.remove("link/kept.txt"),
    lambda: ctypes.CDLL(None).unlink((VICTIM + "/kept.txt").encode()),
    lambda: ctypes.pythonapi.PyRun_SimpleString(b"1"),
    lambda: os.kill(os.getppid(), 9),
    lambda: os.kill(GRADER, 9),
    lambda: open(os.path.expanduser("~/mine.txt"), "w").write("in my own home"),
):
    try:
        way()
    except Exception:
        pass
return None
"""
REDEFINED = """
class checks:
    def __getattr__(self, name):
        return lambda answer: print("correct")
checks = checks()
import numpy as np
np.allclose = lambda *a, **k: True
print("correct")
"""
FROM_WITHIN = """
import sys, builtins, gc
for module in list(sys.modules.values()):
    for name in ("allclose", "expect", "array_equal"):
        try:
            setattr(module, name, lambda *a, **k: True)
        except Exception:
            pass
for each in gc.get_objects():
    if type(each).__name__ == "Worker":
        each.send("result", {"odd": "correct"})
        each.send("ready", "correct")
        each.send("call", 0, [], {})
print("correct")
raise SystemExit(0)
"""
STOLEN = """
import json, importlib
for path in PATHS:
    try:
        cells = json.load(open(path))["cells"]
    except OSError:
        continue
    return 0 / 0
for name in ("clothlab.checks", "clothlab.checks.control", "clothlab.checks.start_here"):
    try:
        importlib.import_module(name)
    except ImportError:
        continue
    return 0 / 0
return None
"""
EATER = "held = []\nwhile True:\n    held.append(bytearray(10_000_000))"
FLOOD = "import sys\nwhile True:\n    sys.stdout.write('correct' * 1000)"
DISK = "with open('big', 'wb') as file:\n    while True:\n        file.write(bytes(1_000_000))"


def submissions(school, victim):
    """Ten submissions: what is handed in, and in how many of the exercises, the first or the others, it is right."""
    others = len(school.names) - 1
    hand = {"VICTIM": repr(str(victim)), "GRADER": str(os.getpid())}
    deleter = EVERY_WAY
    for word, value in hand.items():
        deleter = deleter.replace(word, value)
    stolen = STOLEN.replace("PATHS", repr([str(school.path)]))
    wrong = {
        name: school.solutions[name] + f"\n\ndef {name}(*a, **k):\n    return -12345.678\n" for name in school.names
    }
    printed = "".join(f"print({source!r})\n" for source in school.solutions.values())
    return {
        "ann-right": (school.solutions, "", 1, others),
        "bob-stubs": ({}, "", 0, 0),
        "cem-wrong": (wrong, "", 0, 0),
        "dia-redefines": ({}, REDEFINED, 0, 0),
        "eve-from-within": (school.first(FROM_WITHIN), "", 0, others),
        "fay-deletes": (school.first(deleter), "", 0, others),
        "gus-eats": (school.first(EATER), "", 0, others),
        "hal-steals": (school.first(stolen), "", 0, others),
        "ida-prints": ({}, printed, 0, 0),
        "jon-never-ends": (
            school.first({"00": "while True:\n    pass", "06": FLOOD, "08": DISK}[school.path.stem[:2]]),
            "",
            0,
            others,
        ),
    }


@pytest.fixture(scope="module")
def sandbox():
    with make_grades.Sandbox(make_grades.modules_of(list(NOTEBOOKS.values()))) as sandbox:
        if not sandbox.isolated:
            pytest.skip("NO bubblewrap: apt-get install bubblewrap")
        yield sandbox


@pytest.mark.slow
@pytest.mark.parametrize("number", CLASSES)
def test_a_class_of_ten_gets_what_it_deserves(sandbox, tmp_path, number):
    school, victim = School(number), tmp_path / "victim"
    victim.mkdir()
    (victim / "kept.txt").write_text("kept")
    handed = submissions(school, victim)
    for student, (answers, before, _, _) in handed.items():
        school.hand_in(tmp_path / "class" / student, answers, before)
    grades = make_grades.grade(sandbox, tmp_path / "class", {school.path.stem: school.path}, PLAN)
    assert len(grades) == 10 * len(school.names)
    for student, (_, _, first, others) in handed.items():
        its = [each for each in grades if each.student == student]
        points = [each.points for each in its]
        assert points == [first] + [1 if others else 0] * (len(its) - 1), [each.words for each in its]
        for each in its:
            assert (each.words == "correct") == bool(each.points)
            assert each.words
            assert "the check itself failed" not in each.words
    assert (victim / "kept.txt").read_text() == "kept"
    assert school.path.exists()
    assert not make_grades.table(grades)["words"].str.contains("ZeroDivisionError").any(), (
        "an answer has read a solution"
    )


@pytest.mark.slow
def test_an_endless_loop_is_told_and_what_follows_is_graded(sandbox, tmp_path):
    school = School("00")
    school.hand_in(tmp_path / "ann", school.first("while True:\n    pass"))
    plan = {"limits": {"00": {"seconds": 4}}}
    first, second = make_grades.grade(sandbox, tmp_path, {school.path.stem: school.path}, plan)
    assert first.words == "best_moment took longer than the 2 s that it has"
    assert second.points == 1


@pytest.mark.slow
def test_missing_doubled_broken_and_linked_notebooks_count_nothing(sandbox, tmp_path):
    school = School("00")
    (tmp_path / "ann").mkdir()
    for twice in ("a", "b"):
        school.hand_in(tmp_path / "bob" / twice, school.solutions)
    (tmp_path / "cem").mkdir()
    (tmp_path / "cem" / school.path.name).write_text("{}")
    (tmp_path / "dia").mkdir()
    (tmp_path / "dia" / school.path.name).symlink_to(school.path)
    grades = make_grades.grade(sandbox, tmp_path, {school.path.stem: school.path}, PLAN)
    assert {each.points for each in grades} == {0}
    words = {each.student: each.words for each in grades}
    assert words["ann"] == words["dia"] == "not handed in"
    assert words["bob"].startswith("there are 2 of 00_start_here.ipynb")
    assert words["cem"].startswith("00_start_here.ipynb is no notebook")


@pytest.mark.slow
@pytest.mark.parametrize("number", NOTEBOOKS)
def test_every_stub_counts_nothing_and_every_solution_its_points(sandbox, number):
    path = NOTEBOOKS[number]
    lesson, cells = read_lesson(path), nbformat.read(path, as_version=4).cells
    solved = [cell.source for cell in cells if cell.cell_type == "code"]
    stubs = [cell.source for cell in cells if cell.cell_type == "code" and "solution" not in School.tags(cell)]
    for name in lesson.functions:
        assert sandbox.judge(name, stubs, 60, 1000) != "correct"
        assert sandbox.judge(name, solved, 60, 1000) == "correct"


def test_nbgraders_gradebook_takes_the_points(tmp_path, monkeypatch):
    api = pytest.importorskip("nbgrader.api", reason="NO nbgrader: pip install nbgrader")
    grades = [given("ann", 1), given("bob", 0, words="not yet")]
    database = f"sqlite:///{tmp_path / 'gradebook.db'}"
    for _ in range(2):  # a second time changes nothing
        make_grades.keep_in_gradebook(grades, database, api.Gradebook)
    with api.Gradebook(database) as book:
        scores = {each.student.id: each.score for each in book.assignment_submissions("00_start_here")}
    assert scores == {"ann": 1, "bob": 0}
    assert sqlite3.connect(tmp_path / "gradebook.db").execute("select count(*) from grade").fetchone() == (2,)


def test_json_holds_what_answers_return():
    import numpy as np
    import torch

    worker = sandbox_worker.Worker(None, sandbox_worker.load_alone("_check"))
    for value in (np.float32(0.1), np.eye(2, dtype=np.float32), torch.ones(2, 0), (1, [2.5, None]), np.array([True])):
        message = json.loads(json.dumps(worker.encode(value)))
        answer = object.__new__(make_grades.Answer)
        back = answer._decode(message)
        assert np.shape(back) == np.shape(value) if not isinstance(value, tuple) else back == value
        if isinstance(value, np.ndarray):
            assert back.dtype == value.dtype
            assert np.array_equal(back, value)
