"""Robot arms: their MuJoCo elements, how a command reaches the actuators, and what the robot feels of itself.

Every arm offers what `TorqueArm` does. Nothing above this module asks which arm it is talking to: the sizes of the
command and of the robot state, and which part of that state is muscle tension, are the arm's to say.
"""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from clothlab._choices import choose

__all__ = ["ARMS", "TorqueArm", "check_command", "get_arm"]

JOINTS = ("shoulder", "elbow")
SHOULDER_POSITION = np.array([0.0, 0.0, 1.0])  # [m]
SKIN_RGBA = (0.75, 0.76, 0.78, 1.0)


@dataclass(frozen=True)
class TorqueArm:
    """The simulated two-joint arm of the paper: shoulder and elbow pitch, driven by position servos.

    Angles are positive downwards and zero when the arm is stretched out horizontally. The command is `u = theta_ref`
    and the robot state is joint angles and velocities. The paper gives no dimensions for this arm; these are this
    project's.
    """

    name: str = field(default="torque", metadata={"unit": "-"})
    link_length: float = field(default=0.30, metadata={"unit": "m"})  # upper arm and forearm each
    link_masses: tuple[float, float] = field(default=(1.0, 0.7), metadata={"unit": "kg"})
    servo_stiffness: tuple[float, float] = field(default=(120.0, 60.0), metadata={"unit": "N m/rad"})
    servo_damping: tuple[float, float] = field(default=(8.0, 4.0), metadata={"unit": "N m s/rad"})
    hinge_damping: float = field(default=0.5, metadata={"unit": "N m s/rad"})
    lower: tuple[float, float] = field(default=(-0.8, -1.6), metadata={"unit": "rad"})  # shoulder, elbow
    upper: tuple[float, float] = field(default=(1.0, 0.0), metadata={"unit": "rad"})
    bar_length: float = field(default=0.44, metadata={"unit": "m"})  # the rod in the hand that holds the cloth

    @property
    def command_names(self) -> tuple[str, ...]:
        """What each number of `u` is, with its unit."""
        return ("θ_ref shoulder [rad]", "θ_ref elbow [rad]")

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest command, `[D_u]` [rad]."""
        return np.array(self.lower)

    @property
    def command_upper(self) -> np.ndarray:
        """Largest command, `[D_u]` [rad]."""
        return np.array(self.upper)

    @property
    def home_command(self) -> np.ndarray:
        """The command that a scene starts with, `[D_u]`: a stretched arm, lowered a little, the cloth hanging."""
        return np.array([0.4, -0.4])

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each number of the robot state is, with its unit."""
        return ("θ shoulder [rad]", "θ elbow [rad]", "θ' shoulder [rad/s]", "θ' elbow [rad/s]")

    @property
    def tension_slice(self) -> slice:
        """Where muscle tensions lie in the robot state: nowhere, so that the second term of eq. (8) is left out."""
        return slice(0, 0)

    def add_to(self, spec: mujoco.MjSpec) -> tuple[mujoco.MjsBody, np.ndarray]:
        """Build the arm into a scene.

        Returns:
            The hand's body, and its position in the world when every joint is at zero `[3]` [m].
        """
        position, parent = SHOULDER_POSITION, spec.worldbody
        for i, joint in enumerate(JOINTS):
            body = parent.add_body(name=joint, pos=SHOULDER_POSITION if i == 0 else [self.link_length, 0, 0])
            body.add_joint(
                name=joint,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, 1, 0],
                damping=[self.hinge_damping, 0, 0],
                limited=True,
                range=np.rad2deg([self.lower[i] - 0.3, self.upper[i] + 0.3]),
            )
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0, 0, 0, self.link_length, 0, 0],
                size=[0.035 - 0.008 * i, 0, 0],
                mass=self.link_masses[i],
                rgba=SKIN_RGBA,
                contype=0,
                conaffinity=0,
            )
            servo = spec.add_actuator(
                name=joint,
                target=joint,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                ctrllimited=True,
                ctrlrange=[self.lower[i], self.upper[i]],
            )
            servo.set_to_position(kp=self.servo_stiffness[i], kv=self.servo_damping[i])
            parent, position = body, position + np.array([self.link_length, 0, 0])
        return _add_hand(parent, [self.link_length, 0, 0], self.bar_length), position

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData, u: np.ndarray) -> None:
        """Put the joints where `u` `[D_u]` [rad] wants them, at rest."""
        for i, joint in enumerate(JOINTS):
            data.joint(joint).qpos[0] = u[i]
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        """Send the command `u` `[D_u]` [rad] to the servos."""
        for i, joint in enumerate(JOINTS):
            data.actuator(joint).ctrl[0] = u[i]

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles and velocities, `[D_r]` [rad] [rad/s]."""
        joints = [data.joint(joint) for joint in JOINTS]
        return np.array([joint.qpos[0] for joint in joints] + [joint.qvel[0] for joint in joints])


ARMS = {"torque": TorqueArm()}


def get_arm(name: str) -> TorqueArm:
    """Return the arm of that name.

    Raises:
        KeyError: unknown name; the message lists the choices.
    """
    return choose("arm", name, ARMS)


def check_command(arm: TorqueArm, u: np.ndarray) -> np.ndarray:
    """Return `u` as float64 `[D_u]`.

    Raises:
        ValueError: wrong shape, not finite, or outside the arm's range by more than rounding.
    """
    u = np.asarray(u, dtype=np.float64)
    lower, upper = arm.command_lower, arm.command_upper
    if u.shape != lower.shape:
        raise ValueError(f"a command of the {arm.name} arm has shape {lower.shape}, got {u.shape}")
    if not np.isfinite(u).all():
        raise ValueError(f"a command must be finite, got {u}")
    if ((u < lower - 1e-6) | (u > upper + 1e-6)).any():
        raise ValueError(f"command {u} is outside the {arm.name} arm's range {lower} to {upper}; use numpy.clip")
    return np.clip(u, lower, upper)


def _add_hand(parent: mujoco.MjsBody, position, bar_length: float) -> mujoco.MjsBody:
    """A hand with a bar across, to which the first row of the cloth is tied."""
    hand = parent.add_body(name="hand", pos=position)
    hand.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, -bar_length / 2, 0, 0, bar_length / 2, 0],
        size=[0.008, 0, 0],
        mass=0.05,
        rgba=(0.2, 0.2, 0.2, 1),
        contype=0,
        conaffinity=0,
    )
    hand.add_site(name="hand", size=[0.001, 0, 0], group=4)
    return hand
