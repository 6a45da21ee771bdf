"""The experiment on practice: its runs are kept, its methods do what they say."""

import json
from dataclasses import replace

import numpy as np
import pytest

from clothlab import artifacts
from clothlab.experiments import _kept, other_models, practice
from clothlab.experiments.practice import CASES, METHODS, Record, Run, Settings, jobs, run, run_one

SMALL = {"cases": ("target-2, light",), "models": (0,), "repeats": 1, "steps": 16}


@pytest.fixture(autouse=True)
def short_trials(monkeypatch):
    """The first steps of a few recorded trials, also in place of those that are left to `make data`."""
    whole = artifacts.load_trials
    monkeypatch.setattr(
        artifacts, "load_trials", lambda name: [trial[:40] for trial in whole(name.removesuffix(artifacts.MORE))]
    )
    kept = (practice._seen, practice._model_of_changes)
    for each in kept:
        each.cache_clear()
    yield
    for each in kept:
        each.cache_clear()


def test_what_is_done_is_not_done_again(tmp_path, monkeypatch):
    settings = Settings(methods=("random",), **SMALL)
    first = run(settings, folder=tmp_path)
    monkeypatch.setattr(practice, "run_one", lambda *job, **how: pytest.fail("run again"))
    again = run(settings, folder=tmp_path)
    assert np.array_equal(first.runs[0].best, again.runs[0].best)


def test_another_version_or_length_is_done_again(tmp_path, monkeypatch):
    run(Settings(methods=("random",), **SMALL), folder=tmp_path)
    calls = []
    real = run_one
    monkeypatch.setattr(practice, "run_one", lambda *job, **how: calls.append(job) or real(*job, **how))
    run(Settings(methods=("random",), **SMALL | {"steps": 24}), folder=tmp_path)
    monkeypatch.setattr(_kept, "version", lambda: "another")
    run(Settings(methods=("random",), **SMALL | {"steps": 24}), folder=tmp_path)
    assert len(calls) == 2


def test_a_damaged_file_of_a_run_is_done_again(tmp_path):
    settings = Settings(methods=("random",), **SMALL)
    first = run(settings, folder=tmp_path)
    (path,) = (tmp_path / "results").glob("*.json")
    path.write_text(path.read_text()[:50])
    assert np.array_equal(run(settings, folder=tmp_path).runs[0].best, first.runs[0].best)
    json.loads(path.read_text())


def test_methods_on_which_claims_stand_run_often_and_stiffness_is_a_matter_of_the_muscle_arm():
    count = {}
    for method, case, _, _ in jobs(Settings(models=(0,))):
        count[method, case] = count.get((method, case), 0) + 1
    assert count["practice", "target-1, light"] == 4
    assert count["changes", "target-1, light"] == 1
    assert ("practice, without stiffness", "target-1, light") not in count
    assert count["practice, without stiffness", "foam soft-1"] == 4


@pytest.mark.parametrize("method", [name for name in METHODS if "practice" not in name and "random" not in name])
def test_every_opponent_moves_the_cloth(method, monkeypatch, tmp_path):
    case = "target-2, heavy" if "torque" in METHODS[method].arms else "foam hard-1"
    monkeypatch.setattr(practice, "train_changes", lambda *a, **k: practice_changes(*a, **k))
    monkeypatch.setattr(practice, "OWN_STEPS", 40)
    shorten_trainings(monkeypatch)
    (tmp_path / "weights").mkdir()
    found = run_one(Settings(methods=(method,), models=(0,), steps=16), method, case, 0, 0, folder=tmp_path)
    assert found.best.shape == (1,)
    assert np.isfinite(found.best).all()
    assert found.still > 0


def shorten_trainings(monkeypatch):
    train, go_on = other_models.train_dpmpb, other_models.retrained
    monkeypatch.setattr(
        other_models, "train_dpmpb", lambda runs, recipe, **how: train(runs, replace(recipe, epochs=1), **how)
    )
    brief = other_models.Retraining(updates=2, batch_size=4)
    monkeypatch.setattr(other_models, "retrained", lambda *given, **how: go_on(*given, brief, **how))


