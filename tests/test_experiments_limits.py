"""What is possible: the cases that are searched, and what the record says of them."""

import numpy as np
import pytest

from clothlab import artifacts
from clothlab.analysis import target_distance
from clothlab.experiments import limits
from clothlab.experiments.limits import Case, Record, Run, Settings, Speed
from clothlab.experiments.oracle import SearchSettings
from clothlab.learning.control import recorded_plans

TINY = SearchSettings(starts=2, remembered=1, rounds=1, tries=2, elite=2)


def case(f_const=None, remembers=True, seed=0, cloth="hard-1"):
    return Case("muscle", "muscle", cloth, f_const, remembers, seed)


@pytest.fixture
def record():
    """Distances of 13 periods that are known, 1 in the first three of them."""

    def made(case, last):
        distance = np.full(104, 5.0)
        distance[3:24:8] = 1.0
        distance[27::8] = last
        return Run(case, distance, np.zeros((13, 2)))

    runs = (
        *(made(case(seed=seed), last) for seed, last in ((0, 0.2), (1, 0.4))),
        made(case(10.0), 0.5),
        made(case(70.0), 0.25),
        made(case(remembers=False), 0.9),
        made(case(cloth="soft-1"), 0.1),
    )
    speeds = tuple(
        Speed(f, seed, f_peak + seed, np.zeros(2), np.zeros((1, 3)))
        for f, f_peak in ((10.0, 4.0), (None, 5.0))
        for seed in (0, 1)
    )
    return Record(Settings(tensions=(10.0, 70.0)), runs, speeds)


def test_the_yardstick_is_the_median_of_the_last_ten_periods(record):
    (run,) = record.case("muscle", "hard-1", 10.0)
    assert list(run.best) == [1.0, 1.0, *[0.5] * 10]
    assert run.last_ten == run.median == 0.5
    assert record.possible("muscle", "hard-1") == pytest.approx(0.3)  # mean of two seeds
    assert record.possible("muscle", "soft-1") == pytest.approx(0.1)


def test_a_run_is_read_at_the_ends_of_its_periods(record):
    run = Run(case(), np.arange(32.0), np.zeros((4, 2)))
    assert list(run.ends) == [8, 16, 24]
    assert list(run.best) == [8, 16, 24]


def test_cases_are_found_by_what_they_are(record):
    assert [run.case.seed for run in record.case("muscle", "hard-1")] == [0, 1]
    (forgetful,) = record.case("muscle", "hard-1", remembers=False)
    assert forgetful.last_ten == 0.9
    assert record.case("muscle", "hard-3") == []
    assert record.best_constant("muscle", "hard-1") == 70.0


def test_peak_speeds_are_those_of_all_seeds(record):
    assert list(record.peak_speeds()) == [5, 6]
    assert list(record.peak_speeds(10.0)) == [4, 5]


def test_stiffness_is_held_fixed_only_where_there_is_one():
    settings = Settings(tensions=(10.0, 70.0), seeds=(0, 1), forgetful_seeds=(5,))
    cases = limits.cases(settings)
    assert len(set(cases)) == len(cases) == (4 + 2 + 2 * 2) * 2 + 4 + 2
    assert {case.arm for case in cases if case.f_const is not None} == {"muscle"}
    assert {case.seed for case in cases if not case.remembers} == {5}


def test_any_target_may_be_searched_for(square):
    autoencoder, _ = artifacts.load_autoencoder("muscle")
    plans = recorded_plans(artifacts.load_trials("muscle-train")[:1], 2, 10)
    trial, trace = limits.search_trial(
        autoencoder, "muscle", "soft-1", square, plans, 3, f_const=20.0, search=TINY, seed=4
    )
    assert (trial.commands[:, 2] == 20).all()
    assert trial.seed == 4
    ends = target_distance(autoencoder, trial, square)[2::2]
    assert trace[:-1, -1] == pytest.approx(ends, abs=1e-5)
    assert trace.shape == (3, 2)


def test_a_forgetful_search_knows_nothing_of_the_one_before(monkeypatch):
    asked = []
    monkeypatch.setattr(limits, "search_trial", lambda *_, search, **__: asked.append(search) or 1 / 0)
    for remembers in (True, False):
        with pytest.raises(ZeroDivisionError):
            limits.run_case(Settings(search=TINY), case(remembers=remembers))
    assert [search.remembered for search in asked] == [1, 0]


def test_free_stiffness_is_no_slower_than_any_fixed_one():
    settings = Settings(speed_steps=2, speed_search=TINY, tensions=(10.0, 70.0))
    speeds = limits.run_speeds(settings, 0)
    assert [each.f_const for each in speeds] == [10, 70, None]
    assert [set(each.commands[:, 2]) for each in speeds[:2]] == [{10.0}, {70.0}]
    assert speeds[2].trace[0] >= max(each.peak for each in speeds[:2]) - 1e-4
    for each in speeds:
        assert (np.diff(each.trace) >= 0).all()
        assert each.peak == pytest.approx(each.trace[-1], abs=1e-4)
