"""A made-up class: who is right gets the points, who is wrong a sentence, and who is hostile nothing."""

import contextlib
import os
import sys

import make_grades
import nbformat
import pytest
import sandbox_worker
from make_editions import student_edition
from make_grades import ROOT, Sandbox
from nbformat.v4 import new_code_cell

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


class Nowhere:
    """Stands for a sandbox: whose sources say "right" are."""

    def judge(self, name, sources):
        return "correct" if sources == ["\nright\n"] else f"=Not\nyet, {name}"


def test_every_exercise_is_a_row_and_every_student_a_sum(tmp_path):
    for student, source in {"ann": "right", "=bob()": "wrong"}.items():
        (tmp_path / student / "late").mkdir(parents=True)
        notebook = nbformat.v4.new_notebook(cells=[new_code_cell(f"%magic\n{source}\n!ls")])
        nbformat.write(notebook, tmp_path / student / "late" / NOTEBOOKS[0].name)
    grades = make_grades.grade(Nowhere(), tmp_path, NOTEBOOKS[:2], {"best_moment": 3})
    ann = grades[grades["student"] == "ann"]
    assert ann["points"].tolist() == [3, 0, 0]
    assert ann["words"].tolist() == ["correct"] + ["not handed in"] * 2
    assert make_grades.totals(grades).loc["ann", [NOTEBOOKS[0].stem, "points", "most"]].tolist() == [3, 3, 5]
    assert grades.loc[0, ["student", "words"]].tolist() == ["'=bob()", "'=Not yet, best_moment"], "no formulas"


def test_of_a_submission_definitions_run_and_the_values_that_they_need():
    sources = [
        "import sys, math, no_such_module\nfail()\nnames = list('ab')\n",
        "places = {name: k for k, name in enumerate(names)}\n",
        "count = sys.modules.__setitem__('slow', 1)\n\ndef place(name):\n    return places[name]\n\n1 / 0\n",
        "def f(name):\n    count = 3\n    return place(name) + count * math.pi\n",
    ]
    found, problem = sandbox_worker.defined(sources, "f")
    assert (found("b"), problem) == (pytest.approx(10.42478), "")
    assert "slow" not in sys.modules, "a value that only shares its name with a local variable was computed"


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("f = 3", "there is no function f"),
        ("def f(:\n    return 1", "the cell of f is not Python: SyntaxError"),
        ("@nothing\ndef f():\n    return 1", "f could not be defined: NameError"),
    ],
)
def test_the_reason_is_given_for_a_function_that_is_not_there(source, words):
    found, problem = sandbox_worker.defined([source], "f")
    assert found is None
    assert problem.startswith(words)


def tags(cell):
    return cell.metadata.get("tags", [])


class School:
    """Makes submissions of one notebook, and knows its solutions."""

    def __init__(self, number):
        (self.path,) = (path for path in NOTEBOOKS if path.name.startswith(number))
        self.notebook = nbformat.read(self.path, as_version=4)
        self.names = make_grades.exercises(self.notebook.cells)
        solutions = [cell.source for cell in self.notebook.cells if "solution" in tags(cell)]
        self.solutions = dict(zip(self.names, solutions, strict=True))

    def hand_in(self, folder, answers, before=""):
        """A student edition whose stubs are replaced by answers, with a cell before everything."""
        edition = student_edition(self.notebook)
        stubs = iter(self.names)
        for cell in edition.cells:
            if "stub" in tags(cell):
                cell.source = answers.get(next(stubs), cell.source)
        edition.cells.insert(1, new_code_cell(before))
        folder.mkdir(parents=True)
        nbformat.write(edition, folder / self.path.name)

    def first(self, body):
        """All exercises solved, but the first with another body."""
        name = self.names[0]
        head = next(line for line in self.solutions[name].splitlines() if line.startswith("def "))
        lines = "".join(f"    {line}\n" for line in body.splitlines())
        return self.solutions | {name: f"{self.solutions[name]}\n\n_right = {name}\n\n{head}\n{lines}"}