def practice_changes(runs, model, latent_size, *, seed):
    from clothlab.experiments.opponents import ChangesTraining, train_changes

    return train_changes(runs, model, latent_size, ChangesTraining(updates=3, batch_size=8, neighbours=2), seed=seed)


def made(method, model, seed, best, speed=1.0):
    speeds = np.full(len(best), speed)
    return Run(method, "target-1, light", model, seed, 1.0, np.array(best), speeds, np.empty(0), None)


def test_the_last_ten_and_what_they_are_over_random():
    runs = [made("random", k, k, [2.0] * 12) for k in range(2)]
    runs += [made("practice", k, seed, [9.0, 9.0] + [0.2 * (k + 1)] * 10) for k in range(2) for seed in range(2)]
    record = Record(Settings(models=(0, 1)), tuple(runs))
    assert record.last("practice", "target-1, light") == pytest.approx([0.2, 0.4])
    assert record.over_random("practice", "target-1, light") == pytest.approx([0.1, 0.2])


def test_differences_are_of_runs_that_start_alike():
    case = ["target-1, light"]
    runs = [made("random", k, 0, [2.0] * 12) for k in range(2)]
    runs += [made("gradient", k, seed, [0.5 + 0.1 * seed] * 12, speed=2) for k in range(2) for seed in range(3)]
    runs += [made("practice", k, seed, [0.1 + 0.1 * seed + k] * 12, speed=3) for k in range(2) for seed in range(2)]
    record = Record(Settings(models=(0, 1)), tuple(runs))
    assert record.differences("practice", "gradient", case) == pytest.approx(np.array([[-0.2] * 2, [0.3] * 2]))
    assert record.speed_gains("practice", "gradient", case) == pytest.approx(np.full((2, 2), 0.5))


def test_the_first_run_starts_from_home_and_the_others_elsewhere():
    settings = Settings(steps=20)
    first, second, again = (run_one(settings, "gradient", "target-2, light", 0, repeat) for repeat in (0, 1, 1))
    assert first.still < second.still
    assert np.array_equal(second.best, again.best)
    assert len(first.best) == len(first.hand_speed) == 1
    assert 0 < first.hand_speed[0] < 10


def test_periods_are_counted_until_the_first_that_is_near():
    runs = [made("practice", k, k, best) for k, best in enumerate(([0.9, 0.2, 0.9], [0.1, 0.9, 0.9], [0.9, 0.9, 0.9]))]
    record = Record(Settings(models=(0, 1, 2)), tuple(runs))
    assert record.periods_until("practice", "target-1, light", 0.2).tolist() == [3, 2, 5]


def test_unknown_methods_and_cases_list_the_choices(tmp_path):
    with pytest.raises(KeyError, match="unknown method 'prayer'; choose from random"):
        run(Settings(methods=("prayer",)), folder=tmp_path)
    with pytest.raises(KeyError, match="unknown case 'target-9'; choose from target-1, light"):
        run_one(Settings(), "random", "target-9", 0, 0)


def test_cases_are_those_of_the_tables():
    assert {case.target for case in CASES.values()} <= set(artifacts.load_targets())


def test_a_model_of_another_kind_is_trained_once_and_then_kept(tmp_path, monkeypatch):
    practice.trained_here.cache_clear()
    made = []

    def quickly(learned, runs, seed):
        made.append(seed)
        return other_models.without_p(learned, runs, seed)

    shorten_trainings(monkeypatch)
    monkeypatch.setitem(METHODS, "quick", replace(METHODS["gradient"], model=quickly))
    settings = Settings(methods=("quick",), **SMALL)
    first = run(settings, folder=tmp_path)
    practice.trained_here.cache_clear()
    (tmp_path / "results" / "quick-target-2-light-0-0.json").unlink()
    again = run(settings, folder=tmp_path)
    assert made == [0]
    assert np.array_equal(first.runs[0].best, again.runs[0].best)
