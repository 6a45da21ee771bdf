"""What the panel shows, as plain data.

Its JavaScript draws what it is given, and knows no number of its own.
"""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from clothlab._validation import HEIGHT, WIDTH
from clothlab.analysis import nearest_material
from clothlab.lab._drivers import DRIVERS
from clothlab.lab._equipment import SETUPS
from clothlab.lab._pictures import ellipse_at_hand, encoded, pixels
from clothlab.lab._plane import Plane
from clothlab.lab._session import LiveSession, StepInfo
from clothlab.lab._targets import LARGEST_FILE, Aim
from clothlab.lab._traces import traces
from clothlab.method.autoencoder import decode, encode
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import CLOTHS, FOAMS, get_cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.rendering import onlooker

HISTORY = 150  # steps that the traces show, 30 s
# Lowest, highest, step. Measured with random swinging at the lowest C_damp: below 0.042
# kg the cloth trembles from one time step to the next, below 0.034 kg it diverges.
MATERIAL = {"C_damp [N s/m]": (0.01, 0.10, 0.005), "C_mass [kg]": (0.045, 0.20, 0.005)}
# IoU of a target and the recorded image most like it, from which on the arm is able to
# show it
REACHABLE = 0.5
_TENSION_STEP = 5.0  # [N]
_BRUSH = {"range": (1, 12, 1), "start": 4}  # radius [pixel]
# Vertical axes, right trigger; a stick at rest trembles
_GAMEPAD = {"axes": (1, 3), "trigger": 7, "moves": 0.05}


