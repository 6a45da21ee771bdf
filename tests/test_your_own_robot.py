"""Every Python block of *Your own robot*, in order, with logs of three pendulums."""

import re
from pathlib import Path

import gymnasium
import numpy as np
import pandas as pd
import pytest
import torch

import clothlab

PAGE = Path(clothlab.__file__).parents[1] / "docs" / "your_own_robot.md"
MASSES = {"light": 0.5, "middle": 0.8, "heavy": 1.3}  # [kg]
SMALLER = {r"epochs=\d+": "epochs=1", r"HORIZON = 12": "HORIZON = 2"}
STRAY = 90  # a step of the loop with a state that was never recorded


class Pendulum:
    """Gymnasium's pendulum in the place of a robot."""

    def __init__(self, mass, seed):
        self.env = gymnasium.make("Pendulum-v1").unwrapped
        self.env.m = mass
        self.s, _ = self.env.reset(seed=seed)
        self.reads = 0
        self.sent = []

    def read(self):
        self.reads += 1
        return 100 * self.s if self.reads == STRAY else self.s

    def send(self, u):
        self.sent.append(u)
        self.env.dt = 0.01
        for _ in range(5):
            self.s, *_ = self.env.step(u)


def log_of(mass, seed, rows):
    """Rows 18 to 22 ms apart, with a gap; torques are held for 0.05 to 0.3 s."""
    robot = Pendulum(mass, seed)
    rng = np.random.default_rng(seed)
    torque = rng.uniform(-2, 2, rows).repeat(rng.integers(3, 16, rows))[:rows]
    written = []
    now = 1_700_000_000.0
    for u in torque:
        written.append([now, *robot.s, u])
        robot.env.dt = rng.uniform(0.018, 0.022)
        now += robot.env.dt
        robot.s, *_ = robot.env.step(np.array([u]))
    names = ["time [s]", "cosine [-]", "sine [-]", "speed [rad/s]", "torque [N m]"]
    table = pd.DataFrame(written, columns=names)
    return table.drop(index=range(rows // 2, rows // 2 + 40))


def run_page(folder, rows=2500, smaller=()):
    """What its blocks leave, in a folder of logs."""
    (folder / "logs").mkdir()
    for k, (name, mass) in enumerate(MASSES.items()):
        log_of(mass, k, rows).to_csv(folder / "logs" / f"{name}.csv", index=False)
    log_of(0.65, 10, rows).to_csv(folder / "new.csv", index=False)
    names = {"robot": Pendulum(0.65, 11)}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL):
        code = block
        for large, small in dict(smaller).items():
            code = re.sub(large, small, code)
        exec(compile(code, f"block: {block[:60]}", "exec"), names)
    return names


@pytest.mark.slow
def test_every_block_runs_after_the_ones_before_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    torch.set_num_threads(1)
    names = run_page(tmp_path, 400, SMALLER)
    assert names["u"].shape == (1,)
    assert len(names["runs"]) == 6, "a gap in each log"
    assert names["model"].step == 0.05
    assert len(names["robot"].sent) == 100
    assert names["estimator"].window is None, "what comes before a gap is forgotten"
