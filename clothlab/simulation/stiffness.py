"""How stiff the hand is: static postures, and the stiffness ellipse."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from clothlab._validation import check_array, check_number
from clothlab.simulation.arm import MuscleArm

_SETTLING_TIME = 3.0  # [s], after which a pushed arm has come to rest


def static_posture(arm: MuscleArm, u: ArrayLike, force: ArrayLike) -> np.ndarray:
    """Joint angles `[2]` [rad] at which the muscles balance a force on the hand.

    The force is `[2]` [N] (forward, up); there is no gravity. A ValueError if the
    command is out of range, or the force pushes a joint to its stop.
    """
    u = arm.check_command(u)
    force = check_array("a force on the hand", force, (2,))

    def torque(theta: np.ndarray) -> np.ndarray:
        # Not finite is where a solver ends that finds no balance.
        if not np.isfinite(theta).all():
            return np.full(2, np.nan)
        pushed = arm.hand_jacobian(theta).T @ force
        pulled = arm.moment_arms.T @ arm.static_tension(theta, u)
        return pushed - pulled

    theta = root(torque, u[arm.angle_command], tol=1e-10).x

    # Judged by what is left of the torque [N m], not by the solver: a stretched arm
    # makes it doubt a good answer.
    balanced = np.abs(torque(theta)).max() < 1e-8
    low = np.array(arm.lower) - arm.stop_margin
    high = np.array(arm.upper) + arm.stop_margin
    if not balanced or (theta < low).any() or (theta > high).any():
        raise ValueError(
            f"the muscles cannot hold {force} N under the command {u}: push less"
        )
    return theta


def stiffness_ellipse(
    arm: MuscleArm,
    theta_ref: ArrayLike,
    f_const: float,
    *,
    force: float = 1.0,
    directions: int = 24,
) -> np.ndarray:
    """How far the hand moves when pushed from all directions.

    By simulation, without gravity and cloth (paper, figure on variable stiffness).

    Args:
        arm: An arm with muscles.
        theta_ref: The posture `[2]` [rad].
        f_const: The co-contraction [N].
        force: How strong each push is [N].
        directions: The number of pushes, evenly around.

    Returns:
        Displacement of the hand (forward, up) for each push, `[directions, 2]` [m].
    """
    theta_ref = check_array("theta_ref", theta_ref, (len(arm.home),))
    u = arm.check_command([*theta_ref, check_number("f_const", f_const)])
    force = check_number("force", force, above=0)
    directions = check_number("directions", directions, int, at_least=3)

    # The arm alone, without weight
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    arm.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    settling = round(_SETTLING_TIME / model.opt.timestep)

    displacements = []
    for angle in np.arange(directions) * 2 * np.pi / directions:
        # Where the hand is before
        mujoco.mj_resetData(model, data)
        arm.reset(data, u)
        mujoco.mj_kinematics(model, data)
        start = data.site("hand").xpos.copy()

        # A push that the muscles cannot hold is refused.
        push = force * np.array([np.cos(angle), np.sin(angle)])
        static_posture(arm, u, push)

        # Where it comes to rest
        data.body("hand").xfrc_applied[[0, 2]] = push
        mujoco.mj_step(model, data, settling)
        displacements.append((data.site("hand").xpos - start)[[0, 2]])
    return np.array(displacements)


def ellipse_area(displacements: ArrayLike) -> float:
    """Area [m²] of the ellipse on which displacements `[N, 2]` [m] lie.

    They are made by equal forces evenly around. The polygon through N such points is
    smaller than the ellipse by a factor that depends on N alone.
    """
    x, y = check_array("displacements", displacements, ("N", 2)).T
    if len(x) < 3:
        raise ValueError(f"an ellipse takes three points or more, got {len(x)}")
    polygon = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    corner = 2 * np.pi / len(x)
    return float(polygon * corner / np.sin(corner))
