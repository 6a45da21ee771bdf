"""What the method of the live lab in a page knows beside its graphs, as JSON."""

import base64
import json
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import HEIGHT, WIDTH
from clothlab.lab._equipment import Equipment
from clothlab.method import _drawable
from clothlab.method.control import ControlSettings
from clothlab.method.gauss_newton import NewtonSettings
from course.lab_export import graphs


def method_files(arm: str) -> dict[str, bytes]:
    """All that the page needs of the method for an arm, by name.

    Graphs, their weights, and `constants`.
    """
    equipment = Equipment.of(arm)
    about = json.dumps(constants(equipment)).encode()
    return graphs(equipment.trained) | {"constants": about}


def constants(equipment: Equipment) -> dict[str, Any]:
    """What the page's method needs beside its graphs, as JSON takes it."""
    trained = equipment.trained
    arm = trained.arm
    layout = trained.layout
    return {
        "arm": arm.name,
        "cloth": equipment.setup.cloth,
        "target": equipment.setup.target,
        "z": (layout.z.start, layout.z.stop),
        "memory": trained.model.initial_memory()[0].numel(),
        "lower": arm.command_lower.tolist(),
        "upper": arm.command_upper.tolist(),
        "home": arm.home_command.tolist(),
        "biases": {name: p.tolist() for name, p in trained.biases.items()},
        "control": asdict(ControlSettings()),
        "estimation": asdict(NewtonSettings()),
        "plans": _floats(equipment.plans),
        "size": (HEIGHT, WIDTH),
        "images": _bits(equipment.images),
        "gallery": {name: _bits(mask) for name, mask in equipment.gallery.items()},
        "usual_distance": equipment.usual_distance,
        "cannot_draw": _drawable._CANNOT_DRAW,
    }


def _floats(values: ArrayLike) -> str:
    """Numbers in single precision, as base64."""
    return _base64(np.asarray(values, "<f4"))


def _bits(masks: np.ndarray) -> str:
    """A mask `[H, W]` or several, a bit for each pixel, as base64."""
    return _base64(np.packbits(masks))


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
