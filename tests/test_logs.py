"""Logs, and datasets of others, become runs: evenly spaced, without gaps, with names."""

import csv
import datetime
import json
import shutil
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pandas as pd
import pytest

from clothlab.method.checkpoint import Checkpoint
from clothlab.method.data import Run
from clothlab.method.datasets import runs_from_lerobot, runs_from_minari
from clothlab.method.estimation import BiasEstimator
from clothlab.method.gauss_newton import NewtonEstimator, best_bias, estimate_bias
from clothlab.method.logs import read_runs, runs_from_dataframe
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb

COLUMNS = {"time": "t", "states": ["x", "v"], "commands": ["push"]}
SWING = Path(__file__).with_name("lerobot_swing")  # LeRobot 0.4.4 has written it
PENDULUM = Path(__file__).with_name("minari_pendulum")  # Minari 0.5.4, likewise


def line(time):
    """A log in which everything is known: x = 2t, v = -t, a push for each row."""
    time = np.asarray(time, float)
    return {"t": time, "x": 2 * time, "v": -time, "push": np.arange(len(time)) * 1.0}


def to_runs(data, step=0.1, **more):
    return runs_from_dataframe(
        data, "any", **COLUMNS, **{"step": step, "shortest": 1, **more}
    )


def uneven(count, seed=0):
    """Times of rows, 0.018 to 0.022 s apart."""
    return np.cumsum(np.random.default_rng(seed).uniform(0.018, 0.022, count))


def test_an_even_log_is_taken_as_it_is():
    log = line(0.1 * np.arange(50))
    (run,) = to_runs(log)
    assert np.array_equal(run.s, np.stack([log["x"], log["v"]], 1).astype(np.float32))
    assert np.array_equal(run.u[:, 0], log["push"])
    assert (run.material, run.step) == ("any", 0.1)
    assert (run.state_names, run.command_names) == (("x", "v"), ("push",))


@pytest.mark.parametrize("how", ["average", "last"])
def test_states_lie_on_lines_and_commands_are_averages_or_the_last(how):
    log = line(uneven(500))
    (run,) = to_runs(log, step=0.05, resample_commands=how)
    even = log["t"][0] + 0.05 * np.arange(len(run))
    assert even[-1] <= log["t"][-1] < even[-1] + 0.05
    assert run.s == pytest.approx(np.stack([2 * even, -even], 1), abs=1e-5)

    # By brute force: what was in effect at many moments of each step
    moments = 1 if how == "last" else 2000
    for at, u in zip(even[:-1], run.u[:, 0], strict=False):
        when = at + 0.05 * np.arange(moments) / moments + 1e-9
        rows = np.searchsorted(log["t"], when, side="right") - 1
        assert u == pytest.approx(log["push"][rows].mean(), abs=2e-3)


def test_a_command_is_what_moves_one_state_to_the_next():
    """Of an integrator every state is known, and so is the average of its commands."""
    time = uneven(400, seed=3)
    log = line(time) | {"push": np.random.default_rng(4).normal(size=400)}
    log["v"] = np.append(0, np.cumsum(log["push"][:-1] * np.diff(time)))
    for step in (0.02, 0.05, 0.13):
        (run,) = to_runs(log, step=step)
        assert np.diff(run.s[:, 1]) == pytest.approx(step * run.u[:-1, 0], abs=1e-5)
    (late,) = to_runs(log, step=0.05, resample_commands="last")
    assert np.abs(np.diff(late.s[:, 1]) - 0.05 * late.u[:-1, 0]).max() > 0.01


@pytest.mark.parametrize(("how", "known"), [("average", 20), ("last", 21)])
def test_no_command_tells_of_one_that_was_sent_after_the_next_state(how, known):
    log = line(uneven(200))
    more = {"step": 0.05, "resample_commands": how}
    (before,) = to_runs(log, **more)
    moment = log["t"][0] + 0.05 * 20
    other = log | {"push": np.where(log["t"] > moment, 1e6, log["push"])}
    (after,) = to_runs(other, **more)
    assert np.array_equal(before.u[:known], after.u[:known])
    assert (after.u[known : known + 2] > 1e3).all()


