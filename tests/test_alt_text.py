"""Figures in words: the words name what is drawn, with its numbers, and change when the
figure does.
"""

import numpy as np
import pytest

from clothlab import plots
from clothlab._alt_text import describe
from clothlab.simulation.cloth import CLOTHS, FOAMS

RNG = np.random.default_rng(0)
BIASES = {name: RNG.normal(size=2) for name in CLOTHS}
PATH = np.cumsum(RNG.normal(size=(6, 2)), axis=0)
MASKS = RNG.random((3, 96, 128)) > 0.5
FIGURES = {
    "image grid": lambda: plots.image_grid(MASKS, ["a", "b", "c"], columns=2),
    "untitled image grid": lambda: plots.image_grid([np.zeros((4, 4, 3), np.uint8)]),
    "film strips": lambda: plots.film_strips(
        {"one": MASKS, "other": MASKS}, ["1", "2", "3"]
    ),
    "time series": lambda: plots.time_series(
        {"x": np.arange(4.0), "y": np.arange(4.0) ** 2}, "x [m]"
    ),
    "map": lambda: plots.material_map(BIASES, CLOTHS),
    "map of foams": lambda: plots.material_map(
        {name: RNG.normal(size=2) for name in FOAMS}, FOAMS, {"run": PATH}
    ),
    "map with a region": lambda: plots.material_map(
        BIASES, CLOTHS, {"run": PATH}, {"run": 0.1 * np.eye(2)}
    ),
}


def only(figure):
    """The one paragraph about a figure of one panel."""
    (paragraph,) = describe(figure).details
    return paragraph


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_of_the_package_is_put_in_words(name):
    figure = FIGURES[name]()
    words = describe(figure)
    assert 0 < len(words.summary) <= 240
    assert len(words.details) >= sum(ax.axison and ax.has_data() for ax in figure.axes)
    text = " ".join([words.summary, *words.details])
    assert not any(mark in text for mark in ("\n", "$", "\\", "_child", "nan")), text
    for line in (line for ax in figure.axes for line in ax.lines):
        if (
            not str(line.get_label()).startswith("_")
            and np.isfinite(line.get_xydata()).all(axis=1).any()
        ):
            assert f"{line.get_label()}: " in text


def test_a_line_is_said_by_its_ends_and_by_where_it_is_lowest_and_highest():
    figure = plots.time_series({"error": np.array([2.0, 5.0, 0.25, 1.0])}, "error [m]")
    assert (
        describe(figure).summary
        == "Line chart; horizontal: time [s]; vertical: error [m]; shown: error"
    )
    assert (
        "error: from 2 at 0 to 1 at 0.6, lowest 0.25 at 0.4, highest 5 at 0.2."
        in only(figure)
    )


def test_levels_paths_and_uprights_are_called_so():
    figure, ((ax,),) = plots.new_axes()
    ax.axhline(1.5, label="still")
    ax.axvline(0.25, label="start")
    ax.plot([0, 1, 0.5], [1, 2, 4], label="way")
    paragraph = only(figure)
    assert "still: level at 1.5" in paragraph
    assert "start: upright at 0.25" in paragraph
    assert (
        "way: a path from 1 at 0 to 4 at 0.5, 0 to 1 across and 1 to 4 up" in paragraph
    )


def test_a_picture_is_said_by_how_much_is_white_and_where():
    mask = np.zeros((10, 20), bool)
    mask[0, 15:] = True  # 5 of 200, in the upper right corner
    images = [mask, np.zeros((4, 4), bool), np.full((4, 4), 200), np.zeros((2, 3, 3))]
    words = describe(plots.image_grid(images, ["a", "b", "c", "d"]))
    assert words.summary == "Pictures in 4 panels; a, b, c, d"
    assert words.details == (
        "Panel 1, a. White in 2 % of it, around 88 % from the left and 5 % from the top.",
        "Panel 2, b. All black.",
        "Panel 3, c. Grey picture of 4 by 4 pixels.",
        "Panel 4, d. Colour picture of 3 by 2 pixels.",
    )


def test_a_picture_of_a_strip_is_named_by_its_row_and_its_column():
    words = describe(
        plots.film_strips(
            {"up": np.ones((2, 4, 4)), "down": np.ones((2, 4, 4))}, ["0 s", "1 s"]
        )
    )
    names = [paragraph.split(". ")[0] for paragraph in words.details]
    assert names == [
        "Panel 1, up, 0 s",
        "Panel 2, up, 1 s",
        "Panel 3, down, 0 s",
        "Panel 4, down, 1 s",
    ]


def test_bars_and_intervals_have_their_numbers_and_names_on_an_axis_stand_for_places():
    figure, ((ax,),) = plots.new_axes()
    ax.set_xticks([0, 1], ["light", "heavy"])
    ax.bar([0, 1], [3.0, 4.5], label="speed")
    paragraph = only(figure)
    assert "Horizontal: value with light, heavy" in paragraph
    assert "speed: light 3, heavy 4.5" in paragraph
    assert describe(figure).summary.startswith("Bar chart")
    figure, ((ax,),) = plots.new_axes()
    ax.errorbar(1.0, 2, xerr=[[0.5], [0.25]], fmt="o", label="mean")
    assert "mean: 2 at 1, intervals 0.5 to 1.25 across" in only(figure)


def test_notes_and_the_scale_of_colours_are_read():
    figure, ((ax,),) = plots.new_axes()
    figure.colorbar(ax.scatter([0.5], [2.0], c=[1.0]), label="loss")
    ax.annotate("soft", (0.5, 2.0))
    ax.text(0, 0, "look here")
    panel, colours = describe(figure).details
    assert panel.endswith("soft: 2 at 0.5. Written in it: look here.")
    assert colours.startswith("Colours: loss from ")


@pytest.mark.slow
def test_summaries_are_short():
    words = describe(
        plots.image_grid(np.ones((30, 3, 3)), [f"step {k}" for k in range(30)])
    )
    assert words.summary == "Pictures in 30 panels; step 0 to step 29"
    figure, axes = plots.new_axes(1, 3)
    for k, ax in enumerate(axes.flat):
        ax.plot([0, 1, 2], [1, 2, 3], label=f"{k} " + 30 * "word ")
    summary = describe(figure).summary
    assert len(summary) <= 240
    assert summary.endswith("word …")


def test_labels_lose_the_marks_of_type():
    figure, ((ax,),) = plots.new_axes()
    ax.loglog([0.1, 1], [1, 2], label="a\nb")
    ax.set_xlabel(r"$\mathdefault{C_{damp}}$")
    assert "horizontal: C_damp; shown: a b" in describe(figure).summary
    assert "C_damp from 0.0891 to 1.12, logarithmic" in only(figure), (
        "ticks such as 10^-1 are numbers, not names"
    )


def test_a_notebook_gets_the_words_with_the_picture():
    figure = plots.time_series({"x": np.arange(4.0)}, "x [m]")
    picture, metadata = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert metadata == {
        "alt": describe(figure).summary,
        "details": list(describe(figure).details),
    }
    assert describe(plots.new_axes()[0]).summary == "Empty figure"
