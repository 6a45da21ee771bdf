"""Logs become runs: evenly spaced, without gaps, with names."""

import datetime

import numpy as np
import pandas as pd
import pytest

from clothlab.logs import runs_from_table
from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.weights import Checkpoint

COLUMNS = {"time": "t", "states": ["x", "v"], "commands": ["push"]}


def line(time):
    """A log in which everything is known: x = 2t, v = -t, a push for each row."""
    time = np.asarray(time, float)
    return {"t": time, "x": 2 * time, "v": -time, "push": np.arange(len(time)) * 1.0}


def to_runs(data, step=0.1, **more):
    table = pd.DataFrame(data)
    return runs_from_table(
        table, "any", **COLUMNS, **{"step": step, "shortest": 1, **more}
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
def test_what_is_missing_is_refused_with_row_and_column(nothing):
    log = line(0.1 * np.arange(40))
    log["v"] = [*log["v"][:17], nothing, *log["v"][18:]]
    message = r"row 17 \(counted from 0\), column 'v' is no finite number: .* 1 of 40"
    with pytest.raises(ValueError, match=message):
        to_runs(log)

    # As the message says
    if not np.isinf(nothing or 0):
        (held,) = to_runs(pd.DataFrame(log).ffill(limit=3))
        assert held.s[17].tolist() == pytest.approx([3.4, -1.6])
        (between,) = to_runs(pd.DataFrame(log).dropna())
        assert between.s[17].tolist() == pytest.approx([3.4, -1.7])


BAD = {
    "two rows at one time": (
        {"t": [0.0, 0.1, 0.1, 0.2]},
        r"times must rise, but row 2 .* with 0\.1 comes after 0\.1: leave doubles",
    ),
    "a clock set back": ({"t": [5.0, 5.1, 0.0, 0.1]}, r"row 2 .* or cut the log where"),
    "no time": ({"t": [0.0, np.nan, 0.2, 0.3]}, r"row 1 .* has no time \(column 't'\)"),
    "milliseconds": ({"t": [0, 100, 200, 300]}, "100 s apart .* other units than sec"),
    "too slow": ({"t": [0.0, 0.2, 0.4, 0.6]}, "states in between were not measured"),
    "a word": (
        {"v": [0.0, "off", 0.0, 0.0]},
        "row 1 .*, column 'v' is no finite .*'of",
    ),
    "nothing": ({"t": [], "x": [], "v": [], "push": []}, "the log is empty"),
    "far from zero": (
        {"x": 3948996 + np.array([0.0, 0.1, 0.2, 0.3])},
        "column 'x' varies by 0.112 around 3948996.2, .* take a constant off",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_each_bad_datum_has_its_sentence(name):
    wrong, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        to_runs(line([0.0, 0.1, 0.2, 0.3]) | wrong)


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"states": ["x", "w"]}, KeyError, "no column 'w'; choose from t, x, v, push"),
        ({"states": []}, ValueError, "are lists of columns, got"),
        ({"states": "x"}, ValueError, "are lists of columns, got 'x'"),
        ({"step": 0}, ValueError, "step must be above 0"),
        ({"longest_gap": 0.05}, ValueError, "longest_gap must be at least 0.1"),
        ({"resample_commands": "mean"}, KeyError, "choose from average, last"),
        (
            {"shortest": 50},
            ValueError,
            "none of 1 runs has 50 steps, the longest has 40",
        ),
    ],
)
def test_what_makes_no_sense_is_said(wrong, error, message):
    table = pd.DataFrame(line(0.1 * np.arange(40)))
    right = {"table": table, "material": "any", "step": 0.1}
    with pytest.raises(error, match=message):
        runs_from_table(**(right | COLUMNS | wrong))


def test_columns_may_have_numbers_for_names():
    table = pd.DataFrame(np.column_stack([0.1 * np.arange(40)] * 3))
    (run,) = runs_from_table(table, "a", time=0, states=[1], commands=[2], step=0.1)
    assert (run.state_names, run.command_names) == (("1",), ("2",))


