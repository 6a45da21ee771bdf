"""Every experiment, run tiny: from settings to a record that survives being written and read."""

import dataclasses
import inspect
import json

import make_results
import numpy as np
import pytest

from clothlab import artifacts, experiments
from clothlab.experiments import _record
from clothlab.experiments.oracle import SearchSettings

FEW = SearchSettings(starts=2, remembered=1, rounds=1, tries=1, elite=2)
TINY = {
    "perception": {"targets": ("target-2",), "steps": 6},
    "self_organisation": {"models": (0,)},
    "estimation": {"models": (1,), "repeats": 1, "cloths": ("damp0.03-mass0.15", "between-light"), "steps": 14},
    "control": {"models": (0,), "targets": ("target-2",), "cloths": ("damp0.03-mass0.05",), "steps": 16},
    "integrated": {"models": (0,), "steps": 16},
    "stiffness": {
        "models": (0,),
        "tensions": (30.0,),
        "estimated": ("hard-1", "hard-3"),
        "estimation_steps": 12,
        "conditions": ("Correct w/o stiffness", "Random"),
        "cloths": ("hard-1", "soft-1"),
        "control_steps": 16,
        "speed_steps": 2,
    },
    "limits": {
        "targets": ("target-2",),
        "cloths": ("damp0.03-mass0.05",),
        "foams": ("hard-1",),
        "tensions": (30.0,),
        "periods": 2,
        "search": FEW,
        "seeds": (0,),
        "speed_steps": 2,
        "speed_search": FEW,
        "speed_seeds": (0,),
    },
    "practice": {
        "methods": ("random", "practice, estimated p", "practice, without stiffness"),
        "cases": ("target-2, light", "foam hard-1"),
        "models": (0,),
        "repeats": 1,
        "steps": 16,
    },
    "any_target": {"first": 1, "models": 1, "steps": 16},
    "knowledge": {
        "cloths": ("between-light",),
        "motions": ("operator",),
        "seeds": (1,),
        "steps": 5,
        "times": (0.4, 1.0),
        "repeats": 4,
        "controls": (),
        "other_steps": (),
        "other_disturbances": (),
        "plans": 1,
        "plan_steps": 5,
    },
    "uncertainty": {
        "models": (0,),
        "repeats": 1,
        "cloths": ("damp0.03-mass0.15", "long"),
        "strange_repeats": 1,
        "known": ("damp0.03-mass0.05", "damp0.03-mass0.15", "damp0.07-mass0.05"),
        "known_repeats": 2,
        "lengths": (14,),
    },
}


@pytest.fixture(scope="session")
def tiny(tmp_path_factory):
    """Records by name, each run once."""
    records = {}

    def run(name):
        if name not in records:
            module = experiments.EXPERIMENTS[name]
            keeps = "folder" in inspect.signature(module.run).parameters
            options = {"folder": tmp_path_factory.mktemp(name)} if keeps else {}
            records[name] = module.run(module.Settings(**TINY[name]), **options)
        return records[name]

    return run


@pytest.fixture(autouse=True)
def short_trials(monkeypatch):
    """The first steps of a few recorded trials, also in place of those that are left to `make data`."""
    whole = artifacts.load_trials
    monkeypatch.setattr(
        artifacts, "load_trials", lambda name: [trial[:20] for trial in whole(name.removesuffix(artifacts.MORE))[::4]]
    )


def same(a, b):
    """Whether two records hold the same."""
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(b, np.ndarray) and b.dtype == np.float32:  # what is read is float64, with the digits that float32 has
        a = np.asarray(a, dtype=np.float32)
    return np.array_equal(a, b)


def test_every_experiment_is_run():
    # these have test files of their own
    of_their_own = {"experience", "feeling", "cameras", "race", "more_of_one", "table_setting"}
    assert set(TINY) == set(experiments.EXPERIMENTS) - of_their_own


