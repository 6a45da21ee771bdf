"""How well can C_damp and C_mass of a cloth be known from what the robot senses?

The same commands are sent to scenes whose cloths differ in one constant by a factor
exp(±0.05). The differences of what is sensed are its sensitivities, and the Cramér-Rao
bound follows from them: that of an observer who knows all of the simulator but the two
constants.

The noise of z is measured: each scene is run four times with a camera that is turned by
parts of a pixel and commands that are disturbed by 1e-6 rad, and what scatters beyond
what is proportional to the turn is noise. Joint states are exact in the simulator, so
their noise is stated. "z as predicted" has the network's one-step prediction error for
its noise: the bound of an observer who knows no better than the network how a cloth
moves.
"""

from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import ArrayLike

from clothlab import data
from clothlab._validation import choose
from clothlab.masks import HEIGHT
from clothlab.method.autoencoder import encode
from clothlab.method.estimation import EstimationSettings
from clothlab.policies import OperatorPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import Camera, TorqueArm
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.simulation.vision import focal_length
from clothlab.trials import rollout
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
_DISTURBANCE = 1e-6  # [rad] of start and commands
# Share of the best direction's information below which a measured one counts as none
_LEAST = 1e-5


def vary(cloth: Cloth, constant: str, step: float) -> Cloth:
    """The cloth with one constant, `damping` or `mass`, multiplied by exp(step)."""
    return replace(cloth, **{constant: getattr(cloth, constant) * np.exp(step)})


def _run_one(cloth: str, motion: str, seed: int, steps: int = 200) -> dict[str, Any]:
    """Fisher information of the logarithms in each sensor, up to each of `_TIMES` `[N,
    2, 2]`, and the noise of z.
    """
    autoencoder, arm = trained(_WEIGHTS).autoencoder, TorqueArm()
    held, mover = (CLOTHS | BETWEEN)[cloth], _MOTIONS[motion](arm)
    mover.reset(seed)
    moves = [mover({}) for _ in range(steps)]  # which do not depend on what is seen
    commands = np.array([*moves, moves[-1]])
    turns, z, joints = [], [], []
    for repeat in range(_REPEATS):
        rng = np.random.default_rng(repeat)
        turns.append(rng.uniform(-0.5, 0.5, 2))  # [pixel]
        home = tuple(arm.home + rng.normal(0, _DISTURBANCE, len(arm.home)))
        disturbed = commands.copy()
        angles = disturbed[:, arm.angle_command]
        angles += np.random.default_rng([repeat, 1]).normal(
            0.0, _DISTURBANCE, angles.shape
        )
        policy = ReplayPolicy(np.clip(disturbed, arm.command_lower, arm.command_upper))
        env = ClothEnv(
            replace(arm, camera=_turned(arm.camera, *turns[-1]), home=home), held
        )
        for constant, sign in product(_CONSTANTS, (-1, 1)):
            env.hold(vary(held, constant, sign * _STEP))
            trial = rollout(env, policy, steps + 1, seed=repeat)
            # After each command: the first look is before the first
            z.append(encode(autoencoder, trial.images[1:]))
            joints.append(trial.robot[1:])
        env.close()
    times = _TIMES[steps * CONTROL_PERIOD + 1e-9 >= _TIMES]
    index = np.round(times / CONTROL_PERIOD).astype(int) - 1
    slopes, noise = _slopes_and_noise(z, np.array(turns))
    measured = {"z": (slopes, noise), PREDICTED: (slopes, _prediction_noise())}
    measured["joints"] = _slopes_and_noise(joints, np.array(turns), _JOINT_NOISE)
    found = {
        sensor: unbiased_information(*each)[index].round(3)
        for sensor, each in measured.items()
    }
    return {"time": times, **found, "noise": noise.deviations}


