"""Checks of notebook 02."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab.checks._check import apart, array, check, drawn, expect, number
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.stiffness import static_posture

_ARM = MuscleArm()


@check(number("a stiffness in N m/rad"))
def pair_stiffness(answer: Callable, rng: np.random.Generator) -> None:
    """The stiffness of a turned joint between a flexor and an extensor [N m/rad].

    Given are both coefficients of a spring, the lever of a muscle r [m], the stretch e0
    [m] of both springs of the straight joint, and its angle [rad]; expected is the
    slope of the torque of the two while their motors stand still: straight, turned
    either way, and so far that one muscle is slack; once the springs are linear.
    """
    stiffness = rng.uniform(3000.0, 6000.0)  # [N/m]
    linear = replace(_ARM, spring_linear=stiffness, spring_cubic=0.0)
    cases = [(_ARM, 0.0), (_ARM, 0.6), (_ARM, -0.6), (_ARM, 1.3), (_ARM, -1.3)]
    for arm, share in [*cases, (linear, 1.3)]:
        r = rng.uniform(0.025, 0.06)
        e0 = rng.uniform(0.01, 0.02)
        theta = share * e0 / r * rng.uniform(0.9, 1.1)  # beyond e0 / r one is slack
        k = answer(arm.spring_linear, arm.spring_cubic, r, e0, theta)
        truth = _slope_of_torque(arm, r, e0, theta)
        otherwise = (
            f"turned by {theta:.2f} rad from a stretch of {1000 * e0:.1f} mm with r = "
            f"{1000 * r:.0f} mm, the torque's slope is {truth:.2f} N m/rad, yours is "
            f"{k:.2f}"
        )
        expect(k, truth, otherwise, _pair_slips(arm, r, e0, theta), rtol=1e-4)


def _slope_of_torque(arm: MuscleArm, r: float, e0: float, theta: float) -> float:
    """-dτ/dθ of two muscles that pull against each other, by a central difference."""

    def torque(theta: float) -> float:
        return r * (arm.tension(e0 - r * theta) - arm.tension(e0 + r * theta))

    h = 1e-5  # [rad]
    return (torque(theta - h) - torque(theta + h)) / (2 * h)


def _pair_slips(
    arm: MuscleArm, r: float, e0: float, theta: float
) -> dict[str, ArrayLike]:
    """What is easily written in place of the stiffness, by what is said of it."""
    e = np.array([e0 + r * theta, e0 - r * theta])
    slopes = arm.spring_linear + 3 * arm.spring_cubic * e**2
    taut = slopes[e > 0]
    secants = arm.tension(e[e > 0]) / e[e > 0]
    return {
        "stiffness is -dτ/dθ: a positive number": -(r**2) * taut.sum(),
        "half of it: there are two muscles": r**2 * taut.sum() / 2,
        "that is the flexor alone: the extensor's spring gives way, too": (
            r**2 * slopes[0]
        ),
        "r enters twice: in the stretch and as the lever": r * taut.sum(),
        "a slack spring has no stiffness": r**2 * slopes.sum(),
        "that is the stiffness of the straight joint: where does theta enter?": (
            2 * r**2 * (arm.spring_linear + 3 * arm.spring_cubic * e0**2)
        ),
        "stiffness is df/de, not f/e": r**2 * secants.sum(),
    }


class _Posture(NamedTuple):
    theta: np.ndarray  # [2] [rad]
    f_const: float  # [N]


@check(array("the matrix C", 2, 2))
def compliance(answer: Callable, rng: np.random.Generator) -> None:
    """The compliance of the hand `[2, 2]` [m/N]: how far it gives way to a push.

    Given are the arm with muscles, the angles of its joints `[2]` [rad] and the tension
    of its muscles [N]; expected is what the simulation's statics say of a tiny push.
    """
    push = 1e-4  # [N]

    def draw() -> _Posture:
        theta = np.array([rng.uniform(0.1, 0.7), rng.uniform(-1.5, -0.7)])
        return _Posture(theta, rng.uniform(25.0, 68.0))

    def slips_differ(posture: _Posture) -> bool:
        return apart(_compliance(*posture), _compliance_slips(*posture), rtol=0.01)

    for _ in range(2):
        theta, f_const = drawn(draw, slips_differ)
        C = answer(_ARM, theta, f_const)

        # Push the hand along each axis
        moved = []
        for axis in np.eye(2):
            pushed = static_posture(_ARM, [*theta, f_const], push * axis)
            moved.append(_ARM.hand(pushed) - _ARM.hand(theta))
        truth = np.stack(moved, axis=1) / push

        otherwise = (
            f"tiny pushes give C = {truth.round(5).tolist()} m/N, "
            f"not {C.round(5).tolist()}"
        )
        if not np.allclose(C, C.T, rtol=1e-3):
            otherwise = (
                "C is symmetric, yours is not: which factor is missing its transpose?"
            )
        expect(C, truth, otherwise, _compliance_slips(theta, f_const), rtol=1e-3)


def _compliance(theta: np.ndarray, f_const: float) -> np.ndarray:
    """The compliance `[2, 2]` by the formula of the notebook."""
    J = _ARM.hand_jacobian(theta)
    G = _ARM.moment_arms
    k = 1 / (1 / _ARM.spring_stiffness(f_const) + 1 / _ARM.motor_stiffness)
    return J @ np.linalg.inv(k * G.T @ G) @ J.T


def _compliance_slips(theta: np.ndarray, f_const: float) -> dict[str, np.ndarray]:
    """What is easily written in place of the compliance, by what is said of it."""
    # Stiffness of a muscle's spring, and what is easily taken for it
    e = _ARM.elongation(f_const)
    tangent = _ARM.spring_stiffness(f_const)
    of_stretch = _ARM.spring_stiffness(e)
    secant = f_const / e

    # The formula's other factors
    J = _ARM.hand_jacobian(theta)
    G = _ARM.moment_arms
    motor = _ARM.motor_stiffness

    def of_joints(k: np.ndarray) -> np.ndarray:
        return np.linalg.inv(k * G.T @ G)

    def of_hand(k: np.ndarray) -> np.ndarray:
        return J @ of_joints(k) @ J.T

    def in_series(k: np.ndarray) -> np.ndarray:
        return k * motor / (k + motor)

    joints = of_joints(in_series(tangent))
    stiffness = J @ np.linalg.inv(joints) @ J.T

    # What is said of each
    return {
        "your motors are rigid: they give way in series": of_hand(tangent),
        "spring_stiffness takes the tension of a spring [N], not its stretch e "
        "[m]": of_hand(in_series(of_stretch)),
        "for small pushes the stiffness of a spring is df/de, not f/e": of_hand(
            in_series(secant)
        ),
        "J and Jᵀ have changed places": J.T @ joints @ J,
        "that is how far the joints turn for a torque: where does J enter?": joints,
        "stiffness in place of its inverse: a stiff arm must give way less, not "
        "more": stiffness,
    }


@check(array("a length for each of the six muscles", 6))
def length_to_send(answer: Callable, rng: np.random.Generator) -> None:
    """Lengths `[6]` [m] to send, so that the motors pull as wanted at θ_ref.

    Given are the arm, θ_ref `[2]` [rad] and the tensions `[6]` [N]. Equal tensions must
    give the known path; others the lengths at which the motors pull just so.
    """
    for _ in range(2):
        theta = _ARM.home_command[:2] + rng.uniform(-0.2, 0.2, 2)
        equal = np.full(6, rng.uniform(20.0, 40.0))
        unequal = rng.permutation(np.linspace(5.0, 120.0, 6)) + rng.uniform(0, 10, 6)
        for f in (equal, unequal):
            sent = answer(_ARM, theta, f)

            # The motor gives way, so that it is sent to a shorter length
            measured = _ARM.body_image(theta, f)
            given_way = (f - _ARM.tension_bias) / _ARM.motor_stiffness
            truth = measured - given_way

            # What is easily sent instead
            biased = measured - f / _ARM.motor_stiffness
            slack = theta @ _ARM.moment_arms.T - given_way
            slips = {
                "that is l_ref, the length to be measured: the motor gives way, "
                "too": measured,
                "f_bias is pulled anyway: subtract it from f": biased,
                "the motor gives way by so much, but it must be sent to a shorter "
                "length, not a longer one": measured + given_way,
                "that is the geometry and the motor: the springs stretch, too": slack,
            }
            pull = _ARM.tension_bias + _ARM.motor_stiffness * (measured - sent)
            otherwise = (
                f"with your lengths the motors pull {pull.round(1)} N at θ_ref, "
                f"not {f} N"
            )
            expect(sent, truth, otherwise, slips, atol=1e-7)


@check(number("a time in s"))
def time_between(answer: Callable, rng: np.random.Generator) -> None:
    """How long rigid motors need from one command to another [s].

    Given are the arm, with motors of some speed, and two commands `[3]`, posture [rad]
    and tension [N]; expected is when the last of six wires has its new length.
    """
    for change in ([0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]):
        arm = replace(_ARM, motor_speed=rng.uniform(0.05, 0.2))
        theta = _ARM.home_command[:2] + rng.uniform(-0.2, 0.2, 2)
        before = np.array([*theta, rng.uniform(30.0, 40.0)])
        size = rng.uniform([0.1, -0.4, 15.0], [0.3, -0.2, 25.0])
        after = before + change * size
        found = answer(arm, before, after)

        # The truth, and what is easily taken for it
        lengths = [arm.body_image(u[:2], np.full(6, u[2])) for u in (before, after)]
        ways = lengths[1] - lengths[0]
        slowest = np.abs(ways).max()
        truth = slowest / arm.motor_speed
        slips = {
            "all six motors reel at once: don't add up their times": np.abs(ways).sum()
            / arm.motor_speed,
            "the arm is ready when its last wire is, not an average one": np.abs(
                ways
            ).mean()
            / arm.motor_speed,
            "some wires get shorter: mind the sign before you look for the "
            "longest way": ways.max() / arm.motor_speed,
            "that is the longest way [m]: how long does a motor need for it?": slowest,
            "a way divided by a speed is a time": slowest * arm.motor_speed,
        }
        otherwise = (
            f"the wires move by {(1000 * ways).round(1)} mm, at most "
            f"{1000 * arm.motor_speed:.0f} mm/s, which takes {truth:.3f} s, not "
            f"{found:.3f} s"
        )
        expect(found, truth, otherwise, slips, atol=1e-7)


@check(array("the Jacobian", 2, 2))
def two_link_jacobian(answer: Callable, rng: np.random.Generator) -> None:
    """The Jacobian ∂(hand)/∂θ `[2, 2]` [m/rad] of an arm with two links.

    Given are the angles θ `[2]` [rad], positive downwards, the elbow's counted from the
    upper arm, and the lengths of both links `[2]` [m]. Rows are forward and upward,
    columns shoulder and elbow.
    """

    def draw() -> tuple[np.ndarray, np.ndarray]:
        return rng.uniform([0.2, -1.4], [0.8, -0.6]), rng.uniform(0.2, 0.5, size=2)

    def slips_differ(drawn_pair: tuple[np.ndarray, np.ndarray]) -> bool:
        return apart(_jacobian(*drawn_pair), _jacobian_slips(*drawn_pair))

    for _ in range(2):
        theta, links = drawn(draw, slips_differ)
        J = answer(theta, links)

        # Nudge each joint
        h = 1e-6
        columns = []
        for nudge in h * np.eye(2):
            change = _hand(theta + nudge, links) - _hand(theta - nudge, links)
            columns.append(change / (2 * h))
        truth = np.stack(columns, axis=1)
        otherwise = (
            f"at θ = {theta.round(2)} rad with links of {links.round(2)} m nudges give "
            f"{truth.round(3).tolist()}, not {J.round(3).tolist()}"
        )
        expect(J, truth, otherwise, _jacobian_slips(theta, links))


def _hand(theta: np.ndarray, links: np.ndarray) -> np.ndarray:
    """Where the hand is, forward and upward of the shoulder `[2]` [m]."""
    slopes = np.array([theta[0], theta[0] + theta[1]])
    return np.array([links @ np.cos(slopes), -links @ np.sin(slopes)])


def _jacobian(theta: np.ndarray, links: np.ndarray) -> np.ndarray:
    """The Jacobian `[2, 2]`: each joint turns all links behind it."""
    slopes = np.array([theta[0], theta[0] + theta[1]])
    upper, fore = np.stack([-links * np.sin(slopes), -links * np.cos(slopes)], axis=1)
    return np.stack([upper + fore, fore], axis=1)


def _jacobian_slips(theta: np.ndarray, links: np.ndarray) -> dict[str, np.ndarray]:
    """What is easily written in place of the Jacobian, by what is said of it."""
    J = _jacobian(theta, links)
    alone = np.stack([J[:, 0] - J[:, 1], J[:, 1]], axis=1)
    return {
        "the shoulder moves the forearm, too: its column has two terms": alone,
        "the forearm's slope is θ₁ + θ₂": _jacobian(
            np.array([theta[0], theta[1] - theta[0]]), links
        ),
        "rows are forward and upward, columns the joints: transpose it": J.T,
        "angles are positive downwards: the hand goes down as they grow": J
        * [[1.0], [-1.0]],
        "the derivative of the cosine is minus the sine": J * [[-1.0], [1.0]],
    }


@check(array("an angle for each joint", 2))
def sag(answer: Callable, rng: np.random.Generator) -> None:
    """How far a torque turns the joints `[2]` [rad] against their muscles.

    Given are the moment arms G `[6, 2]` [m/rad], the stiffness k of each muscle `[6]`
    [N/m], and torques at both joints `[2]` [N m], small enough for a linear answer.
    """
    for _ in range(2):
        G = _ARM.moment_arms * rng.uniform(0.8, 1.2)
        k = rng.permutation(np.linspace(1500.0, 9000.0, 6)) * rng.uniform(0.9, 1.1)
        torque = rng.uniform(0.2, 0.6, size=2)
        found = answer(G, k, torque)

        # The truth, and what is easily written in its place
        joints = G.T @ (k[:, None] * G)  # [2, 2] [N m/rad]
        truth = np.linalg.solve(joints, torque)
        slips = {
            "each muscle has its own stiffness: k belongs between Gᵀ and G": (
                np.linalg.solve(k.mean() * G.T @ G, torque)
            ),
            "that is stiffness times torque: a stiff arm must sag less": joints
            @ torque,
            "the joints are coupled by the muscles across both: solve for both angles "
            "at once": torque / np.diag(joints),
            "a torque turns the joints its own way: mind the sign": -truth,
        }
        back = joints @ found
        otherwise = (
            f"turned by your angles, the muscles pull back with {back.round(3)} N m, "
            f"not with {torque.round(3)} N m"
        )
        expect(found, truth, otherwise, slips)
