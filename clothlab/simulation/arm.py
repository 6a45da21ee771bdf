"""Robot arms: their MuJoCo elements, their actuators, and what they sense.

Code above this module never asks which `Arm` it has: an arm says how large its command
and its robot state are, where angles, tensions and stiffness lie in them, and where the
camera stands.
"""

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_number, choose
from clothlab.simulation.muscle import MUSCLES, Muscles

JOINTS = ("shoulder", "elbow")
SHOULDER_POSITION = np.array([0.0, 0.0, 1.0])  # [m]
BAR_RADIUS = 0.008  # [m] of the bar in the hand
_ANGLES = ("θ_ref shoulder [rad]", "θ_ref elbow [rad]")
_SKIN_RGBA = (0.75, 0.76, 0.78, 1.0)
_BAR_RGBA = (0.2, 0.2, 0.2, 1.0)


@dataclass(frozen=True)
class Camera:
    """Where the camera stands and what it looks at."""

    position: tuple[float, float, float]  # [m]
    target: tuple[float, float, float]  # [m]
    fovy: float  # [degree] vertical field of view

    @property
    def axes(self) -> np.ndarray:
        """What is right, up and backward for the camera: the rows of `[3, 3]`."""
        backward = np.subtract(self.position, self.target)
        backward /= np.linalg.norm(backward)
        right = np.cross([0.0, 0.0, 1.0], backward)
        right /= np.linalg.norm(right)
        up = np.cross(backward, right)
        return np.array([right, up, backward])


@dataclass(frozen=True)
class StateLayout:
    """Where things lie in the state `s = (z, robot state)` of an arm."""

    names: tuple[str, ...]  # what each number of `s` is, with its unit
    z: slice  # the latent image
    tensions: slice  # the muscle tensions [N]; empty for an arm without muscles

    @property
    def size(self) -> int:
        """D_s."""
        return len(self.names)


