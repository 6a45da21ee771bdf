"""Forty CSV logs as a robot writes them, read by the public readers.

A pendulum of eight loads, five days each. A row comes after 18 to 22 ms; the writing
stops twice a log for up to a second; one number in two hundred is missing; and a
supply's voltage never changes. The same robot written down without any of that says
what the damage costs.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from gym_robots import Held, make_pendulum

from clothlab import Run, read_runs

DAYS = ("monday", "tuesday", "wednesday", "thursday", "friday")
LOADS = tuple((mass, length) for mass in (0.4, 0.6, 0.8, 1.2) for length in (0.5, 0.9))
SECONDS = 10.0  # of a log
STEP = 0.05  # of the runs [s]
TIME = "time [s]"
STATES = ["cosine [-]", "sine [-]", "speed [rad/s]", "supply [V]"]
COMMANDS = ["torque [N m]"]


def name_of(load: tuple[float, float]) -> str:
    """What a load's folder is called."""
    return f"{load[0]:g} kg, {load[1]:g} m"


def log(load: tuple[float, float], seed: int, messy: bool) -> pd.DataFrame:
    """What is written of random torques, each held for 60 to 360 ms."""
    rng = np.random.default_rng(seed)
    env = make_pendulum(load)
    s, _ = env.reset(seed=seed)
    held = Held(env)
    held.reset(seed)

    # The robot moves on by as much as lies between two rows
    rows = []
    time = 0.0
    while time < SECONDS:
        if len(rows) % 3 == 0:
            u = held(s)
        rows.append([time, *s, 24.0, *u])
        env.unwrapped.dt = rng.uniform(0.018, 0.022) if messy else 0.02
        time += env.unwrapped.dt
        s, *_ = env.unwrapped.step(u)
    table = pd.DataFrame(rows, columns=[TIME, *STATES, *COMMANDS])
    return damaged(table, rng) if messy else table


def damaged(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Two gaps, and numbers that are missing; the time is always there."""
    missing = rng.uniform(size=table.shape) < 0.005
    missing[:, 0] = False
    table = table.mask(missing)
    for _ in range(2):
        start = rng.uniform(0, SECONDS - 1)
        end = start + rng.uniform(0.3, 1.0)
        table = table[(table[TIME] < start) | (table[TIME] > end)]
    return table


def write_logs(folder: Path, seed: int, messy: bool) -> None:
    """Forty files: a folder for each load, and in it a file for each day."""
    for k, load in enumerate(LOADS):
        path = folder / name_of(load)
        path.mkdir(parents=True)
        for day, name in enumerate(DAYS):
            table = log(load, 10_000 * seed + 100 * k + day, messy)
            table.to_csv(path / f"{name}.csv", index=False)


def read(files: str) -> list[Run]:
    """Runs of the files that a pattern names."""
    return read_runs(
        files,
        time=TIME,
        states=STATES,
        commands=COMMANDS,
        step=STEP,
        missing="hold",
        progress=False,
    )
