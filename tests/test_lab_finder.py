"""Who finds p in a live run starts where it is told, and doubts now and then."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from clothlab import artifacts
from clothlab.lab.finder import DOUBT_EVERY, Finder, Later, calibration, calibration_later


@pytest.fixture(scope="module")
def learned():
    return artifacts.load("torque-0")


@pytest.fixture(scope="module")
def run(learned):
    trials = artifacts.load_trials("evaluation")
    return learned.sequences(next(t for t in trials if t.policy == "random" and t.cloth.name == "damp0.07-mass0.10"))


@pytest.fixture(scope="module")
def known():
    found = calibration("torque-0", "evaluation")
    return lambda: found


def follow(finder, run, steps, *, at_rest=True):
    doubts = []
    for k in range(steps):
        finder.update(run.s[k], run.u[k], at_rest=at_rest and k == 0)
        doubts.append(finder.doubt)
    return doubts


def test_doubts_come_now_and_then_and_grow_smaller(learned, known, run):
    doubts = follow(Finder(learned, known, np.zeros(2)), run, 60)
    first = next(k for k, doubt in enumerate(doubts, start=1) if doubt is not None)
    assert first % DOUBT_EVERY == 0
    assert len({id(doubt) for doubt in doubts if doubt is not None}) == 60 // DOUBT_EVERY - first // DOUBT_EVERY + 1
    assert np.trace(doubts[-1].covariance) < np.trace(doubts[first - 1].covariance)
    assert not doubts[-1].unfamiliar


def test_sensors_that_no_cloth_moves_like_that_are_unfamiliar(learned, known, run):
    noise = np.random.default_rng(0).normal(size=run.s.shape).astype(np.float32)
    strange = replace(run, s=run.s + noise * learned.model.s_std.numpy())
    assert follow(Finder(learned, known, np.zeros(2)), strange, 60)[-1].unfamiliar


def test_only_a_run_that_begins_at_rest_has_no_warm_up(learned, known, run):
    at_rest, moving = (Finder(learned, known, np.zeros(2)) for _ in range(2))
    follow(at_rest, run, 10)
    follow(moving, run, 10, at_rest=False)
    assert at_rest.doubt is not None
    assert moving.doubt is None


def test_what_is_computed_later_is_computed_once_and_nobody_waits_for_it():
    gate, calls = threading.Event(), []
    later = Later(lambda: (calls.append(threading.current_thread()), gate.wait(5)))
    assert calls == []
    assert later() is later() is None
    gate.set()
    while later() is None:
        time.sleep(0.001)
    assert len(calls) == 1
    assert calls[0] is not threading.current_thread()


def test_what_goes_wrong_later_is_raised_where_it_is_asked_for():
    def wait():
        while later() is None:
            time.sleep(0.001)

    later = Later(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        wait()


def test_without_a_calibration_p_is_found_without_doubts(learned, known, run):
    missing, there = Finder(learned, lambda: None, np.zeros(2)), Finder(learned, known, np.zeros(2))
    for k in range(20):
        p, same = (finder.update(run.s[k], run.u[k], at_rest=k == 0) for finder in (missing, there))
        assert np.array_equal(p, same)
    assert missing.doubt is None
    assert there.doubt is not None


def test_trials_that_are_not_there_are_named():
    with pytest.raises(KeyError, match="unknown"):
        calibration_later("torque-0", "nothing")
    with pytest.raises(KeyError, match="unknown"):
        calibration("torque-0", "nothing")
