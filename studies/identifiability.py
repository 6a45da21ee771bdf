"""How well can C_damp and C_mass of a cloth be known from what the robot senses?

The same commands are sent to scenes whose cloths differ in one constant by a factor
exp(±0.05). The differences of what is sensed are its sensitivities, and the Cramér-Rao
bound follows from them: that of an observer who knows all of the simulator but the two
constants. What varies is the cloth and the motion.

The noise of z is measured: each scene is run four times with a camera that is turned by
parts of a pixel and commands that are disturbed by 1e-6 rad, and what scatters beyond
what is proportional to the turn is noise. Joint states are exact in the simulator, so
their noise is stated. "z as predicted" has the network's one-step prediction error for
its noise: the bound of an observer who knows no better than the network how a cloth
moves.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import ArrayLike

from clothlab import data
from clothlab._validation import HEIGHT, choose
from clothlab.method.autoencoder import encode
from clothlab.method.estimation import EstimationSettings
from clothlab.policies import OperatorPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import Arm, Camera, TorqueArm
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.trials import Trial, rollout
from studies._grid import Experiment, over
from studies._runs import EVALUATION, trained
from studies.estimation import BETWEEN
from studies.fisher import Noise, cramer_rao, unbiased_information

_WEIGHTS = "torque-0"  # whose autoencoder sees
_TIMES = np.array([1, 2, 3, 5, 7, 10, 14, 20, 28, 40], dtype=float)  # [s]
_MOTIONS = {"random": RandomPolicy, "operator": OperatorPolicy}
_CONSTANTS = ("damping", "mass")  # F is about their logarithms
QUANTITIES = {
    "C_damp": (1, 0),
    "C_mass": (0, 1),
    "C_damp / C_mass": (1, -1),
    "C_damp · C_mass": (1, 1),
}
PREDICTED = "z as predicted"  # by the network
_SENSOR_SETS = {"z": ("z",), "z + joints": ("z", "joints"), PREDICTED: (PREDICTED,)}
# Angles as of an encoder of 12 bits, whose rounding has a standard deviation of
# 2π/4096/√12; velocities as of a difference of angles, filtered.
_JOINT_NOISE = [5e-4, 5e-4, 0.02, 0.02]  # [rad] [rad/s]
_STEP = 0.05  # half the difference of the logarithms
_REPEATS = 4  # of each scene: a mean and two slopes are fitted
_TURN = 0.5  # of the camera, at most [pixel]
_DISTURBANCE = 1e-6  # [rad] of start and commands
# Share of the best direction's information below which a measured one counts as none
_LEAST = 1e-5


def vary(cloth: Cloth, constant: str, step: float) -> Cloth:
    """The cloth with one constant, `damping` or `mass`, multiplied by exp(step)."""
    return replace(cloth, **{constant: getattr(cloth, constant) * np.exp(step)})


def _run_one(cloth: str, motion: str, seed: int, steps: int = 200) -> dict[str, Any]:
    """Fisher information of the logarithms in each sensor, and the noise of z.

    The information is that of all steps up to each of `_TIMES`, `[N, 2, 2]`.
    """
    arm = TorqueArm()
    held = (CLOTHS | BETWEEN)[cloth]

    # Commands, which do not depend on what is seen
    mover = _MOTIONS[motion](arm)
    mover.reset(seed)
    moves = [mover({}) for _ in range(steps)]
    commands = np.array([*moves, moves[-1]])

    # What each repeat senses of each of its four scenes
    turns = []
    z = []
    joints = []
    for repeat in range(_REPEATS):
        rng = np.random.default_rng(repeat)
        turn = rng.uniform(-_TURN, _TURN, 2)
        turns.append(turn)
        for trial in _varied_trials(arm, held, commands, turn, rng, repeat):
            # After each command: the first look is before the first
            z.append(encode(trained(_WEIGHTS).autoencoder, trial.images[1:]))
            joints.append(trial.robot[1:])

    # Sensitivities and noise of each sensor
    slopes, noise = _slopes_and_noise(z, np.array(turns))
    of_joints = _slopes_and_noise(joints, np.array(turns), _JOINT_NOISE)
    f_of = {
        "z": unbiased_information(slopes, noise),
        PREDICTED: unbiased_information(slopes, _prediction_noise()),
        "joints": unbiased_information(*of_joints),
    }

    times = _TIMES[steps * CONTROL_PERIOD + 1e-9 >= _TIMES]
    index = np.round(times / CONTROL_PERIOD).astype(int) - 1
    found = {sensor: f[index].round(3) for sensor, f in f_of.items()}
    return {"time": times, **found, "noise": noise.deviations}


def _varied_trials(
    arm: Arm,
    held: Cloth,
    commands: np.ndarray,
    turn: np.ndarray,
    rng: np.random.Generator,
    repeat: int,
) -> Iterator[Trial]:
    """Runs with less and with more of each constant, all disturbed in the same way."""
    # A scene that differs by almost nothing
    camera = _turned(arm.camera, *turn)
    home = tuple(arm.home + rng.normal(0, _DISTURBANCE, len(arm.home)))

    # Commands that do
    disturbed = commands.copy()
    angles = disturbed[:, arm.angle_command]
    rng_of_commands = np.random.default_rng([repeat, 1])
    angles += rng_of_commands.normal(0.0, _DISTURBANCE, angles.shape)
    policy = ReplayPolicy(np.clip(disturbed, arm.command_lower, arm.command_upper))

    with closing(ClothEnv(replace(arm, camera=camera, home=home), held)) as env:
        for constant in _CONSTANTS:
            for sign in (-1, 1):
                env.hold(vary(held, constant, sign * _STEP))
                yield rollout(env, policy, len(commands), seed=repeat)


def _turned(camera: Camera, across: float, up: float) -> Camera:
    """The camera turned by parts of a pixel of its image."""
    distance = np.linalg.norm(np.subtract(camera.target, camera.position))
    focal_length = 0.5 * HEIGHT / np.tan(np.deg2rad(camera.fovy) / 2)  # [pixel]
    pixel = distance / focal_length  # [m] at the target
    moved = camera.target + pixel * np.array([across, up]) @ camera.axes[:2]
    return replace(camera, target=tuple(moved))


def _slopes_and_noise(
    runs: list[np.ndarray], turns: np.ndarray, stated: ArrayLike = 0.0
) -> tuple[np.ndarray, Noise]:
    """Sensitivities of a sensor in each repeat `[R, T, D, 2]`, and its noise.

    From what it sensed in all runs, as `_varied_trials` gives them `[T, D]`.
    """
    values = np.array(runs, np.float64)
    values = values.reshape(_REPEATS, len(_CONSTANTS), 2, *values.shape[1:])
    values = np.moveaxis(values, 0, 2)  # [2 constants, 2 signs, R, T, D]

    scenes = values.reshape(-1, *values.shape[2:])
    noise = Noise.measured(_residuals(scenes, turns), stated)
    less = values[:, 0]
    more = values[:, 1]
    return np.moveaxis(more - less, 0, -1) / (2 * _STEP), noise


def _residuals(repeats: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """What scatters beyond what is proportional to the turns, `[S R, T, D]`.

    Of repeats `[S, R, T, D]` with turns `[R, 2]`. It is enlarged for what the means and
    the slopes have fitted.
    """
    count = len(turns)
    fitted = np.column_stack([np.ones(count), turns])
    rest = np.eye(count) - fitted @ np.linalg.pinv(fitted)
    residuals = np.tensordot(rest, repeats, axes=(1, 1)).swapaxes(0, 1)
    left = count - np.linalg.matrix_rank(fitted)
    return np.sqrt(count / left) * residuals.reshape(-1, *repeats.shape[2:])


@cache
def _prediction_noise() -> Noise:
    """How far the network's z, a step ahead, is from what comes, with the right p."""
    learned = trained(_WEIGHTS)
    errors = []
    for trial in data.load_trials(EVALUATION["torque"]):
        run = learned.to_run(trial)
        s = torch.as_tensor(run.s)
        u = torch.as_tensor(run.u)
        p = torch.as_tensor(learned.biases[trial.cloth.name])
        with torch.no_grad():
            predicted, _ = learned.model(s[None, :-1], u[None, :-1], p[None])
        missed = predicted[0] - s[1:]
        errors.append(missed[EstimationSettings.warmup :, learned.layout.z].numpy())
    shortest = min(map(len, errors))
    return Noise.measured(np.array([each[:shortest] for each in errors], np.float64))


