"""Robot arms: their MuJoCo elements, how a command reaches the actuators, and what the robot feels of itself.

Every arm is an `Arm`. Nothing above this module asks which one it is talking to: the sizes of the command and of the
robot state, which part of that state is muscle tension, and where the camera stands are the arm's to say.
"""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np
from scipy.optimize import root
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.preprocessing import StandardScaler

from clothlab._choices import choose

__all__ = [
    "ARMS",
    "Arm",
    "Camera",
    "MuscleArm",
    "TorqueArm",
    "check_command",
    "ellipse_area",
    "get_arm",
    "learn_body_image",
    "static_posture",
    "stiffness_ellipse",
]

JOINTS = ("shoulder", "elbow")
SHOULDER_POSITION = np.array([0.0, 0.0, 1.0])  # [m]
SKIN_RGBA = (0.75, 0.76, 0.78, 1.0)
SETTLING_TIME = 3.0  # [s], after which a pushed arm has come to rest


@dataclass(frozen=True)
class Camera:
    """Where the camera stands and what it looks at."""

    position: tuple[float, float, float] = field(metadata={"unit": "m"})
    target: tuple[float, float, float] = field(metadata={"unit": "m"})
    fovy: float = field(metadata={"unit": "degree"})  # vertical field of view


@dataclass(frozen=True, kw_only=True)
class Arm(ABC):
    """Two links that move in the sagittal plane by shoulder and elbow pitch, with a bar in the hand for the cloth.

    Angles are positive downwards and zero when the arm is stretched out horizontally. The paper gives no dimensions;
    these are this project's.
    """

    name: str = field(metadata={"unit": "-"})
    camera: Camera = field(metadata={"unit": "-"})
    link_length: float = field(default=0.30, metadata={"unit": "m"})  # upper arm and forearm each
    link_masses: tuple[float, float] = field(metadata={"unit": "kg"})
    hinge_damping: float = field(metadata={"unit": "N m s/rad"})
    lower: tuple[float, float] = field(default=(-0.8, -1.6), metadata={"unit": "rad"})  # θ_ref: shoulder, elbow
    upper: tuple[float, float] = field(default=(1.0, 0.0), metadata={"unit": "rad"})
    stop_margin: float = field(default=0.3, metadata={"unit": "rad"})  # from the range of θ_ref to the joint's stops
    bar_length: float = field(default=0.44, metadata={"unit": "m"})  # the rod in the hand that holds the cloth

    @property
    @abstractmethod
    def command_names(self) -> tuple[str, ...]:
        """What each number of `u` is, with its unit."""

    @property
    @abstractmethod
    def state_names(self) -> tuple[str, ...]:
        """What each number of the robot state is, with its unit."""

    @property
    @abstractmethod
    def tension_slice(self) -> slice:
        """Where the muscle tensions [N] lie in the robot state."""

    @property
    @abstractmethod
    def home_command(self) -> np.ndarray:
        """The command that a scene starts with, `[D_u]`: a stretched arm, lowered a little, the cloth hanging."""

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest command, `[D_u]`."""
        return np.array(self.lower)

    @property
    def command_upper(self) -> np.ndarray:
        """Largest command, `[D_u]`."""
        return np.array(self.upper)

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

    def add_to(self, spec: mujoco.MjSpec) -> tuple[mujoco.MjsBody, np.ndarray]:
        """Build the arm into a scene.

        Returns:
            The hand's body, and its position in the world when every joint is at zero `[3]` [m].
        """
        parent = spec.worldbody
        for i, joint in enumerate(JOINTS):
            body = parent.add_body(name=joint, pos=SHOULDER_POSITION if i == 0 else [self.link_length, 0, 0])
            body.add_joint(
                name=joint,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, 1, 0],
                damping=[self.hinge_damping, 0, 0],
                limited=True,
                range=np.rad2deg([self.lower[i] - self.stop_margin, self.upper[i] + self.stop_margin]),
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
            parent = body
        self._add_actuators(spec)
        hand = _add_hand(parent, [self.link_length, 0, 0], self.bar_length)
        return hand, SHOULDER_POSITION + np.array([2 * self.link_length, 0, 0])

    def angles(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles θ, `[2]` [rad]. A muscle arm does not sense them; figures show them all the same."""
        return np.array([data.joint(joint).qpos[0] for joint in JOINTS])

    def hand(self, theta: np.ndarray) -> np.ndarray:
        """Where the hand is from the shoulder, (forward, up) `[2]` [m], for joint angles θ `[2]` [rad]."""
        reach = np.cumsum(theta)
        return self.link_length * np.array([np.cos(reach).sum(), -np.sin(reach).sum()])

    def hand_jacobian(self, theta: np.ndarray) -> np.ndarray:
        """∂hand/∂θ, `[2, 2]` [m/rad]."""
        reach = np.cumsum(theta)
        columns = [[-np.sin(reach[j:]).sum(), -np.cos(reach[j:]).sum()] for j in range(2)]
        return self.link_length * np.array(columns).T