class Views:
    """A session as plain data for the browser, as long as the session keeps its arm."""

    def __init__(self, session: LiveSession):
        self._session = session
        biases = session.trained.biases
        self.plane = Plane(biases, {name: get_cloth(name).label for name in biases})

    def fixtures(self) -> dict[str, Any]:
        """What stays as long as the arm does: names, ranges and sizes."""
        muscles = self._session.arm.has_stiffness
        cloths = FOAMS if muscles else CLOTHS
        gallery = self._session.gallery

        # All but the ranges of the commands
        return {
            "period": CONTROL_PERIOD,
            "history": HISTORY,
            "size": (WIDTH, HEIGHT),
            "arms": list(SETUPS),
            "drivers": DRIVERS,
            "cloths": [
                {"name": name, "label": cloth.label} for name, cloth in cloths.items()
            ],
            "material": [] if muscles else list(MATERIAL.items()),
            "map": self.plane.map,
            "brush": _BRUSH,
            "gamepad": _GAMEPAD,
            "largest_file": LARGEST_FILE,
            "gallery": [
                {"name": name, "image": pixels(mask)} for name, mask in gallery.items()
            ],
        } | self._limits()

    def _limits(self) -> dict[str, Any]:
        """Ranges of the arm's commands, and of its stiffness command alone."""
        arm = self._session.arm
        lower = arm.command_lower.tolist()
        upper = arm.command_upper.tolist()
        hands = []
        for name, low, high in zip(arm.command_names, lower, upper, strict=True):
            hands.append((name, (low, high, (high - low) / 100)))
        at = arm.stiffness_command
        tension = (*lower[at], *upper[at], _TENSION_STEP)
        return {
            "hands": hands,
            "tension": tension if arm.has_stiffness else None,
            "stiffness_at": at.start,
        }

    def state(self) -> dict[str, Any]:
        """Where every control stands."""
        session = self._session
        cloth = session.env.cloth
        at = session.arm.stiffness_command
        hand = self._hand()

        # From the robot to the recording
        return {
            "arm": session.arm.name,
            "driver": session.driver,
            "exploring": session.exploring,
            "cloth": {
                "name": cloth.name,
                "label": cloth.label,
                "material": (cloth.damping, cloth.mass),
            },
            "estimating": session.estimating,
            "fixed": session.tension is not None,
            "tension": hand[at].tolist(),
            "hand": hand.tolist(),
            "recording": session.recorder.running,
            "waiting": session.recorder.waiting,
        }

    def _hand(self) -> np.ndarray:
        """The command that is sent `[D_u]`, also when another driver chooses it."""
        session = self._session
        arm = session.arm
        sent = session.hand if session.driver == "manual" else session.command
        hand = np.clip(sent, arm.command_lower, arm.command_upper)
        if session.tension is not None:
            hand[arm.stiffness_command] = session.tension
        return hand

    def target(self) -> dict[str, Any]:
        """The target, and what the autoencoder makes of it."""
        aim = self._session.aim
        usual = self._session.equipment.usual_distance
        return {
            "image": pixels(aim.mask),
            "reconstruction": encoded(aim.reconstruction),
            "known": bool(aim.distance <= usual),
            "verdict": _verdict(aim, usual),
            "reason": _reason(aim, usual),
        }

    def frame(self, history: Sequence[StepInfo]) -> dict[str, Any]:
        """Pictures, traces and p after a step."""
        session = self._session
        step = session.step_number
        clock = f"{step * CONTROL_PERIOD:.1f} s, step {step}"
        if history and history[-1].basis:
            clock += f", plan from {history[-1].basis}"
        scene = session.env.picture(onlooker(session.arm))
        nearest = nearest_material(session.p, session.trained.biases)
        return {
            "scene": encoded(scene, ".jpg"),
            "seen": encoded(self._seen(history)),
            "decoded": encoded(self._reconstruction(history)),
            "clock": clock,
            "traces": traces(session, history),
            "marks": [k for k, moment in enumerate(history) if moment.period_ended],
            "at": self.plane.at(session.p),
            "trail": [self.plane.at(moment.p) for moment in history],
            "nearest": get_cloth(nearest).label,
        } | self._estimate_report()

    def _seen(self, history: Sequence[StepInfo]) -> np.ndarray:
        """What the camera sees `[H, W]`; before a step, a cloth that hangs still."""
        if history:
            return history[-1].image
        return self._session.observation["image"].astype(bool)

    def _reconstruction(self, history: Sequence[StepInfo]) -> np.ndarray:
        """What the autoencoder makes of it `[H, W]`."""
        if history:
            return history[-1].reconstruction
        autoencoder = self._session.trained.autoencoder
        return decode(autoencoder, encode(autoencoder, self._seen(history)))

    def ellipse(self, u: np.ndarray) -> bytes:
        """The stiffness ellipse under a command `[D_u]`, enlarged 10 times.

        Empty for an arm without muscles.
        """
        arm = self._session.arm
        if not arm.has_stiffness:
            return b""
        f_const = self._session.tension
        if f_const is None:
            f_const = u[arm.stiffness_command][0]
        theta = u[arm.angle_command]
        return encoded(ellipse_at_hand(cast(MuscleArm, arm), theta, f_const))

    def _estimate_report(self) -> dict[str, Any]:
        """While p is estimated: how far that scatters, and a warning.

        The warning is of a material that is unlike the trained ones.
        """
        tracker = self._session.tracker
        covariance = tracker.covariance
        if covariance is None or not self._session.estimating:
            return {"region": [], "warning": ""}
        strange = (
            "The material is unlike the trained ones: its motion is predicted badly."
        )
        return {
            "region": self.plane.region(self._session.p, covariance),
            "warning": strange if tracker.is_strange else "",
        }


def _verdict(aim: Aim, usual: float) -> str:
    """Whether the arm can show a target, and the autoencoder knows its shape."""
    known = aim.distance <= usual
    if known:
        reach = "Known shape"
    elif aim.overlap >= REACHABLE:
        reach = "Reachable"
    else:
        reach = "Not reachable"
    reproduces = "reproduces" if known else "does not reproduce"
    return f"{reach}. The autoencoder {reproduces} it."


def _reason(aim: Aim, usual: float) -> str:
    """The numbers that the verdict rests on."""
    reconstruction = "no cloth at all"
    if np.isfinite(aim.distance):
        reconstruction = f"{aim.distance:.1f} pixel from the target"
    return (
        f"Its reconstruction is {reconstruction} (chamfer distance; 99 % of recorded "
        f"images are below {usual:.1f}). The recorded image most like it has an IoU of "
        f"{aim.overlap:.2f} with it."
    )
