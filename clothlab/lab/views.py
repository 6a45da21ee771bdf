"""What the panel shows, as plain data: its JavaScript draws what it is given, and knows no number of its own."""

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike

from clothlab import plots
from clothlab.alt_text import AltText, describe
from clothlab.analysis import principal_axes
from clothlab.lab.drivers import DRIVERS
from clothlab.lab.session import SETUPS, LiveSession, StepInfo
from clothlab.lab.targets import LARGEST_FILE
from clothlab.learning.calibration import outline
from clothlab.simulation.arm import JOINTS, MuscleArm
from clothlab.simulation.cloth import CLOTHS, FOAMS, get_cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.vision import HEIGHT, WIDTH

HISTORY = 150  # steps that the traces show, 30 s
# C_damp [N s/m] and C_mass [kg]: lowest, highest, step. Measured with random swinging at the lowest C_damp: below
# 0.042 kg the cloth trembles from one time step to the next, below 0.034 kg it diverges.
DAMPING, MASS = (0.01, 0.10, 0.005), (0.045, 0.20, 0.005)
TENSION_STEP = 5.0  # [N]
BRUSH = {"range": (1, 12, 1), "start": 4}  # radius [pixel]
GAMEPAD = {"axes": (1, 3), "trigger": 7, "moves": 0.05}  # vertical axes, right trigger; a stick at rest trembles
ELLIPSE_TEXT = 20  # [point], for a picture 4 inches wide


def javascript(*parts: str) -> str:
    """Files of these names as one module, since such a module cannot import what lies beside it."""
    return "\n".join((Path(__file__).parent / "static" / f"{part}.js").read_text("utf-8") for part in parts)


def encoded(picture: np.ndarray | Figure, kind: str = ".png") -> bytes:
    """A figure, a picture `[h, w, 3]` uint8, or an image `[h, w]` of 0 to 1, as a file."""
    if isinstance(picture, Figure):
        file = io.BytesIO()
        picture.savefig(file, format="png", dpi=80, bbox_inches="tight")
        return file.getvalue()
    if picture.dtype != np.uint8:
        picture = (255 * picture.astype(float)).astype(np.uint8)
    return cv2.imencode(kind, picture[..., ::-1] if picture.ndim == 3 else picture)[1].tobytes()


def pixels(mask: np.ndarray) -> bytes:
    """A mask `[H, W]`, one byte a pixel."""
    return np.asarray(mask, np.uint8).tobytes()


class Plane:
    """The two principal axes of the trained p, on which the map is drawn.

    Args:
        biases: trained p of each material, `{name: [D_p]}`.
        labels: what to call them; by default their names.
    """

    def __init__(self, biases: Mapping[str, np.ndarray], labels: Mapping[str, str]):
        self._axes = principal_axes(dict(biases))
        at = {name: self.at(p) for name, p in biases.items()}
        dots = [{"name": name, "label": labels.get(name, name), "at": place} for name, place in at.items()]
        reach = 1.2 * float(np.abs(list(at.values())).max())  # half of the width shown
        self.map = {"dots": dots, "reach": reach, "axes": ["PC1 of p", "PC2 of p"]}

    def at(self, p: ArrayLike) -> list[float]:
        """Where p `[D_p]` is on the map: PC1 and PC2."""
        return self._axes.transform(np.asarray(p)[None])[0].tolist()

    def region(self, p: ArrayLike, covariance: ArrayLike) -> list[list[float]]:
        """Edge of the 90 % region around p `[D_p]` on the map, places of PC1 and PC2."""
        across = self._axes.components_
        return outline(self.at(p), across @ np.asarray(covariance) @ across.T).round(4).tolist()

    def p(self, at: ArrayLike) -> np.ndarray:
        """p `[D_p]` of a place on the map."""
        return self._axes.inverse_transform(np.asarray(at, dtype=float)[None])[0]


def plane(session: LiveSession) -> Plane:
    """The map of the materials that the session's model knows."""
    return Plane(session.trained.biases, {name: get_cloth(name).label for name in session.trained.biases})