def information(table: pd.DataFrame, sensors: str) -> np.ndarray:
    """F in one of `_SENSOR_SETS` `[rows, N, 2, 2]`.

    It is a sum, since the noises of sensors are independent.
    """
    together = choose("set of sensors", sensors, _SENSOR_SETS)
    return np.sum([np.stack([*table[sensor]]) for sensor in together], axis=0)


def bounds(table: pd.DataFrame, sensors: str) -> pd.DataFrame:
    """Cramér-Rao bounds: the least standard deviation of each logarithm.

    A row for each row of the table and each time, with `cloth`, `motion`, `seed`,
    `time` [s] and `QUANTITIES`; infinite if unknown.
    """
    combinations = [*QUANTITIES.values()]
    f = information(table, sensors)
    found = cramer_rao(f, combinations, tolerance=_LEAST)  # [rows, N, 4]

    keys = table[["cloth", "motion", "seed"]]
    long = keys.loc[keys.index.repeat(found.shape[1])].reset_index(drop=True)
    long["time"] = np.concatenate([*table["time"]])
    long[[*QUANTITIES]] = found.reshape(-1, len(QUANTITIES))
    return long


_CASES = over(cloth=(*CLOTHS, *BETWEEN), motion=_MOTIONS, seed=(7000, 7001, 7002))
EXPERIMENTS = (Experiment("identifiability", _run_one, _CASES, slow=True),)
