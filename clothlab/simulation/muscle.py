"""Muscles: motors in series with nonlinear springs, and what they do to the joints.

No simulation here. A muscle's motor reels in `s` [m] of wire; its spring is stretched
by `e = s + Gθ` [m], where G holds the moment arms (flexors, which raise, positive). The
spring pulls with `f = k₁e + k₃e³` [N] and never pushes. The motor is under muscle
stiffness control: `clip(f_bias + K (s_send - s) - D ds/dt, f_bias, f_max)`. The robot
senses tensions f and muscle lengths `l = -s`, nothing else.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array

MUSCLES = (
    "shoulder flexor",
    "shoulder extensor",
    "elbow flexor",
    "elbow extensor",
    "biarticular flexor",
    "biarticular extensor",
)


@dataclass(frozen=True, kw_only=True)
class Muscles:
    """Six muscles that pull on shoulder and elbow.

    The paper gives only the range of f_const; the other values are assumptions, whose
    effect notebook 02 shows.
    """

    shoulder_moment_arm: float = 0.040  # [m]
    elbow_moment_arm: float = 0.030  # [m]
    biarticular_moment_arms: tuple[float, float] = (0.030, 0.030)  # [m]
    spring_linear: float = 456.5  # [N/m] k₁
    # k₃; 0 makes the springs linear
    spring_cubic: float = 7.8e6  # [N/m³]
    motor_stiffness: float = 3e4  # [N/m] K
    motor_damping: float = 250.0  # [N s/m] D
    motor_speed: float = 0.10  # [m/s] how fast s_send can move
    rotor_mass: float = 4.0  # [kg] as felt along the wire
    tension_bias: float = 2.0  # [N] f_bias, keeps the wire taut
    tension_max: float = 250.0  # [N] f_max of the motor
    # Of f_const, the paper's
    tension_range: tuple[float, float] = (10.0, 70.0)  # [N]

    def __post_init__(self) -> None:
        low, high = self.tension_range
        if not self.tension_bias < low <= high < self.tension_max:
            raise ValueError(
                f"tension_range {self.tension_range} N must rise, within f_bias "
                f"{self.tension_bias} and f_max {self.tension_max} N"
            )

    @property
    def moment_arms(self) -> np.ndarray:
        """G = ∂(path length)/∂θ, `[6, 2]` [m/rad]."""
        flexors = np.array(
            [
                (self.shoulder_moment_arm, 0.0),
                (0.0, self.elbow_moment_arm),
                self.biarticular_moment_arms,
            ]
        )
        # Each extensor is wrapped around its joint the other way.
        rows = []
        for arms in flexors:
            rows.append(arms)
            rows.append(-1 * arms)
        return np.array(rows)

    def tension(self, elongation: ArrayLike) -> np.ndarray:
        """Pull of the springs [N] when stretched by `elongation` [m]: f = k₁e + k₃e³.

        It is 0 when they are slack.
        """
        e = np.maximum(check_array("elongation", elongation, (...,)), 0.0)
        return self.spring_linear * e + self.spring_cubic * e**3

    def spring_stiffness(self, tension: ArrayLike) -> np.ndarray:
        """How stiff the springs are [N/m] while they pull with `tension` [N].

        That is df/de = k₁ + 3k₃e².
        """
        e = self.elongation(tension)
        return self.spring_linear + 3 * self.spring_cubic * e**2

    def elongation(self, tension: ArrayLike, more_stiffness: float = 0.0) -> np.ndarray:
        """Stretch [m] at which the springs pull with `tension` [N].

        `more_stiffness` [N/m] is that of a linear spring in parallel. Without it, this
        is the inverse of the method `tension`.
        """
        tension = check_array("tension", tension, (...,))
        linear = self.spring_linear + more_stiffness
        cubic = self.spring_cubic
        if cubic == 0:
            return tension / linear

        # The one real root of e³ + 3a² e = tension / k₃, in its hyperbolic form, which
        # does not lose digits near 0.
        a = np.sqrt(linear / (3 * cubic))
        return 2 * a * np.sinh(np.arcsinh(tension / (2 * cubic * a**3)) / 3)

    def body_image(self, theta: ArrayLike, tension: ArrayLike) -> np.ndarray:
        """Muscle lengths at rest, l = h(θ, f) (paper, eq. 2), `[..., 6]` [m].

        They count from the length at θ = 0, f = 0. For joint angles θ `[..., 2]` [rad]
        and tensions f `[..., 6]` [N].
        """
        arms = self.moment_arms
        theta = check_array("theta", theta, (..., arms.shape[1]))
        tension = check_array("tension", tension, (..., len(MUSCLES)))
        return theta @ arms.T - self.elongation(tension)

    def sent_length(self, u: np.ndarray) -> np.ndarray:
        """The command path u = (θ_ref, f_const, …) → l_ref → l_send, `[6]` [m].

        l_send is shorter than l_ref by what the motors' own stiffness gives under
        f_const.
        """
        f = np.full(len(MUSCLES), u[2])
        l_ref = self.body_image(u[:2], f)
        given = (f - self.tension_bias) / self.motor_stiffness
        return l_ref - given

    def static_tension(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Tensions `[6]` [N] when the arm is held at θ `[2]` [rad] until nothing moves.

        It is under the command `u` `[3]`. Spring and motor are two springs in series,
        within what the motor can pull.
        """
        gap = self.moment_arms @ theta - self.sent_length(u)
        without_spring = self.tension_bias + self.motor_stiffness * gap
        e = self.elongation(without_spring, more_stiffness=self.motor_stiffness)
        return np.clip(self.tension(e), self.tension_bias, self.tension_max)
