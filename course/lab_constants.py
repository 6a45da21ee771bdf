"""What the method of the live lab in a page knows beside its graphs, as JSON."""

import base64
import io
import json
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from clothlab._certainty import SHARE, radius
from clothlab.analysis import spread
from clothlab.lab._equipment import Equipment
from clothlab.lab._pictures import ellipse_axes, pixels, pushed_hand
from clothlab.lab._targets import Aim
from clothlab.lab._tracker import _REPORT_EVERY, _calibration
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.gauss_newton import NewtonSettings
from clothlab.method.iterative import _SAME_MATERIAL, IterativeLearningSettings
from clothlab.method.rollout import Policy
from clothlab.policies import OperatorPolicy, RandomPolicy
from clothlab.simulation.arm import MuscleArm
from course.lab_estimation import Calibrated
from course.lab_export import graphs

# Along a side of the grid on which the stiffness of a hand is known
_COUNT = 9
# Of the picture of it in the page
_SIZE = (4.5, 4.8167)  # [inch]
_DPI = 120

# Steps of commands that are played where no network chooses them
_PLAYED = 2000


def method_files(equipment: Equipment) -> dict[str, bytes]:
    """All that the page needs of the method for an arm, by name.

    Graphs, their weights, and `constants`.
    """
    about = {"constants": as_json(constants(equipment))}
    return graphs(equipment.trained, calibrated(equipment)) | about


def constants(equipment: Equipment) -> dict[str, Any]:
    """What the page's method needs beside its graphs, as JSON takes it."""
    setup = equipment.setup
    first = {"cloth": setup.cloth, "aim": _aim(equipment.first_aim())}
    known = calibrated(equipment)._asdict()
    calibration = {name: each.flatten().tolist() for name, each in known.items()}
    robot = _robot(equipment) | _settings()
    return first | robot | {"calibration": calibration}


def _robot(equipment: Equipment) -> dict[str, Any]:
    """The arm, its materials, and what was recorded with it."""
    trained = equipment.trained
    arm = trained.arm
    z = trained.layout.z
    return {
        "arm": arm.name,
        "z": (z.start, z.stop),
        "memory": trained.model.initial_memory()[0].numel(),
        "lower": arm.command_lower.tolist(),
        "upper": arm.command_upper.tolist(),
        "home": arm.home_command.tolist(),
        "biases": {name: p.tolist() for name, p in trained.biases.items()},
        "spread": spread(trained.biases),
        "plans": floats(equipment.plans),
        "commands": {"random": _played(RandomPolicy(arm))}
        | {"operator": _played(OperatorPolicy(arm))},
        "runs": [_run(run, z) for run in equipment.runs],
        "images": pixels(equipment.images),
        "ellipse": _ellipse(arm) if isinstance(arm, MuscleArm) else None,
    }


def _played(policy: Policy) -> dict[str, str]:
    """Commands of a policy that does not heed what it sees."""
    return floats([policy({}) for _ in range(_PLAYED)])


def _aim(aim: Aim) -> dict[str, Any]:
    """What is aimed at, as the graph `aim` has it."""
    return {
        "mask": pixels(aim.mask),
        "z": floats(aim.z),
        "reconstruction": floats(aim.reconstruction),
        "distance": float(aim.distance),
        "overlap": aim.overlap,
    }


def _settings() -> dict[str, dict[str, Any]]:
    """The constants of control, estimation and iterative learning."""
    estimation = {"report_every": _REPORT_EVERY}
    learning = {"same_material": _SAME_MATERIAL}
    return {
        "control": asdict(ControlSettings()),
        "estimation": asdict(NewtonSettings()) | estimation,
        "learning": asdict(IterativeLearningSettings()) | learning,
    }


def _run(run: Run, z: slice) -> dict[str, Any]:
    """A recording, with what was seen of it."""
    return {"material": run.material, "z": floats(run.s[:, z]), "u": floats(run.u)}


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
        posture = np.array([0, elbow])
        soft_ones = np.linspace(*softness, _COUNT)
        pushes.append([pushed_hand(arm, posture, 1 / soft) for soft in soft_ones])

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


def _axes() -> dict[str, Any]:
    """The empty axes of its picture: a file, their limits, and where those are there.

    `edges` are shares of the picture, from the left and from above.
    """
    figure = ellipse_axes(_SIZE)
    (ax,) = figure.axes
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_DPI)
    left, bottom, right, top = ax.get_position().extents
    edges = (left, right, 1 - bottom, 1 - top)
    limits = {"x": ax.get_xlim(), "y": ax.get_ylim()}
    return {"picture": file.getvalue(), "edges": edges, **limits}


def calibrated(equipment: Equipment) -> Calibrated:
    """What a report on an estimate rests on."""
    setup = equipment.setup
    found = _calibration(setup.weights, setup.known).result()
    numbers = {name: getattr(found, name) for name in Calibrated._fields[:-1]}
    numbers["radius"] = radius(SHARE, found.biases.shape[1])
    tensors = (torch.as_tensor(each, dtype=torch.float64) for each in numbers.values())
    return Calibrated(*tensors)


def as_json(about: dict[str, Any]) -> bytes:
    """Plain data as JSON, with bytes as the page unpacks them."""
    return json.dumps(about, default=_packed).encode()


def _packed(value: bytes) -> dict[str, str]:
    return {"bytes": base64.b64encode(value).decode()}


def floats(values: ArrayLike) -> dict[str, str]:
    """Numbers in single precision, as the page unpacks them."""
    content = np.asarray(values, "<f4").tobytes()
    return {"floats": base64.b64encode(content).decode()}
