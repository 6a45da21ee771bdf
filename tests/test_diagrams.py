"""The drawings: what moves is orange and nothing else, words fit, and can be read."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text

from clothlab import diagrams, plots
from clothlab._alt_text import describe
from clothlab.simulation.muscle import Muscles

RED = to_rgb(plots.COLOURS[1])
QUANTITIES = ("W", "p", "u")
DRAWINGS = {
    **{f"method {lit}": (diagrams.method, (lit,)) for lit in (None, *QUANTITIES)},
    "muscle pair": (diagrams.muscle_pair, ()),
    "muscle arm": (diagrams.muscle_arm, ()),
    "unrolled": (diagrams.unrolled, ()),
}


@pytest.fixture(params=DRAWINGS)
def figure(request):
    draw, given = DRAWINGS[request.param]
    return draw(*given)


def colour(artist):
    """The colour of a text, a line, or a patch's edge."""
    of = getattr(artist, "get_edgecolor", None) or artist.get_color
    return to_rgb(of())


def red(figure):
    """Names of what is drawn red, captions left out."""
    (ax,) = figure.axes
    artists = [*ax.texts, *ax.lines, *ax.patches]
    return {each.get_gid() for each in artists if colour(each) == RED} - {None}


# Training moves p of each cloth by the same gradient as W.
@pytest.mark.parametrize(
    ("lit", "moves"), [("W", {"W", "p"}), ("p", {"p"}), ("u", {"u"}), (None, set())]
)
def test_exactly_what_moves_is_red(lit, moves):
    figure = diagrams.method(lit)
    assert red(figure) == (moves | {"loss", "gradient"} if lit else set())

    # All of it, in each step
    (ax,) = figure.axes
    for each in (*ax.texts, *ax.patches):
        assert (colour(each) == RED) == (each.get_gid() in moves) or (
            each.get_gid() not in QUANTITIES
        )


def test_the_gradient_ends_at_each_quantity_that_moves():
    for lit, tips in (("W", 4), ("p", 1), ("u", 3)):
        (ax,) = diagrams.method(lit).axes
        heads = [each for each in ax.patches if each.get_gid() == "gradient"]
        assert len(heads) == tips
        assert all(each.get_linestyle() not in ("-", "solid") for each in heads)
    (ax,) = diagrams.method().axes
    assert not any(each.get_gid() == "gradient" for each in (*ax.patches, *ax.lines))


@pytest.mark.parametrize(
    ("lit", "task", "counted"),
    [
        ("W", "Training", "all steps, all sensors, all runs"),
        ("p", "Estimation", "a window of the last steps, all sensors"),
        ("u", "Control", "the image at the period's end, and tension"),
    ],
)
def test_the_caption_says_which_loss_it_is(lit, task, counted):
    figure = diagrams.method(lit)
    (ax,) = figure.axes
    caption = ax.texts[-1].get_text()
    assert caption.startswith(f"{task}: ")
    assert counted in caption
    assert counted in describe(figure).details[0]


def test_the_words_name_what_is_lit():
    for lit in QUANTITIES:
        assert f"Orange: {lit}" in describe(diagrams.method(lit)).summary
    assert "Orange" not in describe(diagrams.method()).summary
    assert "W and p" in describe(diagrams.method("W")).summary


def test_control_compares_the_last_step_alone_with_the_target():
    for lit, count in (("u", 1), ("p", 3), ("W", 3)):
        (ax,) = diagrams.method(lit).axes
        both = [each for each in ax.patches if "<|-|>" in repr(style(each))]
        assert len(both) == count
    targets = [text for text in ax.texts if "ref" in text.get_text()]
    assert targets == []
    (ax,) = diagrams.method("u").axes
    assert [text.get_text() for text in ax.texts if "ref" in text.get_text()]


def style(patch):
    """The name of an arrow's heads."""
    arrow = getattr(patch, "get_arrowstyle", lambda: "")()
    return getattr(arrow, "arrow", "")


def test_no_words_lie_over_others_or_over_the_edge(figure):
    figure.canvas.draw()
    paper = figure.bbox
    texts = [each for each in figure.findobj(Text) if each.get_text().strip()]
    texts = [each for each in texts if each.axes is None or each in each.axes.texts]
    boxes = {each: each.get_window_extent() for each in texts}
    for text, box in boxes.items():
        assert paper.x0 <= box.x0 < box.x1 <= paper.x1, text.get_text()
        assert paper.y0 <= box.y0 < box.y1 <= paper.y1, text.get_text()
    for (one, a), (other, b) in itertools.combinations(boxes.items(), 2):
        assert not a.overlaps(b), (one.get_text(), other.get_text())


def test_letters_can_be_read_from_the_last_row(figure):
    """At least 11 points on ten inches, dark on white whatever the page's colour."""
    assert figure.get_size_inches()[0] == 10
    assert to_rgb(figure.get_facecolor()) == (1, 1, 1)
    for text in figure.findobj(Text):
        assert text.get_fontsize() >= 11 or not text.get_text()
        if text.get_text():
            assert contrast(text.get_color()) >= 3.4, text.get_text()


def contrast(ink):
    """Of an ink with white, by the rule for web pages."""
    light = np.array(to_rgb(ink))
    linear = np.where(light <= 0.03928, light / 12.92, ((light + 0.055) / 1.055) ** 2.4)
    return 1.05 / (linear @ [0.2126, 0.7152, 0.0722] + 0.05)


def test_a_figure_is_put_in_words(figure):
    words = describe(figure)
    assert words.summary.startswith("Drawing; ")
    assert len(words.summary) <= 240
    assert not words.summary.endswith("…")
    assert not any(mark in words.details[0] for mark in "$\\\n")


def test_the_table_of_moment_arms_is_the_arm_s():
    (ax,) = diagrams.muscle_arm().axes
    shown = [text.get_text() for text in ax.texts if text.get_text()[:1] in "±0"]
    arms = 1e3 * Muscles().moment_arms[::2]
    assert shown == [f"±{arm:.0f}" if arm else "0" for arm in arms.ravel()]


@pytest.mark.parametrize("wrong", ["w", "z", "None", 3, ""])
def test_another_name_is_refused_with_the_choices(wrong):
    with pytest.raises(KeyError, match="choose from W, p, u"):
        diagrams.method(wrong)
