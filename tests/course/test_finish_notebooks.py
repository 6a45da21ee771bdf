"""What `make format` writes: times, exercises and sums, and links from one notebook to
the next, whose numbers may have a letter.
"""

from pathlib import Path

from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from course import finish_notebooks
from course.repository import number_of

TIMES = "**Working time**: about {} minutes. **Running time**: about 20 seconds"
SYLLABUS = """# Syllabus

| notebook | minutes | ◇ minutes | exercises |
| --- | --- | --- | --- |
| [07 Control](../../notebooks/07_control.ipynb) | 1 | – | – |
| [07b Why](../../notebooks/07b_why.ipynb) | 1 | – | – |
| [09 Own](../../notebooks/09_own.ipynb) | 120 | 30 | – |

## Part I

About 1.0 hours of work, 1 points.

| week | notebooks | hours | to discuss |
| --- | --- | --- | --- |
| 1. Control | 07, 07b | 1.0 | Why? |
| 2. Own | 09 | 2.0 | Now? |
"""


def lesson(title, minutes, *exercises):
    """A notebook with a title, a time, and exercises."""
    text = new_markdown_cell(f"# {title}\n\n{TIMES.format(minutes)}")
    stubs = [
        new_code_cell(f"def {name}():\n    ...", metadata={"tags": ["stub"]})
        for name in exercises
    ]
    end = new_markdown_cell("## Summary\n\nNext: [where](it_was.ipynb). And on.")
    return new_notebook(cells=[text, *stubs, end])


LESSONS = {
    "07_control.ipynb": lesson("07 Control", 90, "mask"),
    "07b_why.ipynb": lesson("07b Why", 45, "start", "score"),
    "10_more.ipynb": lesson("10 More", 60),
}


def test_the_syllabus_has_times_exercises_and_their_sums():
    found = finish_notebooks.with_exercises(SYLLABUS, LESSONS, {"score": 3})
    assert "[07 Control](../../notebooks/07_control.ipynb) | 90 | – | `mask` |" in found
    assert "07b_why.ipynb) | 45 | – | `start` · `score` (3) |" in found
    assert "09_own.ipynb) | 120 | 30 | – |" in found  # is not there yet
    assert "About 2.2 hours of work, 5 points." in found
    assert "| 1. Control | 07, 07b | 2.2 | Why? |" in found
    assert "| 2. Own | 09 | 0.0 | Now? |" in found
    again = finish_notebooks.with_exercises(found, LESSONS, {"score": 3})
    assert again == found


def test_the_readme_has_the_hours_of_part_one_and_times_of_a_notebook_with_a_letter():
    readme = (
        "**Part I, the method**, in two notebooks, about 9 hours: a cloth\n"
        "| [07b why](notebooks/07b_why.ipynb) | Why? | 1 min | 1 s |\n"
        "| [09 own](notebooks/09_own.ipynb) | Own? | 2 min | 2 s |\n"
    )
    found = finish_notebooks.part_one(readme, LESSONS)
    assert found.startswith("**Part I, the method**, in 2 notebooks, about 2 hours: a")
    assert finish_notebooks.part_one(found, LESSONS) == found
    timed = finish_notebooks.with_times(found, LESSONS).splitlines()
    assert timed[1].endswith("| Why? | 45 min | 20 s |")
    assert timed[2].endswith("| Own? | 2 min | 2 s |")


def test_side_roads_are_summed_beside_the_hours():
    longer = lesson("07b Why", 45, "start")
    longer.cells[0].source += ". **Side roads**: about 90 minutes more, for a section."
    lessons = LESSONS | {"07b_why.ipynb": longer}
    readme = "**Part I, the method**, in two notebooks, about 9 hours: a cloth\n"
    for _ in range(2):  # twice is as once
        readme = finish_notebooks.part_one(readme, lessons)
        assert "in 2 notebooks, about 2 hours and 2 of side roads: a" in readme
    found = SYLLABUS
    for _ in range(2):
        found = finish_notebooks.with_exercises(found, lessons, {})
        assert "About 2.2 hours of work and 1.5 of side roads, 2 points." in found
        assert "07b_why.ipynb) | 45 | 90 | `start` |" in found


def test_exercises_on_side_roads_are_marked():
    texts = {
        "## 1. Road": ["road"],
        "**Exercise 2 ◇: a detour.** Go.": ["detour"],
        "**Exercise 3.** Come back.": ["back"],
        "### A path ◇": ["path"],
        "And on.\n\n**Exercise 4.** Further.": ["further"],
        "## 2. Lane ◇": ["lane"],
        "## 3. Road, again": ["again"],
    }
    cells = [new_markdown_cell("# 07 Control\n\n" + TIMES.format(90))]
    for text, names in texts.items():
        stubs = lesson("", 0, *names).cells[1:-1]
        cells += [new_markdown_cell(text), *stubs]
    notebook = new_notebook(cells=cells)
    found = finish_notebooks.side_exercises(notebook)
    assert found == {"detour", "path", "further", "lane"}
    lessons = LESSONS | {"07_control.ipynb": notebook}
    syllabus = finish_notebooks.with_exercises(SYLLABUS, lessons, {"lane": 2})
    assert "`road` · `detour` ◇ · `back` · `path` ◇" in syllabus
    assert "`lane` ◇ (2) · `again` |" in syllabus


def test_a_notebook_leads_on_to_the_next_one():
    first, second = lesson("07 Control", 90), LESSONS["07b_why.ipynb"]
    finish_notebooks.lead_on(first, Path("07b_why.ipynb"), second)
    said = first.cells[-1].source
    assert said == "## Summary\n\nNext: [07b Why](07b_why.ipynb). And on."
    assert number_of(Path("notebooks/07b_why.ipynb")) == "07b"
    assert number_of(Path("notebooks/10_more.ipynb")) == "10"