def test_a_gap_ends_a_run_and_begins_another():
    time = np.delete(0.1 * np.arange(100), np.r_[30:34, 60:62])
    log = line(time)
    # Five steps are too long a gap by default, three are not.
    assert [len(run) for run in to_runs(log)] == [30, 66]
    runs = to_runs(log, longest_gap=0.2)
    assert [len(run) for run in runs] == [30, 26, 38]
    assert runs[1].s[0, 0] == pytest.approx(2 * 3.4)
    assert len(to_runs(log, longest_gap=10)[0]) == 100


@pytest.mark.parametrize("nothing", [np.nan, np.inf, None])
def test_what_is_missing_is_refused_held_or_cut_out(nothing):
    log = line(0.1 * np.arange(40))
    log["v"] = [*log["v"][:17], nothing, *log["v"][18:]]
    message = (
        r"row 17 \(counted from 0\), column 'v' is NaN, infinite or empty, .* 1 of"
    )
    with pytest.raises(ValueError, match=message):
        to_runs(log)
    (held,) = to_runs(log, missing="hold")
    assert held.s[17].tolist() == pytest.approx([3.4, -1.6])
    runs = to_runs(log, missing="split")
    assert [len(run) for run in runs] == [17, 22]
    assert runs[1].s[0, 0] == pytest.approx(2 * 1.8)


def test_a_number_is_not_held_for_ever():
    log = line(0.1 * np.arange(40))
    log["x"][10:20] = np.nan
    log["push"][:2] = np.nan
    # From 0.9 s on for three steps; and before the first there is nothing to hold.
    runs = to_runs(log, missing="hold")
    assert [len(run) for run in runs] == [11, 20]
    assert runs[0].s[-4:, 0] == pytest.approx([1.8] * 4)


BAD = {
    "two rows at one time": (
        {"t": [0.0, 0.1, 0.1, 0.2]},
        r"times must rise, but row 2 .* with 0\.1 s comes after 0\.1 s: leave doubles",
    ),
    "a clock set back": ({"t": [5.0, 5.1, 0.0, 0.1]}, r"row 2 .* or cut the log where"),
    "no time": ({"t": [0.0, np.nan, 0.2, 0.3]}, r"row 1 .* has no time \(column 't'\)"),
    "milliseconds": ({"t": [0, 100, 200, 300]}, "100 s apart .* other units than sec"),
    "too slow": ({"t": [0.0, 0.2, 0.4, 0.6]}, "states in between were not measured"),
    "a word": ({"v": [0.0, "off", 0.0, 0.0]}, "row 1 .*, column 'v' is no number: 'of"),
    "vectors": (
        {"v": np.zeros((4, 3))},
        r"'v' holds \[3\] numbers in each row: give e",
    ),
    "other rows": ({"v": [0.0]}, "column 'v' has 1 rows, 't' has 4"),
    "nothing": ({"t": [], "x": [], "v": [], "push": []}, "the log is empty"),
    "holes": ({"v": [np.nan] * 4}, "each row of the log lacks some number"),
}


@pytest.mark.parametrize("name", BAD)
def test_each_bad_datum_has_its_sentence(name):
    wrong, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        to_runs(line([0.0, 0.1, 0.2, 0.3]) | wrong, missing="split")


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"states": ["x", "w"]}, KeyError, "no column 'w'; choose from t, x, v, push"),
        ({"states": []}, ValueError, "states are names of columns, got none"),
        ({"states": ["x", "push"]}, ValueError, "columns that are given twice: push"),
        ({"step": 0}, ValueError, "step must be above 0"),
        ({"longest_gap": 0.05}, ValueError, "longest_gap must be at least 0.1"),
        ({"missing": "zero"}, KeyError, "choose from refuse, hold, split"),
        (
            {"shortest": 50},
            ValueError,
            "none of 1 runs has 50 steps, the longest has 40",
        ),
        ({"data": [1, 2]}, ValueError, "a log is a table of pandas, polars or PyArrow"),
        ({"material": 3}, ValueError, "material is a str, got int 3"),
    ],
)
def test_what_makes_no_sense_is_said(wrong, error, message):
    right = {"data": line(0.1 * np.arange(40)), "material": "any", "step": 0.1}
    with pytest.raises(error, match=message):
        runs_from_dataframe(**(right | COLUMNS | wrong))


