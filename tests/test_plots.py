"""Every figure is drawn from records, shows what they say, and is shown once."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from clothlab import plots
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import CLOTHS, FOAMS

RNG = np.random.default_rng(0)
BIASES = {name: RNG.normal(size=2) for name in CLOTHS}
PATH = np.cumsum(RNG.normal(size=(6, 2)), axis=0)
MASKS = RNG.random((3, 96, 128)) > 0.5
FIGURES = {
    "loss curves": lambda: plots.loss_curves({"here": [1.0, 0.5], "there": [0.9, 0.6, 0.4]}, "loss [1]"),
    "image grid": lambda: plots.image_grid(MASKS, ["a", "b", "c"], columns=2),
    "untitled image grid": lambda: plots.image_grid([np.zeros((4, 4, 3), np.uint8)]),
    "film strips": lambda: plots.film_strips({"one": MASKS, "other": MASKS}, ["1", "2", "3"]),
    "time series": lambda: plots.time_series({"x": np.arange(4.0), "y": np.arange(4.0) ** 2}, "x [m]"),
    "map": lambda: plots.material_map(BIASES, CLOTHS),
    "map of foams": lambda: plots.material_map({name: RNG.normal(size=2) for name in FOAMS}, FOAMS, {"run": PATH}),
    "map with a region": lambda: plots.material_map(BIASES, CLOTHS, {"run": PATH}, {"run": 0.1 * np.eye(2)}),
    "distances": lambda: plots.distance_transition({"control": RNG.random(19)}, {"still": 1.0}),
    "ellipse": lambda: plots.ellipse_at_hand(MuscleArm(), np.array([0.3, -1.0]), 30.0),
    "ellipses": lambda: plots.ellipse_at_hand(MuscleArm(), np.array([0.3, -1.0]), [10.0, 70.0]),
    "successes": lambda: plots.success_curves({"case": {"control": RNG.random((5, 9))}}, np.linspace(0, 2, 9)),
    "dots": lambda: plots.dots({"a": {"x": RNG.random(5)}, "b": {"x": RNG.random(5)}}, "distance [m]"),
    "scatter": lambda: plots.chamfer_scatter(RNG.random(9), RNG.random(9)),
}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_labelled_drawn_once_and_its_lines_can_be_told_apart(name):
    figure = FIGURES[name]()
    assert plt.get_fignums() == [], "a notebook would show it twice"
    figure.canvas.draw()
    for ax in figure.axes:
        assert not ax.axison or ax.get_xlabel() or ax.get_title() or ax.get_ylabel() or not ax.get_xticks().size
        looks = [(line.get_color(), line.get_linestyle()) for line in ax.lines if not line.get_label().startswith("_")]
        assert len(set(looks)) == len(looks)


def test_the_best_of_each_whole_period_is_marked():
    distance = np.array([3, 1, 2, 5, 4, 6, 0.0])
    _, best = plots.distance_transition({"control": distance}, period=3).axes[0].lines
    assert best.get_ydata().tolist() == [1, 4]
    assert best.get_xdata() == pytest.approx([0.2, 0.8])


def test_the_ellipse_lies_around_the_hand_and_is_smaller_the_stiffer_the_arm():
    arm, theta = MuscleArm(), np.array([0.3, -1.0])
    links, soft, stiff = plots.ellipse_at_hand(arm, theta, [10.0, 70.0]).axes[0].lines
    hand = [line[-1] for line in links.get_data()]
    assert hand == pytest.approx(arm.hand(theta))
    assert np.mean(stiff.get_xydata()[:-1], axis=0) == pytest.approx(hand, abs=0.02)
    assert np.ptp(soft.get_xydata(), axis=0) == pytest.approx(3.3 * np.ptp(stiff.get_xydata(), axis=0), rel=0.1)
    assert (soft.get_label(), stiff.get_label()) == ("10 N", "70 N")


@pytest.mark.slow
def test_a_video_is_played_in_the_page(monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", shown.append)
    plots.show_video([np.full((32, 32, 3), k, np.uint8) for k in (0, 128)], 'a "cloth"', fps=2)
    assert 'aria-label="a &quot;cloth&quot;; a video of 1.0 s without sound"' in shown[0].data


def test_no_images_are_refused():
    with pytest.raises(ValueError, match="no image to show"):
        plots.image_grid([])


def test_a_caption_is_written_into_a_copy():
    picture = np.full((320, 480, 3), 255, np.uint8)
    rows, columns = np.nonzero(plots.captioned(picture, "LOOK").min(axis=2) < 128)
    assert picture.min() == 255
    assert rows.max() < 40
    assert columns.max() < 120
    assert rows.max() - rows.min() == pytest.approx(320 / 16, abs=2)
