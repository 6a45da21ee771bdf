"""What is variable stiffness good for?

The paper's section "Actual Robot Experiment", on a simulated muscle arm with foams.
Three experiments vary the co-contraction of the arm, the foam whose p is estimated, and
the condition under which a foam is controlled.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import target_distance
from clothlab.method.control import ControlSettings
from clothlab.method.rollout import Policy
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.stiffness import ellipse_area, stiffness_ellipse
from clothlab.trials import Trial, recorded_plans
from studies._grid import Experiment, over
from studies._runs import (
    RECORDINGS,
    empty_distance,
    estimating,
    new_trial,
    random_trial,
    trained,
)
from studies.motion import replay

ARM = MuscleArm()
# Of the ellipses [rad]: elbow at 90 degrees, as in the paper
POSTURE = (0.0, -np.pi / 2)
TENSIONS = (10.0, 30.0, 50.0, 70.0)  # of the ellipses [N]
# As stiff at about 30 N
_SPRINGS = {
    "nonlinear": ARM,
    "linear": replace(ARM, spring_linear=5000.0, spring_cubic=0.0),
}
ESTIMATED = ("hard-1", "hard-2", "hard-3")  # from one end of the scale to the other
# What moves them meanwhile: random commands, or the paper's controller
HELD = ("hard-1", "soft-1")  # each is the wrong one for the other
# The paper's conditions
CORRECT = "Correct"
WRONG = "Wrong"
FIXED = "Correct w/o stiffness"
RANDOM = "Random"
PAPERS = (CORRECT, WRONG, FIXED, RANDOM)
# The others also try recorded commands at the start of each period
WARM = "Correct, warm start only"
CONDITIONS = (CORRECT, WRONG, FIXED, WARM, RANDOM)
_FINE = 10  # samples of the joint angles in a control step
_THRESHOLD = 0.5  # of the success rate, the paper's [s.d. of z]
# What the hand's speed may depend on, and the paper does not publish
VARIANTS: dict[str, dict[str, Any]] = {
    "as assumed": {},
    "motor speed 0.05 m/s": {"motor_speed": 0.05},
    "motor speed 0.20 m/s": {"motor_speed": 0.20},
    "hinge damping 0.5 N m s/rad": {"hinge_damping": 0.5},
    "hinge damping 2 N m s/rad": {"hinge_damping": 2.0},
}


def _push(spring: str, f_const: float) -> dict[str, Any]:
    """Stiffness ellipse of the hand at a co-contraction [N], for a push of 1 N.

    Its area [m²] and its semi-axes [m].
    """
    displacements = stiffness_ellipse(_SPRINGS[spring], POSTURE, f_const)
    lengths = np.linalg.svd(displacements, compute_uv=False)
    axes = lengths * np.sqrt(2 / len(displacements))
    return {"area": ellipse_area(displacements), "semi_axes": axes}


def _estimate_moved(
    cloth: str, model: int, weights: str = "muscle", steps: int = 150
) -> dict[str, Any]:
    """Estimate p of a foam from 0 while it is controlled, 30 s.

    Args:
        cloth: one of `ESTIMATED`, by name.
        model: seed of the training.
        weights: name of the training.
        steps: control steps.
    """
    learned = trained(f"{weights}-{model}")
    seed = 16000 + 100 * model + ESTIMATED.index(cloth)
    nothing = np.zeros(learned.model.bias_size)
    controller = learned.controller(data.load_target("muscle"), nothing)
    policy = estimating(controller, learned, nothing)
    new_trial(policy, learned.arm, cloth, steps, seed)
    trace = np.stack(policy.trace)
    p = trace[-1]

    # Where the last p lies from hard-1 (0) to hard-3 (1)
    first = learned.biases[ESTIMATED[0]]
    last = learned.biases[ESTIMATED[-1]]
    scale = last - first
    place = (p - first) @ scale / (scale @ scale)
    return {"trace": trace.round(4), "place": float(place)}


def _control_one(
    condition: str,
    cloth: str,
    model: int,
    weights: str = "muscle",
    steps: int = 125,
    fixed_tension: float = 10.0,
    speed_steps: int = 100,
) -> dict[str, Any]:
    """Distances to the target, commands and motion under one condition.

    Args:
        condition: one of the paper's, or `WARM`.
        cloth: a foam of `HELD`.
        model: seed of the training.
        weights: name of the training.
        steps: control steps; 25 s.
        fixed_tension: what "w/o stiffness" means [N].
        speed_steps: in which the hand's peak speed is looked for; 20 s.
    """
    learned = trained(f"{weights}-{model}")
    mask = data.load_target("muscle")
    if condition == RANDOM:
        trial = random_trial(learned.arm.name, cloth, steps, 17000 + model)
    else:
        policy = _controller(condition, cloth, model, weights, fixed_tension)
        trial = new_trial(policy, learned.arm, cloth, steps, model)

    # The hand's speed, where the controller knows the right p
    speeds: list[float] = []
    if condition in (CORRECT, FIXED, WARM):
        speeds = _peak_speeds(trial[:speed_steps])

    distance = target_distance(learned.autoencoder, trial, mask)
    return {
        "empty": empty_distance(learned.autoencoder, mask),
        # [T] [s.d. of z]; the first is that of the foam hanging still
        "distance": distance.round(4),
        "rate": float((distance < _THRESHOLD).mean()),
        "peak_hand_speed": speeds,
        **_motion(trial, in_full=model == 0 and condition == CORRECT),
    }


def _motion(trial: Trial, *, in_full: bool) -> dict[str, Any]:
    """How the arm comes down.

    And in full commands as sent `[T, 3]` [rad] [rad] [N] and joint angles ten times a
    step `[10 T, 2]` [rad].
    """
    theta = replay(trial, samples=_FINE).theta
    found: dict[str, Any] = {
        "fall": _falls_of_tension(trial.commands),
        "delay": _delay_of_shoulder(theta),
        "lowering": _lowering_times(theta),
        "commands": [],
        "theta": [],
    }
    if in_full:
        found["commands"] = trial.commands.round(4)
        found["theta"] = theta.round(4)
    return found


def _falls_of_tension(commands: np.ndarray) -> np.ndarray:
    """Fall of f_const while the arm comes down, in each whole period but one `[P]` [N].

    From commands `[T, 3]`. The arm begins to come down where the shoulder is highest,
    and larger angles are lower. The first period swings up.
    """
    period = ControlSettings.period
    falls = []
    for start in range(period, len(commands) - period + 1, period):
        part = commands[start : start + period]
        highest = part[:, 0].argmin()
        falls.append(part[highest, -1] - part[-1, -1])
    return np.round(falls, 3)


def _delay_of_shoulder(theta: np.ndarray) -> float:
    """How much later the shoulder moves than the elbow [s].

    It is the shift at which their speeds are most alike, of joint angles `[N, 2]`; with
    an arm that hangs still, 0.
    """
    shoulder, elbow = np.gradient(theta, axis=0).T
    reach = _FINE * 2  # at most two control steps either way
    shifts = np.arange(-reach, reach + 1)
    middle = slice(reach, len(theta) - reach)
    alike = [np.roll(elbow, shift)[middle] @ shoulder[middle] for shift in shifts]
    if not np.any(alike):
        return 0.0
    return float(shifts[np.argmax(alike)] * CONTROL_PERIOD / _FINE)


def _lowering_times(theta: np.ndarray) -> np.ndarray:
    """How long the arm takes to come down, in each whole period but one `[P]` [s].

    The range of the sum of joint angles `[N, 2]` over its highest speed downwards.
    """
    period = ControlSettings.period * _FINE
    fold = theta.sum(axis=1)
    speed = np.gradient(fold, CONTROL_PERIOD / _FINE)
    times = []
    for start in range(period, len(fold) - period + 1, period):
        part = slice(start, start + period)
        times.append(np.ptp(fold[part]) / max(speed[part].max(), 1e-9))
    return np.round(times, 4)


def _recorded_starts(model: int) -> np.ndarray:
    """Recorded plans with which a period may begin `[200, 8, 3]`."""
    return recorded_plans(data.load_trials(RECORDINGS["muscle"]), seed=model)


def _peak_speeds(trial: Trial) -> list[float]:
    """Peak speeds of the hand if the arm were another one, by `VARIANTS` [m/s]."""
    speeds = []
    for change in VARIANTS.values():
        watch = replay(trial, arm=replace(ARM, **change))
        speeds.append(float(watch.hand_speed.max()))
    return speeds


def _controller(
    condition: str, cloth: str, model: int, weights: str, fixed_tension: float
) -> Policy:
    """The controller of one condition, for a foam of `HELD`."""
    learned = trained(f"{weights}-{model}")
    mask = data.load_target("muscle")
    told = cloth
    if condition == WRONG:
        told = next(each for each in HELD if each != cloth)
    plans = None
    if condition != WARM:
        plans = _recorded_starts(model)
    arm = learned.arm
    if condition == FIXED:
        arm = arm.with_stiffness(fixed_tension)
    return learned.controller(mask, told, plans=plans, arm=arm)


def rates(table: pd.DataFrame, share: float) -> pd.DataFrame:
    """Share of steps that are nearer than a threshold, mean of both foams.

    A row for each world, or each training where there is one world, and a column for
    each condition.

    Args:
        table: rows of `foam_control`.
        share: the threshold, over the distance of the hanging foam.
    """
    unit = "world" if "world" in table else "model"
    near = [np.mean(each[1:] < share * each[0]) for each in table["distance"]]
    return table.assign(near=near).pivot_table("near", unit, "condition")


def speed_gains(table: pd.DataFrame) -> np.ndarray:
    """What optimised stiffness gains in peak hand speed, `[units, variants]`.

    The mean speed of both foams with it over that without, minus one. A unit is a
    world, or a training where there is one world.
    """
    unit = "world" if "world" in table else "model"
    speeds = {}
    for condition in (CORRECT, FIXED):
        runs = table[table["condition"] == condition]
        by_unit = runs.groupby(unit)["peak_hand_speed"]
        speeds[condition] = np.stack([np.mean([*each], axis=0) for _, each in by_unit])
    return speeds[CORRECT] / speeds[FIXED] - 1


_PAPER = {"weights": "muscle-paper"}
_MODELS = range(5)
EXPERIMENTS = (
    Experiment("stiffness_ellipse", _push, over(spring=_SPRINGS, f_const=TENSIONS)),
    Experiment(
        "foam_estimation",
        _estimate_moved,
        over(cloth=ESTIMATED, model=_MODELS),
        paper=_PAPER,
    ),
    Experiment(
        "foam_control",
        _control_one,
        over(condition=CONDITIONS, cloth=HELD, model=_MODELS),
        paper=_PAPER,
    ),
)
