"""What does a moved camera cost, and how much of it does recalibration bring back?

A camera is moved by 5 cm and turned by 3 degrees in directions drawn at random, and p
is estimated from what it sees. The method is `studies.recalibration`.
"""

from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from clothlab.analysis import nearest_material
from clothlab.method.estimation import estimate_bias
from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import Camera, get_arm
from clothlab.simulation.cloth import CLOTHS
from clothlab.simulation.env import ClothEnv
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import new_trial, trained
from studies.recalibration import Recalibration, recalibrate, take_views

_ARM = "torque"  # of the arm five trainings
# [m] [degree], and numbers of the drawn directions
_SHIFT, _TURN, _DRAWS = (0.05, 3.0, (0, 1, 2))


def _moved(camera: Camera, draw: int | None) -> Camera:
    """The camera shifted and turned with the draw of that number; None: as it was."""
    if draw is None:
        return camera
    drawn = np.random.default_rng(53_000 + int(draw)).normal(size=(2, 3))
    return camera.moved(
        *drawn * ([[_SHIFT], [_TURN]] / np.linalg.norm(drawn, axis=1, keepdims=True))
    )


@cache
def _recalibration(draw: int | None) -> Recalibration:
    arm = get_arm(_ARM)
    with closing(ClothEnv(replace(arm, camera=_moved(arm.camera, draw)))) as env:
        return recalibrate(arm, take_views(env))


def _estimate(
    draw: int | None, recalibrated: bool, model: int, cloth: str, steps: int = 200
) -> dict[str, Any]:
    """Estimate p of one cloth from what the moved camera sees: the material whose
    trained p is nearest.
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
    table = tables["camera_estimation"].fillna({"draw": -1})
    rate = (
        (table["nearest"] == table["cloth"])
        .groupby([table["draw"] >= 0, table["recalibrated"]])
        .mean()
    )
    label = f"camera off by {_TURN:g}° and {100 * _SHIFT:g} cm, recalibrated: right material, over the unmoved one"
    note = f"as it is {rate[True, False] / rate[False, False]:.2f}"
    value = float(rate[True, True] / rate[False, False])
    return [Row("camera_estimation", label, value, at_least=0.9, note=note)]


_CASES = over(
    model=range(5), cloth=CLOTHS, draw=(None, *_DRAWS), recalibrated=(False, True)
)
EXPERIMENTS = (
    Experiment(
        "camera_estimation", _estimate, _CASES, seconds=6, slow=True, rows=_rows
    ),
)
