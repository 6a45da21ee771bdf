"""What a class gets: stubs for students, executed solutions for the instructor."""

import json
import os
import subprocess
import sys
from pathlib import Path

import editions
import nbformat
import pytest
import repository
import solutions
from nbclient.exceptions import CellExecutionError
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def with_tag(notebook, tag):
    return [
        cell.source for cell in notebook.cells if tag in cell.metadata.get("tags", [])
    ]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_students_get_every_stub_and_neither_solution_nor_condition(path):
    notebook = solutions.solved(nbformat.read(path, as_version=4))
    student = editions.student_edition(notebook)
    nbformat.validate(student)
    assert with_tag(student, "stub") == with_tag(notebook, "stub")
    assert with_tag(student, "solution") == []
    text = json.dumps([cell.source for cell in student.cells], ensure_ascii=False)
    for stub, solution in zip(
        with_tag(notebook, "stub"), with_tag(notebook, "solution"), strict=True
    ):
        answer = [
            line
            for line in solution.splitlines()
            if line.strip() and line not in stub.splitlines()
        ]
        assert json.dumps("\n".join(answer), ensure_ascii=False)[1:-1] not in text
    kept = [
        cell
        for cell in notebook.cells
        if not {"solution", "claim"} & {*cell.metadata.get("tags", [])}
    ]
    assert len(student.cells) == len(kept)


HEAD = "def my_mask(t, settings):\n    "
KERNEL = {
    "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}
}


def lesson(last="print('and so on')", *, checked=True):
    """A notebook as it is committed, with one exercise and a last cell.

    Its check imports the package, which takes seconds.
    """
    solution = (
        HEAD + "steps = range(t + 1, t + settings.horizon + 1)\n    "
        "return [int(k % settings.period == 0) for k in steps]"
    )
    cells = [
        new_markdown_cell("[map](../README.md)"),
        new_code_cell("from clothlab import checks" if checked else "pass"),
        new_code_cell(HEAD + "return None", metadata={"tags": ["stub"]}),
        new_code_cell(solution, metadata={"tags": ["solution"]}),
        new_code_cell("checks.my_mask(my_mask)" if checked else "pass"),
        new_code_cell(last),
    ]
    return solutions.unsolved(new_notebook(cells=cells, metadata=KERNEL))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_in_the_repository_solutions_are_text_that_is_linted_and_formatted(path):
    notebook = nbformat.read(path, as_version=4)
    assert {
        cell.cell_type for cell in notebook.cells if "solution" in solutions.tags(cell)
    } <= {"markdown"}
    assert notebook == solutions.formatted(notebook, path.name), "run `make format`"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_from_the_first_stub_on_an_error_stops_only_a_solved_notebook(path):
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    first = next(
        (k for k, cell in enumerate(code) if "stub" in solutions.tags(cell)), len(code)
    )
    assert [solutions.UNSTOPPED in solutions.tags(cell) for cell in code] == [
        k >= first for k in range(len(code))
    ]
    solved = solutions.solved(notebook)
    assert not with_tag(solved, solutions.UNSTOPPED)
    assert len(with_tag(solved, "solution")) == len(with_tag(notebook, "stub"))
    assert solutions.unsolved(solved) == notebook


def test_a_solution_that_is_not_folded_code_is_refused():
    notebook = new_notebook(
        cells=[new_markdown_cell("`return 1`", metadata={"tags": ["solution"]})]
    )
    with pytest.raises(ValueError, match=r"a solution must be .*return 1"):
        solutions.solved(notebook)


def kinds_of_solutions(notebook):
    """What kinds of cells solutions are, of all that have one."""
    cells = [cell for cell in notebook.cells if "solution" in solutions.tags(cell)]
    return [cell.cell_type for cell in cells]


def test_each_command_does_its_own_and_a_notebook_that_is_right_is_not_touched(
    tmp_path, monkeypatch
):
    path = tmp_path / "08_control.ipynb"
    path.write_text(nbformat.writes(lesson()) + "\n")
    for words in (["format", path], ["solve", "--into", tmp_path / "to", path]):
        monkeypatch.setattr(sys, "argv", ["solutions.py", *map(str, words)])
        solutions.main()
    before = path.stat().st_mtime_ns
    solved = nbformat.read(tmp_path / "to" / path.name, as_version=4)
    assert kinds_of_solutions(solved) == ["code"]
    formatted = nbformat.read(path, as_version=4)
    assert kinds_of_solutions(formatted) == ["markdown"]
    solutions.format_all([path])
    assert path.stat().st_mtime_ns == before


@pytest.mark.slow
def test_an_edition_shows_no_recording_or_try_of_who_makes_it_and_leaves_none(
    tmp_path, monkeypatch
):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "tries.csv").touch()
    monkeypatch.setenv("CLOTHLAB_RECORDINGS", str(mine))
    look = """from clothlab import data
kept = data.own_trials() / "tries.csv"
print(kept.exists())
kept.write_text("a try")"""
    for _ in range(2):
        cells = [new_code_cell(look)]
        notebook = new_notebook(cells=cells, metadata=KERNEL)
        edition = editions.executed(notebook, tmp_path)
        assert edition.cells[0].outputs[0].text == "False\n"
    assert (mine / "tries.csv").read_text() == ""
    assert os.environ["CLOTHLAB_RECORDINGS"] == str(mine)


@pytest.mark.slow
def test_an_error_stops_a_solved_notebook_and_turns_the_run_red(tmp_path):
    committed = lesson(last="1 / 0", checked=False)
    editions.executed(committed, tmp_path)
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        editions.executed(solutions.solved(committed), tmp_path)
    path = tmp_path / "08_control.ipynb"
    nbformat.write(committed, path)
    words = ["solve", "--into", tmp_path / "solved", path]
    subprocess.run(
        [sys.executable, "scripts/solutions.py", *words], cwd=ROOT, check=True
    )
    run = [
        sys.executable,
        "-m",
        "pytest",
        "--nbmake",
        "-p",
        "no:cacheprovider",
        tmp_path / "solved" / path.name,
    ]
    ended = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 1, ended.stdout
    assert "ZeroDivisionError" in ended.stdout


@pytest.mark.slow
def test_the_instructor_gets_solutions_that_ran_and_a_student_words_and_no_answer(
    tmp_path,
):
    path = tmp_path / "08_control.ipynb"
    nbformat.write(lesson(), path)
    editions.write_editions(path, tmp_path / "build")
    made = tmp_path / "build" / "instructor" / path.name
    executed = nbformat.read(made, as_version=4)
    assert executed.cells[-2].outputs[0].text == "correct\n"
    assert executed.cells[3].cell_type == "code"
    assert "source_hidden" not in executed.cells[3].metadata.jupyter
    (map_of_all,) = repository.portable(
        new_notebook(cells=[new_markdown_cell("[map](../README.md)")])
    ).cells
    assert executed.cells[0].source == map_of_all.source
    student = nbformat.read(tmp_path / "build" / "student" / path.name, as_version=4)
    ran = editions.executed(student, tmp_path)
    (failed,) = ran.cells[-2].outputs
    assert failed.ename == "CheckFailed"
    assert "my_mask returned None" in failed.evalue
    assert ran.cells[-1].outputs[0].text == "and so on\n", (
        "an exercise that is not solved stops nothing"
    )