EVERY_WAY = """
import ctypes, os, pathlib, shutil, subprocess
kept = VICTIM + "/kept.txt"
for way in (
    lambda: shutil.rmtree(VICTIM),
    lambda: subprocess.run(["rm", "-r", VICTIM]),
    lambda: os.rename(kept, "mine.txt"),
    lambda: os.truncate(kept, 0),
    lambda: os.symlink(VICTIM, "link") or os.remove("link/kept.txt"),
    lambda: ctypes.CDLL(None).unlink(kept.encode()),
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
import sys, gc
for module in list(sys.modules.values()):
    for name in ("allclose", "expect", "array_equal"):
        try:
            setattr(module, name, lambda *a, **k: True)
        except Exception:
            pass
for each in gc.get_objects():
    if type(each).__name__ == "Worker":
        each.send("failed", "correct")
        each.send("result", {"odd": "correct"})
        each.send("call", 0, [], {})
print("correct")
raise SystemExit(0)
"""
STOLEN = """
import importlib
for read in (lambda: open(PATH), *(lambda name=name: importlib.import_module(name).control for name in NAMES)):
    try:
        read()
    except (OSError, ImportError, AttributeError):
        continue
    return 0 / 0
return None
"""
EATER = "held = []\nwhile True:\n    held.append(bytearray(10_000_000))"
DISK = "with open('big', 'wb') as file:\n    while True:\n        file.write(bytes(1_000_000))"
STRAY = "import os\nif os.fork():\n    return None\nos.setsid()\nwhile True:\n    pass"


def submissions(school, victim):
    """What is handed in, and in how many of the exercises, the first or the others, it is right."""
    deletes = EVERY_WAY.replace("VICTIM", repr(str(victim))).replace("GRADER", str(os.getpid()))
    steals = STOLEN.replace("PATH", repr(str(school.path))).replace("NAMES", '("clothlab", "clothlab.checks")')
    wrong = {
        name: f"{school.solutions[name]}\n\ndef {name}(*a, **k):\n    return -12345.678\n" for name in school.names
    }
    bodies = {"eve-from-within": FROM_WITHIN, "fay-deletes": deletes, "gus-eats": EATER, "hal-steals": steals}
    bodies |= {"jon-never-ends": "while True:\n    pass", "kim-fills-the-disk": DISK, "leo-leaves-a-process": STRAY}
    return {
        "ann-right": (school.solutions, "", 1, 1),
        "bob-stubs": ({}, "", 0, 0),
        "cem-wrong": (wrong, "", 0, 0),
        "dia-redefines": ({}, REDEFINED, 0, 0),
        "ida-prints": ({}, "".join(f"print({source!r})\n" for source in school.solutions.values()), 0, 0),
    } | {student: (school.first(body), "", 0, 1) for student, body in bodies.items()}


@pytest.fixture(scope="module")
def sandbox():
    with contextlib.closing(Sandbox(NOTEBOOKS, seconds=300)) as sandbox:  # of which a busy machine takes more
        if not sandbox.isolated:
            pytest.skip("NO bubblewrap: apt-get install bubblewrap")
        yield sandbox


@pytest.mark.slow
@pytest.mark.parametrize("number", ["00", "07"])
def test_a_class_gets_what_it_deserves(sandbox, tmp_path, monkeypatch, number):
    monkeypatch.setattr(sandbox, "seconds", 5)
    school, victim = School(number), tmp_path / "victim"
    victim.mkdir()
    (victim / "kept.txt").write_text("kept")
    handed = submissions(school, victim)
    for student, (answers, before, _, _) in handed.items():
        school.hand_in(tmp_path / "class" / student, answers, before)
    grades = make_grades.grade(sandbox, tmp_path / "class", [school.path], {})
    words = {student: rows["words"].tolist() for student, rows in grades.groupby("student")}
    for student, (_, _, first, others) in handed.items():
        assert [each == "correct" for each in words[student]] == [first] + [others] * (len(school.names) - 1), words
    assert (grades["points"] == (grades["words"] == "correct")).all()
    assert "took more than 5 s" in words["jon-never-ends"][0]
    assert "ZeroDivisionError" not in words["hal-steals"][0], "an answer has read a solution"
    assert (victim / "kept.txt").read_text() == "kept"


@pytest.mark.slow
def test_missing_doubled_broken_and_linked_notebooks_count_nothing(sandbox, tmp_path):
    school = School("00")
    for twice in ("a", "b"):
        school.hand_in(tmp_path / "bob" / twice, school.solutions)
    for student in ("ann", "cem", "dia"):
        (tmp_path / student).mkdir()
    (tmp_path / "cem" / school.path.name).write_text("{}")
    (tmp_path / "dia" / school.path.name).symlink_to(school.path)
    grades = make_grades.grade(sandbox, tmp_path, [school.path], {})
    assert not grades["points"].any()
    words = dict(zip(grades["student"], grades["words"], strict=True))
    assert words["ann"] == words["dia"] == "not handed in"
    assert words["bob"] == "there are 2 of 00_start_here.ipynb"
    assert words["cem"].startswith("00_start_here.ipynb is no notebook")


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_solution_is_correct_there_too(sandbox, path):
    cells = nbformat.read(path, as_version=4).cells
    for name in make_grades.exercises(cells):
        assert sandbox.judge(name, [cell.source for cell in cells if cell.cell_type == "code"]) == "correct"
