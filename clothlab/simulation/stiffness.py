"""How stiff the hand is: static postures, and the stiffness ellipse."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from clothlab._validation import check_array, check_number
from clothlab.simulation.arm import MuscleArm, check_command

_SETTLING_TIME = 3.0  # [s], after which a pushed arm has come to rest


def static_posture(arm: MuscleArm, u: ArrayLike, force: ArrayLike) -> np.ndarray:
    """Joint angles `[2]` [rad] at which the muscles balance a force `[2]` [N] (forward,
    up) on the hand, no gravity.

    A ValueError if the command is out of range, or the force pushes a joint to its
    stop.
    """
    u, force = check_command(arm, u), check_array("a force on the hand", force, (2,))

    def torque(theta: np.ndarray) -> np.ndarray:
        if not np.isfinite(theta).all():  # where a solver ends that finds no balance
            return np.full(2, np.nan)
        return arm.hand_jacobian(
            theta
        ).T @ force - arm.moment_arms.T @ arm.static_tension(theta, u)

    solution = root(torque, u[arm.angle_command], tol=1e-10)
    low, high = (
        np.array(arm.lower) - arm.stop_margin,
        np.array(arm.upper) + arm.stop_margin,
    )
    # [N m]; a stretched arm makes the solver doubt a good answer
    balanced = np.abs(torque(solution.x)).max() < 1e-8
    if not balanced or (solution.x < low).any() or (solution.x > high).any():
        raise ValueError(
            f"the muscles cannot hold {force} N under the command {u}: push less"
        )
    return solution.x


def stiffness_ellipse(
    arm: MuscleArm,
    theta_ref: ArrayLike,
    f_const: float,
    *,
    force: float = 1.0,
    directions: int = 24,
) -> np.ndarray:
    """How far the hand moves when pushed from all directions (paper, figure on variable
    stiffness).

    By simulation without gravity and cloth, in the posture `theta_ref` `[2]` [rad] with
    co-contraction `f_const` [N], by a `force` [N]: displacement of the hand (forward,
    up) for each direction, `[directions, 2]` [m].
    """
    theta_ref = check_array("theta_ref", theta_ref, (len(arm.home),))
    u = check_command(arm, [*theta_ref, check_number("f_const", f_const)])
    force, directions = (
        check_number("force", force, above=0),
        check_number("directions", directions, int, at_least=3),
    )
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    arm.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    displacements = []
    for angle in np.arange(directions) * 2 * np.pi / directions:
        mujoco.mj_resetData(model, data)
        arm.reset(data, u)
        mujoco.mj_kinematics(model, data)
        start = data.site("hand").xpos.copy()
        push = force * np.array([np.cos(angle), np.sin(angle)])
        static_posture(arm, u, push)  # which refuses what the muscles cannot hold
        data.body("hand").xfrc_applied[[0, 2]] = push
        mujoco.mj_step(model, data, round(_SETTLING_TIME / model.opt.timestep))
        displacements.append((data.site("hand").xpos - start)[[0, 2]])
    return np.array(displacements)


def ellipse_area(displacements: ArrayLike) -> float:
    """Area [m²] of the ellipse on which displacements `[N, 2]` [m] lie, made by equal
    forces evenly around.

    The polygon through N such points is smaller than the ellipse by a factor that
    depends on N alone.
    """
    x, y = check_array("displacements", displacements, ("N", 2)).T
    if len(x) < 3:
        raise ValueError(f"an ellipse takes three points or more, got {len(x)}")
    polygon = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    corner = 2 * np.pi / len(x)
    return float(polygon * corner / np.sin(corner))
