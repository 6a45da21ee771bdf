"""What the panel shows, as plain data: its JavaScript draws what it is given, and knows
no number of its own.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from clothlab import plots
from clothlab.alt_text import AltText, describe
from clothlab.analysis import principal_axes
from clothlab.calibration import outline
from clothlab.lab._drivers import DRIVERS
from clothlab.lab._session import SETUPS, LiveSession, StepInfo
from clothlab.lab._targets import LARGEST_FILE
from clothlab.masks import HEIGHT, WIDTH
from clothlab.method.autoencoder import decode, encode
from clothlab.simulation.arm import JOINTS, MuscleArm
from clothlab.simulation.cloth import CLOTHS, FOAMS, get_cloth
from clothlab.simulation.env import CONTROL_PERIOD, onlooker
from clothlab.simulation.stiffness import static_posture

HISTORY = 150  # steps that the traces show, 30 s
# Lowest, highest, step. Measured with random swinging at the lowest C_damp: below 0.042
# kg the cloth trembles from one time step to the next, below 0.034 kg it diverges.
MATERIAL = {"C_damp [N s/m]": (0.01, 0.10, 0.005), "C_mass [kg]": (0.045, 0.20, 0.005)}
_TENSION_STEP = 5.0  # [N]
_BRUSH = {"range": (1, 12, 1), "start": 4}  # radius [pixel]
# Vertical axes, right trigger; a stick at rest trembles
_GAMEPAD = {"axes": (1, 3), "trigger": 7, "moves": 0.05}
_ELLIPSE_TEXT = 20  # [point], for a picture 4 inches wide


def javascript(*parts: str) -> str:
    """Files of these names as one module, since such a module cannot import what lies
    beside it.
    """
    return "\n".join(
        (Path(__file__).parent / "static" / f"{part}.js").read_text("utf-8")
        for part in parts
    )


def encoded(picture: np.ndarray | Figure, kind: str = ".png") -> bytes:
    """A figure, a picture `[h, w, 3]` uint8, or an image `[h, w]` of 0 to 1, as a file."""
    if isinstance(picture, Figure):
        file = io.BytesIO()
        picture.savefig(file, format="png", dpi=80, bbox_inches="tight")
        return file.getvalue()
    if picture.dtype != np.uint8:
        picture = (255 * picture.astype(float)).astype(np.uint8)
    return cv2.imencode(kind, picture[..., ::-1] if picture.ndim == 3 else picture)[
        1
    ].tobytes()


def _pixels(mask: np.ndarray) -> bytes:
    return np.asarray(mask, np.uint8).tobytes()


class Plane:
    """The two principal axes of the trained p, `{name: [D_p]}`, on which the map is
    drawn; `labels` name its dots.
    """

    def __init__(self, biases: Mapping[str, np.ndarray], labels: Mapping[str, str]):
        self._axes = principal_axes(dict(biases))
        at = {name: self.at(p) for name, p in biases.items()}
        dots = [
            {"name": name, "label": labels.get(name, name), "at": place}
            for name, place in at.items()
        ]
        reach = 1.2 * float(np.abs(list(at.values())).max())  # half of the width shown
        self.map = {"dots": dots, "reach": reach, "axes": ["PC1 of p", "PC2 of p"]}

    def at(self, p: ArrayLike) -> list[float]:
        """Where p `[D_p]` is on the map: PC1 and PC2."""
        return self._axes.transform(np.asarray(p)[None])[0].tolist()

    def region(self, p: ArrayLike, covariance: ArrayLike) -> list[list[float]]:
        """Edge of the 90 % region around p `[D_p]` on the map, places of PC1 and PC2."""
        across = self._axes.components_
        return (
            outline(self.at(p), across @ np.asarray(covariance) @ across.T)
            .round(4)
            .tolist()
        )

    def p(self, at: ArrayLike) -> np.ndarray:
        """p `[D_p]` of a place on the map."""
        return self._axes.inverse_transform(np.asarray(at, dtype=float)[None])[0]


# IoU of a target and the recorded image most like it, from which on the arm is able to
# show it
REACHABLE = 0.5


class Views:
    """A session as plain data for the browser, as long as the session keeps its arm."""

    def __init__(self, session: LiveSession):
        self._session = session
        biases = session.trained.biases
        self.plane = Plane(biases, {name: get_cloth(name).label for name in biases})

    def fixtures(self) -> dict[str, Any]:
        """What stays as long as the arm does: names, ranges and sizes."""
        arm = self._session.arm
        lower, upper = arm.command_lower, arm.command_upper
        limits = zip(arm.command_names, lower.tolist(), upper.tolist(), strict=True)
        at, muscles = arm.stiffness_command, arm.has_stiffness
        return {
            "period": CONTROL_PERIOD,
            "history": HISTORY,
            "size": (WIDTH, HEIGHT),
            "arms": list(SETUPS),
            "drivers": DRIVERS,
            "cloths": [
                {"name": name, "label": each.label}
                for name, each in (FOAMS if muscles else CLOTHS).items()
            ],
            "material": [] if muscles else list(MATERIAL.items()),
            "hands": [
                (name, (low, high, (high - low) / 100)) for name, low, high in limits
            ],
            "tension": (*lower[at].tolist(), *upper[at].tolist(), _TENSION_STEP)
            if muscles
            else None,
            "stiffness_at": at.start,
            "map": self.plane.map,
            "brush": _BRUSH,
            "gamepad": _GAMEPAD,
            "largest_file": LARGEST_FILE,
            "gallery": [
                {"name": name, "image": _pixels(mask)}
                for name, mask in self._session.gallery.items()
            ],
        }

    def state(self) -> dict[str, Any]:
        """Where every control stands."""
        session, arm, cloth = self._session, self._session.arm, self._session.env.cloth
        sent = session.hand if session.driver == "manual" else session.command
        hand = np.clip(sent, arm.command_lower, arm.command_upper)
        if session.tension is not None:
            hand[arm.stiffness_command] = session.tension
        return {
            "arm": arm.name,
            "driver": session.driver,
            "exploring": session.exploring,
            "cloth": {
                "name": cloth.name,
                "label": cloth.label,
                "material": (cloth.damping, cloth.mass),
            },
            "estimating": session.estimating,
            "fixed": session.tension is not None,
            "tension": hand[arm.stiffness_command].tolist(),
            # The command that is sent, also when another driver chooses it
            "hand": hand.tolist(),
            "recording": session.recorder.running,
            "waiting": session.recorder.waiting,
        }

    def target(self) -> dict[str, Any]:
        """The target, and what the autoencoder makes of it."""
        session, usual = self._session, self._session.usual_distance
        distance, known = (
            session.reconstruction_distance,
            session.reconstruction_distance <= usual,
        )
        reconstruction = (
            f"{distance:.1f} pixel from the target"
            if np.isfinite(distance)
            else "no cloth at all"
        )
        reach = (
            "Known shape"
            if known
            else "Reachable"
            if session.overlap >= REACHABLE
            else "Not reachable"
        )
        return {
            "image": _pixels(session.target),
            "reconstruction": encoded(session.reconstruction),
            "known": bool(known),
            "verdict": f"{reach}. The autoencoder {'reproduces' if known else 'does not reproduce'} it.",
            "reason": f"Its reconstruction is {reconstruction} (chamfer distance; 99 % of recorded images are below "
            f"{usual:.1f}). The recorded image most like it has an IoU of {session.overlap:.2f} with it.",
        }

    def frame(self, history: Sequence[StepInfo]) -> dict[str, Any]:
        """Pictures, traces and p after a step."""
        session, step = self._session, self._session.step_number
        seen, decoded = (
            (history[-1].image, history[-1].reconstruction)
            if history
            else self._before_a_step()
        )
        basis = (
            f", plan from {history[-1].basis}" if history and history[-1].basis else ""
        )
        return {
            "scene": encoded(session.env.picture(onlooker(session.arm)), ".jpg"),
            "seen": encoded(seen),
            "decoded": encoded(decoded),
            "clock": f"{step * CONTROL_PERIOD:.1f} s, step {step}{basis}",
            "traces": self._traces(history),
            "marks": [k for k, moment in enumerate(history) if moment.period_ended],
            "at": self.plane.at(session.p),
            "trail": [self.plane.at(moment.p) for moment in history],
            "nearest": get_cloth(session.nearest).label,
        } | self._estimate_report()

    def _before_a_step(self) -> tuple[np.ndarray, np.ndarray]:
        """The image of a cloth that hangs still, and what the autoencoder makes of it,
        both `[H, W]`.
        """
        image, autoencoder = (
            self._session.observation["image"].astype(bool),
            self._session.trained.autoencoder,
        )
        return image, decode(autoencoder, encode(autoencoder, image))

    def period(self, history: Sequence[StepInfo]) -> dict[str, Any]:
        """What the control predicts for the end of this period; of the last one, what
        it predicted and achieved.
        """

        def decoded(z: np.ndarray | None) -> np.ndarray | None:
            return None if z is None else decode(self._session.trained.autoencoder, z)

        shown: dict[str, np.ndarray | None] = {}
        ended = next((moment for moment in reversed(history) if moment.period), None)
        shown["what the camera sees"] = (
            history[-1].image if history else self._before_a_step()[0]
        )
        if history:
            shown["predicted for the end of this period"] = decoded(
                history[-1].foreseen
            )
        if ended and ended.period:
            predicted, achieved = ended.period
            shown[f"achieved at the end of the last period: {achieved:.2f}"] = (
                ended.image
            )
            shown[f"predicted for it when it began: {predicted:.2f}"] = decoded(
                ended.began
            )
        files = (b"" if image is None else encoded(image) for image in shown.values())
        return {
            "pictures": [
                {"about": about, "image": file}
                for about, file in zip(shown, files, strict=True)
            ]
        }

    def ellipse(self, u: np.ndarray) -> bytes:
        """The stiffness ellipse under a command `[D_u]`, enlarged 10 times; empty for
        an arm without muscles.
        """
        arm, tension = self._session.arm, self._session.tension
        if not arm.has_stiffness:
            return b""
        f_const = u[arm.stiffness_command][0] if tension is None else tension
        return encoded(
            ellipse_at_hand(cast(MuscleArm, arm), u[arm.angle_command], f_const)
        )

    def _estimate_report(self) -> dict[str, Any]:
        """While p is estimated: its 90 % region, and a warning where the material is
        unlike the trained ones.
        """
        report = self._session.tracker.report if self._session.estimating else None
        if report is None:
            return {"region": [], "warning": ""}
        warning = "p lies outside the trained ones." if report.outside_hull else ""
        if report.out_of_distribution:
            times = np.exp(report.log_error_ratio)
            warning = f"The material is unlike the trained ones: squared prediction error {times:.1f} times the usual."
        return {
            "region": self.plane.region(self._session.p, report.covariance),
            "warning": warning,
        }

    def _traces(self, history: Sequence[StepInfo]) -> list[dict[str, Any]]:
        """The curves of a history; a limit is `(name, value)`, pairs are `(index,
        predicted, achieved)` of periods.
        """
        angles = [
            _line(joint, (m.theta[j] for m in history), j)
            for j, joint in enumerate(JOINTS)
        ]
        angles += [
            _line(f"{joint} ref", (m.command[j] for m in history), j, dash=1)
            for j, joint in enumerate(JOINTS)
        ]
        distances = [_line("distance", (m.distance for m in history))]
        if any(m.predicted is not None for m in history):
            predicted = (m.predicted for m in history)
            distances.append(
                _line("predicted at each step", predicted, 1, dash=1, fine=True)
            )
        still, seconds = (
            self._session.still_distance,
            _line("step", (1e3 * m.seconds for m in history)),
        )
        shown = [
            _plot(
                "distance to the target",
                "s.d. of z",
                distances,
                limit=("hanging still", still),
            ),
            _plot("joint angles", "rad", angles),
            _plot(
                "time a step took",
                "ms",
                [seconds],
                limit=("control period", 1e3 * CONTROL_PERIOD),
            ),
        ]
        shown[0]["pairs"] = [
            (k, *np.round(m.period, 4).tolist())
            for k, m in enumerate(history)
            if m.period
        ]
        arm = self._session.arm
        if arm.has_stiffness:
            f_const = _line(
                "f_const", (m.command[arm.stiffness_command][0] for m in history)
            )
            shown.insert(2, _plot("stiffness command", "N", [f_const]))
        return shown


def ellipse_at_hand(arm: MuscleArm, theta: np.ndarray, f_const: float) -> Figure:
    """The arm in posture θ `[2]` [rad], and ten times how far a push of 1 N from any
    direction moves its hand.
    """
    angles, theta = np.linspace(0, 2 * np.pi, 25), np.clip(theta, arm.lower, arm.upper)
    hand = arm.hand(theta)
    elbow = arm.link_length * np.array([np.cos(theta[0]), -np.sin(theta[0])])
    pushed = [
        static_posture(arm, [*theta, f_const], np.array([np.cos(a), np.sin(a)]))
        for a in angles
    ]
    ellipse = hand + 10 * (np.array([arm.hand(each) for each in pushed]) - hand)
    figure, ((ax,),) = plots.new_axes(size=(4.0, 3.6))
    ax.plot(*np.array([[0, 0], elbow, hand]).T, "o-", color="0.6", lw=6, zorder=1)
    ax.plot(*ellipse.T, lw=2, color=plots.COLOURS[0], label=f"{f_const:.0f} N")
    # The same for every posture
    ax.set(aspect="equal", xlim=(-0.35, 1.0), ylim=(-0.75, 0.75))
    ax.set(xticks=(0, 0.5, 1), yticks=(-0.5, 0, 0.5))
    ax.set_xlabel("forward [m]", fontsize=_ELLIPSE_TEXT)
    ax.set_ylabel("up [m]", fontsize=_ELLIPSE_TEXT)
    ax.tick_params(labelsize=_ELLIPSE_TEXT)
    return figure


def _line(
    name: str,
    values: Iterable[float | None],
    colour: int = 0,
    *,
    dash: int = 0,
    fine: bool = False,
) -> dict[str, Any]:
    """A curve with a gap where a value is None; a fine one is left out on a projector."""
    rounded = [None if value is None else round(float(value), 4) for value in values]
    return {
        "name": name,
        "values": rounded,
        "colour": colour,
        "dash": dash,
        "fine": fine,
    }


def _plot(
    title: str, unit: str, lines: list[dict], *, limit: tuple[str, float] | None = None
) -> dict[str, Any]:
    return {"title": title, "unit": unit, "lines": lines, "limit": limit, "pairs": []}


def masks(
    frame: Mapping[str, Any], target: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """What the camera sees and the target `[H, W]`, made of what was sent."""
    seen = np.asarray(
        cv2.imdecode(np.frombuffer(frame["seen"], np.uint8), cv2.IMREAD_GRAYSCALE)
    )
    return seen > 127, np.frombuffer(target["image"], bool).reshape(HEIGHT, WIDTH)


def still(frame: Mapping[str, Any], target: Mapping[str, Any]) -> tuple[bytes, AltText]:
    """A frame and the target as one picture, with words for it, made of what was sent:
    any thread may ask.
    """
    scene = np.asarray(
        cv2.imdecode(np.frombuffer(frame["scene"], np.uint8), cv2.IMREAD_COLOR)
    )
    titles = [f"the scene, {frame['clock']}", "what the camera sees", "the target"]
    figure = plots.image_grid([scene[..., ::-1], *masks(frame, target)], titles)
    return encoded(figure), describe(figure)
