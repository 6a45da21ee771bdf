"""The studies of notebook 16 on rivals of p, and on when p pays."""

from dataclasses import replace

import another_robot
import fair_rivals
import gymnasium
import numpy as np
import pandas as pd
import pytest
import when_p_pays
from when_p_pays import PENDULA, WORLDS


def test_the_fast_reacher_is_gymnasiums():
    world = WORLDS["reacher"]
    env = another_robot.make_robot(another_robot.MATERIALS[2])
    env.reset(seed=0)
    env.unwrapped.set_state(np.array([0.3, -0.4, 0.1, 0.1]), np.zeros(4))
    u = when_p_pays.excite(world, 20, 3)
    theirs = [another_robot.see(env.step(each)[0]) for each in u]
    ours = world.see(world.move(2, np.array([0.3, -0.4, 0, 0]), u[None]))[0]
    assert ours == pytest.approx(np.array(theirs), abs=2e-4)


def test_the_pendulum_without_friction_is_gymnasiums(monkeypatch):
    monkeypatch.setattr(when_p_pays, "PENDULA", ((1.0, 0.0),))
    env = gymnasium.make("Pendulum-v1").unwrapped
    env.reset(seed=0)
    env.state = np.array([np.pi, 0.0])
    u = when_p_pays.excite(WORLDS["pendulum"], 20, 3)
    theirs = [env.step(each)[0] for each in u]
    ours = WORLDS["pendulum"].move(0, np.array([np.pi, 0.0]), u[None])
    assert WORLDS["pendulum"].see(ours)[0] == pytest.approx(np.array(theirs), abs=1e-5)


@pytest.mark.parametrize("name", WORLDS)
def test_friction_slows_and_mass_too(name):
    world = WORLDS[name]
    start, _ = world.draw(0)
    first = len(start) // 2  # the first joint's speed
    push = np.full((1, 4, world.commands), world.limit)
    push[..., 1:] = 0
    speeds = [abs(world.move(k, start, push)[0, -1, first]) for k in (0, 2, 8)]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[0] > 1.5 * speeds[-1]


def test_the_oracle_finds_its_goal_and_misses_it_with_another_mass():
    world = WORLDS["pendulum"]
    right = when_p_pays.miss(world, 0, 1, when_p_pays.oracle(world, 0, 1))
    wrong = when_p_pays.miss(world, 0, 1, when_p_pays.oracle(world, 8, 1))
    repaired = when_p_pays.miss(world, 0, 1, when_p_pays.oracle(world, 8, 1), 1)
    assert right < 0.02
    assert wrong > 0.1
    assert repaired < wrong / 2


def test_without_feedback_all_of_the_gap_is_left():
    rows = when_p_pays.measure_gap("pendulum", 0, "some mass")
    assert [row["feedback"] for row in rows] == list(when_p_pays.FEEDBACK)
    assert rows[0]["left"] == rows[0]["gap"]
    assert rows[0]["gap"] == rows[2]["gap"]


@pytest.mark.parametrize("name", WORLDS)
def test_halves_share_no_goal_and_pair(name):
    first = set(when_p_pays.half(name, "development"))
    second = set(when_p_pays.half(name, "test"))
    assert not first & second
    assert first | second == set(when_p_pays.tasks(name))
    assert len(first) == len(second)


def test_the_slope_is_that_of_a_line_through_zero():
    left = pd.Series([1.0, 2.0, 3.0])
    assert when_p_pays.slope(left, 0.7 * left) == pytest.approx(0.7)
    assert when_p_pays.slope(0 * left + 1, left) == pytest.approx(2)


def test_distances_are_over_those_of_random_commands():
    row = {"gap": 2.0, "gain": 1.0, "random": 4.0, "world": "pendulum"}
    found = when_p_pays.in_units(pd.DataFrame([row]))
    assert found[["gap", "gain"]].to_numpy().tolist() == [[0.5, 0.25]]


def test_the_test_half_was_predicted_before(monkeypatch):
    """Predictions are of just those tasks that the number does not come from."""
    saved = {}
    learnt_from, *_ = when_p_pays.half("reacher", "development")
    others = when_p_pays.half("reacher", "test")[:2]
    tasks = [("reacher", *task, "never") for task in (learnt_from, *others)]
    oracle = pd.DataFrame(tasks, columns=when_p_pays.TASK)
    oracle = oracle.assign(gap=[0.2, 0.4, 0.6], left=[0.2, 0.4, 0.6], random=2.0)
    learnt = oracle[:1].assign(gain=0.1, training=0)
    tables = {"when_p_pays_oracle": oracle, "when_p_pays_development": learnt}
    monkeypatch.setattr(when_p_pays.studies, "load", tables.get)
    monkeypatch.setattr(
        when_p_pays, "save", lambda table, name: saved.update({name: table})
    )
    when_p_pays.predict()
    predicted = saved["when_p_pays_predicted"]
    found = zip(predicted["goal"], predicted["pair"], strict=True)
    assert list(found) == others
    assert predicted["rule"].to_numpy() == pytest.approx([0.1, 0.15])
    assert predicted["mean gain"].to_numpy() == pytest.approx([0.05, 0.05])


@pytest.mark.slow
def test_a_gain_is_measured_small(monkeypatch):
    few = replace(when_p_pays.PENDULUM_TRAINING, epochs=1)
    trained = when_p_pays.train("pendulum", 0, 60, few)
    monkeypatch.setattr(when_p_pays, "trained_for", lambda *which: trained)
    monkeypatch.setattr(when_p_pays, "kept", lambda function: function)
    monkeypatch.setattr(when_p_pays, "ESTIMATE", 30)
    rows = when_p_pays.measure_gain("pendulum", 0, 0, "both")
    assert len(rows) == len(when_p_pays.FEEDBACK)
    assert all(0 <= row[p] <= 2 for row in rows for p in ("estimated", "wrong"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", fair_rivals.MODELS)
def test_each_rival_trains_and_reaches(kind):
    few = replace(fair_rivals.BUDGET, epochs=1)
    trained = fair_rivals.train(kind, 0, 260, few)
    method = fair_rivals.METHODS[kind]
    far = another_robot.control(trained, method, another_robot.MATERIALS[0], False, 0)
    assert far.shape == (10,)
    assert (far < 0.42).all()


def test_nine_pendula_have_two_properties():
    assert len({mass for mass, _ in PENDULA}) == 3
    assert len(PENDULA) == 9
