"""The race: all get the same and are told nothing; what is done is kept; errors are what they say."""

from dataclasses import replace

import mujoco.sysid
import numpy as np
import pytest

from clothlab import artifacts, experiments
from clothlab.experiments import _kept, knowledge, practice, race
from clothlab.experiments.race import ALL, GROUPS, METHODS, OUTSIDE, ROUGH, Method, Record, Run, Settings, run, run_one
from clothlab.experiments.sysid import UNKNOWN, FitSettings, RegressorTraining, logs
from clothlab.learning.dpmpb import Sequences
from clothlab.simulation.cloth import CLOTHS, DAMPINGS, MASSES

TINY = {"cloths": ("damp0.03-mass0.15", "outside-heavy"), "models": (1,), "steps": (12, 14)}
TINY |= {"fit": FitSettings(cells=1, iterations=1), "network": RegressorTraining(updates=2, window=20)}


@pytest.fixture(autouse=True)
def short_trials(monkeypatch):
    """The first steps of a few recorded trials, also in place of those that are left to `make data`."""
    whole = artifacts.load_trials
    monkeypatch.setattr(
        artifacts, "load_trials", lambda name: [trial[:40] for trial in whole(name.removesuffix(artifacts.MORE))[::6]]
    )
    practice._seen.cache_clear()
    yield
    practice._seen.cache_clear()


def guess(settings, learned, model, folder):
    """Answers without looking, a little better with every step."""
    return lambda run: logs(CLOTHS["damp0.05-mass0.10"]) + 1 / len(run)


@pytest.fixture
def guesses(monkeypatch):
    monkeypatch.setitem(METHODS, "guess", Method(guess, "nothing"))
    return Settings(**TINY | {"methods": ("guess",)})


def test_everybody_is_asked_about_every_cloth_and_it_is_kept(tmp_path, monkeypatch):
    settings = Settings(methods=("p", "p by momentum", "network"), **TINY)
    record = run(settings, folder=tmp_path)
    assert [(each.cloth, each.method) for each in record.runs] == [
        (cloth, method) for cloth in settings.cloths for method in settings.methods
    ]
    for each in record.runs:
        assert each.error.shape == (2, 2)
        assert (each.seconds > 0).all()
    assert record.training["p"] > 0 < record.training["network"]
    assert record.training["p by momentum"] == record.training["p"], "the same weights"
    assert len({each.seed for each in record.runs}) == 2, "all methods get the same run, and each cloth its own"
    experiments.save("race", record, data=tmp_path)
    again = experiments.load("race", data=tmp_path)
    assert again.settings == settings
    assert np.array_equal(again.errors("p", "C_damp"), record.errors("p", "C_damp"))
    for name in ("answers", "sensed", "train_regressor", "train_dpmpb"):
        monkeypatch.setattr(race, name, lambda *a, **k: pytest.fail("done again"))
    assert np.array_equal(run(settings, folder=tmp_path).runs[5].error, record.runs[5].error)


@pytest.mark.skipif(not hasattr(mujoco.sysid, "optimize"), reason="packages of mujoco.sysid are missing")
def test_the_simulation_is_fitted_to_what_the_robot_senses(tmp_path):
    settings, learned = Settings(**TINY), race.trained("torque-1")
    seen = race.sensed(settings, learned, "between-light", seed=3)[:3]
    found, again, rough = (
        METHODS[name].make(settings, learned, 1, tmp_path)(seen) for name in ("sysid", "sysid", "sysid-rough")
    )
    assert np.array_equal(found, again)
    assert not np.array_equal(found, rough)
    assert ROUGH.stiffness < CLOTHS["damp0.03-mass0.05"].stiffness


def test_nobody_is_told_what_is_in_the_hand(guesses, tmp_path, monkeypatch):
    given = []

    def spy(*told):
        return lambda *asked: given.append((told, asked)) or np.zeros(2)

    monkeypatch.setitem(METHODS, "guess", Method(spy, "nothing"))
    for name in TINY["cloths"]:
        run_one(guesses, name, 1, tmp_path)
    (first, _), *_ = given
    assert len(given) == 4
    for told, asked in given:
        assert told == first, "the same whatever is in the hand"
        (seen,) = asked
        assert type(seen) is Sequences
        assert seen.material == UNKNOWN
        assert vars(seen).keys() == {"s", "u", "material"}
    assert [len(asked[0]) for _, asked in given] == [12, 14] * 2


def test_errors_are_those_of_the_logarithms(guesses, tmp_path):
    record = run(guesses, folder=tmp_path)
    cloth, middle = ALL["damp0.03-mass0.15"], CLOTHS["damp0.05-mass0.10"]
    expected = np.log(middle.damping / cloth.damping) + 1 / np.array([12, 14])
    assert record.errors("guess", "C_damp", "trained") == pytest.approx(expected[None], abs=1e-4)
    ratio = np.log(middle.damping / middle.mass) - np.log(cloth.damping / cloth.mass)
    assert record.errors("guess", "C_damp / C_mass", "trained") == pytest.approx(np.full((1, 2), ratio), abs=1e-4)
    assert record.errors("guess", "C_damp / C_mass").shape == (2, 2)
    assert record.errors("guess", "C_damp / C_mass", "between").shape == (0, 2)
    assert record.times == pytest.approx([2.4, 2.8])
    assert record.training == {"guess": 0.0}