def test_short_runs_are_counted():
    time = np.delete(0.1 * np.arange(100), np.r_[10:20])
    with pytest.warns(
        UserWarning, match="1 of 2 runs have fewer than 31 steps"
    ) as told:
        assert [len(run) for run in to_runs(line(time), shortest=31)] == [80]
    assert told[0].filename.endswith("logs.py")


@pytest.mark.parametrize("kind", ["pandas", "polars", "pyarrow", "mapping"])
def test_any_table_will_do(kind):
    log = line(uneven(100))
    log["v"][3] = np.nan
    makers = {"pandas": "DataFrame", "polars": "DataFrame", "pyarrow": "table"}
    table = log
    if kind in makers:
        table = getattr(pytest.importorskip(kind), makers[kind])(log)
    for found, expected in zip(
        to_runs(table, missing="split"), to_runs(log, missing="split"), strict=True
    ):
        assert np.array_equal(found.s, expected.s)
        assert np.array_equal(found.u, expected.u)


def test_dates_are_times():
    log = line(0.1 * np.arange(40))
    (plain,) = to_runs(log)
    start = datetime.datetime(2026, 11, 25, tzinfo=datetime.UTC)
    aware = [start + datetime.timedelta(seconds=each) for each in log["t"]]
    naive = pd.to_datetime(log["t"], unit="s")
    for dates in (aware, naive, pd.Series(aware)):
        (run,) = to_runs(log | {"t": dates})
        assert run.s == pytest.approx(plain.s, abs=1e-5)
        assert np.array_equal(run.u, plain.u)


def write(path, log):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(log)
        writer.writerows(zip(*log.values(), strict=True))


def read(files, material=None, **more):
    settings = COLUMNS | {"step": 0.1, "shortest": 1, "progress": False} | more
    return read_runs(files, material, **settings)


@pytest.fixture
def folder(tmp_path):
    for name in ("heavy", "light"):
        for k in range(2):
            log = line(0.1 * np.arange(40 + k))
            write(tmp_path / name / f"{k}.csv", log | {"load": [name] * len(log["t"])})
    (tmp_path / "notes.txt").write_text("not a log")
    return tmp_path


@pytest.mark.parametrize(
    ("files", "material", "names"),
    [
        ("", None, ["heavy", "heavy", "light", "light"]),
        ("*/1.csv", None, ["heavy", "light"]),
        ("", "load", ["heavy", "heavy", "light", "light"]),
        ("", lambda path: path.stem, ["0", "1", "0", "1"]),
    ],
)
def test_a_folder_of_logs_is_read(folder, files, material, names):
    runs = read(folder / files, material)
    assert [run.material for run in runs] == names
    assert len(runs[-1]) == 41
    assert runs[-1].s[:, 0] == pytest.approx(0.2 * np.arange(41))
    assert len(read([folder / "light" / "0.csv"])) == 1


def test_a_column_may_say_the_material_of_each_stretch(tmp_path):
    names = np.repeat(["a", "b", "a"], [30, 50, 20])
    write(tmp_path / "day.csv", line(0.1 * np.arange(100)) | {"load": names})
    runs = read(tmp_path, "load")
    assert [(run.material, len(run)) for run in runs] == [
        ("a", 30),
        ("b", 50),
        ("a", 20),
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "1.csv is damaged or holds no table: it is empty"),
        ("t,x,v,push\n0,1,2", r"row 0 .* has 3 values, the first line names 4 columns"),
        ("t,x,push\n0,1,2", "light.1.csv: no column 'v'; choose from t, x, push"),
        (
            "t,x,v,push\n0,1,,2",
            "light.1.csv: row 0 .*, column 'v' is NaN, infinite or em",
        ),
        ("t,x,v,push\n", "light.1.csv: the log is empty"),
    ],
)
def test_a_file_that_fails_is_named(folder, content, message):
    (folder / "light" / "1.csv").write_text(content)
    with pytest.raises(ValueError, match=message):
        read(folder)


