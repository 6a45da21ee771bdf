"""Estimation in a live run: it starts where it should, and says how sure it is."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab import data
from clothlab.lab._tracker import BiasTracker
from clothlab.method.estimation import NewtonEstimator, NewtonSettings


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


def follow(bias_tracker, run, steps, *, at_rest=True):
    covariances = []
    for k in range(steps):
        bias_tracker.update(run.s[k], run.u[k], at_rest=at_rest and k == 0)
        covariances.append(bias_tracker.covariance)
    return covariances


def test_it_grows_surer(learned, run):
    tracker = BiasTracker(learned, np.zeros(2))
    assert tracker.covariance is None
    covariances = follow(tracker, run, 60)
    first = next(k for k, each in enumerate(covariances) if each is not None)
    assert first < 10
    assert np.trace(covariances[-1]) < np.trace(covariances[first])
    assert not tracker.is_strange


def test_states_unlike_any_training_are_strange(learned, run):
    noise = np.random.default_rng(0).normal(size=run.s.shape).astype(np.float32)
    strange = replace(run, s=run.s + noise * learned.model.s_std.numpy())
    tracker = BiasTracker(learned, np.zeros(2))
    follow(tracker, strange, 60)
    assert tracker.is_strange


def test_it_estimates_as_the_package_does(learned, run):
    tracker = BiasTracker(learned, np.zeros(2))
    estimator = NewtonEstimator(learned.model, settings=NewtonSettings(from_rest=True))
    for k in range(20):
        p = tracker.update(run.s[k], run.u[k], at_rest=k == 0)
        assert np.array_equal(p, estimator.update(run.s[k], run.u[k]))
    assert np.array_equal(tracker.covariance, estimator.linearisation().covariance())


def test_only_a_run_that_begins_at_rest_has_no_warm_up(learned, run):
    at_rest, moving = (BiasTracker(learned, np.zeros(2)) for _ in range(2))
    assert follow(at_rest, run, 10)[-1] is not None
    assert follow(moving, run, 10, at_rest=False)[-1] is None