def test_a_product_errs_by_both_and_seconds_are_of_the_median_run():
    runs = [
        Run("p", "between-slow", 0, k, np.array([[0.1, 0.2]]), np.array([s])) for k, s in enumerate((1.0, 9.0, 2.0))
    ]
    record = Record(Settings(methods=("p",), steps=(12,)), tuple(runs), {"p": 0.0})
    assert record.curves("between")["C_damp · C_mass"]["p"] == pytest.approx(np.full((3, 1), 0.3))
    assert record.seconds("p") == pytest.approx([2.0])
    with pytest.raises(KeyError, match="unknown quantity 'C_mess'; choose from C_damp"):
        record.errors("p", "C_mess")
    with pytest.raises(KeyError, match="unknown group of cloths 'foams'; choose from trained"):
        record.errors("p", "C_mass", "foams")


def test_errors_are_compared_with_the_bound_of_the_same_cloth():
    def case(cloth, information):
        told = dict.fromkeys(("z", "joints"), information[None] / 2)
        how = knowledge.Case(cloth, "random", 7000, 0.05, 1e-6)
        return knowledge.Run(how, knowledge.Known(told, {}, {}, 0.0, np.zeros(3)))

    cloths = ("damp0.03-mass0.05", "damp0.07-mass0.15")
    settings = knowledge.Settings(cloths=cloths, steps=10, times=(2,))
    known = knowledge.Record(settings, tuple(map(case, cloths, (np.eye(2) * 200, np.eye(2) * 800))), ())
    errors = {cloths[0]: (0.3, 0.1), cloths[1]: (0.0, 0.1), "between-light": (9.0, 0.0)}
    runs = tuple(Run("p", cloth, 0, 0, np.array([[5.0, 5.0], e]), np.ones(2)) for cloth, e in errors.items())
    record = Record(Settings(steps=(12, 20), methods=("p",)), runs, {"p": 0.0})
    with pytest.raises(ValueError, match="bounds are for 2 s, the race ends after 4 s"):
        record.over_bound("p", known, "z + joints", "C_damp / C_mass")
    known = replace(known, settings=replace(settings, steps=20, times=(2, 4)))
    over = record.over_bound("p", known, "z + joints", "C_damp / C_mass")
    assert over == pytest.approx([0.2 / 0.1, 0.1 / 0.05])


def test_the_rough_simulation_is_fitted_less_often(guesses, tmp_path, monkeypatch):
    monkeypatch.setitem(METHODS, "sysid-rough", Method(guess, "nothing"))
    monkeypatch.setattr(race, "sysid_tools", lambda: None)
    settings = Settings(**TINY | {"methods": ("guess", "sysid-rough"), "models": (0, 1), "cloths": ("between-fast",)})
    assert [each.method for each in run(settings, folder=tmp_path).runs] == ["guess", "sysid-rough", "guess"]


def test_other_settings_are_run_anew(guesses, tmp_path, monkeypatch):
    first = run_one(guesses, "between-fast", 1, tmp_path)[0]
    monkeypatch.setitem(METHODS, "guess", Method(lambda *told: lambda run: np.zeros(2), "nothing"))
    kept = run_one(guesses, "between-fast", 1, tmp_path)[0]
    assert np.array_equal(kept.error, first.error)
    monkeypatch.setattr(_kept, "version", lambda: "another")
    assert not np.array_equal(run_one(guesses, "between-fast", 1, tmp_path)[0].error, first.error)


def test_cloths_between_lie_between_and_those_outside_do_not():
    lower, upper = np.log([DAMPINGS[0], MASSES[0]]), np.log([DAMPINGS[-1], MASSES[-1]])
    assert [len(cloths) for cloths in GROUPS.values()] == [9, 5, 2]
    assert len(ALL) == 16
    assert all(cloth.name == name for name, cloth in ALL.items())
    known = np.array([logs(cloth) for cloth in CLOTHS.values()])
    for cloth in GROUPS["between"].values():
        assert (lower < logs(cloth)).all()
        assert (logs(cloth) < upper).all()
        assert np.abs(known - logs(cloth)).max(axis=1).min() > 0.05
    for cloth in OUTSIDE.values():
        assert ((logs(cloth) < lower) | (logs(cloth) > upper)).all()


def test_sysid_that_cannot_run_is_missed_before_anything_is_trained(tmp_path, monkeypatch):
    monkeypatch.delattr(mujoco.sysid, "optimize", raising=False)
    monkeypatch.setattr(race, "train_model", lambda *a: pytest.fail("trained"))
    with pytest.raises(ImportError, match="pip install absl-py"):
        run(Settings(**TINY), folder=tmp_path)


def test_settings_that_make_no_race_are_refused():
    with pytest.raises(KeyError, match="unknown method 'oracle'; choose from p, p by momentum"):
        Settings(methods=("oracle",))
    with pytest.raises(KeyError, match=r"unknown cloth 'felt'; choose from damp0\.03"):
        Settings(cloths=("felt",))
    with pytest.raises(ValueError, match=r"Settings.models needs an entry"):
        Settings(models=())
    with pytest.raises(ValueError, match=r"Settings.steps grow, got \(50, 25\)"):
        Settings(steps=(50, 25))
    with pytest.raises(ValueError, match=r"Settings.steps must be at least 12"):
        Settings(steps=(5,))


def test_all_say_what_they_need():
    assert set(Settings().methods) == set(METHODS)
    assert all(method.needs for method in METHODS.values())