@pytest.mark.parametrize("name", TINY)
def test_a_record_survives_the_round_trip(name, tiny, tmp_path):
    record = tiny(name)
    experiments.save(name, record, data=tmp_path)
    assert same(experiments.load(name, data=tmp_path), record)
    assert record.settings == experiments.EXPERIMENTS[name].Settings(**TINY[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["estimation", "control"])
def test_the_same_settings_give_the_same_record_on_any_number_of_workers(name, tiny):
    module = experiments.EXPERIMENTS[name]
    assert same(module.run(module.Settings(**TINY[name]), workers=2), tiny(name))


def test_an_estimation_knows_whether_its_cloth_was_trained(tiny):
    record = tiny("estimation")
    assert [run.cloth for run in record.trained] == ["damp0.03-mass0.15"]
    assert [run.cloth for run in record.between] == ["between-light"]
    assert record.runs[0].trace.shape == (14, 2)


def test_control_starts_from_the_cloth_that_hangs_still(tiny):
    (run,) = tiny("control").runs
    assert run.control[0] == pytest.approx(run.still, abs=1e-4)
    assert run.control[0] == pytest.approx(run.random[0], abs=1e-4)
    assert run.best("control") == pytest.approx([run.control[8:].min()])
    assert run.empty > 0


def test_an_arm_without_a_stiffness_command_keeps_its_stiffness(tiny):
    (fixed,) = tiny("stiffness").case("Correct w/o stiffness", "hard-1")
    (free,) = tiny("stiffness").case("Random", "hard-1")
    assert (fixed.commands[:, 2] == 10).all()
    assert np.ptp(free.commands[:, 2]) > 1
    assert set(fixed.peak_hand_speed) == set(experiments.stiffness.VARIANTS)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("control", {"steps": 3}, "Settings.steps must be at least 16"),
        ("estimation", {"models": (0.5,)}, "Settings.models is a whole number"),
        ("integrated", {"weights": 7}, "Settings.weights is a str"),
    ],
)
def test_settings_that_cannot_be_are_refused(name, change, message):
    with pytest.raises(ValueError, match=message):
        experiments.EXPERIMENTS[name].Settings(**change)


def test_unknown_cloths_weights_and_experiments_list_the_choices(tmp_path):
    module = experiments.estimation
    with pytest.raises(KeyError, match=r"unknown cloth 'felt'; choose from damp0\.03"):
        module.run(module.Settings(models=(0,), cloths=("felt",), steps=12))
    with pytest.raises(KeyError, match="unknown dpmpb weights 'torque-77'; choose from muscle-0"):
        module.run(module.Settings(models=(77,), steps=12))
    with pytest.raises(KeyError, match="unknown experiment 'alchemy'; choose from perception"):
        experiments.load("alchemy")
    with pytest.raises(KeyError, match="unknown results 'control'"):
        experiments.load("control", data=tmp_path)


def test_a_record_of_another_version_is_refused(tiny, tmp_path):
    experiments.save("control", tiny("control"), data=tmp_path)
    path = tmp_path / "results" / "control.json"
    stored = json.loads(path.read_text())
    del stored["record"]["runs"][0]["still"]
    path.write_text(json.dumps(stored))
    with pytest.raises(ValueError, match="damaged or of another version"):
        experiments.load("control", data=tmp_path)


def test_a_record_that_is_not_finite_is_not_written(tiny, tmp_path):
    broken = dataclasses.replace(tiny("perception"), iou=float("nan"))
    with pytest.raises(ValueError, match="not JSON compliant: nan"):
        experiments.save("perception", broken, data=tmp_path)
    assert not list(tmp_path.rglob("*.json"))


def test_a_slow_experiment_may_have_no_record_yet(tiny, tmp_path):
    for name in TINY:
        experiments.save(name, tiny(name), data=tmp_path)
    assert set(experiments.load_all(data=tmp_path)) == set(TINY)
    (tmp_path / "results" / "control.json").unlink()
    with pytest.raises(KeyError, match="unknown results 'control'"):
        experiments.load_all(data=tmp_path)


