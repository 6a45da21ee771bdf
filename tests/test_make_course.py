"""The syllabus says what the notebooks say, and adds up."""

import tomllib
from pathlib import Path

import make_course
import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
WEEKS = ROOT / "docs" / "course" / "weeks.toml"
FIRST = (
    "# 01 Cloth\n\n**Goals**\n- Swing it.\n- Catch it.\n\n**Working time**: about 90 minutes. **Running time**: 1 s."
)


def stub(name="f"):
    return new_code_cell(f"def {name}(): ...\n\n{name}()", metadata={"tags": ["stub"]})


def lesson(number, minutes, exercises=()):
    points = tuple(range(1, len(exercises) + 1))
    return make_course.Lesson(f"{number}_a", f"{number} A", ("swing",), minutes, exercises, exercises, points)


def test_a_lesson_is_read_off_the_first_cell_and_the_stubs(tmp_path):
    cells = [
        new_markdown_cell(FIRST),
        new_markdown_cell("### Exercise 1: fall\n\nLet it fall."),
        stub("g"),
        new_markdown_cell("**2. Who wins?** Say it."),
        stub(),
        new_markdown_cell("**3. Count.** One by one."),
        new_markdown_cell("A hint."),
        stub(),
    ]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), tmp_path / "01_cloth.ipynb")
    read = make_course.read_lesson(tmp_path / "01_cloth.ipynb", {"g": 3})
    titles, names, points = ("fall", "Who wins?", "Count"), ("g", "f", "f"), (3, 1, 1)
    assert read == make_course.Lesson("01_cloth", "01 Cloth", ("Swing it", "Catch it"), 90, titles, names, points)


@pytest.mark.parametrize("part", ["**Goals**", "about 90 minutes"])
def test_a_first_cell_that_lacks_something_is_named(tmp_path, part):
    cells = [new_markdown_cell(FIRST.replace(part, "?"))]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), tmp_path / "01_cloth.ipynb")
    with pytest.raises(ValueError, match=r"01_cloth.ipynb: the first cell has \*\*Goals"):
        make_course.read_lesson(tmp_path / "01_cloth.ipynb")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_notebook_has_a_lesson_with_a_title_for_each_exercise(path):
    read = make_course.read_lesson(path)
    assert read.title.startswith(path.stem[:2])
    assert 1 <= len(read.goals) <= 6
    assert 10 <= read.minutes <= 240
    assert len(set(read.exercises)) == len(read.exercises) >= 2
    assert all(read.exercises)


def test_times_and_points_add_up_and_what_is_left_out_is_said():
    lessons = {"00": lesson("00", 30, ("a",)), "01": lesson("01", 60, ("b", "c")), "02": lesson("02", 45)}
    weeks = {"six": [{"title": t, "notebooks": [n], "question": "Why?"} for t, n in (("One", "00"), ("Two", "01"))]}
    page = make_course.syllabus(weeks, lessons)
    assert "## Six weeks\n\nAbout 1.5 hours of work, 4 points in all." in page
    assert "### Week 1 of 2: One\n\nAbout 0.5 hours of work, 1 point." in page
    assert "To hand in: *b* (1) · *c* (2)" in page
    assert f"{make_course.LEFT_OUT}: [02 A](../notebooks/02_a.ipynb)." in page


def test_an_unknown_notebook_lists_the_choices():
    with pytest.raises(ValueError, match="no notebook 07; there are 00"):
        make_course.syllabus({"six": [{"title": "A", "notebooks": ["07"], "question": "?"}]}, {"00": lesson("00", 20)})


def test_six_weeks_take_every_notebook_once_and_none_is_far_too_long():
    plans = tomllib.loads(WEEKS.read_text("utf-8"))
    lessons = {path.stem[:2]: make_course.read_lesson(path) for path in NOTEBOOKS}
    for plan, most in (("six", 6), ("three", 7)):
        held = [number for week in plans[plan] for number in week["notebooks"]]
        assert len(held) == len(set(held))
        assert held == sorted(held)
        for week in plans[plan]:
            assert sum(lessons[number].minutes for number in week["notebooks"]) <= 60 * most, week["title"]
    assert {number for week in plans["six"] for number in week["notebooks"]} == set(lessons)
    assert {len(plans["six"]), len(plans["three"])} == {6, 3}
    assert make_course.write_syllabus(WEEKS, NOTEBOOKS).count("To discuss: ") == 9


def test_points_of_an_unknown_exercise_are_told(tmp_path):
    (tmp_path / "weeks.toml").write_text("six = []\nthree = []\n[points]\nsewing = 2\n")
    with pytest.raises(ValueError, match="no exercise sewing"):
        make_course.write_syllabus(tmp_path / "weeks.toml", NOTEBOOKS[:1])