@dataclass(frozen=True, kw_only=True, repr=False)
class Arm(ABC):
    """Two links in the sagittal plane, with a bar in the hand for the cloth.

    They move by shoulder and elbow pitch. Angles are positive downwards, and zero when
    the arm is stretched out horizontally. The paper gives no dimensions; these are this
    project's.
    """

    name: str
    camera: Camera
    link_length: float = 0.30  # [m] upper arm and forearm each
    link_masses: tuple[float, float]  # [kg]
    hinge_damping: float  # [N m s/rad]
    lower: tuple[float, float] = (-0.8, -1.6)  # [rad] θ_ref: shoulder, elbow
    upper: tuple[float, float] = (1.0, 0.0)  # [rad]
    # Stretched, lowered a little: a scene starts here
    home: tuple[float, float] = (0.4, -0.4)  # [rad]
    # From the range of θ_ref to the joint's stops
    stop_margin: float = 0.3  # [rad]
    # The rod in the hand that holds the cloth
    bar_length: float = 0.44  # [m]

    # Whether the hand opens on command. One more number in `u` then says for how much
    # of the control period it is closed. A throw is a plan that ends in
    # 1, …, 1, 0.4, 0, …, 0: it lets go after 0.4 of a period.
    gripper: bool = False

    # What each number of the robot state is, with its unit
    state_names: ClassVar[tuple[str, ...]]

    # Where the muscles' tensions [N] lie in the robot state; empty without muscles
    tensions = slice(0, 0)
    # Where θ_ref lies in `u` [rad]
    angle_command = slice(0, len(JOINTS))

    def __post_init__(self) -> None:
        for low, home, high in zip(self.lower, self.home, self.upper, strict=True):
            if not low <= home <= high:
                raise ValueError(
                    f"{self.home} is not from {self.lower} to {self.upper}: home, "
                    "lower and upper of an arm"
                )

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, ...)"

    def with_stiffness(self, f_const: float) -> Self:
        """The same arm with its stiffness command fixed at `f_const` [N]."""
        raise ValueError(f"the {self.name} arm has no stiffness to set")

    def layout(self, latent_size: int) -> StateLayout:
        """Where things lie in `s`, for a z of `latent_size` numbers."""
        z_names = [f"z{n + 1} [s.d.]" for n in range(latent_size)]
        names = (*z_names, *self.state_names)
        first = latent_size + self.tensions.start
        last = latent_size + self.tensions.stop
        return StateLayout(names, z=slice(0, latent_size), tensions=slice(first, last))

    @property
    def _stiffness_ranges(self) -> dict[str, tuple[float, float, float]]:
        """The part of `_ranges` that commands stiffness; none without muscles."""
        return {}

    @property
    def _ranges(self) -> dict[str, tuple[float, float, float]]:
        """Lower bound, home and upper bound of each number in `u`, by its name."""
        angles = zip(self.lower, self.home, self.upper, strict=True)
        ranges = dict(zip(_ANGLES, angles, strict=True)) | self._stiffness_ranges
        if self.gripper:
            ranges["hand closed [period]"] = (0.0, 1.0, 1.0)
        return ranges

    @property
    def command_names(self) -> tuple[str, ...]:
        """What each number in `u` is, with its unit."""
        return tuple(self._ranges)

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest command, `[D_u]`."""
        return np.array([lower for lower, _, _ in self._ranges.values()])

    @property
    def home_command(self) -> np.ndarray:
        """The command that a scene starts with, `[D_u]`.

        The cloth then hangs in front of the camera.
        """
        return np.array([home for _, home, _ in self._ranges.values()])

    @property
    def command_upper(self) -> np.ndarray:
        """Largest command, `[D_u]`."""
        return np.array([upper for _, _, upper in self._ranges.values()])

    @property
    def has_stiffness(self) -> bool:
        """Whether the arm takes a stiffness command."""
        return bool(self._stiffness_ranges)

    @property
    def stiffness_command(self) -> slice:
        """Where f_const [N] lies in `u`; empty where it cannot be commanded."""
        return slice(len(JOINTS), len(JOINTS) + len(self._stiffness_ranges))

    @property
    def closed_command(self) -> slice:
        """Where in `u` the hand is closed [period]; empty where it always is."""
        first = self.stiffness_command.stop
        return slice(first, first + int(self.gripper))

    def check_command(self, u: ArrayLike) -> np.ndarray:
        """Return a copy of `u` as float64 `[D_u]`, moved into the arm's range.

        A ValueError if it is outside the range by more than rounding.
        """
        lower = self.command_lower
        upper = self.command_upper
        u = check_array(f"a command of the {self.name} arm", u, lower.shape)
        nearest = u.clip(lower, upper)
        if np.abs(u - nearest).max() > 1e-6:
            raise ValueError(
                f"command {u} is outside the {self.name} arm's range {lower} to "
                f"{upper}; use numpy.clip"
            )
        return nearest

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
    def estimate_angles(self, robot: ArrayLike) -> np.ndarray:
        """Joint angles θ `[..., 2]` [rad], as they follow from `robot` `[..., D_r]`."""

    @abstractmethod
    def _add_actuators(self, spec: mujoco.MjSpec) -> None: ...

    def add_to(
        self, spec: mujoco.MjSpec, parent: mujoco.MjsBody | None = None
    ) -> tuple[mujoco.MjsBody, np.ndarray]:
        """Add the arm to a scene, on a body at the world's origin or on the world.

        Returns the hand's body, and its position in the world when every joint is at
        zero `[3]` [m].
        """
        forearm = self._add_links(spec.worldbody if parent is None else parent)
        self._add_actuators(spec)

        # The hand, with the bar across, to which the first row of the cloth is tied
        hand = forearm.add_body(name="hand", pos=[self.link_length, 0, 0])
        hand.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0, -self.bar_length / 2, 0, 0, self.bar_length / 2, 0],
            size=[BAR_RADIUS, 0, 0],
            mass=0.05,
            rgba=_BAR_RGBA,
            contype=0,
            conaffinity=0,
        )
        hand.add_site(name="hand", size=[0.001, 0, 0], group=4)
        stretched = np.array([2 * self.link_length, 0, 0])
        return hand, SHOULDER_POSITION + stretched

    def _add_links(self, parent: mujoco.MjsBody) -> mujoco.MjsBody:
        """Add upper arm and forearm, each with the joint at its near end."""
        for i, joint in enumerate(JOINTS):
            # Where the link begins, and how far it turns
            begins = SHOULDER_POSITION if i == 0 else [self.link_length, 0, 0]
            lowest = self.lower[i] - self.stop_margin
            highest = self.upper[i] + self.stop_margin
            body = parent.add_body(name=joint, pos=begins)
            body.add_joint(
                name=joint,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, 1, 0],
                damping=[self.hinge_damping, 0, 0],
                limited=True,
                range=np.rad2deg([lowest, highest]),
            )

            # The link itself, which touches nothing
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
        return parent

    def angles(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles θ, `[2]` [rad].

        A muscle arm does not sense them; figures show them.
        """
        return np.array([data.joint(joint).qpos[0] for joint in JOINTS])

    def hand(self, theta: ArrayLike) -> np.ndarray:
        """Where the hand is from the shoulder, (forward, up) `[2]` [m].

        The joint angles θ are `[2]` [rad].
        """
        slopes = np.cumsum(check_array("theta", theta, (len(JOINTS),)))
        forward = np.cos(slopes).sum()
        up = -np.sin(slopes).sum()
        return self.link_length * np.array([forward, up])

    def hand_jacobian(self, theta: ArrayLike) -> np.ndarray:
        """∂hand/∂θ, `[2, 2]` [m/rad], at joint angles θ `[2]` [rad]."""
        slopes = np.cumsum(check_array("theta", theta, (len(JOINTS),)))
        columns = []
        for j in range(len(JOINTS)):
            moved = slopes[j:]  # of the links that this joint moves
            columns.append([-np.sin(moved).sum(), -np.cos(moved).sum()])
        return self.link_length * np.array(columns).T


