"""What the page knows of an arm beside its graphs, as plain data for JSON."""

import base64
import io
import json
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab import ControlSettings, OperatorPolicy, Policy, RandomPolicy, plots
from clothlab.analysis import principal_axes, spread
from clothlab.lab import LivePanel, LiveSession
from clothlab.method.data import Run
from clothlab.method.estimation import NewtonSettings
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.simulation.arm import JOINTS, MuscleArm
from clothlab.simulation.stiffness import static_posture
from web.scene import any_cloth_scene, cloths

# Who can drive there: a controller for each kind of start
DRIVERS = ["control", "control: last", "control: earlier"]
DRIVERS += ["iterative", "manual", "random", "operator"]
# Steps of commands that are played where no network chooses them
_PLAYED = 2000
# Squared distance in p, in units of the trained spread, from which on iterative
# learning takes a material for another one
_SAME_MATERIAL = 0.25
# Predictions to judge before the estimated p moves
_LEAST = 5
# IoU of a target and the recorded image most like it, from which on the arm is able to
# show it
_REACHABLE = 0.5

# Along a side of the grid on which the stiffness of a hand is known
_COUNT = 9
_PUSHES = 25  # from all around, the last as the first
# Of the picture of it in the page
_SIZE = (4.5, 4.8167)  # [inch]
_DPI = 120
_TEXT = 20  # [point]


def method_constants(session: LiveSession) -> dict[str, Any]:
    """What control, estimation and iterative learning need beside their graphs."""
    trained = session.trained
    arm = trained.arm
    z = trained.layout.z
    return {
        "cloth": session.env.cloth.name,
        "aim": _aim(session),
        "arm": arm.name,
        "z": (z.start, z.stop),
        "memory": trained.model.initial_memory()[0].numel(),
        "lower": arm.command_lower.tolist(),
        "upper": arm.command_upper.tolist(),
        "home": arm.home_command.tolist(),
        "biases": {name: p.tolist() for name, p in trained.biases.items()},
        "spread": spread(trained.biases),
        "plans": floats(session.plans),
        "commands": {"random": _played(RandomPolicy(arm))}
        | {"operator": _played(OperatorPolicy(arm))},
        "runs": [_run(run, z) for run in session.runs],
        "images": _pixels(session.images),
        "ellipse": _ellipse(arm) if isinstance(arm, MuscleArm) else None,
        "control": asdict(ControlSettings()),
        "estimation": asdict(NewtonSettings()) | {"least": _LEAST},
        "learning": asdict(IterativeLearningSettings())
        | {"same_material": _SAME_MATERIAL},
    }


def panel_constants(session: LiveSession) -> dict[str, Any]:
    """What the page's panel shows of an arm: names and ranges, scene, plots, map."""
    panel = LivePanel(session)
    panel.step()
    axes = principal_axes(dict(session.trained.biases))
    return {
        "about": panel.about | {"arm": session.arm.name, "drivers": DRIVERS},
        "scene": any_cloth_scene(session.arm.name, session.env.cloth),
        "cloths": cloths(session.arm),
        "plots": _plots(panel.frame["traces"]),
        "plane": {"mean": axes.mean_.tolist(), "axes": axes.components_.tolist()},
        "usual_distance": session.usual_distance,
        "reachable": _REACHABLE,
    }


def as_json(about: dict[str, Any]) -> bytes:
    """Plain data as JSON, with bytes as the page unpacks them."""
    return json.dumps(about, default=_packed).encode()


def floats(values: ArrayLike) -> dict[str, str]:
    """Numbers in single precision, as the page unpacks them."""
    content = np.asarray(values, "<f4").tobytes()
    return {"floats": base64.b64encode(content).decode()}


def _packed(value: bytes) -> dict[str, str]:
    return {"bytes": base64.b64encode(value).decode()}


def _pixels(masks: ArrayLike) -> bytes:
    """Masks as the page takes them: a byte for each pixel, 0 or 1."""
    return np.asarray(masks, np.uint8).tobytes()


