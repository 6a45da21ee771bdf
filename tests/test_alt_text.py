"""Figures in words: the words name what is drawn, with its numbers, and change when the figure does."""

import numpy as np
import pytest
from test_plots import FIGURES

from clothlab import plots
from clothlab.alt_text import LONGEST, describe, plain


def only(figure):
    """The one paragraph about a figure of one panel."""
    (paragraph,) = describe(figure).details
    return paragraph


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_of_the_package_is_put_in_words(name):
    figure = FIGURES[name]()
    words = describe(figure)
    assert 0 < len(words.summary) <= LONGEST
    assert len(words.details) >= sum(ax.axison and ax.has_data() for ax in figure.axes)
    text = " ".join([words.summary, *words.details])
    assert not any(mark in text for mark in ("\n", "$", "\\", "_child", "nan")), text
    for ax in figure.axes:
        for line in ax.lines:
            label = str(line.get_label())
            if not label.startswith("_") and np.isfinite(line.get_xydata()).all(axis=1).any():
                assert f"{plain(label)}: " in text


def test_a_line_is_said_by_its_ends_and_by_where_it_is_lowest_and_highest():
    figure = plots.time_series({"error": np.array([2.0, 5.0, 0.25, 1.0])}, "error [m]", time=np.arange(4.0))
    assert describe(figure).summary == "Line chart; horizontal: time [s]; vertical: error [m]; shown: error"
    assert "error: from 2 at 0 to 1 at 3, lowest 0.25 at 2, highest 5 at 1." in only(figure)


def test_a_level_is_a_level():
    figure, ((ax,),) = plots.new_axes()
    ax.axhline(1.5, label="still")
    ax.set_ylabel("distance")
    assert "still: level at 1.5" in only(figure)


def test_a_mask_is_said_by_how_much_is_white_and_where():
    mask = np.zeros((10, 20), bool)
    mask[0, 15:] = True  # 5 of 200, in the upper right corner
    words = describe(plots.image_grid([mask, ~mask, np.zeros((4, 4), bool)], ["a", "b", "c"], columns=3))
    assert words.summary == "Pictures in 3 panels; a, b, c"
    assert words.details[0] == "Panel 1, a. White in 2 % of it, around 88 % from the left and 5 % from the top."
    assert "White in 98 %" in words.details[1]
    assert words.details[2] == "Panel 3, c. All black."


def test_grey_values_are_said_by_what_is_nearer_to_white():
    grey = np.full((4, 4), 0.2)
    grey[:, 3] = 0.7
    images = [grey, np.full((4, 4), 0.2), np.full((4, 4), 200)]
    first, second, third = describe(plots.image_grid(images, ["a", "b", "c"], columns=3)).details
    assert first.endswith(
        "Nearer to white than to black in 25 % of it, around 88 % from the left and 50 % from the top."
    )
    assert second.endswith("Dark everywhere.")
    assert third.endswith("Grey picture of 4 by 4 pixels.")


def test_a_picture_of_a_strip_is_named_by_its_row_and_its_column():
    words = describe(plots.film_strips({"up": np.ones((2, 4, 4)), "down": np.ones((2, 4, 4))}, ["0 s", "1 s"]))
    assert [paragraph.split(". ")[0] for paragraph in words.details] == [
        "Panel 1, up, 0 s",
        "Panel 2, up, 1 s",
        "Panel 3, down, 0 s",
        "Panel 4, down, 1 s",
    ]


def test_names_on_an_axis_stand_for_its_numbers():
    figure, ((ax,),) = plots.new_axes()
    ax.set_xticks([0, 1], ["light", "heavy"])
    ax.bar([0, 1], [3.0, 4.5], label="speed")
    paragraph = only(figure)
    assert "Horizontal: value with light, heavy" in paragraph
    assert "speed: light 3, heavy 4.5" in paragraph
    assert describe(figure).summary.startswith("Bar chart")


def test_bars_on_their_side_and_intervals_have_their_numbers():
    figure, ((ax,),) = plots.new_axes()
    ax.barh([0, 1], [3.0, 4.5], label="speed")
    assert "speed: 0 3, 1 4.5" in only(figure)
    assert "a at 1, intervals 0.5 to 1.5 across" in only(plots.intervals({"a": (1.0, 0.5, 1.5)}, "difference"))


def test_dots_with_a_note_are_called_by_it():
    figure, ((ax,),) = plots.new_axes()
    ax.scatter([0.5], [2.0])
    ax.annotate("soft", (0.5, 2.0))
    ax.annotate("look here", (9, 9))
    assert only(figure).endswith("soft: 2 at 0.5. Written in it: look here.")


def test_what_has_no_name_is_of_its_colour_or_is_counted():
    figure, ((ax,),) = plots.new_axes()
    ax.plot([0, 1], [1, 2], color="red", label="a")
    ax.plot([0, 1], [5, 6], color="red")
    ax.plot([0, 1], [7, 8], color="blue")
    assert "a: from 5 at 0 to 6 at 1. without a name: from 7 at 0 to 8 at 1" in only(figure)
    for k in range(20):
        ax.plot([0, 1], [k, k + 1], color="green")
    assert "21 more, 0 to 1 across and 0 to 20 up" in only(figure)


def test_lines_of_one_colour_are_told_apart_by_their_style():
    figure, ((ax,),) = plots.new_axes()
    for level, style, label in ((1, "--", "still"), (2, ":", "empty"), (3, "--", None), (4, ":", None), (5, "-", None)):
        ax.plot([0, 1], [level, level], style, color="0.25", label=label)
    paragraph = only(figure)
    assert "still: level at 1. empty: level at 2. still: level at 3. empty: level at 4" in paragraph
    assert "without a name: level at 5" in paragraph, "a third style may be neither"


def test_many_panels_are_said_by_the_first_and_the_last():
    words = describe(plots.image_grid(np.ones((30, 3, 3)), [f"step {k}" for k in range(30)]))
    assert words.summary == "Pictures in 30 panels; step 0 to step 29"


def test_a_summary_ends_between_words():
    figure, axes = plots.new_axes(1, 3)
    for k, ax in enumerate(axes.flat):
        ax.plot([0, 1, 2], [1, 2, 3], label=f"{k} " + 30 * "word ")
    summary = describe(figure).summary
    assert len(summary) <= LONGEST
    assert summary.endswith("word …")


@pytest.mark.parametrize(
    ("label", "read"), [("$\\mathdefault{10^{-1}}$", "10^-1"), ("a\nb", "a b"), ("$C_{damp}$", "C_damp")]
)
def test_labels_lose_the_marks_of_type(label, read):
    assert plain(label) == read


def test_nothing_drawn_is_an_empty_figure():
    figure, _ = plots.new_axes()
    assert describe(figure).summary == "Empty figure"
    assert describe(figure).details == ()


def test_a_notebook_gets_the_words_with_the_picture():
    figure = plots.time_series({"x": np.arange(4.0)}, "x [m]")
    picture, metadata = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert metadata == {"alt": describe(figure).summary, "details": list(describe(figure).details)}
