"""What the method of the live lab in a page knows beside its graphs, as JSON."""

import base64
import json
from dataclasses import asdict
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab._certainty import SHARE, radius
from clothlab._validation import HEIGHT, WIDTH
from clothlab.lab._equipment import Equipment
from clothlab.lab._pictures import pushed_hand
from clothlab.lab._tracker import _REPORT_EVERY, _calibration
from clothlab.method import _drawable
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.gauss_newton import Linearisation, NewtonSettings
from clothlab.method.iterative import _SAME_MATERIAL, IterativeLearningSettings
from clothlab.simulation.arm import MuscleArm
from course.lab_export import graphs

# Of the grid on which the stiffness of a hand is known
_ELBOWS = 9
_SOFTNESSES = 9


def method_files(equipment: Equipment) -> dict[str, bytes]:
    """All that the page needs of the method for an arm, by name.

    Graphs, their weights, and `constants`.
    """
    about = json.dumps(constants(equipment)).encode()
    return graphs(equipment.trained) | {"constants": about}


def constants(equipment: Equipment) -> dict[str, Any]:
    """What the page's method needs beside its graphs, as JSON takes it."""
    setup = equipment.setup
    first = {"cloth": setup.cloth, "target": setup.target}
    known = _robot(equipment) | _settings() | _images(equipment)
    return first | known | {"calibration": _calibrated(equipment)}


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
        "plans": _floats(equipment.plans),
        "runs": [_run(run, z) for run in equipment.runs],
        "ellipse": _ellipse(arm) if isinstance(arm, MuscleArm) else None,
    }


def _settings() -> dict[str, dict[str, Any]]:
    """The constants of control, estimation and iterative learning."""
    lag = signature(Linearisation.covariance).parameters["lag"].default
    estimation = {"lag": lag, "report_every": _REPORT_EVERY}
    learning = {"same_material": _SAME_MATERIAL}
    return {
        "control": asdict(ControlSettings()),
        "estimation": asdict(NewtonSettings()) | estimation,
        "learning": asdict(IterativeLearningSettings()) | learning,
    }


def _images(equipment: Equipment) -> dict[str, Any]:
    """Images to aim at, and to judge a target by."""
    return {
        "size": (HEIGHT, WIDTH),
        "images": _bits(equipment.images),
        "gallery": {name: _bits(mask) for name, mask in equipment.gallery.items()},
        "usual_distance": equipment.usual_distance,
        "cannot_draw": _drawable._CANNOT_DRAW,
    }


def _run(run: Run, z: slice) -> dict[str, str]:
    """A recording, with what was seen of it."""
    return {"material": run.material, "z": _floats(run.s[:, z]), "u": _floats(run.u)}


def _ellipse(arm: MuscleArm) -> dict[str, Any]:
    """How far a push moves the hand, for some elbows and softnesses, 1 / f_const.

    The shoulder's angle turns the whole arm, and what moves its hand with it.
    """
    low, high = arm.tension_range
    elbows = np.linspace(arm.lower[1], arm.upper[1], _ELBOWS)
    softness = np.linspace(1 / high, 1 / low, _SOFTNESSES)
    pushes = [
        [pushed_hand(arm, np.array([0, elbow]), 1 / soft) for soft in softness]
        for elbow in elbows
    ]
    grid = {"elbows": elbows.tolist(), "softness": softness.tolist()}
    return grid | {"pushes": _floats(pushes)}


def _calibrated(equipment: Equipment) -> dict[str, Any]:
    """What a report on an estimate rests on."""
    setup = equipment.setup
    found = _calibration(setup.weights, setup.known).result()
    numbers = {
        name: np.asarray(value).tolist() for name, value in asdict(found).items()
    }
    about = {"sides": found.sides.tolist(), "reach": found.reach}
    return numbers | about | {"radius": radius(SHARE, found.biases.shape[1])}


def _floats(values: ArrayLike) -> str:
    """Numbers in single precision, as base64."""
    return _base64(np.asarray(values, "<f4"))


def _bits(masks: np.ndarray) -> str:
    """A mask `[H, W]` or several, a bit for each pixel, as base64."""
    return _base64(np.packbits(masks))


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
