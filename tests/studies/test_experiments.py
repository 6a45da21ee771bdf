"""Experiments: cases become rows, rows are kept, stored and made anew."""

import joblib
import numpy as np
import pandas as pd
import pytest
import reproduce

import studies
from clothlab import analysis, data
from studies import EXPERIMENTS, PAPER, Experiment, report
from studies._grid import grid, shared
from studies._parallel import KEPT

TINY = {
    "chamfer": {"target": "target-2", "steps": 6},
    "trained_p": {"model": 0, "weights": "torque"},
    "estimation": {
        "model": 1,
        "repeat": 0,
        "cloth": ["damp0.03-mass0.15", "between-light"],
        "steps": 14,
    },
    "control": {
        "model": 0,
        "target": "target-2",
        "cloth": "damp0.03-mass0.05",
        "steps": 16,
    },
    "joint_estimation_control": {"model": 0, "steps": 16},
    "stiffness_ellipse": {"f_const": 30.0},
    "foam_estimation": {"model": 0, "cloth": ["hard-1", "hard-3"], "steps": 12},
    "foam_control": {
        "model": 0,
        "condition": ["Correct w/o stiffness", "Random"],
        "cloth": "soft-1",
        "steps": 16,
    }
    | {"speed_steps": 2},
}
RESULTS = data.data_folder() / "results"
STORED = [
    (name, ending)
    for ending in ("", PAPER)
    for name in EXPERIMENTS
    if (RESULTS / f"{name}{ending}.csv").exists()
]


