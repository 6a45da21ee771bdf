"""Checks of appendix A2: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise
from clothlab.simulation.arm import MuscleArm

_ARM = MuscleArm()


@exercise("a length for each of the six muscles", 6, atol=1e-7)
def length_to_send(rng: np.random.Generator) -> Question:
    """Lengths `[6]` [m] to send, so that the motors pull as wanted at θ_ref.

    Given are the arm, θ_ref `[2]` [rad] and the tensions `[6]` [N], which differ.
    """
    theta = _ARM.home_command[:2] + rng.uniform(-0.2, 0.2, 2)
    f = rng.permutation(np.linspace(5.0, 120.0, 6)) + rng.uniform(0, 10, 6)

    # The motor gives way, so that it is sent to a shorter length
    measured = _ARM.body_image(theta, f)
    given_way = (f - _ARM.tension_bias) / _ARM.motor_stiffness
    truth = measured - given_way
    slips = {
        "that is l_ref, the length to be measured: the motor gives way, too": measured,
        "f_bias is pulled anyway: subtract it from f": measured
        - f / _ARM.motor_stiffness,
        "the motor gives way by so much, but it must be sent to a shorter length, not "
        "a longer one": measured + given_way,
        "that is the geometry and the motor: the springs stretch, too": theta
        @ _ARM.moment_arms.T
        - given_way,
    }

    def otherwise(found: np.ndarray) -> str:
        pull = _ARM.tension_bias + _ARM.motor_stiffness * (measured - found)
        return (
            f"with your lengths the motors pull {pull.round(1)} N at θ_ref, "
            f"not {f.round(1)} N"
        )

    return Question((_ARM, theta, f), truth, slips, otherwise)


@exercise("the Jacobian", 2, 2)
def two_link_jacobian(rng: np.random.Generator) -> Question:
    """The Jacobian ∂(hand)/∂θ `[2, 2]` [m/rad] of an arm with two links.

    Given are the angles θ `[2]` [rad], positive downwards, the elbow's counted from the
    upper arm, and the lengths of both links `[2]` [m]. Rows are forward and upward,
    columns shoulder and elbow.
    """
    theta = rng.uniform([0.2, -1.4], [0.8, -0.6])
    links = rng.uniform(0.2, 0.5, size=2)
    J = _jacobian(theta, links)
    alone = np.stack([J[:, 0] - J[:, 1], J[:, 1]], axis=1)
    slips = {
        "the shoulder moves the forearm, too: its column has two terms": alone,
        "the forearm's slope is θ₁ + θ₂": _jacobian(
            np.array([theta[0], theta[1] - theta[0]]), links
        ),
        "rows are forward and upward, columns the joints: transpose it": J.T,
        "angles are positive downwards: the hand goes down as they grow": J
        * [[1.0], [-1.0]],
        "the derivative of the cosine is minus the sine": J * [[-1.0], [1.0]],
    }
    return Question(
        (theta, links),
        J,
        slips,
        lambda found: (
            f"at θ = {theta.round(2)} rad with links of {links.round(2)} m nudges give "
            f"{J.round(3).tolist()}, not {found.round(3).tolist()}"
        ),
    )


def _jacobian(theta: np.ndarray, links: np.ndarray) -> np.ndarray:
    """The Jacobian `[2, 2]`: each joint turns all links behind it."""
    slopes = np.array([theta[0], theta[0] + theta[1]])
    upper, fore = np.stack([-links * np.sin(slopes), -links * np.cos(slopes)], axis=1)
    return np.stack([upper + fore, fore], axis=1)


@exercise("the matrix C", 2, 2, rtol=1e-4, atol=1e-8)
def compliance(rng: np.random.Generator) -> Question:
    """The compliance of the hand `[2, 2]` [m/N]: how far it gives way to a push.

    Given are the arm with muscles, the angles of its joints `[2]` [rad] and the tension
    of its muscles [N].
    """
    theta = np.array([rng.uniform(0.1, 0.7), rng.uniform(-1.5, -0.7)])
    f_const = rng.uniform(25.0, 68.0)
    J = _ARM.hand_jacobian(theta)
    G = _ARM.moment_arms
    motor = _ARM.motor_stiffness

    def of_joints(k: np.ndarray) -> np.ndarray:
        return np.linalg.inv(k * G.T @ G)

    def of_hand(k: np.ndarray) -> np.ndarray:
        return J @ of_joints(k) @ J.T

    def in_series(k: np.ndarray) -> np.ndarray:
        return k * motor / (k + motor)

    # Stiffness of a muscle's spring, and what is easily taken for it
    e = _ARM.elongation(f_const)
    tangent = _ARM.spring_stiffness(f_const)
    joints = of_joints(in_series(tangent))
    truth = J @ joints @ J.T
    slips = {
        "your motors are rigid: they give way in series": of_hand(tangent),
        "spring_stiffness takes the tension of a spring [N], not its stretch e "
        "[m]": of_hand(in_series(_ARM.spring_stiffness(e))),
        "for small pushes the stiffness of a spring is df/de, not f/e": of_hand(
            in_series(f_const / e)
        ),
        "J and Jᵀ have changed places": J.T @ joints @ J,
        "that is how far the joints turn for a torque: where does J enter?": joints,
        "stiffness in place of its inverse: a stiff arm must give way less, not more": J
        @ np.linalg.inv(joints)
        @ J.T,
    }

    def otherwise(found: np.ndarray) -> str:
        if not np.allclose(found, found.T, rtol=1e-3):
            return "C is symmetric, yours is not: which factor misses its transpose?"
        return (
            f"tiny pushes give C = {truth.round(5).tolist()} m/N, "
            f"not {found.round(5).tolist()}"
        )

    return Question((_ARM, theta, f_const), truth, slips, otherwise)


@exercise("an angle for each joint", 2)
def sag(rng: np.random.Generator) -> Question:
    """How far a torque turns the joints `[2]` [rad] against their muscles.

    Given are the moment arms G `[6, 2]` [m/rad], the stiffness k of each muscle `[6]`
    [N/m], and torques at both joints `[2]` [N m], small enough for a linear answer.
    """
    G = _ARM.moment_arms * rng.uniform(0.8, 1.2)
    k = rng.permutation(np.linspace(1500.0, 9000.0, 6)) * rng.uniform(0.9, 1.1)
    torque = rng.uniform(0.2, 0.6, size=2)
    joints = G.T @ (k[:, None] * G)  # [2, 2] [N m/rad]
    truth = np.linalg.solve(joints, torque)
    slips = {
        "each muscle has its own stiffness: k belongs between Gᵀ and G": (
            np.linalg.solve(k.mean() * G.T @ G, torque)
        ),
        "that is stiffness times torque: a stiff arm must sag less": joints @ torque,
        "the joints are coupled by the muscles across both: solve for both angles "
        "at once": torque / np.diag(joints),
        "a torque turns the joints its own way: mind the sign": -truth,
    }

    def otherwise(found: np.ndarray) -> str:
        back = joints @ found
        return (
            f"turned by your angles, the muscles pull back with {back.round(3)} N m, "
            f"not with {torque.round(3)} N m"
        )

    return Question((G, k, torque), truth, slips, otherwise)
