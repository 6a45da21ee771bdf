"""Checks of notebook 02."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from clothlab.arm import MuscleArm, static_posture
from clothlab.checks._check import array, check, number

__all__ = ["compliance", "length_for_measured_tension", "pair_stiffness", "stretch_by_bisection"]


@check(number("a stiffness in N m/rad"))
def pair_stiffness(answer: Callable) -> None:
    """Compare with the slope of the torque of a flexor and an extensor whose motors stand still."""
    arm = MuscleArm()
    linear_arm = replace(arm, spring_linear=5000.0, spring_cubic=0.0)
    for one, r, e0 in ((arm, 0.04, 0.01), (linear_arm, 0.04, 0.01), (arm, 0.03, 0.02)):
        k = answer(one.spring_linear, one.spring_cubic, r, e0)
        h = 1e-5  # [rad]
        torque = [r * (one.tension(e0 - r * theta) - one.tension(e0 + r * theta)) for theta in (-h, h)]
        wanted = (torque[0] - torque[1]) / (2 * h)
        assert not np.isclose(2 * k, wanted, rtol=1e-4), "half of it: there are two muscles"
        assert not np.isclose(-k, wanted, rtol=1e-4), "stiffness is -dτ/dθ: a positive number"
        assert not np.isclose(k * r, wanted, rtol=1e-4), "r enters twice: in the stretch and as the lever"
        tangent, secant = spring_stiffness(one, e0), one.tension(e0) / e0
        if not np.isclose(tangent, secant):
            assert not np.isclose(k / secant, wanted / tangent, rtol=1e-4), "stiffness is df/de, not f/e"
        assert np.isclose(k, wanted, rtol=1e-4), f"the torque's slope is {wanted:.2f} N m/rad, yours is {k:.2f}"


@check(number("a stretch in metres"))
def stretch_by_bisection(answer: Callable) -> None:
    """Our spring, whose inverse is known, and an exponential one."""
    curves = {"our spring": MuscleArm().tension, "an exponential spring": lambda e: 5 * np.expm1(e / 0.0075)}
    for name, curve in curves.items():
        for tension in (0.5, 10.0, 70.0):
            e = answer(curve, tension)
            assert 0 <= e <= 0.05, f"{name}: {e:.4g} m lies outside the interval 0 to 0.05 m"
            message = f"{name}, stretched by your {1e3 * e:.4f} mm, pulls with {curve(e):.4f} N, not {tension:g} N"
            assert abs(curve(e) - tension) < 1e-3, message + "; go on halving, and keep the half with the answer"


@check(array("the matrix C", 2, 2))
def compliance(answer: Callable) -> None:
    """Compare with the exact solution for a tiny push."""
    arm, push = MuscleArm(), 1e-4  # [N]
    for theta, f_const in ((np.array([0.3, -np.pi / 2]), 30.0), (np.array([0.6, -0.7]), 70.0)):
        C = answer(arm, theta, f_const)
        pushed = [static_posture(arm, [*theta, f_const], push * axis) for axis in np.eye(2)]
        wanted = np.stack([arm.hand(q) - arm.hand(theta) for q in pushed], axis=1) / push
        rigid = 1 + spring_stiffness(arm, arm.elongation(f_const)) / arm.motor_stiffness
        assert not np.allclose(C * rigid, wanted, rtol=1e-3), "your motors are rigid: they give way in series"
        J = arm.hand_jacobian(theta)
        swapped = J.T @ np.linalg.solve(J, wanted) @ np.linalg.inv(J.T) @ J
        assert not np.allclose(C, swapped, rtol=1e-3), "J and Jᵀ have changed places"
        assert np.allclose(C, C.T), "C is symmetric, yours is not: which factor is missing its transpose?"
        message = f"tiny pushes give C = {wanted.round(5).tolist()} m/N, not {np.round(C, 5).tolist()}"
        assert np.allclose(C, wanted, rtol=1e-3), message


@check(array("a length for each of the six muscles", 6))
def length_for_measured_tension(answer: Callable) -> None:
    """Equal tensions must give the known path; others the lengths at which the motors pull just so."""
    arm = MuscleArm()
    home = arm.home_command[:2]
    for f in (np.full(6, 30.0), np.array([120.0, 5.0, 40.0, 50.0, 90.0, 20.0])):
        sent = answer(arm, home, f)
        measured = arm.body_image(home, f)
        assert not np.allclose(sent, measured), "that is l_ref, the length to be measured: the motor gives way, too"
        pull = arm.tension_bias + arm.motor_stiffness * (measured - sent)
        assert not np.allclose(pull - arm.tension_bias, f), "f_bias is pulled anyway: subtract it from f"
        assert np.allclose(pull, f), f"with your lengths the motors pull {pull.round(1)} N at θ_ref, not {f} N"


def spring_stiffness(arm: MuscleArm, e: float) -> float:
    """df/de [N/m] of a taut spring that is stretched by e [m], as the notebook has it."""
    return arm.spring_linear + 3 * arm.spring_cubic * e**2
