"""What the site is made of: the notebooks with folded code and pictures for widgets, and no answer for students."""

import json
import runpy
import zipfile
from pathlib import Path

import make_book
import make_editions
import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FOLDED = {"source_hidden": True}
PICTURE = {"image/png": "iVBORw0KGgo="}
WORDS = {"image/png": {"alt": "Line chart; shown: a", "details": ["a < b: from 1 at 0 to 2 at 1."]}}


def printed(text):
    return new_output("stream", name="stdout", text=text)


def shown(data, metadata=None):
    return new_output("display_data", data, metadata=metadata or {})


@pytest.fixture
def lesson():
    """A notebook that ran: a figure, an exercise, and what comes after it."""
    cells = [
        new_markdown_cell("# 08 Lesson"),
        new_code_cell("draw()", metadata={"tags": ["plot"], "jupyter": FOLDED}, outputs=[shown(PICTURE, WORDS)]),
        new_code_cell("holds()", metadata={"tags": ["claim"], "jupyter": FOLDED}, outputs=[printed("✓ it holds")]),
        new_code_cell("def f():\n    return None", metadata={"tags": ["stub"]}, outputs=[printed("of the stub")]),
        new_code_cell("def f():\n    return sesame", metadata={"tags": ["solution"], "jupyter": FOLDED}),
        new_code_cell("check(f)", outputs=[printed("correct, sesame")]),
        new_markdown_cell("## Summary"),
        new_code_cell("last()", outputs=[printed("the end")]),
    ]
    return new_notebook(cells=cells, metadata={"widgets": {"state": {}}})


def code(page):
    return {cell.source.splitlines()[-1].strip(): cell for cell in page.cells if cell.cell_type == "code"}


def test_code_of_figures_claims_and_solutions_is_folded_and_says_what_it_is(lesson):
    before = nbformat.writes(lesson)
    cells = code(make_book.web_page(lesson, "08_lesson.ipynb", student=False))
    prompts = {
        name: cells[name].metadata["mystnb"]["code_prompt_show"] for name in ("draw()", "holds()", "return sesame")
    }
    assert prompts == {
        "draw()": "Show the code of this figure",
        "holds()": "Show the condition that was checked",
        "return sesame": "Show a solution",
    }
    assert all("hide-input" in cells[name].metadata["tags"] for name in prompts)
    assert not any("hide-input" in cells[name].metadata["tags"] for name in ("return None", "check(f)", "last()"))
    assert cells["holds()"].outputs[0].text == "✓ it holds"
    assert nbformat.writes(lesson) == before


def test_a_figure_has_its_alternative_text_and_its_numbers_folded_below(lesson):
    cell = code(make_book.web_page(lesson, "08_lesson.ipynb", student=False))["draw()"]
    assert cell.metadata["mystnb"]["image"] == {"alt": "Line chart; shown: a"}
    picture, words = cell.outputs
    assert picture.data == PICTURE
    assert "<summary>In words</summary><p>a &lt; b: from 1 at 0 to 2 at 1.</p>" in words.data["text/html"]


def test_a_picture_without_words_takes_those_of_its_cell():
    cell = new_code_cell("picture", metadata={"alt": "an arm"}, outputs=[shown(PICTURE)])
    page = make_book.web_page(new_notebook(cells=[new_markdown_cell("# 01"), cell]), "01.ipynb", student=False)
    assert page.cells[-1].metadata["mystnb"]["image"]["alt"] == "an arm"


def test_students_see_neither_a_solution_nor_what_came_of_it(lesson):
    lesson.cells[-2].source += ", [map](../README.md)"
    page = make_book.web_page(lesson, "08_lesson.ipynb", student=True)
    assert page.cells[-2].source == lesson.cells[-2].source, "links lead to other pages of the site"
    assert "sesame" not in json.dumps(page)
    cells = code(page)
    assert cells["return None"].outputs == cells["check(f)"].outputs == []
    assert cells["last()"].outputs[0].text == "the end"
    assert cells["draw()"].outputs[0].data == PICTURE


def test_downloads_are_those_of_the_edition(lesson):
    both, one = (make_book.web_page(lesson, "08_lesson.ipynb", student=each).cells[1].source for each in (False, True))
    assert "downloads/student/08_lesson.ipynb" in both
    assert "downloads/instructor/08_lesson.ipynb" in both
    assert "instructor" not in one


def test_a_widget_becomes_its_picture_and_a_progress_bar_nothing():
    view = {make_book.WIDGET: {"model_id": "1"}, "text/plain": "Control()"}
    assert list(make_book.web_output(shown(view))) == []
    picture, note, words = make_book.web_output(shown(view | PICTURE, WORDS))
    assert picture.data == PICTURE
    assert make_book.HOW_TO_RUN in note.data["text/html"]
    assert "In words" in words.data["text/html"]
    assert list(make_book.web_output(new_output("stream", name="stderr", text="3/40 [00:01<00:20]"))) == []


