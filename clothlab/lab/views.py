"""What the panel shows, as plain data.

Its JavaScript draws what it is given, and knows no number of its own.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import cv2
import numpy as np
from matplotlib.figure import Figure

from clothlab import plots
from clothlab._validation import HEIGHT, WIDTH
from clothlab.analysis import nearest_material
from clothlab.lab.drivers import DRIVERS
from clothlab.lab.map import Plane
from clothlab.lab.session import SETUPS, LiveSession, StepInfo
from clothlab.lab.targets import Aim
from clothlab.lab.widget import encoded
from clothlab.method.autoencoder import decode, encode
from clothlab.simulation.arm import JOINTS, MuscleArm
from clothlab.simulation.cloth import CLOTHS, FOAMS, get_cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.rendering import onlooker
from clothlab.simulation.stiffness import static_posture

HISTORY = 150  # steps that the traces show, 30 s
# Lowest, highest, step. Measured with random swinging at the lowest C_damp: below 0.042
# kg the cloth trembles from one time step to the next, below 0.034 kg it diverges.
MATERIAL = {"C_damp [N s/m]": (0.01, 0.10, 0.005), "C_mass [kg]": (0.045, 0.20, 0.005)}
# IoU of a target and the recorded image most like it, from which on the arm is able to
# show it
REACHABLE = 0.5
_TENSION_STEP = 5.0  # [N]
_BRUSH = {"range": (1, 12, 1), "start": 4}  # radius [pixel]
_AIM = (230, 159, 0)  # colour of the target where the camera's picture shows it
# Vertical axes, right trigger; a stick at rest trembles
_GAMEPAD = {"axes": (1, 3), "trigger": 7, "moves": 0.05}
_UNFAMILIAR = (
    "The material is unlike the trained ones: its p is far from all of theirs."
)
_ELLIPSE_TEXT = 20  # [point], for a picture 4 inches wide
_ENLARGED = 10  # times, or nobody would see the ellipse


class Views:
    """A session as plain data for the browser, as long as the session keeps its arm."""

    def __init__(self, session: LiveSession):
        self._session = session
        biases = session.trained.biases
        self.plane = Plane(biases, {name: get_cloth(name).label for name in biases})

    def about(self) -> dict[str, Any]:
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
        usual = self._session.usual_distance
        return {
            "image": pixels(aim.mask),
            "reconstruction": encoded(aim.reconstruction),
            "known": bool(aim.distance <= usual),
            "verdict": _verdict(aim, usual),
            "reason": _reason(aim, usual),
        }

    def frame(self, history: Sequence[StepInfo]) -> dict[str, Any]:
        """Pictures, traces and p after a step; before any, of a cloth that hangs."""
        session = self._session
        step = session.step_number
        clock = f"{step * CONTROL_PERIOD:.1f} s, step {step}"
        if history and history[-1].basis:
            clock += f", plan from {history[-1].basis}"

        # What the camera sees, and what the autoencoder makes of it
        if history:
            seen, decoded = history[-1].image, history[-1].reconstruction
        else:
            seen = session.observation["image"].astype(bool)
            autoencoder = session.trained.autoencoder
            decoded = decode(autoencoder, encode(autoencoder, seen))

        nearest = nearest_material(session.p, session.trained.biases)
        return {
            "scene": encoded(session.env.picture(onlooker(session.arm)), ".jpg"),
            "seen": encoded(outlined(seen, session.target)),
            "decoded": encoded(decoded),
            "clock": clock,
            "traces": traces(session, history),
            "marks": [k for k, moment in enumerate(history) if moment.period_ended],
            "at": self.plane.at(session.p),
            "trail": [self.plane.at(moment.p) for moment in history],
            "nearest": get_cloth(nearest).label,
            "region": self._region(),
            "warning": _UNFAMILIAR if session.unfamiliar else "",
        }

    def _region(self) -> list[list[float]]:
        """Edge of the region that holds p in nine cases of ten, while p is estimated.

        It is empty before that can be said.
        """
        session = self._session
        covariance = session.covariance if session.estimating else None
        return [] if covariance is None else self.plane.region(session.p, covariance)

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


def outlined(seen: np.ndarray, target: np.ndarray) -> np.ndarray:
    """A mask `[H, W]` with the edge of another one in colour, `[H, W, 3]` uint8."""
    picture = np.repeat(255 * seen.astype(np.uint8)[..., None], 3, axis=2)
    inner = cv2.erode(target.astype(np.uint8), np.ones((3, 3)))
    picture[target & (inner == 0)] = _AIM
    return picture


def pixels(mask: np.ndarray) -> bytes:
    """A mask `[H, W]` as the browser takes it: a byte for each pixel, 0 or 1."""
    return np.asarray(mask, np.uint8).tobytes()


def still_picture(
    frame: Mapping[str, Any], target: Mapping[str, Any]
) -> tuple[bytes, str]:
    """A frame and the target as one picture, PNG, with a sentence for it.

    It is made of what was sent to the browser, so that any thread may ask.
    """
    scene = _decoded(frame["scene"], cv2.IMREAD_COLOR)[..., ::-1]
    seen = _decoded(frame["seen"], cv2.IMREAD_COLOR)[..., ::-1]
    aim = np.frombuffer(target["image"], bool).reshape(HEIGHT, WIDTH)
    titles = [f"the scene, {frame['clock']}", "what the camera sees", "the target"]
    figure = plots.image_grid([scene, seen, aim], titles, width=4.5)
    figure.set_figheight(figure.get_figheight() + 0.2)
    for ax in figure.axes:
        ax.title.set_fontsize(18)
    return encoded(figure), plots.alt_text(figure)


def _decoded(file: bytes, kind: int) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(file, np.uint8), kind))


def ellipse_at_hand(arm: MuscleArm, theta: np.ndarray, f_const: float) -> Figure:
    """The arm, and ten times how far a push of 1 N from any direction moves its hand.

    The posture θ is `[2]` [rad], the tension of the muscles f_const [N].
    """
    # The arm
    theta = np.clip(theta, arm.lower, arm.upper)
    hand = arm.hand(theta)
    elbow = arm.link_length * np.array([np.cos(theta[0]), -np.sin(theta[0])])

    # Its hand, pushed from all around
    pushed = []
    for angle in np.linspace(0, 2 * np.pi, 25):
        force = np.array([np.cos(angle), np.sin(angle)])
        pushed.append(arm.hand(static_posture(arm, [*theta, f_const], force)))
    ellipse = hand + _ENLARGED * (np.array(pushed) - hand)

    # The figure
    figure, ((ax,),) = plots.new_axes(size=(4.0, 3.6))
    ax.set(aspect="equal", xlim=(-0.35, 1.0), ylim=(-0.75, 0.75))
    ax.set(xticks=(0, 0.5, 1), yticks=(-0.5, 0, 0.5))
    ax.set_xlabel("forward [m]", fontsize=_ELLIPSE_TEXT)
    ax.set_ylabel("up [m]", fontsize=_ELLIPSE_TEXT)
    ax.tick_params(labelsize=_ELLIPSE_TEXT)
    ax.plot(*np.array([[0, 0], elbow, hand]).T, "o-", color="0.6", lw=6, zorder=1)
    ax.plot(*ellipse.T, lw=2, color=plots.COLOURS[0], label=f"{f_const:.0f} N")
    return figure


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


def traces(session: LiveSession, history: Sequence[StepInfo]) -> list[dict[str, Any]]:
    """The plots of a history, one below the other."""
    plots = [_distances(session, history), _angles(history)]
    if session.arm.has_stiffness:
        plots.append(_stiffness(session, history))
    plots.append(_times(history))
    return plots


def _distances(session: LiveSession, history: Sequence[StepInfo]) -> dict[str, Any]:
    """Distance to the target, what was predicted of it, and both at a period's end."""
    lines = [_line("distance", (moment.distance for moment in history))]
    predicted = [moment.predicted for moment in history]
    if any(each is not None for each in predicted):
        lines.append(_line("predicted at each step", predicted, 1, dash=1, fine=True))

    plot = _plot("distance to the target", "s.d. of z", lines)
    plot["limit"] = ("hanging still", session.still_distance)
    for k, moment in enumerate(history):
        if moment.period:
            pair = np.round(moment.period, 4).tolist()  # predicted and achieved
            plot["pairs"].append((k, *pair))
    return plot


