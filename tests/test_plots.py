"""Every figure is drawn from records, shows what they say, and is shown once."""

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from clothlab import plots
from clothlab.analysis import Landscape, principal_axes
from clothlab.simulation.arm import MuscleArm, TorqueArm
from clothlab.simulation.cloth import CLOTHS, FOAMS
from clothlab.table_scene.perception import PointCloud

RNG = np.random.default_rng(0)
BIASES = {name: RNG.normal(size=2) for name in CLOTHS}
LANDSCAPE = Landscape(principal_axes(BIASES), np.linspace(-2, 2, 5), np.linspace(-2, 2, 4), 0.1 + RNG.random((4, 5)))
PATH = np.cumsum(RNG.normal(size=(6, 2)), axis=0)
MASKS = RNG.random((3, 96, 128)) > 0.5
RACE = {name: {who: RNG.random((4, 2)) for who in ("p", "sysid")} for name in ("C_damp", "C_mass", "C_damp / C_mass")}
CLOUD = PointCloud(RNG.random((50, 3)), RNG.integers(0, 255, (50, 3)), np.ones(50, bool), np.zeros(3))
MOTION = SimpleNamespace(commands=RNG.random((20, 3)), theta=RNG.random((200, 2)), distance=RNG.random(20))


class Grown:
    """What three amounts of experience gave, of which one has a mark that was measured and one that was not."""

    def curves(self):
        return {
            "error": {"torque": np.array([[3.0, 5.0], [2.0, 2.0], [1.0, 2.0]]), "muscle": RNG.random((3, 2))},
            "R²": {"torque": RNG.random((3, 2))},
            "IoU": {"muscle": RNG.random((3, 1))},
        }

    def steps(self, arm):
        return {0.5: 100, 1.0: 200, 5.0: 1000}

    def marks(self):
        return {"the paper's": 1.0, "default": 20.0}


