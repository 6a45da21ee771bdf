"""Estimation in a live run: it starts where it should, and reports now and then."""

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest

from clothlab import data
from clothlab.lab import _tracker as tracker
from clothlab.lab._tracker import _REPORT_EVERY, BiasTracker, _calibration

pytestmark = pytest.mark.slow  # a calibration takes seconds


@pytest.fixture(scope="module")
def learned():
    return data.load("torque-0")


@pytest.fixture(scope="module")
def run(learned):
    trials = data.load_trials("evaluation")
    return learned.to_run(
        next(
            t
            for t in trials
            if t.policy == "random" and t.cloth.name == "damp0.07-mass0.10"
        )
    )


@pytest.fixture
def calibrated():
    _calibration("torque-0", "evaluation").result()


def follow(bias_tracker, run, steps, *, at_rest=True):
    reports = []
    for k in range(steps):
        bias_tracker.update(run.s[k], run.u[k], at_rest=at_rest and k == 0)
        reports.append(bias_tracker.report)
    return reports


@pytest.mark.slow
def test_reports_come_now_and_then_and_grow_surer(learned, calibrated, run):
    reports = follow(BiasTracker(learned, "evaluation", np.zeros(2)), run, 60)
    first = next(k for k, report in enumerate(reports, start=1) if report is not None)
    assert first % _REPORT_EVERY == 0
    assert np.trace(reports[-1].covariance) < np.trace(reports[first - 1].covariance)
    assert not reports[-1].out_of_distribution


def test_states_unlike_any_training_are_out_of_distribution(learned, calibrated, run):
    noise = np.random.default_rng(0).normal(size=run.s.shape).astype(np.float32)
    strange = replace(run, s=run.s + noise * learned.model.s_std.numpy())
    assert follow(BiasTracker(learned, "evaluation", np.zeros(2)), strange, 60)[
        -1
    ].out_of_distribution


def test_only_a_run_that_begins_at_rest_has_no_warm_up(learned, calibrated, run):
    at_rest, moving = (
        BiasTracker(learned, "evaluation", np.zeros(2)) for _ in range(2)
    )
    follow(at_rest, run, 10)
    follow(moving, run, 10, at_rest=False)
    assert at_rest.report is not None
    assert moving.report is None


def test_before_the_calibration_is_there_p_is_estimated_without_reports(
    learned, calibrated, run, monkeypatch
):
    there = BiasTracker(learned, "evaluation", np.zeros(2))
    follow(there, run, 20)
    monkeypatch.setattr(tracker, "_calibration", lambda *_: Future())
    missing = BiasTracker(learned, "evaluation", np.zeros(2))
    follow(missing, run, 20)
    assert np.array_equal(missing._estimator.p, there._estimator.p)
    assert missing.report is None
    assert there.report is not None
