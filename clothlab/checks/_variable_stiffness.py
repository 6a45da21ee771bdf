"""Checks of notebook 02."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from clothlab.checks._check import apart, array, check, drawn, expect, number
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.stiffness import static_posture


@check(number("a stiffness in N m/rad"))
def pair_stiffness(answer: Callable, rng: np.random.Generator) -> None:
    """Compare with the slope of the torque of a flexor and an extensor whose motors
    stand still.
    """
    arm = MuscleArm()
    linear_arm = replace(
        arm, spring_linear=rng.uniform(3000.0, 6000.0), spring_cubic=0.0
    )
    for one in (arm, linear_arm, arm):
        r, e0 = rng.uniform(0.025, 0.06), rng.uniform(0.01, 0.02)
        k = answer(one.spring_linear, one.spring_cubic, r, e0)
        h = 1e-5  # [rad]
        torque = [
            r * (one.tension(e0 - r * theta) - one.tension(e0 + r * theta))
            for theta in (-h, h)
        ]
        wanted = (torque[0] - torque[1]) / (2 * h)
        assert not np.isclose(2 * k, wanted, rtol=1e-4), (
            "half of it: there are two muscles"
        )
        assert not np.isclose(-k, wanted, rtol=1e-4), (
            "stiffness is -dτ/dθ: a positive number"
        )
        assert not np.isclose(k * r, wanted, rtol=1e-4), (
            "r enters twice: in the stretch and as the lever"
        )
        tangent, secant = one.spring_stiffness(one.tension(e0)), one.tension(e0) / e0
        if not np.isclose(tangent, secant):
            assert not np.isclose(k / secant, wanted / tangent, rtol=1e-4), (
                "stiffness is df/de, not f/e"
            )
        assert np.isclose(k, wanted, rtol=1e-4), (
            f"the torque's slope is {wanted:.2f} N m/rad, yours is {k:.2f}"
        )


@check(array("the matrix C", 2, 2))
def compliance(answer: Callable, rng: np.random.Generator) -> None:
    """Compare with the exact solution for a tiny push."""
    arm, push = MuscleArm(), 1e-4  # [N]

    def draw() -> tuple[np.ndarray, float]:
        return np.array([rng.uniform(0.1, 0.7), rng.uniform(-1.5, -0.7)]), rng.uniform(
            25.0, 68.0
        )

    for _ in range(2):
        theta, f_const = drawn(
            draw,
            lambda one: apart(
                _compliance(arm, *one), _compliance_slips(arm, *one), rtol=0.01
            ),
        )
        C = answer(arm, theta, f_const)
        pushed = [
            static_posture(arm, [*theta, f_const], push * axis) for axis in np.eye(2)
        ]
        wanted = (
            np.stack([arm.hand(q) - arm.hand(theta) for q in pushed], axis=1) / push
        )
        otherwise = f"tiny pushes give C = {wanted.round(5).tolist()} m/N, not {C.round(5).tolist()}"
        if not np.allclose(C, C.T, rtol=1e-3):
            otherwise = (
                "C is symmetric, yours is not: which factor is missing its transpose?"
            )
        expect(C, wanted, otherwise, _compliance_slips(arm, theta, f_const), rtol=1e-3)


def _compliance(arm: MuscleArm, theta: np.ndarray, f_const: float) -> np.ndarray:
    """The compliance by the formula of the notebook `[2, 2]`, whose slips must be apart
    from it.
    """
    J, G = arm.hand_jacobian(theta), arm.moment_arms
    k = 1 / (1 / arm.spring_stiffness(f_const) + 1 / arm.motor_stiffness)
    return J @ np.linalg.inv(k * G.T @ G) @ J.T


def _compliance_slips(
    arm: MuscleArm, theta: np.ndarray, f_const: float
) -> dict[str, np.ndarray]:
    """What is easily written in place of the compliance: what the reader is told, and
    the value.
    """
    J, G, motor, e = (
        arm.hand_jacobian(theta),
        arm.moment_arms,
        arm.motor_stiffness,
        arm.elongation(f_const),
    )
    tangent, stretch = arm.spring_stiffness(f_const), arm.spring_stiffness(e)

    def by(k: Any) -> np.ndarray:
        return J @ np.linalg.inv(k * G.T @ G) @ J.T

    def in_series(k: Any) -> Any:
        return k * motor / (k + motor)

    joints = np.linalg.inv(in_series(tangent) * G.T @ G)
    return {
        "your motors are rigid: they give way in series": by(tangent),
        "spring_stiffness takes the tension of a spring [N], not its stretch e [m]": by(
            in_series(stretch)
        ),
        "for small pushes the stiffness of a spring is df/de, not f/e": by(
            in_series(f_const / e)
        ),
        "J and Jᵀ have changed places": J.T @ joints @ J,
        "that is how far the joints turn for a torque: where does J enter?": joints,
        "stiffness in place of its inverse: a stiff arm must give way less, not more": J
        @ np.linalg.inv(joints)
        @ J.T,
    }


@check(array("a length for each of the six muscles", 6))
def length_for_measured_tension(answer: Callable, rng: np.random.Generator) -> None:
    """Equal tensions must give the known path; others the lengths at which the motors
    pull just so.
    """
    arm = MuscleArm()
    for _ in range(2):
        theta = arm.home_command[:2] + rng.uniform(-0.2, 0.2, 2)
        for f in (
            np.full(6, rng.uniform(20.0, 40.0)),
            rng.permutation(np.linspace(5.0, 120.0, 6)) + rng.uniform(0, 10, 6),
        ):
            sent = answer(arm, theta, f)
            measured = arm.body_image(theta, f)
            given = (f - arm.tension_bias) / arm.motor_stiffness
            pull = arm.tension_bias + arm.motor_stiffness * (measured - sent)
            slips = {
                "that is l_ref, the length to be measured: the motor gives way, too": measured,
                "f_bias is pulled anyway: subtract it from f": measured
                - f / arm.motor_stiffness,
                "the motor gives way by so much, but it must be sent to a shorter length, not a longer one": measured
                + given,
                "that is the geometry and the motor: the springs stretch, too": theta
                @ arm.moment_arms.T
                - given,
            }
            otherwise = f"with your lengths the motors pull {pull.round(1)} N at θ_ref, not {f} N"
            expect(sent, measured - given, otherwise, slips, atol=1e-7)
