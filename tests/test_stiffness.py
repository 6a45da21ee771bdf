"""Laws of stiffness: how far a push moves the hand."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from clothlab.simulation.arm import MuscleArm, TorqueArm
from clothlab.simulation.stiffness import (
    ellipse_area,
    static_posture,
    stiffness_ellipse,
)

ARM = MuscleArm()
BENT = np.array([0.3, -np.pi / 2])
DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


@pytest.mark.slow
def test_more_co_contraction_less_deflection_at_every_posture():
    for theta in product((-0.6, 0.2, 1.0), (-1.6, -0.8, -0.1)):
        for push in DIRECTIONS:
            moved = [
                np.linalg.norm(
                    ARM.hand(static_posture(ARM, [*theta, f], push))
                    - ARM.hand(np.array(theta))
                )
                for f in (10, 30, 50, 70)
            ]
            assert (np.diff(moved) < 0).all(), (theta, push)


@pytest.mark.parametrize("f_const", [10.0, 70.0])
def test_simulated_ellipse_is_the_static_solution(f_const):
    simulated = stiffness_ellipse(ARM, BENT, f_const, directions=4)
    static = [
        ARM.hand(static_posture(ARM, [*BENT, f_const], push)) - ARM.hand(BENT)
        for push in DIRECTIONS
    ]
    assert (
        np.linalg.norm(simulated - static, axis=1).max()
        < 0.02 * np.linalg.norm(static, axis=1).min()
    )


def test_it_is_the_nonlinear_spring_that_makes_stiffness_a_command():
    linear = replace(ARM, spring_linear=5000.0, spring_cubic=0.0)
    for arm, wanted in (
        (ARM, pytest.approx(2.6, abs=0.3)),
        (linear, pytest.approx(1.0, abs=0.02)),
    ):
        soft, stiff = (
            ellipse_area(stiffness_ellipse(arm, BENT, f, directions=4))
            for f in (30.0, 70.0)
        )
        assert soft / stiff == wanted


@pytest.mark.parametrize("count", [3, 4, 36])
def test_the_area_of_a_known_ellipse_does_not_hang_on_the_number_of_directions(count):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    assert ellipse_area(
        np.stack([3 * np.cos(angle), 2 * np.sin(angle)], axis=1)
    ) == pytest.approx(6 * np.pi)


def test_an_arm_without_muscles_has_no_ellipse():
    with pytest.raises(ValueError, match=r"a command of the torque arm is \[2\]"):
        stiffness_ellipse(TorqueArm(), BENT, 30.0)


def test_a_force_beyond_the_muscles_is_refused():
    with pytest.raises(ValueError, match="push less"):
        static_posture(ARM, [*BENT, 30.0], [0.0, 1e5])


@pytest.mark.parametrize(
    ("force", "joint"), [(25.0, "elbow below"), (40.0, "shoulder above")]
)
def test_one_joint_beyond_its_stop_is_enough_to_refuse_a_push(force, joint):
    with pytest.raises(ValueError, match="push less"):
        static_posture(ARM, [0.9, -1.57, 10.0], [-force, 0.0])


def test_a_stretched_arm_has_an_ellipse_too():
    angles = np.linspace(0, 2 * np.pi, 25)
    moved = [
        static_posture(MuscleArm(), [0.0, 0.0, 30.0], [np.cos(a), np.sin(a)])
        for a in angles
    ]
    assert np.allclose(moved[0], moved[-1], atol=1e-9)
    assert np.ptp(moved, axis=0).min() > 1e-4


def test_an_ellipse_takes_three_directions():
    with pytest.raises(ValueError, match="directions"):
        stiffness_ellipse(ARM, BENT, 30.0, directions=2)