def _aim(session: LiveSession) -> dict[str, Any]:
    """What is aimed at first, as the graph `aim` has it."""
    aim = session.aim
    return {
        "mask": _pixels(aim.mask),
        "z": floats(aim.z),
        "reconstruction": floats(aim.reconstruction),
        "distance": float(aim.distance),
        "overlap": aim.overlap,
    }


def _played(policy: Policy) -> dict[str, str]:
    """Commands of a policy that does not heed what it sees."""
    return floats([policy({}) for _ in range(_PLAYED)])


def _run(run: Run, z: slice) -> dict[str, Any]:
    """A recording, with what was seen of it."""
    return {"material": run.material, "z": floats(run.s[:, z]), "u": floats(run.u)}


def _plots(traces: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What the plots of a run look like, and where a moment has the values of a line.

    From the traces of one step by a controller, without what it was.
    """
    places: dict[str, list[str | int]] = {
        "distance": ["distance"],
        "predicted at each step": ["predicted"],
        "f_const": ["command", len(JOINTS)],
        "step": ["milliseconds"],
    }
    for j, joint in enumerate(JOINTS):
        places |= {joint: ["theta", j], f"{joint} ref": ["command", j]}
    empty = []
    for plot in traces:
        lines = [
            {name: value for name, value in line.items() if name != "values"}
            | {"place": places[line["name"]]}
            for line in plot["lines"]
        ]
        empty.append(plot | {"lines": lines})
    return empty


def _ellipse(arm: MuscleArm) -> dict[str, Any]:
    """How far a push moves the hand, for some elbows and softnesses, 1 / f_const.

    The shoulder's angle turns the whole arm, and what moves its hand with it.
    """
    low, high = arm.tension_range
    elbows = (arm.lower[1], arm.upper[1])
    softness = (1 / high, 1 / low)

    # On a grid of both, between whose points the page interpolates
    pushes = []
    for elbow in np.linspace(*elbows, _COUNT):
        for soft in np.linspace(*softness, _COUNT):
            pushes.append(pushed_hand(arm, np.array([0, elbow]), 1 / soft))

    # With the empty axes that they are drawn into
    return {
        "link_length": arm.link_length,
        "lower": arm.lower,
        "upper": arm.upper,
        "axes": _axes(),
        "elbows": elbows,
        "softness": softness,
        "count": _COUNT,
        "pushes": floats(pushes),
    }


def pushed_hand(arm: MuscleArm, theta: np.ndarray, f_const: float) -> np.ndarray:
    """How far a push of 1 N from all around moves the hand, `[N, 2]` (forward, up) [m].

    The posture θ is `[2]` [rad], the tension of the muscles f_const [N].
    """
    pushed = []
    for angle in np.linspace(0, 2 * np.pi, _PUSHES):
        force = np.array([np.cos(angle), np.sin(angle)])
        pushed.append(arm.hand(static_posture(arm, [*theta, f_const], force)))
    return np.array(pushed) - arm.hand(theta)


def _axes() -> dict[str, Any]:
    """The empty axes of its picture: a file, their limits, and where those are there.

    `edges` are shares of the picture, from the left and from above.
    """
    figure, ((ax,),) = plots.new_axes(size=_SIZE)
    ax.set(aspect="equal", xlim=(-0.35, 1.0), ylim=(-0.75, 0.75))
    ax.set(xticks=(0, 0.5, 1), yticks=(-0.5, 0, 0.5))
    ax.set_xlabel("forward [m]", fontsize=_TEXT)
    ax.set_ylabel("up [m]", fontsize=_TEXT)
    ax.tick_params(labelsize=_TEXT)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_DPI)
    left, bottom, right, top = ax.get_position().extents
    edges = (left, right, 1 - bottom, 1 - top)
    limits = {"x": ax.get_xlim(), "y": ax.get_ylim()}
    return {"picture": file.getvalue(), "edges": edges, **limits}