@pytest.mark.parametrize(
    ("asked", "run"), [([], set(TINY) - experiments.SLOW), (["--only", "experience"], {"experience"})]
)
def test_results_leave_slow_experiments_out_unless_asked(asked, run, monkeypatch):
    done = set()
    for name, module in experiments.EXPERIMENTS.items():
        monkeypatch.setattr(module, "run", lambda *_, name=name, **__: done.add(name))
    for module, name in ((experiments, "save"), (artifacts, "write_checksums"), (make_results, "publish")):
        monkeypatch.setattr(module, name, lambda *_: None)
    monkeypatch.setattr("sys.argv", ["make_results.py", *asked])
    make_results.main()
    assert done == run


def test_jobs_give_the_callers_number_of_threads_back():
    import torch

    torch.set_num_threads(1)
    assert _record.run_jobs(len, [("abc",), ("",)], workers=1, progress=False) == [3, 0]
    assert torch.get_num_threads() == 1


def test_rates_count_the_steps_below_each_threshold(tiny):
    (run,) = tiny("control").runs
    (rates,) = tiny("control").rates([0.0, run.control[0] + 1e-3, 99.0]).values()
    assert rates["Control"].shape == (1, 3)
    assert rates["Control"][0, [0, 2]].tolist() == [0, 1]
    assert rates["Control"][0, 1] == pytest.approx(np.mean(run.control < run.control[0] + 1e-3))
    assert rates["still"][0].tolist() == [0, 1, 1]
    foams = tiny("stiffness").rates([0.0, 99.0], ["Random"])
    assert {label: rates["Random"].tolist() for label, rates in foams.items()} == {
        "hard-1": [[0, 1]],
        "soft-1": [[0, 1]],
    }


def test_a_gap_is_correct_minus_another_condition():
    def run(condition, model, best):
        distance = np.array([2.0, best])
        peaks = {"as assumed": 4.0 if condition == "Correct" else 3.2}
        return experiments.stiffness.Control(
            condition, "hard-1", model, 3.0, distance, 0.1, peaks, np.empty((0, 3)), np.empty((0, 2))
        )

    settings = experiments.stiffness.Settings(models=(0, 1), cloths=("hard-1",))
    runs = tuple(
        run(name, k, best + k) for name, best in (("Correct", 0.1), ("Correct w/o stiffness", 0.4)) for k in (0, 1)
    )
    record = experiments.stiffness.Record(settings, (), np.empty((2, 2)), (), (), runs)
    smallest, _ = experiments.stiffness.QUANTITIES["minimum distance"]
    assert record.gap(smallest, "hard-1", "Correct w/o stiffness") == pytest.approx([-0.3, -0.3])
    assert record.speed_gains() == pytest.approx(np.full((1, 2, 1), 0.25))


def test_estimates_begin_at_zero(tiny):
    paths = tiny("stiffness").estimates(0)
    assert set(paths) == {"estimate of hard-1", "estimate of hard-3"}
    assert all(path.shape == (13, 2) and not path[0].any() and path[1:].any() for path in paths.values())


def test_thirds_are_the_ends_of_a_run():
    run = experiments.integrated.Run(0, np.zeros((64, 2)), np.repeat(np.arange(8.0), 8), 0.5)
    record = experiments.integrated.Record(experiments.integrated.Settings(models=(0,)), (run,))
    assert [part.tolist() for part in record.thirds()] == [[1.5], [6.5]]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["self_organisation", "estimation", "control", "integrated", "stiffness"])
def test_trainings_one_by_one_give_the_record_of_them_all(name):
    module = experiments.EXPERIMENTS[name]
    few = {"repeats": 2} if name == "estimation" else {"conditions": ("Random",)} if name == "stiffness" else {}
    settings = module.Settings(**TINY[name] | few | {"models": (0, 1)})
    each = [module.run(dataclasses.replace(settings, models=(k,))) for k in settings.models]
    assert same(module.merged(settings, each), module.run(settings))


def test_runs_of_single_trainings_take_turns():
    parts = [["a1", "a2", "a3", "a4"], ["b1", "b2", "b3", "b4"]]
    assert _record.interleaved(parts) == ("a1", "b1", "a2", "b2", "a3", "b3", "a4", "b4")
    assert _record.interleaved(parts, 2) == ("a1", "a2", "b1", "b2", "a3", "a4", "b3", "b4")
    assert _record.interleaved([]) == ()
