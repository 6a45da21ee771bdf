"""What the site is made of: the notebooks with folded code and pictures for widgets,
and no answer for students.
"""

import json
import re
import tomllib
import zipfile

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from course import book, editions, grades
from course.editions import ROOT
from course.repository import number_of

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FOLDED = {"source_hidden": True}
PICTURE = {"image/png": "iVBORw0KGgo="}
WORDS = {
    "image/png": {
        "alt": "Line chart; shown: a",
        "details": ["a < b: from 1 at 0 to 2 at 1."],
    }
}


def printed(text):
    return new_output("stream", name="stdout", text=text)


def shown(data, metadata=None):
    return new_output("display_data", data, metadata=metadata or {})


@pytest.fixture
def lesson():
    """A notebook that ran: a figure, an exercise, and what comes after it."""
    cells = [
        new_markdown_cell("# 08 Lesson"),
        new_code_cell(
            "import on_colab", metadata={"tags": ["colab"], "jupyter": FOLDED}
        ),
        new_code_cell(
            "draw()",
            metadata={"tags": ["plot"], "jupyter": FOLDED},
            outputs=[shown(PICTURE, WORDS)],
        ),
        new_code_cell("arm", metadata={"alt": "an arm"}, outputs=[shown(PICTURE)]),
        new_code_cell(
            "def f():\n    return None",
            metadata={"tags": ["stub"]},
            outputs=[printed("of the stub")],
        ),
        new_code_cell(
            "def f():\n    return sesame",
            metadata={"tags": ["solution"], "jupyter": FOLDED},
        ),
        new_code_cell("check(f)", outputs=[printed("correct, sesame")]),
        new_markdown_cell("## Summary, [map](../README.md)"),
        new_code_cell("last()", outputs=[printed("the end")]),
    ]
    return new_notebook(cells=cells, metadata={"widgets": {"state": {}}})


def code(page):
    return {
        cell.source.splitlines()[-1].strip(): cell
        for cell in page.cells
        if cell.cell_type == "code"
    }


def test_code_of_figures_and_solutions_is_folded_and_says_what_it_is(lesson):
    cells = code(book.web_page(lesson, "08_lesson.ipynb", student=False))
    assert (
        cells["draw()"].metadata["mystnb"]["code_prompt_show"]
        == "Show the code of this figure"
    )
    assert (
        cells["return sesame"].metadata["mystnb"]["code_prompt_show"]
        == "Show a solution"
    )
    folded = {
        source
        for source, cell in cells.items()
        if "hide-input" in cell.metadata["tags"]
    }
    assert folded == {"draw()", "return sesame"}
    assert "import on_colab" not in cells, "nothing that only Colab needs"


def test_a_figure_has_its_alternative_text_and_its_numbers_folded_below(lesson):
    cells = code(book.web_page(lesson, "08_lesson.ipynb", student=False))
    assert cells["draw()"].metadata["mystnb"]["image"] == {
        "alt": "Line chart; shown: a"
    }
    assert cells["arm"].metadata["mystnb"]["image"] == {"alt": "an arm"}
    picture, words = cells["draw()"].outputs
    assert picture.data == PICTURE
    assert (
        "<summary>In words</summary><p>a &lt; b: from 1 at 0 to 2 at 1.</p>"
        in words.data["text/html"]
    )


def test_students_see_neither_a_solution_nor_what_came_of_it(lesson):
    before = nbformat.writes(lesson)
    page = book.web_page(lesson, "08_lesson.ipynb", student=True)
    assert "sesame" not in json.dumps(page)
    cells = code(page)
    assert cells["return None"].outputs == cells["check(f)"].outputs == []
    assert cells["last()"].outputs[0].text == "the end"
    assert cells["draw()"].outputs[0].data == PICTURE
    assert nbformat.writes(lesson) == before


def test_a_widget_becomes_its_picture_or_nothing_and_a_video_waits():
    view = {book.WIDGET: {"model_id": "1"}, "text/plain": "Control()"}
    assert list(book.web_output(shown(view))) == []
    (picture,) = book.web_output(shown(view | PICTURE))
    assert picture.data == PICTURE
    page = '<video controls width="9" autoplay loop aria-label="a loop"><source src="data:video/mp4;base64,A"/>'
    (output,) = book.web_output(shown({"text/html": page, "text/plain": "<HTML>"}))
    assert output.data["text/html"] == page.replace(" autoplay loop", "")


@pytest.mark.slow
def test_every_notebook_is_a_page_and_a_download(tmp_path):
    notebooks = {path.name: nbformat.read(path, as_version=4) for path in NOTEBOOKS}
    book.lay_out(notebooks, tmp_path, student=True)
    assert sorted(
        path.name for path in (tmp_path / "notebooks").glob("*.ipynb")
    ) == list(notebooks)
    for name, notebook in notebooks.items():
        nbformat.validate(nbformat.read(tmp_path / "notebooks" / name, as_version=4))
        held = nbformat.read(tmp_path / "downloads" / name, as_version=4)
        assert held == editions.student_edition(notebook)
    with zipfile.ZipFile(tmp_path / "notebooks.zip") as archive:
        assert sorted(set(archive.namelist()) & set(notebooks)) == list(notebooks)


def rows(section):
    """Cells of the tables in a section of the syllabus, without their heads."""
    syllabus = (ROOT / "docs" / "course" / "syllabus.md").read_text("utf-8")
    text = syllabus.split(f"## {section}\n")[1].split("\n## ")[0]
    return [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in text.splitlines()
        if re.match(r"\| [\[\d]", line)
    ]


def test_the_syllabus_says_what_the_notebooks_say_and_adds_up():
    points = tomllib.loads(grades.POINTS.read_text())
    minutes, names = {}, set()
    for path, (link, time, aside, exercises) in zip(
        NOTEBOOKS, rows("The notebooks"), strict=True
    ):
        notebook = nbformat.read(path, as_version=4)
        assert f"({'../../notebooks/' + path.name})" in link
        first = notebook.cells[0].source
        assert f"**Working time**: about {time} minutes" in first
        if aside == "–":
            assert "**Side roads**" not in first
        else:
            assert f"**Side roads**: about {aside} minutes more" in first
        weights = {
            name: points.get(name, 1) for name in grades.exercises(notebook.cells)
        }
        names |= set(weights)
        asked = [
            f"`{name}`" + f" ({most})" * (most != 1) for name, most in weights.items()
        ]
        assert exercises.replace(" ◇", "").split(" · ") == (asked or ["–"])
        minutes[number_of(path)] = int(time)
    part = [number for number in minutes if number < "10"]
    for plan, planned in {
        "Part I in five weeks": part,
        "Everything in seven weeks": [*minutes],
    }.items():
        for title, numbers, hours, _ in rows(plan):
            summed = sum(minutes[number] for number in numbers.split(", "))
            assert float(hours) == pytest.approx(summed / 60, abs=0.06), title
        assert (
            sorted(", ".join(numbers for _, numbers, _, _ in rows(plan)).split(", "))
            == planned
        )
    assert set(points) <= names