def fixtures(session: LiveSession, the_plane: Plane) -> dict[str, Any]:
    """What stays as long as the arm does: names, ranges and sizes."""
    arm, cloths = session.arm, FOAMS if session.arm.has_stiffness else CLOTHS
    hands = zip(arm.command_names, arm.command_lower, arm.command_upper, strict=True)
    tension = [(limits[arm.stiffness_command]).tolist() for limits in (arm.command_lower, arm.command_upper)]
    return {
        "period": CONTROL_PERIOD,
        "history": HISTORY,
        "size": (WIDTH, HEIGHT),
        "arms": list(SETUPS),
        "drivers": DRIVERS,
        "cloths": [{"name": name, "label": cloth.label} for name, cloth in cloths.items()],
        "material": [] if arm.has_stiffness else [("C_damp [N s/m]", DAMPING), ("C_mass [kg]", MASS)],
        "hands": [(name, (low, high, (high - low) / 100)) for name, low, high in hands],
        "tension": (*tension[0], *tension[1], TENSION_STEP) if arm.has_stiffness else None,
        "stiffness_at": arm.stiffness_command.start,
        "map": the_plane.map,
        "brush": BRUSH,
        "gamepad": GAMEPAD,
        "largest_file": LARGEST_FILE,
        "gallery": [{"name": name, "image": pixels(mask)} for name, mask in session.gallery.items()],
    }


def state(session: LiveSession) -> dict[str, Any]:
    """Where every control stands."""
    cloth, tension, arm = session.env.cloth, session.tension, session.arm
    hand = np.clip(
        session.hand if session.driver == "manual" else session.command, arm.command_lower, arm.command_upper
    )
    if tension is not None:
        hand[arm.stiffness_command] = tension  # whatever else is said of f_const
    return {
        "arm": arm.name,
        "driver": session.driver,
        "exploring": session.exploring,
        "cloth": {"name": cloth.name, "label": cloth.label, "material": (cloth.damping, cloth.mass)},
        "estimating": session.estimating,
        "fixed": tension is not None,
        "tension": hand[arm.stiffness_command].tolist(),
        "hand": hand.tolist(),  # what is sent, whoever drives
        "recording": session.recording,
        "waiting": session.recorder.waiting,
    }


def gamepad(session: LiveSession, enough: bool) -> str:
    """What a gamepad's sticks and trigger do with this arm."""
    if not enough:
        raise ValueError("a gamepad needs two sticks and a trigger")
    trigger = ", right trigger: stiffness" if session.arm.has_stiffness else ""
    return f"gamepad: left stick: shoulder, right stick: elbow{trigger}"


def target(session: LiveSession) -> dict[str, Any]:
    """The target, and what the network makes of it."""
    distance, usual = session.reconstruction_distance, session.usual_distance
    reconstruction = f"{distance:.1f} pixel from the target" if np.isfinite(distance) else "no cloth at all"
    return {
        "image": pixels(session.target),
        "reconstruction": encoded(session.reconstruction),
        "known": bool(distance <= usual),
        "verdict": "The autoencoder reproduces it." if distance <= usual else "The autoencoder does not reproduce it.",
        "reason": f"Its reconstruction is {reconstruction} (chamfer distance; 99 % of recorded images are below "
        f"{usual:.1f}).",
    }


def frame(session: LiveSession, the_plane: Plane, history: Sequence[StepInfo]) -> dict[str, Any]:
    """Pictures, traces and p after a step."""
    step = session.step_number
    images = (history[-1].image, history[-1].reconstruction) if history else (np.zeros((HEIGHT, WIDTH)),) * 2
    return {
        "scene": encoded(session.picture(), ".jpg"),
        "seen": encoded(images[0]),
        "decoded": encoded(images[1]),
        "clock": f"{step * CONTROL_PERIOD:.1f} s, step {step}",
        "traces": traces(session, history),
        "marks": [k for k, moment in enumerate(history) if moment.period_ended],
        "at": the_plane.at(session.p),
        "trail": [the_plane.at(moment.p) for moment in history],
        "nearest": get_cloth(session.nearest).label,
    } | estimate_report(session, the_plane)