def test_no_files_and_other_files_are_named(folder):
    with pytest.raises(FileNotFoundError, match=r"no .csv or .parquet file is there"):
        read(folder / "*.csv")
    with pytest.raises(ValueError, match=r"notes.txt is no log that can be read here"):
        read(folder / "*.txt")


def test_parquet_says_the_same(tmp_path):
    pytest.importorskip("pyarrow")
    log = pd.DataFrame(line(uneven(300)))
    write(tmp_path / "csv" / "a.csv", log.to_dict("list"))
    (tmp_path / "parquet").mkdir()
    log.to_parquet(tmp_path / "parquet" / "a.parquet")
    one, other = (read(tmp_path / name)[0] for name in ("csv", "parquet"))
    assert np.array_equal(one.s, other.s)
    assert np.array_equal(one.u, other.u)


def test_parquet_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "a.parquet").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    message = "reading a.parquet needs pyarrow: pip install pyarrow"
    with pytest.raises(ModuleNotFoundError, match=message):
        read(tmp_path)


# A run knows its step and its names


def plain(count=40, **more):
    rng = np.random.default_rng(count)
    return Run(rng.normal(size=(count, 2)), rng.normal(size=(count, 1)), "a", **more)


def test_a_stretch_of_a_run_keeps_step_and_names():
    part = plain(step=0.1, state_names=("x", "v"), command_names=("push",))[5:9]
    assert len(part) == 4
    assert (part.step, part.state_names, part.command_names) == (
        0.1,
        ("x", "v"),
        ("push",),
    )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"step": 0}, "step of a run must be above 0"),
        ({"state_names": ("x",)}, "2 states need as many names, or none, got 1: x"),
        ({"command_names": ("a", "b")}, "1 commands need as many names"),
    ],
)
def test_step_and_names_are_checked(wrong, message):
    with pytest.raises(ValueError, match=message):
        plain(**wrong)
    for steps in (3, slice(None, None, 2)):
        with pytest.raises(ValueError, match=r"a run is cut with run\[first:last\]"):
            plain()[steps]


QUICK = ModelTraining(epochs=1, batch_size=20)


@pytest.mark.parametrize(
    ("one", "other", "message"),
    [
        (
            {"step": 0.05},
            {"step": 0.1},
            r"steps of 0\.05 s and of 0\.1 s: bring all to",
        ),
        (
            {"state_names": ("x", "v")},
            {"state_names": ("v", "x")},
            r"differ in their state_names: \(x, v\) and \(v, x\)",
        ),
    ],
)
def test_runs_of_different_robots_are_not_trained_on(one, other, message):
    with pytest.raises(ValueError, match=message):
        train_dpmpb([plain(**one), plain(**other)], QUICK, progress=False)


def test_a_model_remembers_the_step_of_its_runs():
    runs = [plain(step=0.05), plain(step=0.0504), plain()]
    model, _, _ = train_dpmpb(runs, QUICK, progress=False)
    assert model.step == 0.05
    assert train_dpmpb([plain()], QUICK, progress=False)[0].step is None


def test_a_model_keeps_its_step_with_its_weights(tmp_path):
    path = tmp_path / "own.safetensors"
    model = DPMPB(2, 1)
    model.step = 0.05
    Checkpoint(name="own", model=model, biases={}).save(path)
    assert Checkpoint.load(path).model.step == 0.05


@pytest.fixture
def at_twenty_hertz():
    model = DPMPB(2, 1).eval()
    model.step = 0.05
    return model


def test_a_run_at_another_rate_is_not_estimated_from(at_twenty_hertz):
    for use in (estimate_bias, lambda model, run: best_bias(model, run, [0, 0])):
        with pytest.raises(
            ValueError, match=r"has 0\.1 s, and nothing was measured in"
        ):
            use(at_twenty_hertz, plain(step=0.1))
        with pytest.raises(
            ValueError, match=r"0\.02 s: resample it, runs_from_datafra"
        ):
            use(at_twenty_hertz, plain(step=0.02))
        use(at_twenty_hertz, plain(step=0.0502))
        use(at_twenty_hertz, plain())


def follow(estimator, run, step, start=0.0):
    for k, (s, u) in enumerate(zip(run.s, run.u, strict=True)):
        estimator.update(s, u, time=start + k * step)


