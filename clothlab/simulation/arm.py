"""Robot arms: their MuJoCo elements, how a command reaches the actuators, and what the
robot senses of itself.

Code above this module never asks which `Arm` it has: an arm says how large its command
and its robot state are, where angles, tensions and stiffness lie in them, and where the
camera stands.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, NoReturn, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from clothlab._files import OtherKindError
from clothlab._validation import Checked, check_array, check_number, choose, setting
from clothlab.simulation.muscle import MUSCLES, Muscles

JOINTS = ("shoulder", "elbow")
SHOULDER_POSITION = np.array([0.0, 0.0, 1.0])  # [m]
BAR_RADIUS = 0.008  # [m]
_SKIN_RGBA = (0.75, 0.76, 0.78, 1.0)
_BAR_RGBA = (0.2, 0.2, 0.2, 1.0)


@dataclass(frozen=True)
class Camera(Checked):
    """Where the camera stands and what it looks at."""

    position: tuple[float, float, float] = setting(unit="m")
    target: tuple[float, float, float] = setting(unit="m")
    fovy: float = setting(unit="degree", above=0, at_most=170)  # vertical field of view
    # Turn about the line of sight; positive turns the picture clockwise
    roll: float = setting(0.0, "degree")

    @property
    def axes(self) -> np.ndarray:
        """What is right, up and backward for the camera, in the world: rows of `[3,
        3]`.
        """
        backward = np.subtract(self.position, self.target)
        backward /= np.linalg.norm(backward)
        right = np.cross([0.0, 0.0, 1.0], backward)
        right /= np.linalg.norm(right)
        level = np.array([right, np.cross(backward, right), backward])
        return _turned((0.0, 0.0, self.roll)) @ level

    def moved(
        self, shift: ArrayLike = (0, 0, 0), turn: ArrayLike = (0, 0, 0)
    ) -> "Camera":
        """The same camera elsewhere: shifted to its right, upward and backward `[3]`
        [m], and turned.

        `turn` is a rotation vector about these axes `[3]` [degree]: up (pitch), left
        (yaw), counterclockwise (roll).
        """
        shift, turn = check_array("shift", shift, (3,)), check_array("turn", turn, (3,))
        axes = _turned(turn) @ self.axes
        position = np.add(self.position, shift @ self.axes)
        target = position - axes[2] * np.linalg.norm(
            np.subtract(self.position, self.target)
        )
        if abs(axes[2, 2]) > 0.999:
            raise ValueError(
                "a camera that looks straight up or down has no upright picture"
            )
        level = replace(
            self,
            position=tuple(position.tolist()),
            target=tuple(target.tolist()),
            roll=0.0,
        )
        right, up, _ = level.axes
        return replace(
            level, roll=float(np.rad2deg(np.arctan2(axes[0] @ up, axes[0] @ right)))
        )


def _turned(turn: ArrayLike) -> np.ndarray:
    """Axes `[3, 3]`, one in a row, turned by a rotation vector `[3]` [degree] in their
    own frame.
    """
    return Rotation.from_rotvec(turn, degrees=True).as_matrix().T


@dataclass(frozen=True)
class StateLayout:
    """Where things lie in the state `s = (z, robot state)` of an arm."""

    names: tuple[str, ...]  # what each number of `s` is, with its unit
    z: slice  # the latent image
    robot: slice  # the robot state
    tensions: slice  # the muscle tensions [N]; empty for an arm without muscles

    @property
    def size(self) -> int:
        """D_s."""
        return len(self.names)


@dataclass(frozen=True, kw_only=True)
class Arm(Checked, ABC):
    """Two links that move in the sagittal plane by shoulder and elbow pitch, with a bar
    in the hand for the cloth.

    Angles are positive downwards and zero when the arm is stretched out horizontally.
    The paper gives no dimensions; these are this project's.
    """

    name: str
    camera: Camera
    link_length: float = setting(0.30, "m", above=0)  # upper arm and forearm each
    link_masses: tuple[float, float] = setting(unit="kg", above=0)
    hinge_damping: float = setting(unit="N m s/rad", at_least=0)
    lower: tuple[float, float] = setting((-0.8, -1.6), "rad")  # θ_ref: shoulder, elbow
    upper: tuple[float, float] = setting((1.0, 0.0), "rad")
    # Stretched, lowered a little: a scene starts here
    home: tuple[float, float] = setting((0.4, -0.4), "rad")
    # From the range of θ_ref to the joint's stops
    stop_margin: float = setting(0.3, "rad", at_least=0)
    # The rod in the hand that holds the cloth
    bar_length: float = setting(0.44, "m", above=0)

    # What each number of `u` is, with its unit
    command_names: ClassVar[tuple[str, ...]]
    # What each number of the robot state is, with its unit
    state_names: ClassVar[tuple[str, ...]]
    tensions = slice(0, 0)  # where the muscle tensions [N] lie in the robot state
    # Where the joint angles [rad] lie in the robot state, if they are sensed
    sensed_angles = slice(0, 0)
    angle_command = slice(0, len(JOINTS))  # where θ_ref lies in `u`
    # Where f_const [N] lies in `u`, if there is one
    stiffness_command = slice(len(JOINTS), len(JOINTS))
    closed_command = slice(
        0,
        0,
        # Where it lies in `u` for how much of the period the hand is closed, if it can
        # open
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(
            a <= b <= c
            for a, b, c in zip(self.lower, self.home, self.upper, strict=True)
        ):
            raise ValueError(
                f"{self.home} is not from {self.lower} to {self.upper}: home, lower and upper of an arm"
            )

    @property
    def has_stiffness(self) -> bool:
        """Whether the arm takes a stiffness command."""
        return self.stiffness_command.stop > self.stiffness_command.start

    def with_stiffness(self, f_const: float) -> Self:
        """The same arm with its stiffness command fixed at `f_const` [N]."""
        raise ValueError(f"the {self.name} arm has no stiffness to set")

    def layout(self, latent_size: int) -> StateLayout:
        """Where things lie in `s`, for a z of `latent_size` numbers."""
        names = (*(f"z{n + 1} [s.d.]" for n in range(latent_size)), *self.state_names)
        tensions = slice(
            self.tensions.start + latent_size, self.tensions.stop + latent_size
        )
        return StateLayout(
            names, slice(0, latent_size), slice(latent_size, len(names)), tensions
        )

    @property
    def _beyond_angles(self) -> list[tuple[float, float, float]]:
        """Lower bound, home and upper bound of the commands after θ_ref."""
        return []

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest command, `[D_u]`."""
        return np.array([*self.lower, *(lower for lower, _, _ in self._beyond_angles)])

    @property
    def home_command(self) -> np.ndarray:
        """The command that a scene starts with, `[D_u]`: the cloth hangs in front of
        the camera.
        """
        return np.array([*self.home, *(home for _, home, _ in self._beyond_angles)])

    @property
    def command_upper(self) -> np.ndarray:
        """Largest command, `[D_u]`."""
        return np.array([*self.upper, *(upper for _, _, upper in self._beyond_angles)])

    @abstractmethod
    def reset(self, data: mujoco.MjData, u: np.ndarray) -> None:
        """Put joints and actuators where `u` `[D_u]` wants them, at rest."""

    @abstractmethod
    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        """Send the command `u` `[D_u]` to the actuators."""

    @abstractmethod
    def state(self, data: mujoco.MjData) -> np.ndarray:
        """What the robot's own sensors say, `[D_r]`."""

    @abstractmethod
    def _add_actuators(self, spec: mujoco.MjSpec) -> None: ...

    def add_to(
        self, spec: mujoco.MjSpec, parent: mujoco.MjsBody | None = None
    ) -> tuple[mujoco.MjsBody, np.ndarray]:
        """Add the arm to a scene, on a body at the world's origin or on the world
        itself.

        Returns the hand's body, and its position in the world when every joint is at
        zero `[3]` [m].
        """
        parent = spec.worldbody if parent is None else parent
        for i, joint in enumerate(JOINTS):
            body = parent.add_body(
                name=joint,
                pos=SHOULDER_POSITION if i == 0 else [self.link_length, 0, 0],
            )
            body.add_joint(
                name=joint,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, 1, 0],
                damping=[self.hinge_damping, 0, 0],
                limited=True,
                range=np.rad2deg(
                    [self.lower[i] - self.stop_margin, self.upper[i] + self.stop_margin]
                ),
            )
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0, 0, 0, self.link_length, 0, 0],
                size=[0.035 - 0.008 * i, 0, 0],
                mass=self.link_masses[i],
                rgba=_SKIN_RGBA,
                contype=0,
                conaffinity=0,
            )
            parent = body
        self._add_actuators(spec)
        hand = parent.add_body(name="hand", pos=[self.link_length, 0, 0])
        hand.add_geom(  # the bar across, to which the first row of the cloth is tied
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0, -self.bar_length / 2, 0, 0, self.bar_length / 2, 0],
            size=[BAR_RADIUS, 0, 0],
            mass=0.05,
            rgba=_BAR_RGBA,
            contype=0,
            conaffinity=0,
        )
        hand.add_site(name="hand", size=[0.001, 0, 0], group=4)
        return hand, SHOULDER_POSITION + np.array([2 * self.link_length, 0, 0])

    def felt_angles(self, robot: ArrayLike) -> np.ndarray:
        """Joint angles θ `[..., 2]` [rad] that follow from the robot state `[...,
        D_r]`.
        """
        return np.asarray(robot)[..., self.sensed_angles]

    def angles(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles θ, `[2]` [rad].

        A muscle arm does not sense them; figures show them.
        """
        return np.array([data.joint(joint).qpos[0] for joint in JOINTS])

    def hand(self, theta: ArrayLike) -> np.ndarray:
        """Where the hand is from the shoulder, (forward, up) `[2]` [m], for joint
        angles θ `[2]` [rad].
        """
        reach = np.cumsum(check_array("theta", theta, (len(JOINTS),)))
        return self.link_length * np.array([np.cos(reach).sum(), -np.sin(reach).sum()])

    def hand_jacobian(self, theta: ArrayLike) -> np.ndarray:
        """∂hand/∂θ, `[2, 2]` [m/rad], at joint angles θ `[2]` [rad]."""
        reach = np.cumsum(check_array("theta", theta, (len(JOINTS),)))
        columns = [
            [-np.sin(reach[j:]).sum(), -np.cos(reach[j:]).sum()] for j in range(2)
        ]
        return self.link_length * np.array(columns).T


@dataclass(frozen=True, kw_only=True)
class TorqueArm(Arm):
    """The paper's simulated arm: position servos.

    `u = θ_ref`; the robot state is joint angles and velocities.
    """

    name: str = "torque"
    camera: Camera = Camera(
        position=(1.35, -1.35, 1.75), target=(0.42, 0.0, 0.93), fovy=39.0
    )
    link_masses: tuple[float, float] = setting((1.0, 0.7), "kg", above=0)
    hinge_damping: float = setting(0.5, "N m s/rad", at_least=0)
    servo_stiffness: tuple[float, float] = setting((120.0, 60.0), "N m/rad", above=0)
    servo_damping: tuple[float, float] = setting((8.0, 4.0), "N m s/rad", at_least=0)

    command_names = ("θ_ref shoulder [rad]", "θ_ref elbow [rad]")
    state_names: ClassVar[tuple[str, ...]] = (
        "θ shoulder [rad]",
        "θ elbow [rad]",
        "θ' shoulder [rad/s]",
        "θ' elbow [rad/s]",
    )
    sensed_angles = slice(0, len(JOINTS))

    def _add_actuators(self, spec: mujoco.MjSpec) -> None:
        for i, joint in enumerate(JOINTS):
            servo = spec.add_actuator(
                name=joint,
                target=joint,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                ctrllimited=True,
                ctrlrange=[self.lower[i], self.upper[i]],
            )
            servo.set_to_position(kp=self.servo_stiffness[i], kv=self.servo_damping[i])

    def reset(self, data: mujoco.MjData, u: np.ndarray) -> None:
        for joint, angle in zip(JOINTS, u, strict=True):
            data.joint(joint).qpos[0] = angle
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        for joint, angle in zip(JOINTS, u, strict=True):
            data.actuator(joint).ctrl[0] = angle

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles and velocities, `[4]` [rad] [rad/s]."""
        return np.concatenate(
            [self.angles(data), [data.joint(joint).qvel[0] for joint in JOINTS]]
        )


@dataclass(frozen=True, kw_only=True)
class MuscleArm(Muscles, Arm):
    """An arm pulled by six muscles: `u = (θ_ref [2], f_const)`.

    It senses tensions and muscle lengths only.
    """

    name: str = "muscle"
    # At the robot's head, to the right of its left arm.
    camera: Camera = Camera(
        position=(-0.05, -0.25, 1.45), target=(0.50, 0.0, 0.90), fovy=75.0
    )
    link_masses: tuple[float, float] = setting((1.3, 1.2), "kg", above=0)
    hinge_damping: float = setting(1.0, "N m s/rad", at_least=0)
    # Wide, because a soft arm sags
    stop_margin: float = setting(0.6, "rad", at_least=0)
    # f_const at the start, where the range allows it
    home_tension: float = setting(30.0, "N", above=0)

    command_names: ClassVar[tuple[str, ...]] = (*TorqueArm.command_names, "f_const [N]")
    state_names = (
        *(f"f {name} [N]" for name in MUSCLES),
        *(f"l {name} [m]" for name in MUSCLES),
    )
    tensions = slice(0, len(MUSCLES))
    stiffness_command = slice(len(JOINTS), len(JOINTS) + 1)

    def with_stiffness(self, f_const: float) -> Self:
        u = self.home_command
        u[self.stiffness_command] = check_number("f_const", f_const)
        check_command(self, u)
        return replace(self, tension_range=(f_const, f_const))

    @property
    def _beyond_angles(self) -> list[tuple[float, float, float]]:
        low, high = self.tension_range
        return [(low, min(max(self.home_tension, low), high), high)]

    def _add_actuators(self, spec: mujoco.MjSpec) -> None:
        inputs = int(mujoco.mjtCtrlInput.mjINPUT_POS) | int(
            mujoco.mjtCtrlInput.mjINPUT_FF
        )
        # a scene may have a place for them among its coordinates
        rotors = spec.body("rotors") or spec.worldbody
        for name, arms in zip(MUSCLES, self.moment_arms, strict=True):
            rotor = rotors.add_body(
                name=name, mass=1e-3, inertia=[1e-6] * 3, explicitinertial=True
            )
            rotor.add_joint(
                name=name,
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[0, 1, 0],  # level, so that the rotor has no weight
                armature=self.rotor_mass,
            )
            tendon = spec.add_tendon(
                name=name,
                springlength=[-9, 0],  # slack at any length below zero
                stiffness=[self.spring_linear, 0, self.spring_cubic],
            )
            for joint, coefficient in ((name, 1.0), *zip(JOINTS, arms, strict=True)):
                if coefficient:
                    tendon.wrap_joint(joint, coefficient)
            motor = spec.add_actuator(
                name=name,
                target=name,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                forcelimited=True,
                forcerange=[self.tension_bias, self.tension_max],
            )
            motor.set_to_pid(
                kp=self.motor_stiffness,
                kv=self.motor_damping,
                slewmax=self.motor_speed,
                ctrlspec=inputs,
            )

    def reset(self, data: mujoco.MjData, u: np.ndarray) -> None:
        theta, f_const = u[:2], u[2]
        for joint, angle in zip(JOINTS, theta, strict=True):
            data.joint(joint).qpos[0] = angle
        lengths = self.body_image(theta, np.full(len(MUSCLES), f_const))
        for name, length, sent in zip(
            MUSCLES, lengths, self.sent_length(u), strict=True
        ):
            data.joint(name).qpos[0] = -length
            # The set-point that the speed limit moves is a state of its own: left at
            # zero, it would jerk the arm.
            data.act[data.model.actuator(name).actadr[0]] = -sent
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        for name, length in zip(MUSCLES, self.sent_length(u), strict=True):
            data.actuator(name).ctrl[:] = -length, self.tension_bias

    def felt_angles(self, robot: ArrayLike) -> np.ndarray:
        f, lengths = np.split(np.asarray(robot), 2, axis=-1)
        # The body image, read backwards, by least squares over the muscles that pull: a
        # slack one says nothing.
        taut = (f > 0).astype(np.float64)
        squares = np.einsum(
            "mi,...m,mj->...ij", self.moment_arms, taut, self.moment_arms
        )
        sums = np.einsum(
            "mi,...m->...i", self.moment_arms, taut * (lengths + self.elongation(f))
        )
        return np.einsum("...ij,...j->...i", np.linalg.pinv(squares), sums)

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Tensions f and muscle lengths l, `[12]` [N] [m]."""
        f = self.tension(np.array([data.tendon(name).length[0] for name in MUSCLES]))
        return np.concatenate([f, [-data.joint(name).qpos[0] for name in MUSCLES]])


@dataclass(frozen=True, kw_only=True)
class GripperArm(MuscleArm):
    """The muscle arm with a gripper: one more number in `u` says for how much of the
    control period it is closed.

    A throw is a plan that ends in 1, …, 1, 0.4, 0, …, 0: the gripper lets go after 0.4
    of a period.
    """

    name: str = "muscle-hand"

    command_names = (*MuscleArm.command_names, "hand closed [period]")
    closed_command = slice(
        len(MuscleArm.command_names), len(MuscleArm.command_names) + 1
    )

    @property
    def _beyond_angles(self) -> list[tuple[float, float, float]]:
        return [*super()._beyond_angles, (0.0, 1.0, 1.0)]


ARMS: dict[str, Arm] = {
    arm.name: arm for arm in (TorqueArm(), MuscleArm(), GripperArm())
}


def get_arm(arm: Arm | str) -> Arm:
    """Return the arm of that name; an arm is returned as it is."""
    return arm if isinstance(arm, Arm) else choose("arm", arm, ARMS)


def arm_data(arm: Arm) -> str | dict[str, Any]:
    """Return what a file says of an arm: the name of one of `ARMS`, else the class and
    every number.

    So a changed arm is read as itself, even where it has kept its name.
    """
    if ARMS.get(arm.name) == arm:
        return arm.name
    return {"class": type(arm).__name__, **asdict(arm)}


def arm_from_data(data: str | dict[str, Any]) -> Arm:
    """Return the arm of which a file says this; an `OtherKindError` if no class of arms
    fits it.
    """
    if isinstance(data, str):
        return get_arm(data) if data in ARMS else _refuse(f"arm {data!r}", ARMS)
    fields = dict(data)
    name = fields.pop("class")
    kinds = {kind.__name__: kind for kind in _kinds()}
    if name not in kinds:
        _refuse(f"class of arms {name!r}", kinds)
    fields["camera"] = Camera(**fields["camera"])
    return kinds[name](**fields)


def _refuse(what: str, known: Iterable[str]) -> NoReturn:
    raise OtherKindError(
        f"its {what} is unknown; known are {', '.join(known)}. Import yours before reading the file"
    )


def _kinds(parent: type = Arm) -> Iterator[type]:
    """Every class of arms that is defined at this moment."""
    child: type
    for child in parent.__subclasses__():
        yield child
        yield from _kinds(child)


def check_command(arm: Arm, u: ArrayLike) -> np.ndarray:
    """Return a copy of `u` as float64 `[D_u]`; a ValueError if it is outside the arm's
    range by more than rounding.
    """
    lower, upper = arm.command_lower, arm.command_upper
    u = check_array(f"a command of the {arm.name} arm", u, lower.shape)
    nearest = u.clip(lower, upper)
    if np.abs(u - nearest).max() > 1e-6:
        raise ValueError(
            f"command {u} is outside the {arm.name} arm's range {lower} to {upper}; use numpy.clip"
        )
    return nearest