@dataclass(frozen=True, kw_only=True)
class TorqueArm(Arm):
    """The paper's simulated arm: position servos. `u = θ_ref`; the robot state is joint angles and velocities."""

    name: str = field(default="torque", metadata={"unit": "-"})
    camera: Camera = field(
        default=Camera(position=(1.35, -1.35, 1.75), target=(0.42, 0.0, 0.93), fovy=39.0), metadata={"unit": "-"}
    )
    link_masses: tuple[float, float] = field(default=(1.0, 0.7), metadata={"unit": "kg"})
    hinge_damping: float = field(default=0.5, metadata={"unit": "N m s/rad"})
    servo_stiffness: tuple[float, float] = field(default=(120.0, 60.0), metadata={"unit": "N m/rad"})
    servo_damping: tuple[float, float] = field(default=(8.0, 4.0), metadata={"unit": "N m s/rad"})

    @property
    def command_names(self) -> tuple[str, ...]:
        """What each number of `u` is, with its unit."""
        return ("θ_ref shoulder [rad]", "θ_ref elbow [rad]")

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each number of the robot state is, with its unit."""
        return ("θ shoulder [rad]", "θ elbow [rad]", "θ' shoulder [rad/s]", "θ' elbow [rad/s]")

    @property
    def tension_slice(self) -> slice:
        """Nowhere, so that the second term of eq. (8) is left out."""
        return slice(0, 0)

    @property
    def home_command(self) -> np.ndarray:
        """θ_ref at the start, `[2]` [rad]."""
        return np.array([0.4, -0.4])

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
        """Put the joints where `u` `[2]` [rad] wants them, at rest."""
        for joint, angle in zip(JOINTS, u, strict=True):
            data.joint(joint).qpos[0] = angle
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        """Send the command `u` `[2]` [rad] to the servos."""
        for joint, angle in zip(JOINTS, u, strict=True):
            data.actuator(joint).ctrl[0] = angle

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Joint angles and velocities, `[4]` [rad] [rad/s]."""
        return np.concatenate([self.angles(data), [data.joint(joint).qvel[0] for joint in JOINTS]])


MUSCLES = (
    "shoulder flexor",
    "shoulder extensor",
    "elbow flexor",
    "elbow extensor",
    "biarticular flexor",
    "biarticular extensor",
)