def _angles(history: Sequence[StepInfo]) -> dict[str, Any]:
    """Angles of the joints, and their references."""
    lines = []
    for j, joint in enumerate(JOINTS):
        lines.append(_line(joint, [moment.theta[j] for moment in history], j))
    for j, joint in enumerate(JOINTS):
        sent = [moment.command[j] for moment in history]
        lines.append(_line(f"{joint} ref", sent, j, dash=1))
    return _plot("joint angles", "rad", lines)


def _stiffness(session: LiveSession, history: Sequence[StepInfo]) -> dict[str, Any]:
    at = session.arm.stiffness_command
    sent = [moment.command[at][0] for moment in history]
    return _plot("stiffness command", "N", [_line("f_const", sent)])


def _times(history: Sequence[StepInfo]) -> dict[str, Any]:
    """How long steps took to compute."""
    line = _line("step", (1e3 * moment.seconds for moment in history))
    plot = _plot("time a step took", "ms", [line])
    plot["limit"] = ("control period", 1e3 * CONTROL_PERIOD)
    return plot


def _line(
    name: str,
    values: Iterable[float | None],
    colour: int = 0,
    *,
    dash: int = 0,
    fine: bool = False,
) -> dict[str, Any]:
    """A curve, with a gap where a value is None; a fine one is not for a projector."""
    rounded = [None if value is None else round(float(value), 4) for value in values]
    return {
        "name": name,
        "values": rounded,
        "colour": colour,
        "dash": dash,
        "fine": fine,
    }


def _plot(title: str, unit: str, lines: list[dict]) -> dict[str, Any]:
    """A plot without a limit, `(name, value)`, and without pairs.

    Pairs are `(index, predicted, achieved)` of the periods that ended.
    """
    return {"title": title, "unit": unit, "lines": lines, "limit": None, "pairs": []}