@dataclass(frozen=True, kw_only=True, repr=False)
class TorqueArm(Arm):
    """The paper's simulated arm: position servos.

    `u = θ_ref`; the robot state is joint angles and velocities.
    """

    name: str = "torque"
    camera: Camera = Camera(
        position=(1.35, -1.35, 1.75), target=(0.42, 0.0, 0.93), fovy=39.0
    )
    link_masses: tuple[float, float] = (1.0, 0.7)  # [kg]
    hinge_damping: float = 0.5  # [N m s/rad]
    servo_stiffness: tuple[float, float] = (120.0, 60.0)  # [N m/rad]
    servo_damping: tuple[float, float] = (8.0, 4.0)  # [N m s/rad]

    state_names = (
        "θ shoulder [rad]",
        "θ elbow [rad]",
        "θ' shoulder [rad/s]",
        "θ' elbow [rad/s]",
    )

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
        for joint, angle in zip(JOINTS, u[self.angle_command], strict=True):
            data.joint(joint).qpos[0] = angle
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        for joint, angle in zip(JOINTS, u[self.angle_command], strict=True):
            data.actuator(joint).ctrl[0] = angle

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles and velocities, `[4]` [rad] [rad/s]."""
        velocities = [data.joint(joint).qvel[0] for joint in JOINTS]
        return np.concatenate([self.angles(data), velocities])

    def estimate_angles(self, robot: ArrayLike) -> np.ndarray:
        return np.asarray(robot)[..., : len(JOINTS)]


@dataclass(frozen=True, kw_only=True, repr=False)
class MuscleArm(Arm, Muscles):
    """An arm pulled by six muscles: `u = (θ_ref [2], f_const)`.

    It senses tensions and muscle lengths only.
    """

    name: str = "muscle"
    # At the robot's head, to the right of its left arm.
    camera: Camera = Camera(
        position=(-0.05, -0.25, 1.45), target=(0.50, 0.0, 0.90), fovy=75.0
    )
    link_masses: tuple[float, float] = (1.3, 1.2)  # [kg]
    hinge_damping: float = 1.0  # [N m s/rad]
    # Wide, because a soft arm sags
    stop_margin: float = 0.6  # [rad]
    # f_const at the start, where the range allows it
    home_tension: float = 30.0  # [N]

    state_names = (
        *(f"f {name} [N]" for name in MUSCLES),
        *(f"l {name} [m]" for name in MUSCLES),
    )
    tensions = slice(0, len(MUSCLES))

    def __post_init__(self) -> None:
        Arm.__post_init__(self)
        Muscles.__post_init__(self)

    def with_stiffness(self, f_const: float) -> Self:
        u = self.home_command
        f_const = check_number("f_const", f_const)
        u[self.stiffness_command] = f_const
        self.check_command(u)
        return replace(self, tension_range=(f_const, f_const))

    @property
    def _stiffness_ranges(self) -> dict[str, tuple[float, float, float]]:
        low, high = self.tension_range
        home = min(max(self.home_tension, low), high)
        return {"f_const [N]": (low, home, high)}

    def _add_actuators(self, spec: mujoco.MjSpec) -> None:
        # A scene may have a place for the rotors among its coordinates.
        rotors = spec.body("rotors") or spec.worldbody
        for name, arms in zip(MUSCLES, self.moment_arms, strict=True):
            self._add_motor(spec, rotors, name)
            self._add_spring(spec, name, arms)

    def _add_motor(
        self, spec: mujoco.MjSpec, rotors: mujoco.MjsBody, name: str
    ) -> None:
        """Add the rotor of a motor, and the control that moves it."""
        rotor = rotors.add_body(
            name=name, mass=1e-3, inertia=[1e-6] * 3, explicitinertial=True
        )
        rotor.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0, 1, 0],  # level, so that the rotor has no weight
            armature=self.rotor_mass,
        )
        motor = spec.add_actuator(
            name=name,
            target=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            forcelimited=True,
            forcerange=[self.tension_bias, self.tension_max],
        )

        # It is sent a position, and a force in addition: f_bias.
        position = int(mujoco.mjtCtrlInput.mjINPUT_POS)
        force = int(mujoco.mjtCtrlInput.mjINPUT_FF)
        motor.set_to_pid(
            kp=self.motor_stiffness,
            kv=self.motor_damping,
            slewmax=self.motor_speed,
            ctrlspec=position | force,
        )

    def _add_spring(self, spec: mujoco.MjSpec, name: str, arms: np.ndarray) -> None:
        """Add the spring between a rotor and the joints, with its moment arms `[2]`."""
        tendon = spec.add_tendon(
            name=name,
            springlength=[-9, 0],  # slack at any length below zero
            stiffness=[self.spring_linear, 0, self.spring_cubic],
        )
        tendon.wrap_joint(name, 1.0)
        for joint, moment_arm in zip(JOINTS, arms, strict=True):
            if moment_arm:
                tendon.wrap_joint(joint, moment_arm)

    def reset(self, data: mujoco.MjData, u: np.ndarray) -> None:
        # The joints at θ_ref
        theta = u[:2]
        for joint, angle in zip(JOINTS, theta, strict=True):
            data.joint(joint).qpos[0] = angle

        # Each motor where its spring pulls with f_const. The set-point that the speed
        # limit moves is a state of its own: left at zero, it would jerk the arm.
        tension = np.full(len(MUSCLES), u[2])
        lengths = self.body_image(theta, tension)
        sent = self.sent_length(u)
        for k, name in enumerate(MUSCLES):
            data.joint(name).qpos[0] = -lengths[k]
            set_point = data.model.actuator(name).actadr[0]
            data.act[set_point] = -sent[k]
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        for name, length in zip(MUSCLES, self.sent_length(u), strict=True):
            data.actuator(name).ctrl[:] = -length, self.tension_bias

    def estimate_angles(self, robot: ArrayLike) -> np.ndarray:
        # The body image, read backwards, by least squares over the muscles that pull: a
        # slack one says nothing.
        f, lengths = np.split(np.asarray(robot), 2, axis=-1)
        taut = (f > 0).astype(np.float64)
        arms = self.moment_arms
        path = lengths + self.elongation(f)
        squares = np.einsum("mi,...m,mj->...ij", arms, taut, arms)
        sums = np.einsum("mi,...m->...i", arms, taut * path)
        return np.einsum("...ij,...j->...i", np.linalg.pinv(squares), sums)

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Tensions f and muscle lengths l, `[12]` [N] [m]."""
        stretch = [data.tendon(name).length[0] for name in MUSCLES]
        lengths = [-data.joint(name).qpos[0] for name in MUSCLES]
        return np.concatenate([self.tension(np.array(stretch)), lengths])