FIGURES = {
    "loss curves": lambda: plots.loss_curves({"here": [1.0, 0.5], "there": [0.9, 0.6, 0.4]}, "loss [1]"),
    "image grid": lambda: plots.image_grid(MASKS, ["a", "b", "c"], columns=2),
    "untitled image grid": lambda: plots.image_grid([np.zeros((4, 4, 3), np.uint8)]),
    "film strips": lambda: plots.film_strips({"one": MASKS, "other": MASKS}, ["1", "2", "3"]),
    "time series": lambda: plots.time_series({"x": np.arange(4.0), "y": np.arange(4.0) ** 2}, "x [m]"),
    "time series over time": lambda: plots.time_series({"x": np.arange(4.0)}, "x [m]", time=np.arange(4.0)),
    "profiles": lambda: plots.cloth_profiles({"a": RNG.random((3, 6, 3, 3)), "b": RNG.random((2, 6, 3, 3))}),
    "map": lambda: plots.material_map(BIASES, CLOTHS),
    "map of foams": lambda: plots.material_map({name: RNG.normal(size=2) for name in FOAMS}, FOAMS, {"run": PATH}),
    "map with a region": lambda: plots.material_map(BIASES, CLOTHS, {"run": PATH}, {"run": 0.1 * np.eye(2)}),
    "landscapes": lambda: plots.loss_landscapes({"run": LANDSCAPE, "other": LANDSCAPE}, BIASES),
    "landscape": lambda: plots.loss_landscapes({"run": LANDSCAPE}, BIASES, next(iter(BIASES)), {"run": PATH}),
    "predictions": lambda: plots.predicted_states(RNG.random((5, 2)), {"p": RNG.random((5, 2))}, ["a [m]", "b [N]"]),
    "distances": lambda: plots.distance_transition({"control": RNG.random(19)}),
    "ellipse": lambda: plots.ellipse_at_hand(MuscleArm(), np.array([0.3, -1.0]), 30.0),
    "ellipses": lambda: plots.ellipse_at_hand(MuscleArm(), np.array([0.3, -1.0]), [10.0, 70.0]),
    "motion": lambda: plots.arm_motion({"hard-1": MOTION}, until=16),
    "bars": lambda: plots.bars({"rate [%]": {"hard-1": {"Correct": RNG.random(5), "Random": RNG.random(5)}}}),
    "successes": lambda: plots.success_curves({"case": {"control": RNG.random((5, 9))}}, np.linspace(0, 2, 9)),
    "experience": lambda: plots.experience(Grown(), columns=2),
    "promises": lambda: plots.promise_scatter({"one": tuple(RNG.random((2, 12)))}, picked=3),
    "periods": lambda: plots.period_bests({"a": RNG.random((3, 9)), "b": RNG.random(9)}, {"still": 1.0, "empty": 2.0}),
    "dots": lambda: plots.dots({"a": {"x": RNG.random(5), "y": RNG.random(3)}, "b": {"x": RNG.random(5)}}, "distance"),
    "intervals": lambda: plots.intervals({"a": (1.0, 0.5, 1.5), "b": (0.1, -0.5, 0.6)}, "difference"),
    "bounds": lambda: plots.bounds_over_time(
        {
            "C_damp": {"z": np.array([np.inf, 0.3, 0.1]), "mask": 0.1 + RNG.random(3)},
            "C_mass": {"z": np.full(3, np.inf)},
        },
        np.array([1.0, 10.0, 40.0]),
    ),
    "race": lambda: plots.race(RACE, np.array([5.0, 10.0]), {"bound": {"C_damp": np.array([0.02, 0.01])}}),
    "cloud": lambda: plots.cloud_views(CLOUD, {"edge": RNG.random((2, 3)), "bar": RNG.random((2, 3))}, most=20),
    "unmarked cloud": lambda: plots.cloud_views(CLOUD),
    "repetitions": lambda: plots.repetitions({"soft-1": np.array([4, 4, 0]), "hard-1": np.array([3])}, 4),
    "successes over places": lambda: plots.success_curves(
        {"soft-1": {"slow": RNG.random((1, 3)), "thrown": RNG.random((1, 3))}}, np.arange(3.0), "place [m]", "rate"
    ),
    "scatter": lambda: plots.chamfer_scatter(RNG.random(9), RNG.random(9)),
}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_drawn_labelled_and_left_to_its_caller(name):
    figure = FIGURES[name]()
    assert isinstance(figure, Figure)
    assert plt.get_fignums() == [], "a notebook would show it twice"
    figure.canvas.draw()
    drawn = [ax for ax in figure.axes if ax.axison]
    assert all(ax.get_xlabel() or ax.get_title() or ax.get_ylabel() or not ax.get_xticks().size for ax in drawn)


@pytest.mark.parametrize("name", FIGURES)
def test_colours_can_be_told_apart(name):
    for ax in FIGURES[name]().axes:
        looks = [(line.get_color(), line.get_linestyle()) for line in ax.lines if not line.get_label().startswith("_")]
        assert len(set(looks)) == len(looks)


def test_commands_are_drawn_with_the_angles_that_follow_them(trial):
    figure = plots.trial_traces(trial, TorqueArm())
    for k, ax in enumerate(figure.axes):
        commanded, measured = ax.lines
        assert np.array_equal(commanded.get_ydata(), trial.commands[:, k])
        assert np.array_equal(measured.get_ydata(), trial.robot[:, k])
        assert measured.get_label() == "measured"
        assert ax.get_ylabel() == TorqueArm().command_names[k]


def test_tensions_are_not_drawn_as_angles(muscle_trial):
    figure = plots.trial_traces(muscle_trial, MuscleArm())
    assert len(figure.axes) == 3
    for k, ax in enumerate(figure.axes):
        (commanded,) = ax.lines  # the arm does not sense its angles
        assert np.array_equal(commanded.get_ydata(), muscle_trial.commands[:, k])


def test_the_best_of_each_whole_period_is_marked():
    distance = np.array([3, 1, 2, 5, 4, 6, 0.0])
    _, best = plots.distance_transition({"control": distance}, period=3).axes[0].lines
    assert best.get_ydata().tolist() == [1, 4]
    assert best.get_xdata() == pytest.approx([0.2, 0.8])