@dataclass(frozen=True, kw_only=True)
class MuscleArm(Arm):
    """An arm pulled by six muscles, each a motor in series with a nonlinear spring: `u = (θ_ref [2], f_const)`.

    A muscle's motor reels in `s` [m] of wire; its spring is stretched by `e = s + Gθ` [m], where G holds the moment
    arms (flexors, which raise, positive). The spring pulls with `f = k₁e + k₃e³` [N] and never pushes. The motor is
    under muscle stiffness control: `clip(f_bias + K (s_send - s) - D ds/dt, f_bias, f_max)`. All that the robot senses
    are tensions f and muscle lengths `l = -s`. The paper publishes none of these numbers: they are assumptions, and
    notebook 02 shows what hangs on them.
    """

    name: str = field(default="muscle", metadata={"unit": "-"})
    camera: Camera = field(  # at the robot's head, to the right of its left arm
        default=Camera(position=(-0.05, -0.25, 1.45), target=(0.50, 0.0, 0.90), fovy=75.0), metadata={"unit": "-"}
    )
    link_masses: tuple[float, float] = field(default=(1.3, 1.2), metadata={"unit": "kg"})
    hinge_damping: float = field(default=1.0, metadata={"unit": "N m s/rad"})
    stop_margin: float = field(default=0.6, metadata={"unit": "rad"})  # wide, because a soft arm sags
    shoulder_moment_arm: float = field(default=0.040, metadata={"unit": "m"})
    elbow_moment_arm: float = field(default=0.030, metadata={"unit": "m"})
    biarticular_moment_arms: tuple[float, float] = field(default=(0.030, 0.030), metadata={"unit": "m"})
    spring_linear: float = field(default=456.5, metadata={"unit": "N/m"})  # k₁
    spring_cubic: float = field(default=7.8e6, metadata={"unit": "N/m³"})  # k₃; 0 makes the linear-spring control
    motor_stiffness: float = field(default=3e4, metadata={"unit": "N/m"})  # K
    motor_damping: float = field(default=250.0, metadata={"unit": "N s/m"})  # D
    motor_speed: float = field(default=0.10, metadata={"unit": "m/s"})  # how fast s_send can move
    rotor_mass: float = field(default=4.0, metadata={"unit": "kg"})  # as felt along the wire
    tension_bias: float = field(default=2.0, metadata={"unit": "N"})  # f_bias, keeps the wire taut
    tension_max: float = field(default=250.0, metadata={"unit": "N"})  # f_max of the motor
    tension_range: tuple[float, float] = field(default=(10.0, 70.0), metadata={"unit": "N"})  # of f_const; the paper's

    @property
    def command_names(self) -> tuple[str, ...]:
        """What each number of `u` is, with its unit."""
        return ("θ_ref shoulder [rad]", "θ_ref elbow [rad]", "f_const [N]")

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each number of the robot state is, with its unit."""
        return (*(f"f {name} [N]" for name in MUSCLES), *(f"l {name} [m]" for name in MUSCLES))

    @property
    def tension_slice(self) -> slice:
        """The first six numbers of the robot state."""
        return slice(0, 6)

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest command, `[3]` [rad] [rad] [N]."""
        return np.array([*self.lower, self.tension_range[0]])

    @property
    def command_upper(self) -> np.ndarray:
        """Largest command, `[3]` [rad] [rad] [N]."""
        return np.array([*self.upper, self.tension_range[1]])

    @property
    def home_command(self) -> np.ndarray:
        """θ_ref and f_const at the start, `[3]` [rad] [rad] [N]."""
        return np.array([0.4, -0.4, 30.0])

    @property
    def moment_arms(self) -> np.ndarray:
        """G = ∂(path length)/∂θ, `[6, 2]` [m/rad]."""
        flexors = [(self.shoulder_moment_arm, 0.0), (0.0, self.elbow_moment_arm), self.biarticular_moment_arms]
        return np.array([sign * np.array(arms) for arms in flexors for sign in (1, -1)])

    def tension(self, elongation: np.ndarray) -> np.ndarray:
        """Pull of the springs [N] when stretched by `elongation` [m]: f = k₁e + k₃e³, and 0 when slack."""
        e = np.maximum(elongation, 0.0)
        return self.spring_linear * e + self.spring_cubic * e**3

    def elongation(self, tension: np.ndarray, more_stiffness: float = 0.0) -> np.ndarray:
        """Inverse of `tension`: stretch [m] at which the springs pull with `tension` [N].

        Args:
            tension: [N].
            more_stiffness: of a linear spring beside this one [N/m].
        """
        linear, cubic = self.spring_linear + more_stiffness, self.spring_cubic
        if cubic == 0:
            return np.asarray(tension) / linear
        # The one real root of e³ + 3a² e = tension / k₃, in its hyperbolic form, which does not lose digits near 0.
        a = np.sqrt(linear / (3 * cubic))
        return 2 * a * np.sinh(np.arcsinh(np.asarray(tension) / (2 * cubic * a**3)) / 3)

    def body_image(self, theta: np.ndarray, tension: np.ndarray) -> np.ndarray:
        """Muscle lengths at rest, l = h(θ, f) (paper, eq. 2): geometry minus what the springs give.

        Args:
            theta: joint angles `[..., 2]` [rad].
            tension: f `[..., 6]` [N].

        Returns:
            l `[..., 6]` [m], counted from the length at θ = 0 without tension.
        """
        return np.asarray(theta) @ self.moment_arms.T - self.elongation(tension)

    def sent_length(self, u: np.ndarray) -> np.ndarray:
        """The command path (θ_ref, f_const) → l_ref → l_send, `[6]` [m].

        l_send is shorter than l_ref by what the motors' own stiffness gives under f_const.
        """
        f = np.full(len(MUSCLES), u[2])
        return self.body_image(u[:2], f) - (f - self.tension_bias) / self.motor_stiffness

    def static_tension(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Tensions `[6]` [N] when the arm is held at θ `[2]` [rad] under the command `u` until nothing moves.

        Spring and motor are two springs in series, within what the motor can pull.
        """
        gap = self.moment_arms @ theta - self.sent_length(u)
        e = self.elongation(self.tension_bias + self.motor_stiffness * gap, more_stiffness=self.motor_stiffness)
        return np.clip(self.tension(e), self.tension_bias, self.tension_max)

    def _add_actuators(self, spec: mujoco.MjSpec) -> None:
        inputs = int(mujoco.mjtCtrlInput.mjINPUT_POS) | int(mujoco.mjtCtrlInput.mjINPUT_FF)
        for name, arms in zip(MUSCLES, self.moment_arms, strict=True):
            rotor = spec.worldbody.add_body(name=name, mass=1e-3, inertia=[1e-6] * 3, explicitinertial=True)
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
            motor.set_to_pid(kp=self.motor_stiffness, kv=self.motor_damping, slewmax=self.motor_speed, ctrlspec=inputs)

    def reset(self, data: mujoco.MjData, u: np.ndarray) -> None:
        """Put joints, rotors and set-points where `u` `[3]` wants them, at rest."""
        for joint, angle in zip(JOINTS, u[:2], strict=True):
            data.joint(joint).qpos[0] = angle
        lengths = self.body_image(u[:2], np.full(len(MUSCLES), u[2]))
        for name, length, sent in zip(MUSCLES, lengths, self.sent_length(u), strict=True):
            data.joint(name).qpos[0] = -length
            # The set-point that the speed limit moves is a state of its own: left at zero, it would jerk the arm.
            data.act[data.model.actuator(name).actadr[0]] = -sent
        self.command(data, u)

    def command(self, data: mujoco.MjData, u: np.ndarray) -> None:
        """Send the command `u` `[3]` to the motors."""
        for name, length in zip(MUSCLES, self.sent_length(u), strict=True):
            data.actuator(name).ctrl[:] = -length, self.tension_bias

    def state(self, data: mujoco.MjData) -> np.ndarray:
        """Tensions f and muscle lengths l, `[12]` [N] [m]."""
        f = self.tension(np.array([data.tendon(name).length[0] for name in MUSCLES]))
        return np.concatenate([f, [-data.joint(name).qpos[0] for name in MUSCLES]])


ARMS = {"torque": TorqueArm(), "muscle": MuscleArm()}


def get_arm(name: str) -> Arm:
    """Return the arm of that name.

    Raises:
        KeyError: unknown name; the message lists the choices.
    """
    return choose("arm", name, ARMS)


def check_command(arm: Arm, u: np.ndarray) -> np.ndarray:
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


def learn_body_image(
    theta: np.ndarray, tension: np.ndarray, length: np.ndarray, *, seed: int = 0
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Fit a network to sensed l = h(θ, f), as the paper does on the real robot (its eq. 2).

    Args:
        theta: joint angles `[N, 2]` [rad].
        tension: f `[N, 6]` [N].
        length: l `[N, 6]` [m].
        seed: of the network's weights.

    Returns:
        A function like `MuscleArm.body_image`. It is to be trusted near the data alone.
    """
    inputs, outputs = StandardScaler(), StandardScaler()
    network = MLPRegressor(
        hidden_layer_sizes=(64, 64),
        activation="tanh",
        learning_rate_init=0.005,
        max_iter=600,
        n_iter_no_change=600,
        random_state=seed,
    )
    with warnings.catch_warnings(action="ignore", category=ConvergenceWarning):  # it is to run all its epochs
        network.fit(inputs.fit_transform(np.hstack([theta, tension])), outputs.fit_transform(length))

    def body_image(theta: np.ndarray, tension: np.ndarray) -> np.ndarray:
        x = np.hstack([np.atleast_2d(theta), np.atleast_2d(tension)])
        return outputs.inverse_transform(network.predict(inputs.transform(x)))

    return body_image


def static_posture(arm: MuscleArm, u: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Joint angles `[2]` [rad] at which the muscles balance a force `[2]` [N] (forward, up) on the hand, no gravity.

    Raises:
        ValueError: a command outside the arm's range, or a force that pushes a joint to its stop.
    """
    u = check_command(arm, u)

    def torque(theta: np.ndarray) -> np.ndarray:
        return arm.hand_jacobian(theta).T @ force - arm.moment_arms.T @ arm.static_tension(theta, u)

    solution = root(torque, u[:2], tol=1e-10)
    low, high = np.array(arm.lower) - arm.stop_margin, np.array(arm.upper) + arm.stop_margin
    if not solution.success or (solution.x < low).any() or (solution.x > high).any():
        raise ValueError(f"the muscles cannot hold {force} N under the command {u}: push less")
    return solution.x


def stiffness_ellipse(
    arm: MuscleArm, theta_ref: np.ndarray, f_const: float, *, force: float = 1.0, directions: int = 24
) -> np.ndarray:
    """How far the hand moves when pushed from all directions (paper, figure on variable stiffness).

    By simulation, without gravity and without a cloth.

    Args:
        arm: a muscle arm.
        theta_ref: posture `[2]` [rad].
        f_const: co-contraction [N].
        force: [N].
        directions: how many, evenly around.

    Returns:
        Displacement of the hand (forward, up) for each direction, `[directions, 2]` [m].

    Raises:
        ValueError: a posture or an f_const outside the arm's range.
    """
    u = check_command(arm, [*theta_ref, f_const])
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
        data.body("hand").xfrc_applied[:3] = force * np.array([np.cos(angle), 0, np.sin(angle)])
        mujoco.mj_step(model, data, round(SETTLING_TIME / model.opt.timestep))
        displacements.append((data.site("hand").xpos - start)[[0, 2]])
    return np.array(displacements)


def ellipse_area(displacements: np.ndarray) -> float:
    """Area [m²] inside displacements `[N, 2]` [m] given in order around the origin."""
    x, y = displacements.T
    return float(abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2)


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