def test_two_columns_of_one_name_are_refused():
    table = pd.DataFrame(line(0.1 * np.arange(40)))
    table.insert(4, "x", 999.0, allow_duplicates=True)
    with pytest.raises(ValueError, match="2 columns have the name 'x'"):
        to_runs(table)


def test_short_runs_are_counted():
    time = np.delete(0.1 * np.arange(100), np.r_[10:20])
    with pytest.warns(
        UserWarning, match="1 of 2 runs have fewer than 31 steps"
    ) as told:
        assert [len(run) for run in to_runs(line(time), shortest=31)] == [80]
    assert told[0].filename.endswith("test_logs.py")


def test_dates_are_times():
    log = line(0.1 * np.arange(40))
    (plain,) = to_runs(log)
    start = datetime.datetime(2026, 11, 25, tzinfo=datetime.UTC)
    aware = [start + datetime.timedelta(seconds=each) for each in log["t"]]
    naive = pd.to_datetime(log["t"], unit="s")
    for dates in (aware, naive, pd.Series(aware), 1_700_000_000 + log["t"]):
        (run,) = to_runs(log | {"t": dates})
        assert run.s == pytest.approx(plain.s, abs=1e-5)
        assert np.array_equal(run.u, plain.u)


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
            r"steps of 0\.1 s, the model has 0\.05 s: resample it",
        ),
        (
            {"state_names": ("x", "v")},
            {"state_names": ("v", "x")},
            r"state_names \(v, x\), the model \(x, v\): give the same",
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
    for step in (0.1, 0.02):
        with pytest.raises(
            ValueError, match=rf"steps of {step} s, .*runs_from_table\(..., step=0.05"
        ):
            estimate_bias(at_twenty_hertz, plain(step=step))
    estimate_bias(at_twenty_hertz, plain(step=0.0502))
    estimate_bias(at_twenty_hertz, plain())


def test_a_run_in_another_order_is_not_estimated_from(at_twenty_hertz):
    at_twenty_hertz.state_names = ("x", "v")
    with pytest.raises(ValueError, match=r"state_names \(v, x\), the model"):
        estimate_bias(at_twenty_hertz, plain(state_names=("v", "x")))
    estimate_bias(at_twenty_hertz, plain(state_names=("x", "v")))


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


@pytest.mark.slow
def test_p_of_a_new_log_is_nearest_to_the_right_damping():
    dampings = {"dry": 2.0, "oiled": 0.1, "rusty": 6.0}

    def logged(seed):
        runs = []
        for name, damping in dampings.items():
            table = pd.DataFrame(swing_log(damping, seed)).ffill(limit=3)
            runs += runs_from_table(table, name, **COLUMNS, step=0.1, shortest=11)
        return runs

    with pytest.raises(ValueError, match=r"row \d+ .*, column 'v' is no finite"):
        to_runs(swing_log(2.0, seed=1))
    runs = logged(seed=1)
    assert len(runs) == 6, "a gap in each"

    # With a fifth of the epochs, two of three trainings confused two dampings.
    settings = ModelTraining(
        epochs=100, batch_size=40, sequence_length=10, stride=3, bias_learning_rate=0.03
    )
    model, biases, _ = train_dpmpb(runs, settings, progress=False)
    for run in logged(seed=2):
        p, _ = estimate_bias(model, run, method="newton")
        gaps = {name: np.linalg.norm(p - known) for name, known in biases.items()}
        assert min(gaps, key=gaps.get) == run.material


def test_a_hole_in_a_run_is_told_by_step_and_number():
    s = np.zeros((50, 3), np.float32)
    s[40, 1] = np.nan
    with pytest.raises(ValueError, match=r"is nan in step 40, number 1 .* of a log"):
        Run(s, np.zeros((50, 1), np.float32), "a")