def _turned(camera: Camera, across: float, up: float) -> Camera:
    """The camera turned by parts of a pixel of its image."""
    distance = np.linalg.norm(np.subtract(camera.target, camera.position))
    pixel = distance / focal_length(camera.fovy, HEIGHT)  # [m] at the target
    return replace(
        camera,
        target=tuple(camera.target + pixel * np.array([across, up]) @ camera.axes[:2]),
    )


def _slopes_and_noise(
    runs: list[np.ndarray], turns: np.ndarray, stated: ArrayLike = 0.0
) -> tuple[np.ndarray, Noise]:
    """Sensitivities of a sensor in each repeat `[R, T, D, 2]`, and its noise, from the
    runs of all scenes.
    """
    values = np.array(runs, np.float64)
    # [2, 2, R, T, D]
    values = np.moveaxis(
        values.reshape(_REPEATS, len(_CONSTANTS), 2, *values.shape[1:]), 0, 2
    )
    noise = Noise.measured(
        _residuals(values.reshape(-1, *values.shape[2:]), turns), stated
    )
    return np.moveaxis(values[:, 1] - values[:, 0], 0, -1) / (2 * _STEP), noise


def _residuals(repeats: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """What scatters over repeats `[S, R, T, D]` beyond what is proportional to the
    turns `[R, 2]`: `[S R, T, D]`.

    It is enlarged for what the means and the slopes have fitted.
    """
    fitted = np.column_stack([np.ones(len(turns)), turns])
    residuals = np.tensordot(
        np.eye(len(turns)) - fitted @ np.linalg.pinv(fitted), repeats, axes=(1, 1)
    ).swapaxes(0, 1)
    left = len(turns) - np.linalg.matrix_rank(fitted)
    return np.sqrt(len(turns) / left) * residuals.reshape(-1, *repeats.shape[2:])


@cache
def _prediction_noise() -> Noise:
    """How far the network's z, a step ahead and with the right p, is from the z that
    comes.
    """
    learned, errors = trained(_WEIGHTS), []
    for trial in data.load_trials(EVALUATION["torque"]):
        run, p = (
            learned.to_run(trial),
            torch.as_tensor(learned.biases[trial.cloth.name]),
        )
        s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
        with torch.no_grad():
            predicted, _ = learned.model(s[None, :-1], u[None, :-1], p[None])
        errors.append(
            (predicted[0] - s[1:])[
                EstimationSettings.warmup :, learned.layout.z
            ].numpy()
        )
    shortest = min(map(len, errors))
    return Noise.measured(np.array([each[:shortest] for each in errors], np.float64))


def information(table: pd.DataFrame, sensors: str) -> np.ndarray:
    """F in one of `_SENSOR_SETS` `[rows, N, 2, 2]`: a sum, since the noises of sensors
    are independent.
    """
    return np.sum(
        [
            np.stack([*table[each]])
            for each in choose("set of sensors", sensors, _SENSOR_SETS)
        ],
        axis=0,
    )


def bounds(table: pd.DataFrame, sensors: str) -> pd.DataFrame:
    """Cramér-Rao bounds: the least standard deviation of the logarithm of each of
    `QUANTITIES`; infinite if unknown.

    A row for each row of the table and each time, with `cloth`, `motion`, `seed`,
    `time` [s] and the quantities.
    """
    # [rows, N, 4]
    found = cramer_rao(
        information(table, sensors), [*QUANTITIES.values()], tolerance=_LEAST
    )
    keys = table[["cloth", "motion", "seed"]]
    long = keys.loc[keys.index.repeat(found.shape[1])].reset_index(drop=True)
    long["time"] = np.concatenate([*table["time"]])
    long[[*QUANTITIES]] = found.reshape(-1, len(QUANTITIES))
    return long


_CASES = over(cloth=(*CLOTHS, *BETWEEN), motion=_MOTIONS, seed=(7000, 7001, 7002))
EXPERIMENTS = (Experiment("identifiability", _run_one, _CASES, seconds=40, slow=True),)
