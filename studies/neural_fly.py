"""Recorded flights of a real quadrotor in wind, from a folder that you fetched.

They are those of *Neural-Fly enables rapid learning for agile flight in strong winds*
(O'Connell, Shi, Shi, Azizzadenesheli, Anandkumar, Yue and Chung, Science Robotics 7,
eabm6597, 2022): a figure of eight, flown by several controllers in several winds. Their
licence is for personal and educational use, and no flight is part of this repository:

    git clone https://github.com/aerorobotics/neural-fly
    export NEURAL_FLY=$PWD/neural-fly

What is read is judged by the SHA-256 of each file as its authors published it (commit
0ed5024), in `neural_fly.sha256` beside this module. A file may be compressed by `xz`.
"""

import hashlib
import io
import json
import lzma
import os
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from clothlab._validation import choose
from clothlab.method.data import Run

VARIABLE = "NEURAL_FLY"  # names the folder
CONTROLLERS = ("baseline", "indi", "L1", "NF-C", "NF")
WINDS = {"nowind": 0.0, "35wind": 4.2, "70wind": 8.5, "100wind": 12.1}  # [m/s]
STATE_NAMES = (
    *(f"speed along {axis} [m/s]" for axis in "xyz"),
    *(f"tilt towards {axis}" for axis in "xy"),
    *(f"angular velocity about {axis} [rad/s]" for axis in "xyz"),
)
COMMAND_NAMES = ("thrust over hover", "tilt towards x", "tilt towards y")
EVERY = 5  # recorded at 50 Hz, used at 10 Hz
STEP = 0.02 * EVERY  # [s]
_SUMS = Path(__file__).with_name("neural_fly.sha256")
_FETCH = (
    "git clone https://github.com/aerorobotics/neural-fly, and set "
    f"{VARIABLE} to that folder"
)


def here() -> bool:
    """Whether a folder is named."""
    return bool(os.environ.get(VARIABLE))


def folder() -> Path:
    """Where the flights lie: the folder `NEURAL_FLY`, or `data/experiment` in it."""
    named = os.environ.get(VARIABLE)
    if not named:
        raise FileNotFoundError(
            f"the flights of Neural-Fly are not part of this repository: {_FETCH}"
        )
    root = Path(named).expanduser()
    inner = root / "data" / "experiment"
    return inner if inner.is_dir() else root


def load_flight(controller: str, wind: str) -> Run:
    """A flight by the names of its controller and of its wind, such as "70wind".

    It has `STATE_NAMES` and `COMMAND_NAMES`; its material is the wind.
    """
    choose("controller", controller, dict.fromkeys(CONTROLLERS))
    choose("wind", wind, WINDS)
    return _load(controller, wind, folder())


@cache
def _load(controller: str, wind: str, where: Path) -> Run:
    name = f"custom_figure8_{controller}_{wind}.csv"
    content = _checked(where, name)
    table = pd.read_csv(io.BytesIO(content)).iloc[::EVERY]

    # The thrust's axis, in the world: of the drone, and as commanded
    rotation = _numbers(table, "R").reshape(-1, 3, 3)
    tilt = rotation[:, :2, 2]
    commanded = _thrust_axis(_numbers(table, "q_sp"))[:, :2]
    thrust = _numbers(table, "T_sp") / _numbers(table, "hover_throttle")

    states = np.hstack([_numbers(table, "v"), tilt, _numbers(table, "w")])
    commands = np.hstack([thrust, commanded])
    return Run(states, commands, wind)


def _checked(where: Path, name: str) -> bytes:
    """The content of a file, plain or compressed, if it is as it was published."""
    plain = where / name
    packed = where / f"{name}.xz"
    if plain.is_file():
        content = plain.read_bytes()
    elif packed.is_file():
        content = lzma.decompress(packed.read_bytes())
    else:
        raise FileNotFoundError(f"there is no {name} in {where}: {_FETCH}")

    lines = _SUMS.read_text("utf-8").splitlines()
    sums = {line[66:]: line[:64] for line in lines}
    if hashlib.sha256(content).hexdigest() != sums[name]:
        raise ValueError(
            f"{name} in {where} is not as published (commit 0ed5024): {_FETCH}"
        )
    return content


def _numbers(table: pd.DataFrame, column: str) -> np.ndarray:
    """A column of lists, which are written as text, `[T, D]`."""
    values = [json.loads(str(text)) for text in table[column]]
    return np.array(values, dtype=float).reshape(len(table), -1)


def _thrust_axis(q: np.ndarray) -> np.ndarray:
    """The z axis that a rotation makes, `[T, 3]`, of quaternions `[T, 4]` (x y z w)."""
    x, y, z, w = q.T
    axis = [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x**2 + y**2)]
    return np.stack(axis, axis=1)