@pytest.fixture(autouse=True)
def short_trials(monkeypatch):
    """The first steps of a few recorded trials."""
    whole = data.load_trials
    monkeypatch.setattr(
        data, "load_trials", lambda name: [trial[:20] for trial in whole(name)[::4]]
    )


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A folder for tiny tables, and tables by name, each run once."""
    folder, made = tmp_path_factory.mktemp("data"), {}

    def run(name):
        if name not in made:
            made[name] = studies.run(name, **TINY[name])
            studies.save(made[name], name, data=folder)
        return made[name]

    run.folder = folder
    return run


def same(a, b):
    """Whether two tables hold the same, float32 by its few digits."""
    assert list(a) == list(b)
    for column in a:
        for x, y in zip(a[column], b[column], strict=True):
            if isinstance(x, np.ndarray | list):
                assert np.array_equal(
                    np.asarray(x, np.float32), np.asarray(y, np.float32)
                ), column
            else:
                assert x == y or (pd.isna(x) and pd.isna(y)), column


SLOW = {
    "control",
    "joint_estimation_control",
    "foam_control",
    "estimation",
    "foam_estimation",
    "chamfer",
    "stiffness_ellipse",
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name
        for name in TINY
    ],
)
def test_a_table_survives_the_file_and_a_row_of_it_is_made_anew(name, tiny):
    table = tiny(name)
    read = studies.load(name, data=tiny.folder)
    same(read, table)
    which = {key: read[key].iloc[-1] for key in EXPERIMENTS[name].keys}
    both = studies.recompute(name, data=tiny.folder, **which)
    assert list(both.index) == ["stored", "here"]
    same(both.loc[["stored"]], both.loc[["here"]])


@pytest.mark.parametrize(("name", "ending"), STORED)
def test_a_stored_table_has_the_rows_of_the_full_size(name, ending):
    experiment = EXPERIMENTS[name]
    cases = experiment.cases(**(experiment.paper if ending else {}))
    stored = studies.load(name + ending)
    wanted = pd.DataFrame([experiment.defaults | case for case in cases])
    same(stored[experiment.keys], wanted[experiment.keys])
    assert not stored[experiment.keys].duplicated().any()


@pytest.mark.parametrize(
    ("name", "which"),
    [
        ("trained_p", {"model": 3, "weights": "torque"}),
        ("stiffness_ellipse", {"spring": "nonlinear", "f_const": 10.0}),
    ],
)
def test_a_full_size_row_agrees_with_the_stored_one(name, which):
    stored, here = studies.recompute(name, **which).to_dict("records")
    for column in set(stored) - {*EXPERIMENTS[name].keys, "materials"}:
        # Other graphics may draw an outline a little differently.
        assert here[column] == pytest.approx(stored[column], rel=1e-2, abs=2e-2)


@pytest.mark.slow
def test_closed_loops_end_as_near():
    controlled = studies.recompute(
        "control", target="target-2", cloth="damp0.07-mass0.15", model=1
    )["control"]
    stored, here = (np.median(analysis.best_per_period(each)) for each in controlled)
    # On another machine runs soon differ
    assert here == pytest.approx(stored, abs=0.15)


@pytest.mark.parametrize("name", ["rivals", "another_robot_rivals", "drone_prediction"])
def test_tables_of_rivals_are_read_although_nothing_here_makes_them(name):
    assert name not in EXPERIMENTS
    assert len(studies.load(name)) > 30


def test_unknown_names_list_the_choices(tmp_path):
    with pytest.raises(
        KeyError, match="unknown experiment 'alchemy'; choose from chamfer"
    ):
        studies.run("alchemy")
    with pytest.raises(KeyError, match="unknown results 'control'"):
        studies.load("control", data=tmp_path)


def test_a_row_is_chosen_by_parameters_that_leave_one():
    with pytest.raises(
        ValueError,
        match=r"(?s)10 rows of control fit; choose by cloth, model:.*damp0\.07-mass0\.15",
    ):
        studies.recompute("control", target="target-1")
    with pytest.raises(ValueError, match="0 rows of control fit"):
        studies.recompute("control", target="target-9")
    with pytest.raises(
        ValueError, match="control has no 'seed'; choose by target, cloth, model"
    ):
        studies.recompute("control", seed=1)


@pytest.fixture
def counted():
    """An experiment that counts how often it is run, and can be interrupted."""

    @shared
    def train(seed):
        done.append(f"train {seed}")
        return np.full(3, seed)

    def run_one(number, seed=7, word=None):
        if number == broken.get("at"):
            raise KeyboardInterrupt
        done.append(number)
        return {
            "found": number + train(seed).sum(),
            "trace": np.array([0.1, number], np.float32),
            "name": "a word",
        }

    done, broken = [], {}
    return (Experiment("counted", run_one, lambda: grid(number=range(3))), done, broken)


def test_kept_rows_are_not_made_again(counted, tmp_path, monkeypatch):
    experiment, done, _ = counted
    monkeypatch.setenv(KEPT, str(tmp_path))
    first = experiment.run()
    assert done == [0, "train 7", 1, 2]
    same(experiment.run(), first)
    assert len(done) == 4
    experiment.run(grid(number=2, seed=8))
    assert done[4:] == [2, "train 8"]


def test_without_a_folder_nothing_is_kept(counted):
    experiment, done, _ = counted
    same(experiment.run(), experiment.run())
    assert done == [0, "train 7", 1, 2, 0, 1, 2]


def test_an_interrupted_run_goes_on_at_its_next_row(counted, tmp_path, monkeypatch):
    experiment, done, broken = counted
    monkeypatch.setenv(KEPT, str(tmp_path))
    broken["at"] = 2
    with pytest.raises(KeyboardInterrupt):
        experiment.run()
    broken.clear()
    assert list(experiment.run()["number"]) == [0, 1, 2]
    assert [each for each in done if each != "train 7"] == [0, 1, 2]


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["threading", "loky"])
def test_threads_and_processes_give_the_stored_rows(backend):
    cases = EXPERIMENTS["trained_p"].cases(model=0)
    with joblib.parallel_config(backend):
        table = EXPERIMENTS["trained_p"].run(cases, workers=2)
    stored = studies.load("trained_p").head(2)
    for column in set(stored) - {*EXPERIMENTS["trained_p"].keys, "materials"}:
        for here, there in zip(table[column], stored[column], strict=True):
            assert here == pytest.approx(there, rel=1e-2, abs=2e-2)


def test_a_table_keeps_words_arrays_and_what_is_not_there(counted, tmp_path):
    experiment, _, _ = counted
    studies.save(experiment.run(), "counted", data=tmp_path)
    assert "[0.1, 1.0]" in (tmp_path / "results" / "counted.csv").read_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EXPERIMENTS, "counted", experiment)
        both = studies.recompute("counted", number=1, word=None, data=tmp_path)
    same(both.loc[["stored"]], both.loc[["here"]])


@pytest.mark.parametrize("asked", [[], ["control"]])
def test_results_leave_slow_experiments_out_unless_asked(asked, monkeypatch, tmp_path):
    monkeypatch.setenv(KEPT, "")  # is set anew
    monkeypatch.setattr(reproduce, "ROOT", tmp_path)
    ran, usual = [], [name for name, each in EXPERIMENTS.items() if not each.slow]
    monkeypatch.setattr(studies, "run", lambda name, **_: ran.append(name))
    monkeypatch.setattr(studies, "save", lambda *_: None)
    monkeypatch.setattr(data, "write_checksums", lambda: None)
    monkeypatch.setattr(report, "publish", lambda _: None)
    monkeypatch.setattr(report, "claims_table", lambda: "")
    monkeypatch.setattr("sys.argv", ["reproduce.py", "results", *asked])
    reproduce.main()
    wanted = asked or usual
    assert ran == [
        name + end
        for name in wanted
        for end in ("", PAPER)
        if not end or (name, end) in STORED
    ]


def test_a_row_of_a_world_says_what_stands_behind_it():
    with pytest.raises(ValueError, match="run `make worlds`, set CLOTHLAB_DATA"):
        studies.recompute("worlds-control-paper", world=1)
