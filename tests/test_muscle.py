"""Laws of muscles: springs that pull and never push, and what they make of a command."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab.simulation.muscle import Muscles

SIX = Muscles()


def test_elongation_inverts_tension():
    f = np.array([0.0, 1e-6, 2.0, 10.0, 70.0, 250.0])
    assert SIX.tension(SIX.elongation(f)) == pytest.approx(f, rel=1e-9, abs=1e-12)


def test_a_slack_spring_does_not_push():
    assert (SIX.tension(np.array([-0.01, 0.0])) == 0).all()


def test_a_linear_spring_is_the_limit_of_the_nonlinear_one():
    linear, nearly = replace(SIX, spring_cubic=0.0), replace(SIX, spring_cubic=1e-3)
    f = np.array([2.0, 70.0])
    assert linear.elongation(f) == pytest.approx(f / SIX.spring_linear)
    assert nearly.elongation(f) == pytest.approx(linear.elongation(f), rel=1e-6)


def test_stiffness_is_the_slope_of_tension():
    f = np.array([5.0, 30.0, 70.0])
    e, step = SIX.elongation(f), 1e-7
    slope = (SIX.tension(e + step) - SIX.tension(e - step)) / (2 * step)
    assert SIX.spring_stiffness(f) == pytest.approx(slope, rel=1e-5)
    assert (np.diff(SIX.spring_stiffness(f)) > 0).all()


def test_a_spring_beside_takes_its_share():
    more = 1000.0
    e = SIX.elongation(np.array([50.0]), more_stiffness=more)
    assert SIX.tension(e) + more * e == pytest.approx(50.0)


def test_muscle_lengths_follow_the_joints_by_their_moment_arms():
    f = np.full(6, 30.0)
    theta, turn = np.array([0.2, -0.5]), np.array([0.01, -0.02])
    change = SIX.body_image(theta + turn, f) - SIX.body_image(theta, f)
    assert change == pytest.approx(SIX.moment_arms @ turn)
    assert SIX.body_image(np.tile(theta, (4, 1)), np.tile(f, (4, 1))).shape == (4, 6)


@pytest.mark.parametrize("f_const", [10.0, 70.0])
def test_held_at_its_reference_every_muscle_pulls_with_the_commanded_tension(f_const):
    u = np.array([0.3, -1.0, f_const])
    assert SIX.static_tension(u[:2], u) == pytest.approx(np.full(6, f_const), rel=1e-9)


def test_springs_of_ones_own_pull_in_everything_that_follows_from_springs():
    class OwnSprings(type(SIX)):
        def tension(self, elongation):
            return 5000.0 * np.maximum(elongation, 0.0)

        def elongation(self, tension, more_stiffness=0.0):
            return tension / (5000.0 + more_stiffness)

    linear, u = (
        replace(SIX, spring_linear=5000.0, spring_cubic=0.0),
        np.array([0.3, -1.0, 30.0]),
    )
    assert OwnSprings().sent_length(u) == pytest.approx(linear.sent_length(u))
    assert OwnSprings().static_tension(u[:2] + 0.1, u) == pytest.approx(
        linear.static_tension(u[:2] + 0.1, u)
    )
    assert OwnSprings().static_tension(u[:2] + 0.1, u) != pytest.approx(
        SIX.static_tension(u[:2] + 0.1, u), abs=0.1
    )


def test_motors_pull_within_their_limits_however_far_the_arm_is_moved():
    u = np.array([0.3, -1.0, 30.0])
    f = SIX.static_tension(np.array([20.0, -20.0]), u)
    assert f.min() == SIX.tension_bias
    assert f.max() == SIX.tension_max


def test_a_range_of_tension_rises_within_what_motors_can_pull():
    with pytest.raises(
        ValueError, match=r"must rise, within f_bias 2.0 and f_max 250.0 N"
    ):
        Muscles(tension_range=(10.0, 300.0))