def test_what_grows_is_drawn_over_the_steps_with_its_spread_and_its_marks():
    figure = plots.experience(Grown(), columns=2)
    error, _, _, nothing = figure.axes
    assert not nothing.axison
    line, muscle = error.lines
    assert line.get_xdata().tolist() == [100, 200, 1000]
    assert line.get_ydata().tolist() == [4, 2, 1.5]
    assert error.get_xscale() == "log"
    assert error.collections[0].get_datalim(error.transData).intervaly == pytest.approx([1, 5])
    assert error.collections[1].get_offsets().tolist() == [[200, 2]]  # five times was marked by nobody
    only_muscle = figure.axes[2].lines[0]
    assert only_muscle.get_color() == muscle.get_color()


def test_the_ellipse_is_drawn_around_the_hand():
    arm, theta = MuscleArm(), np.array([0.3, -1.0])
    links, ellipse = plots.ellipse_at_hand(arm, theta, 30.0).axes[0].lines
    hand = [line[-1] for line in links.get_data()]
    assert hand == pytest.approx(arm.hand(theta))
    assert np.mean(ellipse.get_xydata()[:-1], axis=0) == pytest.approx(hand, abs=0.02)


def test_the_stiffer_the_arm_the_smaller_its_ellipse():
    _, soft, stiff = plots.ellipse_at_hand(MuscleArm(), np.array([0.3, -1.0]), [10.0, 70.0]).axes[0].lines
    assert np.ptp(soft.get_xydata(), axis=0) == pytest.approx(3.3 * np.ptp(stiff.get_xydata(), axis=0), rel=0.1)
    assert (soft.get_label(), stiff.get_label()) == ("10 N", "70 N")


def test_an_arm_is_shaded_while_it_comes_down():
    commands = np.zeros((16, 3))
    commands[3, 0] = commands[13, 0] = -1  # where the shoulder's target is highest
    run = SimpleNamespace(commands=commands, theta=np.zeros((160, 2)), distance=np.full(16, 2.0))
    (column,) = np.reshape(plots.arm_motion({"run": run}, until=16).axes, (1, 4))
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in column[3].patches]
    assert np.array(spans) == pytest.approx(np.array([(0.6, 1.6), (2.6, 3.2)]))
    assert len(column[2].lines) == 1, "f_const has no measured value"


def test_bars_have_the_mean_and_a_dot_for_each_repeat():
    panels = {"rate [%]": {"hard-1": {"Correct": np.array([1.0, 3.0])}, "soft-1": {"Correct": np.array([5.0])}}}
    hard, soft = plots.bars(panels).axes
    assert hard.patches[0].get_height() == 2
    assert hard.lines[-1].get_ydata().tolist() == [1, 3]
    assert (hard.get_ylabel(), soft.get_title()) == ("rate [%]", "soft-1")


def test_a_bound_is_drawn_beside_the_root_of_time():
    time = np.array([1.0, 4.0, 16.0])
    figure = plots.bounds_over_time({"C_damp": {"z": np.array([np.inf, 0.4, 0.1])}}, time)
    bound, guide = figure.axes[0].lines
    assert bound.get_ydata()[1:].tolist() == [0.4, 0.1]
    assert np.isnan(bound.get_ydata()[0]), "what is not known has no place on the axis"
    assert guide.get_ydata() == pytest.approx([0.4, 0.2, 0.1])
    assert figure.axes[0].get_xlabel() == "time [s]"


def test_what_falls_off_has_a_column_for_each_kind_of_displacement():
    rows = {"rate": {"shift [cm]": {"up": np.array([[1.0, 0.5], [1.0, 0.9]])}, "turn [°]": {"yaw": np.ones((2, 3))}}}
    figure = plots.fall_off(rows, {"shift [cm]": np.array([1.0, 5.0]), "turn [°]": np.array([1.0, 3.0, 10.0])})
    shift, turn = figure.axes
    plain, mended = shift.lines
    assert plain.get_ydata().tolist() == [1.0, 0.5]
    assert mended.get_ydata().tolist() == [1.0, 0.9]
    assert plain.get_linestyle() != mended.get_linestyle()
    assert (shift.get_xlabel(), shift.get_ylabel(), turn.get_xlabel()) == ("shift [cm]", "rate", "turn [°]")
    assert [text.get_text() for text in turn.get_legend().get_texts()] == ["yaw"]