# To add an arm, add one here.
_ARMS = [TorqueArm(), MuscleArm(), MuscleArm(name="muscle-hand", gripper=True)]
ARMS: dict[str, Arm] = {arm.name: arm for arm in _ARMS}


def get_arm(arm: Arm | str) -> Arm:
    """Return the arm of that name; an arm is returned as it is."""
    return arm if isinstance(arm, Arm) else choose("arm", arm, ARMS)


def arm_data(arm: Arm) -> str | dict[str, Any]:
    """Return what a file says of an arm: its class and fields.

    One of `ARMS` is only named. A changed arm is written as what it is, even where it
    has kept its name.
    """
    if arm in ARMS.values():
        return arm.name
    return {"class": type(arm).__name__, **asdict(arm)}


def arm_from_data(data: str | dict[str, Any]) -> Arm:
    """Return the arm of which a file says this; a KeyError if it is unknown."""
    if isinstance(data, str):
        return get_arm(data)
    classes = {each.__name__: each for each in (TorqueArm, MuscleArm)}
    fields = _with_tuples(data)
    chosen = choose("class of arms", fields.pop("class"), classes)
    fields["camera"] = Camera(**_with_tuples(fields["camera"]))
    return chosen(**fields)


def _with_tuples(fields: dict[str, Any]) -> dict[str, Any]:
    """The same fields, with tuples for JSON's lists."""
    return {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in fields.items()
    }
