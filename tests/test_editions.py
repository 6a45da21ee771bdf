"""What a class gets: stubs for students, executed solutions for the instructor."""

import json
import re
from pathlib import Path

import make_editions
import nbformat
import pytest
import repository

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def with_tag(notebook, tag):
    return [cell.source for cell in notebook.cells if tag in cell.metadata.get("tags", [])]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_students_get_every_stub_and_neither_solution_nor_condition(path):
    notebook = nbformat.read(path, as_version=4)
    student = make_editions.student_edition(notebook)
    nbformat.validate(student)
    assert with_tag(student, "stub") == with_tag(notebook, "stub")
    assert with_tag(student, "solution") == []
    text = json.dumps([cell.source for cell in student.cells], ensure_ascii=False)
    for stub, solution in zip(with_tag(notebook, "stub"), with_tag(notebook, "solution"), strict=True):
        answer = [line for line in solution.splitlines() if line.strip() and line not in stub.splitlines()]
        assert json.dumps("\n".join(answer), ensure_ascii=False)[1:-1] not in text
    kept = [cell for cell in notebook.cells if not {"solution", "claim"} & {*cell.metadata.get("tags", [])}]
    assert len(student.cells) == len(kept)


@pytest.mark.slow
def test_the_instructor_gets_solutions_that_ran_and_a_student_words_and_no_answer(tmp_path):
    head, cell = "def my_mask(t, horizon, period):\n    ", nbformat.v4.new_code_cell
    solution = head + "return [int(k % period == 0) for k in range(t + 1, t + horizon + 1)]"
    folded = {"tags": ["solution"], "jupyter": {"source_hidden": True}}
    cells = [
        nbformat.v4.new_markdown_cell("[map](../README.md)"),
        cell("from clothlab import checks"),
        cell(head + "return None", metadata={"tags": ["stub"]}),
        cell(solution, metadata=folded),
        cell("checks.my_mask(my_mask)"),
        cell("print('and so on')"),
    ]
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    path = tmp_path / "08_control.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=metadata), path)
    executed = make_editions.write_editions(path, tmp_path / "build")
    assert executed.cells[-2].outputs[0].text == "correct\n"
    assert "source_hidden" not in executed.cells[3].metadata.jupyter
    assert executed.cells[0].source == f"[map]({repository.address()}/blob/main/README.md)"
    page = re.sub("<[^>]*>", "", (tmp_path / "build" / "instructor" / "08_control.html").read_text())
    assert "range(t + 1, t + horizon + 1)" in page

    student = nbformat.read(tmp_path / "build" / "student" / path.name, as_version=4)
    ran = make_editions.instructor_edition(student, tmp_path)
    (failed,) = ran.cells[-2].outputs
    assert failed.ename == "CheckFailed"
    assert "my_mask returned None" in failed.evalue
    assert ran.cells[-1].outputs[0].text == "and so on\n", "an exercise that is not solved stops nothing"
