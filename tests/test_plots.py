"""Every figure is drawn from records, shows what they say, and is shown once."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from clothlab import plots
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


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_labelled_drawn_once_and_its_lines_can_be_told_apart(name):
    figure = FIGURES[name]()
    assert plt.get_fignums() == [], "a notebook would show it twice"
    figure.canvas.draw()
    for ax in figure.axes:
        assert (
            not ax.axison
            or ax.get_xlabel()
            or ax.get_title()
            or ax.get_ylabel()
            or not ax.get_xticks().size
        )
        looks = [
            (line.get_color(), line.get_linestyle())
            for line in ax.lines
            if not line.get_label().startswith("_")
        ]
        assert len(set(looks)) == len(looks)


@pytest.mark.slow
def test_a_video_is_played_in_the_page(monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", shown.append)
    plots.show_video(
        [np.full((32, 32, 3), k, np.uint8) for k in (0, 128)], 'a "cloth"', fps=2
    )
    assert (
        'aria-label="a &quot;cloth&quot;; a video of 1.0 s without sound"'
        in shown[0].data
    )


def test_no_images_are_refused():
    with pytest.raises(ValueError, match="no image to show"):
        plots.image_grid([])
