"""Every figure is drawn from records, shows what they say, and is shown once."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import chi2

from clothlab import plots
from clothlab.simulation.cloth import CLOTHS, FOAMS

RNG = np.random.default_rng(0)
MASKS = RNG.random((3, 96, 128)) > 0.5


def map_axes(figure):
    """The axes of a map, and where its dots and rings are, in the order drawn."""
    (ax,) = figure.axes
    return ax, [np.array(each.get_offsets()[0]) for each in ax.collections]


def test_time_series_show_each_quantity_over_seconds():
    x, y = np.arange(4.0), np.arange(4.0) ** 2
    figure = plots.time_series({"x": x, "y": y}, "x [m]")
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "x [m]")
    for line, label, values in zip(ax.lines, "xy", (x, y), strict=True):
        assert line.get_label() == label
        shown = np.column_stack([0.2 * np.arange(4), values])
        assert line.get_xydata() == pytest.approx(shown)
    assert [text.get_text() for text in figure.legends[0].texts] == ["x", "y"]
    looks = {(line.get_color(), line.get_linestyle()) for line in ax.lines}
    assert len(looks) == 2


def test_images_stand_in_rows_with_their_titles():
    figure = plots.image_grid(MASKS, ["a", "b", "c"], columns=2)
    assert len(figure.axes) == 4
    for ax, mask, title in zip(figure.axes, MASKS, "abc", strict=False):
        assert np.array_equal(ax.images[0].get_array(), mask)
        assert ax.get_title() == title
    assert not any(ax.axison for ax in figure.axes)
    assert [len(ax.images) for ax in figure.axes] == [1, 1, 1, 0]
    picture = np.full((4, 4, 3), 128, np.uint8)
    (ax,) = plots.image_grid([picture]).axes
    assert np.array_equal(ax.images[0].get_array(), picture)


def test_runs_of_masks_stand_below_each_other():
    figure = plots.film_strips({"one": MASKS, "other": ~MASKS}, ["1", "2", "3"])
    shown = [ax.images[0].get_array() for ax in figure.axes]
    assert np.array_equal(shown, [*MASKS, *~MASKS])
    assert [ax.get_title() for ax in figure.axes] == ["1", "2", "3", "", "", ""]
    rows = [ax.get_ylabel() for ax in figure.axes]
    assert rows == ["one", "", "", "other", "", ""]


def test_runs_of_masks_are_cut_to_where_cloth_is_in_any_of_them():
    masks = np.zeros((2, 2, 96, 128), bool)
    masks[0, 0, 20:30, 50] = True
    masks[1, 1, 40, 60:70] = True
    figure = plots.film_strips(dict(zip("ab", masks, strict=True)), ["1", "2"])
    shown = np.array([ax.images[0].get_array() for ax in figure.axes])
    assert np.array_equal(shown, masks.reshape(4, 96, 128)[:, 16:45, 46:74])


def test_runs_without_any_cloth_are_shown_whole():
    figure = plots.film_strips({"a": np.zeros((1, 96, 128))}, ["1"])
    assert figure.axes[0].images[0].get_array().shape == (96, 128)


def test_plans_are_bars_of_both_joints_and_down_is_down():
    plan = RNG.normal(size=(8, 2))
    figure = plots.plans({"one": plan, "other": -plan}, "angle [rad]")
    for ax, shown in zip(figure.axes, (plan, -plan), strict=True):
        heights = [bar.get_height() for bar in ax.patches]
        assert heights == pytest.approx(shown.T.ravel())
        bottom, top = ax.get_ylim()
        assert bottom > top
    assert [ax.get_title() for ax in figure.axes] == ["one", "other"]


def test_throws_show_what_happened_at_the_ends_of_periods_and_what_was_hoped():
    points = np.arange(17.0)
    figure = plots.throws({"run": points}, {"run": np.array([30.0, 40.0, 50.0])})
    (ax,) = figure.axes
    drawn = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert drawn["got"] == [[8, 8], [16, 16]]
    assert drawn["hoped"] == [[8, 30], [16, 40]]
    (without,) = plots.throws({"run": points}).axes
    assert "hoped" not in [line.get_label() for line in without.lines]


def test_a_map_has_pc1_across_and_pc2_upwards():
    """Five times as far apart across as upwards, whichever number of p that is."""
    grid = np.array([(5.0 * i, 1.0 * j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    for axes in ([0, 1], [1, 0]):
        biases = dict(zip(CLOTHS, grid[:, axes], strict=True))
        path = np.array([[0.0, 0.0], [2.0, 0.5]])[:, axes]
        spread = np.diag([0.4, 0.1])[axes][:, axes]
        runs = {"run": path}, {"run": spread}
        ax, places = map_axes(plots.material_map(biases, CLOTHS, *runs))
        assert ax.get_xlabel() == "PC1 (96% of the variance)"
        assert ax.get_ylabel() == "PC2 (4%)"
        assert np.abs(places[:9]) == pytest.approx(np.abs(grid))
        labels = [text.get_text() for text in ax.texts]
        assert labels == [cloth.label for cloth in CLOTHS.values()]
        (line,) = ax.lines
        assert np.abs(line.get_xydata()) == pytest.approx(np.array([[0, 0], [2, 0.5]]))
        assert np.abs(places[9]) == pytest.approx([2, 0.5])  # the ring
        (region,) = ax.patches
        halves = np.ptp(region.get_xy(), axis=0) / 2
        edge = np.sqrt(chi2.ppf(0.9, 2) * np.array([0.4, 0.1]))
        assert halves == pytest.approx(edge, rel=0.01)


def test_a_marker_s_size_is_the_mass_and_its_shape_the_drag_or_the_foam():
    for cloths in (CLOTHS, FOAMS):
        biases = {name: RNG.normal(size=2) for name in cloths}
        ax, _ = map_axes(plots.material_map(biases, cloths))
        sizes = [dots.get_sizes()[0] for dots in ax.collections]
        masses = [cloth.mass for cloth in cloths.values()]
        assert np.divide(sizes, masses) == pytest.approx(sizes[0] / masses[0])
        shapes = {}
        for dots, cloth in zip(ax.collections, cloths.values(), strict=True):
            shape = dots.get_paths()[0].vertices.tobytes()
            shapes.setdefault(cloth.foam or cloth.damping, set()).add(shape)
        assert [len(each) for each in shapes.values()] == [1] * len(shapes)
        assert len(set.union(*shapes.values())) == len(shapes)
    assert ax.get_title() == ""  # which would explain numbers


def test_a_figure_is_put_in_a_sentence():
    series = {"x": np.arange(4.0), "y": np.arange(4.0)}
    figure = plots.time_series(series, "x,\n$y$ [m]")
    words = "Chart; across: time [s]; up: x, y [m]; shown: x, y"
    assert plots.alt_text(figure) == words
    picture, metadata = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert metadata == {"alt": words}
    grid = plots.image_grid(MASKS, ["a", "b", "c"], columns=2)
    assert plots.alt_text(grid) == "Pictures; a, b, c"


def test_a_figure_is_shown_once_in_a_notebook():
    plots.time_series({"x": np.arange(4.0)}, "x [m]").canvas.draw()
    assert plt.get_fignums() == []


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


def test_a_mask_over_a_target_is_white_where_both_have_cloth():
    image = np.array([[True, True, False, False]])
    target = np.array([[True, False, True, False]])
    (pixels,) = plots.over_target(image, target)
    white, orange, blue, black = pixels.tolist()
    assert white == [255, 255, 255]
    assert orange[0] > orange[2]
    assert blue[2] > blue[0]
    assert black == [0, 0, 0]


def test_decoded_images_over_a_target_count_as_cloth_above_one_half():
    decoded = np.array([[[0.4, 0.6]], [[0.6, 0.4]]])
    pictures = plots.over_target(decoded, np.array([[True, True]]))
    white = np.all(pictures == 255, axis=-1)
    assert np.array_equal(white, [[[False, True]], [[True, False]]])


def test_no_images_are_refused():
    with pytest.raises(ValueError, match="no image to show"):
        plots.image_grid([])


def test_a_figure_for_a_projector_has_larger_letters_everywhere():
    figure, axes = plots.new_axes(1, 2)
    assert plots.larger(figure) is figure
    for ax in axes.flat:
        texts = (ax.title, ax.xaxis.label, ax.yaxis.label)
        assert [text.get_fontsize() for text in texts] == [14, 14, 14]
        assert ax.get_xticklabels()[0].get_fontsize() == 13


def test_a_drawing_is_described_and_a_wrong_name_lists_all():
    _, metadata = plots.drawing("memory")._repr_svg_()
    assert metadata["alt"].startswith("The network over four steps")
    with pytest.raises(KeyError, match="muscle_arm"):
        plots.drawing("elephant")


def test_lines_have_colours_that_differ_to_all_eyes():
    _, ((ax,),) = plots.new_axes()
    drawn = [ax.plot([k])[0].get_color() for k in range(len(plots.COLOURS))]
    assert drawn == list(plots.COLOURS)