@pytest.mark.parametrize("kind", [BiasEstimator, NewtonEstimator])
def test_a_stream_at_another_rate_is_refused_and_moves_nothing(at_twenty_hertz, kind):
    estimator = kind(at_twenty_hertz)
    with pytest.raises(
        ValueError, match=r"comes 0\.1 s after .* of 0\.05 s: bring the"
    ):
        follow(estimator, plain(), 0.1)
    with pytest.raises(ValueError, match=r"comes -0\.02 s after"):
        estimator.update([0, 0], [0], time=-0.02)
    assert estimator.window is None
    estimator.reset()
    with pytest.raises(ValueError, match=r"came 0\.06 s apart on average, and the mod"):
        follow(estimator, plain(), 0.06)

    # The stream as it should be, with jitter, is as good as one without times.
    timed, untimed = kind(at_twenty_hertz), kind(at_twenty_hertz)
    run = plain()
    follow(timed, run, 0.052)
    p = [untimed.update(s, u) for s, u in zip(run.s, run.u, strict=True)][-1]
    assert np.array_equal(timed.p, p)
    assert p.any()


@pytest.mark.parametrize("kind", [BiasEstimator, NewtonEstimator])
def test_after_a_gap_the_window_is_forgotten_and_p_is_kept(at_twenty_hertz, kind):
    run = plain()
    estimator = kind(at_twenty_hertz)
    follow(estimator, run, 0.05)
    before = estimator.p
    with pytest.raises(ValueError, match=r"After a gap, call `forget\(\)`"):
        follow(estimator, run, 0.05, start=60)
    estimator.forget()
    assert estimator.window is None
    assert np.array_equal(estimator.p, before)

    # What comes after the gap is in the middle of a motion, whose memory is not empty.
    fresh = kind(at_twenty_hertz, p=before)
    if kind is NewtonEstimator:
        fresh = kind(at_twenty_hertz, p=before, from_rest=False)
    follow(estimator, run, 0.05, start=60)
    follow(fresh, run, 0.05)
    assert np.array_equal(estimator.p, fresh.p)
    estimator.reset()
    assert not estimator.p.any()


def test_times_say_nothing_to_a_model_that_knows_no_step():
    with pytest.raises(ValueError, match="the model does not know its step"):
        BiasEstimator(DPMPB(2, 1).eval()).update([0, 0], [0], time=0.0)


# Logs of a swing, as a stranger has them