def test_a_video_is_played_in_the_page(capsys, monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", shown.append)
    plots.show_video([np.full((32, 32, 3), k, np.uint8) for k in (0, 128)], 'a "cloth"', fps=2)
    assert 'aria-label="a &quot;cloth&quot;; a video of 1.0 s without sound"' in shown[0].data


def test_nothing_to_show_is_refused():
    with pytest.raises(ValueError, match="no image to show"):
        plots.image_grid([])


def test_a_race_shows_the_median_run_and_a_bound_where_there_is_one():
    times, errors = np.array([5.0, 40.0]), np.array([[0.1, 0.01], [0.2, 0.02], [0.6, 0.9]])
    figure = plots.race({"a": {"p": errors}, "b": {"p": errors / 2}}, times, {"bound": {"b": times / 100}}, ["a", "b"])
    first, second = figure.axes
    assert [line.get_label() for line in first.lines] == ["p"]
    assert list(first.lines[0].get_ydata()) == pytest.approx([0.2, 0.02])
    assert list(second.lines[0].get_ydata()) == pytest.approx([0.1, 0.01])
    assert list(second.lines[1].get_ydata()) == pytest.approx([0.05, 0.4])
    assert [line.get_label() for line in second.lines] == ["p", "bound"]
    assert first.get_yscale() == "log"
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"p", "bound"}


def test_a_cloud_keeps_its_colours_and_is_seen_from_two_sides():
    side, above = plots.cloud_views(CLOUD, {"edge": np.array([[0.1, 0.2, 0.3], [0.1, 0.9, 0.3]])}).axes
    assert len(side.collections[0].get_offsets()) == 50
    assert side.lines[0].get_xydata() == pytest.approx(np.array([[0.1, 0.3], [0.1, 0.3]]))
    assert above.lines[0].get_xydata() == pytest.approx(np.array([[0.1, 0.2], [0.1, 0.9]]))
    lowest = np.argmin(CLOUD.points[:, 2])
    assert np.asarray(above.collections[0].get_offsets())[0] == pytest.approx(CLOUD.points[lowest, :2]), (
        "what is higher hides it"
    )
    assert above.collections[0].get_facecolor()[0, :3] == pytest.approx(CLOUD.colours[lowest] / 255)
    assert len(plots.cloud_views(CLOUD, most=20).axes[0].collections[0].get_offsets()) <= 20


def test_repetitions_stand_beside_what_chance_alone_would_give():
    (ax,) = plots.repetitions({"a": np.array([2, 2, 0]), "b": np.array([1])}, 2).axes
    assert [bar.get_height() for bar in ax.patches] == [1, 0, 2, 0, 1, 0]
    share = 5 / 8
    assert ax.lines[0].get_ydata() == pytest.approx(4 * np.array([(1 - share) ** 2, 2 * share * (1 - share), share**2]))


def test_a_caption_is_written_into_a_copy():
    picture = np.full((320, 480, 3), 255, np.uint8)
    told = plots.captioned(picture, "LOOK")
    assert picture.min() == 255
    rows, columns = np.nonzero(told.min(axis=2) < 128)
    assert rows.max() < 40
    assert columns.max() < 120
    assert rows.max() - rows.min() == pytest.approx(320 / 16, abs=2)


def test_pictures_have_the_width_that_was_asked_for():
    assert plots.image_grid([np.zeros((3, 4, 3), np.uint8)] * 2, width=4.0).get_size_inches() == pytest.approx(
        [8, 3.05]
    )
    assert plots.image_grid(MASKS, ["a", "b", "c"]).get_size_inches() == pytest.approx([6, 1.75])