def test_videos_wait_until_somebody_starts_them():
    page = '<video controls width="9" loop autoplay muted aria-label="loop"><source src="data:video/mp4;base64,A"/>'
    (output,) = make_book.web_output(shown({"text/html": page, "text/plain": "<HTML>"}))
    assert output.data["text/html"] == page.replace(" loop autoplay", "")


def test_every_notebook_is_a_page_without_a_run(tmp_path):
    pages = {path.name: nbformat.read(path, as_version=4) for path in NOTEBOOKS}
    make_book.lay_out(NOTEBOOKS, tmp_path / "source", pages, student=True)
    laid = sorted((tmp_path / "source" / "notebooks").glob("*.ipynb"))
    assert [path.name for path in laid] == [path.name for path in NOTEBOOKS]
    for path, master in zip(laid, NOTEBOOKS, strict=True):
        page = nbformat.read(path, as_version=4)
        nbformat.validate(page)
        assert page.cells[0].source == nbformat.read(master, as_version=4).cells[0].source
    assert not (tmp_path / "source" / "downloads" / "instructor").exists()
    with zipfile.ZipFile(tmp_path / "source" / "downloads" / "student.zip") as archive:
        assert archive.namelist() == [path.name for path in NOTEBOOKS]
        held = nbformat.reads(archive.read(NOTEBOOKS[0].name).decode(), as_version=4)
    assert held == make_editions.student_edition(nbformat.read(NOTEBOOKS[0], as_version=4))
    assert (tmp_path / "source" / "downloads.md").read_text().count("{download}") == 1


def test_a_run_is_fresh_until_the_notebook_changes(tmp_path, lesson):
    path, kept = tmp_path / "08_lesson.ipynb", tmp_path / "kept.ipynb"
    nbformat.write(lesson, path)
    assert not make_editions.is_fresh(kept, path)
    lesson.metadata["made_from"] = make_editions.made_from(path)
    nbformat.write(lesson, kept)
    assert make_editions.is_fresh(kept, path)
    path.write_text(path.read_text().replace("last()", "very_last()"))
    assert not make_editions.is_fresh(kept, path)


def test_a_small_run_is_taken_until_the_notebook_changes(tmp_path, lesson, monkeypatch):
    monkeypatch.setattr(make_book, "BUILD", tmp_path / "build")
    path = tmp_path / "08_lesson.ipynb"
    nbformat.write(lesson, path)
    with pytest.raises(FileNotFoundError, match="make notebooks"):
        make_book.ran(path, small=True)
    make_editions.write_small_copies([path], tmp_path / "build" / "small")
    assert make_book.ran(path, small=True).cells[1].source == lesson.cells[1].source
    path.write_text(path.read_text().replace("last()", "very_last()"))
    with pytest.raises(FileNotFoundError, match="older than the notebook"):
        make_book.ran(path, small=True)
    make_book.ran(path, small=True, old=True)


@pytest.fixture(scope="module")
def conf():
    """What Sphinx is told."""
    return runpy.run_path(str(ROOT / "docs" / "book" / "conf.py"))


def test_docstrings_in_markdown_become_what_sphinx_reads(conf):
    lines = ["Takes `p [D_p]` and ``q``:", "", "| a | b |", "| --- | --- |", "| `B` | batch |", "", "End."]
    conf["read_docstring"](None, "function", "f", None, None, lines)
    text = "\n".join(lines)
    assert text.startswith("Takes ``p [D_p]`` and ``q``:")
    assert "   * - a\n     - b\n   * - ``B``\n     - batch" in text
    assert "---" not in text
    assert text.endswith("End.")


def test_the_words_before_a_colon_are_no_type(conf):
    lines = ["Distance at the end [s.d. of z]: what the search looks at."]
    conf["read_docstring"](None, "property", "p", None, None, lines)
    assert lines == ["..", "", "Distance at the end [s.d. of z]: what the search looks at."]


def test_captions_say_their_level(conf):
    context = {"body": '<p class="caption" role="heading">', "furo_navigation_tree": ""}
    conf["level_captions"](None, "index", "page.html", context, None)
    assert 'role="heading" aria-level="2"' in context["body"]


def test_the_books_tools_are_pinned_beside_the_environment():
    pinned, asked, common = (
        {line.strip().lower() for line in (ROOT / name).read_text().splitlines() if "==" in line}
        for name in ("docs/requirements.txt", "docs/requirements.in", "environment.txt")
    )
    assert asked <= pinned, "run `make lock`"
    names = {each.split("==")[0] for each in common}
    assert not names & {each.split("==")[0] for each in pinned}, "one version of everything"