def still(frame: Mapping[str, Any], target: Mapping[str, Any]) -> tuple[bytes, AltText]:
    """A frame and the target as one picture, with words for it: nothing is drawn anew, so that any thread may ask."""
    files = (np.frombuffer(frame[name], np.uint8) for name in ("scene", "seen"))
    scene, seen = (np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR)) for file in files)
    aim = np.frombuffer(target["image"], np.uint8).reshape(HEIGHT, WIDTH)
    titles = [f"the scene, {frame['clock']}", "what the camera sees", "the target"]
    figure = plots.image_grid([scene[..., ::-1], seen[..., 0] > 127, aim > 0], titles)
    return encoded(figure), describe(figure)


def estimate_report(session: LiveSession, the_plane: Plane) -> dict[str, Any]:
    """While p is estimated: the edge of its 90 % region, and a warning where the material is unlike the trained ones.

    The region is empty, and the warning too, where there is nothing to say.
    """
    report = session.tracker.report if session.estimating else None
    if report is None:
        return {"region": [], "warning": ""}
    warning = "p lies outside the trained ones." if report.outside_hull else ""
    if report.out_of_distribution:
        times = np.exp(report.log_error_ratio)
        warning = f"The material is unlike the trained ones: squared prediction error {times:.1f} times the usual."
    return {"region": the_plane.region(session.p, report.covariance), "warning": warning}


def traces(session: LiveSession, history: Sequence[StepInfo]) -> list[dict[str, Any]]:
    """The curves of a history, `{title, unit, lines: [{name, values, colour, dash, fine}], limit, pairs}` each.

    Where a curve has a gap, its value is None. A fine line is left out on a projector. A limit is `(name, value)`, and
    pairs are `(index, predicted, achieved)` of the periods that are over.
    """

    def line(
        name: str, values: Iterable[float | None], colour: int = 0, dash: int = 0, fine: bool = False
    ) -> dict[str, Any]:
        rounded = [None if v is None else round(float(v), 4) for v in values]
        return {"name": name, "values": rounded, "colour": colour, "dash": dash, "fine": fine}

    def plot(title: str, unit: str, *lines: dict, limit: tuple[str, float] | None = None) -> dict[str, Any]:
        return {"title": title, "unit": unit, "lines": lines, "limit": limit, "pairs": []}

    angles = [line(joint, (m.theta[j] for m in history), j) for j, joint in enumerate(JOINTS)]
    angles += [line(f"{joint} ref", (m.command[j] for m in history), j, 1) for j, joint in enumerate(JOINTS)]
    distances = [line("distance", (m.distance for m in history))]
    if any(m.predicted is not None for m in history):
        distances.append(line("predicted at each step", (m.predicted for m in history), 1, 1, fine=True))
    seconds = line("step", (1e3 * m.seconds for m in history))
    shown = [
        plot("distance to the target", "s.d. of z", *distances, limit=("hanging still", session.still_distance)),
        plot("joint angles", "rad", *angles),
        plot("time a step took", "ms", seconds, limit=("control period", 1e3 * CONTROL_PERIOD)),
    ]
    kept = [(k, *np.round(moment.period, 4).tolist()) for k, moment in enumerate(history) if moment.period]
    shown[0]["pairs"] = kept
    if session.arm.has_stiffness:
        f_const = line("f_const", (m.command[session.arm.stiffness_command][0] for m in history))
        shown.insert(2, plot("stiffness command", "N", f_const))
    return shown


def ellipse(session: LiveSession, u: np.ndarray) -> bytes:
    """The stiffness ellipse under a command `[D_u]`, enlarged 10 times; nothing for an arm without muscles.

    Its words stand in the page, where a projector's style enlarges them.
    """
    arm = session.arm
    if not arm.has_stiffness:
        return b""
    f_const = u[arm.stiffness_command][0] if session.tension is None else session.tension
    figure = plots.ellipse_at_hand(cast(MuscleArm, arm), u[arm.angle_command], f_const)
    (ax,) = figure.axes
    ax.set_title("")
    ax.tick_params(labelsize=ELLIPSE_TEXT)
    for axis in (ax.xaxis, ax.yaxis):
        axis.label.set_fontsize(ELLIPSE_TEXT)
        axis.set_major_locator(MultipleLocator(0.5))
    return encoded(figure)