def swing_log(damping, seed, seconds=40.0):
    """A pushed swing at 50 Hz with jitter, a gap and numbers that are missing."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.018, 0.022, int(seconds / 0.02)))
    push = rng.uniform(-2, 2, len(time) // 20 + 1).repeat(20)[: len(time)]
    x = np.zeros((len(time), 2))
    for k, dt in enumerate(np.diff(time)):
        angle, speed = x[k]
        speed += dt * (push[k] - 6 * np.sin(angle) - damping * speed)
        x[k + 1] = angle + dt * speed, speed
    log = {"t": time, "x": x[:, 0].copy(), "v": x[:, 1].copy(), "push": push}
    log["v"][rng.integers(len(time), size=3)] = np.nan
    kept = np.r_[0 : len(time) // 2, len(time) // 2 + 25 : len(time)]
    return {name: values[kept] for name, values in log.items()}


@pytest.mark.nightly
def test_p_of_a_new_log_is_nearest_to_the_right_damping(tmp_path):
    dampings = {"dry": 2.0, "oiled": 0.1, "rusty": 6.0}
    for name, damping in dampings.items():
        write(tmp_path / "train" / name / "a.csv", swing_log(damping, seed=1))
        write(tmp_path / "new" / name / "b.csv", swing_log(damping, seed=2))
    with pytest.raises(ValueError, match=r"a\.csv: row \d+ .*, column 'v' is NaN"):
        read(tmp_path / "train")
    more = {"missing": "hold", "shortest": 11}
    runs = read(tmp_path / "train", **more)
    assert len(runs) == 6, "a gap in each"

    # With a fifth of the epochs, two of three trainings confused two dampings.
    settings = ModelTraining(
        epochs=100, batch_size=40, sequence_length=10, stride=3, bias_learning_rate=0.03
    )
    model, biases, _ = train_dpmpb(runs, settings, progress=False)
    for run in read(tmp_path / "new", **more):
        p, _ = estimate_bias(model, run, method="newton")
        gaps = {name: np.linalg.norm(p - known) for name, known in biases.items()}
        assert min(gaps, key=gaps.get) == run.material


# Datasets of others


class Episode:
    """What an episode of Minari has."""

    def __init__(self, observations, actions, id=0):
        self.id = id
        self.observations = observations
        self.actions = actions


def test_the_last_observation_of_an_episode_is_kept():
    s = np.arange(82.0).reshape(41, 2)
    u = np.arange(40.0)[:, None]
    (run,) = runs_from_minari([Episode(s, u)], "a", step=0.1)
    assert np.array_equal(run.s, s)
    assert np.array_equal(run.u, np.vstack([u, u[-1:]]))
    assert run.step == 0.1

    # And its command means nothing to anybody.
    model = DPMPB(2, 1).eval()
    other = Run(run.s, np.vstack([u, [[1e3]]]), "a")
    for method in ("sgd", "newton"):
        p, _ = estimate_bias(model, run, method=method)
        assert np.array_equal(p, estimate_bias(model, other, method=method)[0])


PARTS = {"place": np.zeros((41, 2)), "goal": (np.ones((41, 1)), np.ones(41))}
U = np.zeros((40, 1))


@pytest.mark.parametrize(
    ("episode", "message"),
    [
        (
            Episode(PARTS, U, 3),
            "of episode 3 have several parts, place, goal: say which",
        ),
        (Episode((U, U), U), "have several parts, a tuple"),
        (
            Episode(np.zeros((41, 8, 8, 3), np.uint8), U),
            "A picture needs an autoencoder",
        ),
        (
            Episode(np.zeros((40, 2)), U),
            "has 40 observations and 40 actions: one obser",
        ),
        (Episode(np.zeros((41, 2)), np.zeros(40, int)), r"are discrete \(int64\): the"),
        (Episode(np.zeros((41, 2)), {"arm": U}), "a command is one vector of real"),
        (Episode(np.zeros((9, 2)), U[:8]), "none of 1 runs has 31 steps, the longest"),
    ],
)
def test_an_episode_that_is_no_run_is_refused(episode, message):
    with pytest.raises(ValueError, match=message):
        runs_from_minari([episode], "a")


def test_the_shortest_run_of_others_is_a_step_or_more():
    (run,) = runs_from_minari([Episode(np.zeros((9, 2)), U[:8])], "a", shortest=1)
    assert len(run) == 9
    for to_runs, dataset in ((runs_from_minari, []), (runs_from_lerobot, SWING)):
        with pytest.raises(ValueError, match="shortest must be at least 1"):
            to_runs(dataset, "a", shortest=0)
    assert len(runs_from_lerobot(SWING, "one", shortest=1)) == 3


def test_observations_in_parts_are_seen_one_by_one():
    see = lambda seen: [*seen["place"], *seen["goal"][0], seen["goal"][1]]  # noqa: E731
    (run,) = runs_from_minari([Episode(PARTS, U)], "a", observe=see)
    assert np.array_equal(run.s, np.tile([0, 0, 1, 1], (41, 1)))
    with pytest.raises(ValueError, match="the dataset has no episodes"):
        runs_from_minari([], "a")


def test_a_dataset_of_minari_is_read():
    minari = pytest.importorskip("minari")
    pytest.importorskip("pyarrow")
    runs = runs_from_minari(
        minari.MinariDataset(PENDULUM), lambda episode: f"load {episode.id}", step=0.05
    )
    assert [run.material for run in runs] == ["load 0", "load 1", "load 2"]

    # It was recorded from these seeds on: all that the pendulum then shows is there.
    env = gymnasium.make("Pendulum-v1")
    for seed, run in enumerate(runs):
        states = [env.reset(seed=seed)[0]]
        states += [env.step(u)[0] for u in run.u[:-1]]
        assert len(run) == 41
        assert run.s == pytest.approx(np.array(states), abs=1e-5)


def test_a_dataset_of_lerobot_is_read():
    pytest.importorskip("pyarrow")
    runs = runs_from_lerobot(SWING)
    assert [run.material for run in runs] == [f"swing with load {k}" for k in range(3)]
    for k, run in enumerate(runs):
        count = np.arange(40 + k)
        assert run.s == pytest.approx(np.stack([k + count / 100, -count / 100], 1))
        assert np.array_equal(run.u[:, 0], count)
        assert run.step == 0.05
        assert run.state_names == ("angle [rad]", "speed [rad/s]")
        assert run.command_names == ("torque [N m]",)

    class Dataset:
        root = SWING

    assert len(runs_from_lerobot(Dataset(), "one")) == 3
    named = runs_from_lerobot(SWING, lambda episode, task: f"{task[-1]}{episode}")
    assert [run.material for run in named] == ["00", "11", "22"]


def test_a_dataset_of_lerobots_format_before_is_read(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    about = json.loads((SWING / "meta" / "info.json").read_text())
    about["codebase_version"] = "v2.1"
    about["features"]["action"]["names"] = {"motors": ["torque"]}
    about["features"]["observation.state"]["names"] = None
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps(about))
    tasks = [{"task_index": k, "task": f"load {k}"} for k in range(3)]
    lines = "\n".join(map(json.dumps, tasks))
    (tmp_path / "meta" / "tasks.jsonl").write_text(lines)

    # A file for each episode
    whole = parquet.read_table(SWING / "data" / "chunk-000" / "file-000.parquet")
    (tmp_path / "data" / "chunk-000").mkdir(parents=True)
    for k in range(3):
        part = whole.filter(np.asarray(whole["episode_index"]) == k)
        name = f"episode_{k:06d}.parquet"
        parquet.write_table(part, tmp_path / "data" / "chunk-000" / name)
    runs = runs_from_lerobot(tmp_path)
    assert [run.material for run in runs] == ["load 0", "load 1", "load 2"]
    assert runs[0].state_names == ("observation.state[0]", "observation.state[1]")
    assert runs[0].command_names == ("torque",)
    for run, same in zip(runs, runs_from_lerobot(SWING), strict=True):
        assert np.array_equal(run.s, same.s)


def test_what_is_no_dataset_of_lerobot_is_said(tmp_path):
    pytest.importorskip("pyarrow")
    with pytest.raises(
        FileNotFoundError, match=r"no LeRobot dataset: it has no .*info"
    ):
        runs_from_lerobot(tmp_path)
    with pytest.raises(KeyError, match=r"no feature 'force'; choose from observation"):
        runs_from_lerobot(SWING, states=["force"])
    shutil.copytree(SWING, tmp_path / "swing")
    path = tmp_path / "swing" / "meta" / "info.json"
    about = json.loads(path.read_text())
    about["features"]["observation.image"] = {"shape": [3, 96, 96]}
    path.write_text(json.dumps(about))
    with pytest.raises(ValueError, match=r"shape \[3, 96, 96\].* needs an autoencoder"):
        runs_from_lerobot(tmp_path / "swing", states=["observation.image"])
    path.write_text(json.dumps(about | {"codebase_version": "v1.6"}))
    with pytest.raises(ValueError, match=r"has LeRobot's format v1\.6, and v2 and v3"):
        runs_from_lerobot(tmp_path / "swing")


def test_a_csv_of_semicolons_is_read_as_one_of_commas(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t;x;u\n" + "".join(f"{0.1 * k:g};{k};0\n" for k in range(40)))
    (run,) = read_runs(
        [path],
        material=lambda path: path.stem,
        time="t",
        states=["x"],
        commands=["u"],
        step=0.1,
        progress=False,
    )
    assert run.s[:3, 0].tolist() == pytest.approx([0, 1, 2], abs=1e-5)


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_hole_in_a_run_is_told_by_step_and_number(tmp_path, on_disk):
    s = np.zeros((50, 3), np.float32)
    s[40, 1] = np.nan
    if on_disk:
        np.save(tmp_path / "s.npy", s)
        s = np.load(tmp_path / "s.npy", mmap_mode="r")
    with pytest.raises(
        ValueError, match=r"is nan in step 40, number 1 .* goes through"
    ):
        Run(s, np.zeros((50, 1), np.float32), "a")
