"""What does a moved camera cost, and how much of it does recalibration bring back?

A camera is moved by some centimetres along its own axes or turned by some degrees about them, one at a time, and both
at once in directions drawn at random. Everything is judged from the old pose: the same run is simulated again with the
camera there. The method is `clothlab.experiments.recalibration`.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab.analysis import best_per_period, late_median, nearest_material, target_distance
from clothlab.experiments._grid import Case, Experiment, Tables, over
from clothlab.experiments._rows import Row
from clothlab.experiments._runs import HEAVY, LIGHT, new_trial, trained
from clothlab.experiments.iterative_control import CONTROLLERS, ITERATIVE, PAPERS
from clothlab.experiments.recalibration import RecalibratedPolicy, Recalibration, recalibrate, take_views
from clothlab.learning.estimation import NewtonSettings, estimate_bias
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import Camera, get_arm
from clothlab.simulation.cloth import CLOTHS
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import HEIGHT

_ARM, _TARGET = "torque", "target-2"  # of the arm five trainings
UNMOVED, BOTH = "unmoved", "both"
_SHIFTS, _TURNS = ("right", "up", "backward"), ("pitch", "yaw", "roll")  # along and about the camera's own axes
_BOTH_SHIFT, _BOTH_TURN, _DRAWS = 0.05, 3.0, (0.0, 1.0, 2.0)  # [m] [degree], and numbers of the drawn directions
_POSES = [
    (UNMOVED, 0.0),
    *product(_SHIFTS, (0.01, 0.05, 0.2)),  # [m]
    *product(_TURNS, (1.0, 3.0, 10.0)),  # [degree]
    *product([BOTH], _DRAWS),
]


def _moved(camera: Camera, direction: str, size: float) -> Camera:
    """The camera in one of `_POSES`: moved by a size [m] or [degree], or in both ways with the draw of that number."""
    if direction == UNMOVED:
        return camera
    if direction == BOTH:
        drawn = np.random.default_rng(53_000 + int(size)).normal(size=(2, 3))
        return camera.moved(*drawn * ([[_BOTH_SHIFT], [_BOTH_TURN]] / np.linalg.norm(drawn, axis=1, keepdims=True)))
    shift, turn = ([size * (name == direction) for name in names] for names in (_SHIFTS, _TURNS))
    return camera.moved(shift, turn)


@cache
def _recalibration(direction: str, size: float) -> Recalibration:
    arm = get_arm(_ARM)
    with closing(ClothEnv(replace(arm, camera=_moved(arm.camera, direction, size)))) as env:
        return recalibrate(arm, take_views(env))


def _find_pose(direction: str, size: float) -> dict[str, Any]:
    """How well the camera's pose is found: residual [pixel], error of the position [m] and of the turn [degree]."""
    found, right = _recalibration(direction, size), _moved(get_arm(_ARM).camera, direction, size)
    cosine = (np.trace(found.camera.axes @ right.axes.T) - 1) / 2
    return {
        "residual": found.residual * HEIGHT,
        "shift_error": float(np.linalg.norm(np.subtract(found.camera.position, right.position))),
        "turn_error": float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))),
    }


def _estimate(
    direction: str, size: float, recalibrated: bool, model: int, cloth: str, steps: int = 200
) -> dict[str, Any]:
    """Estimate p of one cloth from what the moved camera sees: the material whose trained p is nearest."""
    learned = trained(f"{_ARM}-{model}")
    arm = replace(learned.arm, camera=_moved(learned.arm.camera, direction, size))
    seed = 50_000 + 20 * model + [*CLOTHS].index(cloth)  # the same for every pose
    trial = new_trial(RandomPolicy(arm), arm, cloth, steps, seed)
    if recalibrated:
        trial = _recalibration(direction, size).trial(trial)
    p, _ = estimate_bias(learned.model, learned.sequences(trial), settings=NewtonSettings())
    return {"nearest": nearest_material(p, learned.biases)}


def _control(
    direction: str, size: float, recalibrated: bool, controller: str, model: int, cloth: str, steps: int = 200
) -> dict[str, Any]:
    """Aim with the moved camera: best distance of each period but the first, from the old pose [s.d. of z]."""
    learned, mask = trained(f"{_ARM}-{model}"), artifacts.load_target(_TARGET)
    arm = replace(learned.arm, camera=_moved(learned.arm.camera, direction, size))
    policy = CONTROLLERS[controller](learned, mask, cloth, model, learned.biases[cloth])
    if recalibrated:
        policy = RecalibratedPolicy(policy, _recalibration(direction, size))
    trial = new_trial(policy, arm, cloth, steps, model)
    if arm != learned.arm:
        trial = new_trial(ReplayPolicy(trial.commands), learned.arm, cloth, steps, model)
    return {"best": best_per_period(target_distance(learned.autoencoder, trial, mask)).round(4)}


def _cases(**axes: Any) -> Callable[..., list[Case]]:
    """A grid with the unmoved camera and with those shifted and turned at once, as they are and recalibrated."""
    every = over(**axes, direction=(UNMOVED, BOTH), size=_DRAWS, recalibrated=(False, True))
    return lambda **sizes: [case for case in every(**sizes) if case["direction"] == BOTH or case["size"] == 0]


def _rows(tables: Tables) -> list[Row]:
    """Cameras shifted and turned at once, over the unmoved one."""
    estimates, runs, where = tables["camera_estimation"], tables["camera_control"], ["direction", "recalibrated"]
    found = runs.assign(last=runs.best.map(late_median)).pivot_table("last", where, "controller", sort=False)
    measures = {"nearest": "nearest-material rate"} | {name: f"{name}, {_TARGET}, last ten periods" for name in found}
    found["nearest"] = (estimates.nearest == estimates.cloth).groupby([estimates[key] for key in where]).mean()
    over_unmoved = (found / found.loc[UNMOVED, False]).loc[BOTH]
    camera = f"camera off by {_BOTH_TURN:g}° and {100 * _BOTH_SHIFT:g} cm, recalibrated"
    return [
        Row(
            f"camera_control/{column}",
            f"{camera}: {measure} over the unmoved camera's",
            over_unmoved.loc[True, column],
            at_least=0.9 if column == "nearest" else None,
            at_most=None if column == "nearest" else 1.1,
            note=f"as it is {over_unmoved.loc[False, column]:.2f}",
        )
        for column, measure in measures.items()
    ]


def _poses() -> list[Case]:
    return [{"direction": direction, "size": size} for direction, size in _POSES]


_ESTIMATED = _cases(model=range(5), cloth=CLOTHS)
_CONTROLLED = _cases(controller=(PAPERS, ITERATIVE), model=range(3), cloth=(LIGHT, HEAVY))
EXPERIMENTS = (
    Experiment("camera_pose", _find_pose, _poses, seconds=3),
    Experiment("camera_estimation", _estimate, _ESTIMATED, seconds=6, slow=True),
    Experiment("camera_control", _control, _CONTROLLED, seconds=40, slow=True, rows=_rows),
)
