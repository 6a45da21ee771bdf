"""What does a moved camera cost, and how much of it does recalibration bring back?

p is estimated from what a camera sees. What varies is where the camera has been moved,
and whether the robot has recalibrated it (`studies.recalibration`).
"""

from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from clothlab.analysis import nearest_material
from clothlab.method.gauss_newton import estimate_bias
from clothlab.policies import RandomPolicy
from clothlab.simulation._arm_data import get_arm
from clothlab.simulation.arm import Camera
from clothlab.simulation.cloth import CLOTHS
from clothlab.simulation.env import ClothEnv
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import new_trial, trained
from studies.recalibration import Recalibration, recalibrate, take_views

_ARM = "torque"  # of the arm five trainings
_SHIFT = 0.05  # [m] of the camera
_TURN = 3.0  # [degree]
_DRAWS = (0, 1, 2)  # numbers of the drawn directions


def _moved(camera: Camera, draw: int | None) -> Camera:
    """The camera shifted and turned with the draw of that number; None: as it was."""
    if draw is None:
        return camera
    rng = np.random.default_rng(53_000 + int(draw))
    directions = rng.normal(size=(2, 3))
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    shift, turn = directions * ([[_SHIFT], [_TURN]] / lengths)
    return camera.moved(shift, turn)


@cache
def _recalibration(draw: int | None) -> Recalibration:
    arm = get_arm(_ARM)
    with closing(ClothEnv(replace(arm, camera=_moved(arm.camera, draw)))) as env:
        return recalibrate(arm, take_views(env))


def _estimate(
    draw: int | None, recalibrated: bool, model: int, cloth: str, steps: int = 200
) -> dict[str, Any]:
    """Estimate p from what a moved camera sees: the material of the nearest trained p.

    Args:
        draw: number of the drawn directions; None: the camera is where it was.
        recalibrated: whether images are warped to what it would have seen from there.
        model: seed of the training.
        cloth: in the hand, by name.
        steps: of random commands.
    """
    learned = trained(f"{_ARM}-{model}")
    arm = replace(learned.arm, camera=_moved(learned.arm.camera, draw))
    seed = 50_000 + 20 * model + [*CLOTHS].index(cloth)  # the same for every pose
    trial = new_trial(RandomPolicy(arm), arm, cloth, steps, seed)
    if recalibrated:
        trial = _recalibration(draw).trial(trial)
    p, _ = estimate_bias(learned.model, learned.to_run(trial), method="newton")
    return {"nearest": nearest_material(p, learned.biases)}


def _rows(tables: Tables) -> list[Row]:
    """Moved cameras over the unmoved one."""
    table = tables["camera_estimation"]
    right = table["nearest"] == table["cloth"]
    moved = table["draw"].notna()
    rate = right.groupby([moved, table["recalibrated"]]).mean()
    unmoved = rate[False, False]
    recalibrated = Row(
        "camera_estimation",
        f"camera off by {_TURN:g}° and {100 * _SHIFT:g} cm, recalibrated: right "
        "material, over the unmoved one",
        float(rate[True, True] / unmoved),
        at_least=0.9,
    )
    as_it_is = Row(
        "camera_estimation/as-it-is",
        "the same without recalibration",
        float(rate[True, False] / unmoved),
    )
    return [recalibrated, as_it_is]


_ABOUT = """
What does a moved camera cost, and how much of it does recalibration bring back?

A camera is moved by 5 cm and turned by 3 degrees in directions drawn at random, and p
is estimated from what it sees. The method is `studies.recalibration`.
"""
_CASES = over(
    model=range(5), cloth=CLOTHS, draw=(None, *_DRAWS), recalibrated=(False, True)
)
EXPERIMENTS = (
    Experiment(
        "camera_estimation",
        _estimate,
        _CASES,
        seconds=6,
        slow=True,
        rows=_rows,
        about=_ABOUT,
    ),
)
