"""Slides: a heading begins one, text in pieces, a figure without its code, and nothing
of the solutions.
"""

import re

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_output

from course import slides
from course.repository import number_of, throw_page

PICTURE = new_output(
    "display_data",
    {"image/png": "iVBORw0KGgo="},
    metadata={"image/png": {"alt": "a line chart"}},
)
WORDS = new_output("stream", name="stdout", text="0.3")


def test_what_is_on_a_slide():
    cells = [
        new_markdown_cell("# 06 Bias\n\nTwo numbers."),
        new_code_cell("draw()", outputs=[PICTURE, WORDS], metadata={"tags": ["plot"]}),
        new_code_cell("print(0.3)", outputs=[WORDS]),
        new_markdown_cell("**Finding**: one.\n\n## 2. More\n\nText."),
        new_markdown_cell("## Exercises\n\n### Exercise 1: fall\n\nWrite it."),
        new_code_cell(
            "def f(): return 'solved'",
            metadata={"tags": ["solution"]},
            outputs=[PICTURE],
        ),
        new_code_cell("checks.f(f)", outputs=[PICTURE]),
        new_markdown_cell("## Summary\n\n- All.\n\n## References\n\n- K."),
    ]
    deck = slides.deck_of(nbformat.v4.new_notebook(cells=cells))
    nbformat.validate(deck)
    kinds = [cell.metadata["slideshow"]["slide_type"] for cell in deck.cells]
    assert kinds == ["slide", "subslide", "subslide", "slide", "slide"]
    assert [cell.source for cell in deck.cells][-2:] == [
        "## 2. More\n\nText.",
        "## Summary\n\n- All.",
    ]
    assert deck.cells[1].outputs == [PICTURE]
    # No name of a cell, which are random, has such letters
    assert "solved" not in nbformat.writes(deck)


def test_what_asks_for_the_notebook_is_left_to_it():
    change = "**Change this**: the rate.\n\n<details><summary>What to expect</summary>\n\nIt is fast.\n\n</details>"
    cells = [
        new_markdown_cell("## 1. Loop\n\nThe text.\n\n**Exercise 1.** Write the line."),
        new_markdown_cell("**Exercise 2.** Write another."),
        new_markdown_cell(
            "The package's function is this loop.",
            metadata={"slideshow": {"slide_type": "skip"}},
        ),
        new_markdown_cell(f"{change}\n\nAnd on."),
    ]
    deck = slides.deck_of(nbformat.v4.new_notebook(cells=cells))
    assert [cell.source for cell in deck.cells] == [
        "## 1. Loop\n\nThe text.",
        "And on.",
    ]


def test_the_last_slide_leads_telephones_to_the_live_lab():
    pytest.importorskip("segno", reason="NO segno: `make book` installs it")
    slide = slides.throw_slide()
    assert f"<{throw_page()}>" in slide.source
    # What the code says can't be read here; but another address has another code.
    assert slide.source.count("data:image/svg+xml") == 1


def test_the_decks_are_of_notebooks_that_exist():
    numbers = [number_of(path) for path in (slides.ROOT / "notebooks").glob("*.ipynb")]
    assert {"04", "06"} < {*slides.DECKS} <= {*numbers}


def test_long_text_goes_on_on_the_next_slide_and_nothing_is_lost():
    text = "# Title\n\n" + "\n\n".join(f"{k} " + "word " * 60 for k in range(9))
    found = slides.pieces(text)
    assert len(found) > 2
    assert all(len(piece) <= slides.LETTERS for piece in found)
    assert re.findall(r"^\d", "\n".join(found), re.MULTILINE) == list("012345678")
