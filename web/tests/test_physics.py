"""MuJoCo in WebAssembly moves a scene as MuJoCo in Python does."""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import ARMS
from web.scene import scene

PERIODS = 20  # of 100 time steps
BOUND = 1e-9  # [rad], [m]
WORLDS = [("torque", "damp0.05-mass0.10"), ("muscle", "soft-1")]


def here(arm, world, commands):
    """Positions and what the arm senses at the end of each period, in Python."""
    model = mujoco.MjModel.from_xml_string(world["mjcf"])
    data = mujoco.MjData(model)
    for name, values in world["start"].items():
        getattr(data, name)[:] = values
    mujoco.mj_forward(model, data)
    positions = []
    sensed = []
    for u in commands:
        arm.command(data, u)
        mujoco.mj_step(model, data, world["substeps"])
        mujoco.mj_forward(model, data)
        positions.append(data.qpos.copy())
        sensed.append(arm.state(data))
    return np.array(positions), np.array(sensed)


@pytest.mark.parametrize(("arm", "cloth"), WORLDS)
def test_2000_time_steps_are_the_same(node, arm, cloth):
    world = scene(arm, cloth)
    rng = np.random.default_rng(0)
    moved = ARMS[arm]
    size = (PERIODS, len(moved.command_names))
    commands = rng.uniform(moved.command_lower, moved.command_upper, size)
    expected, sensed = here(moved, world, commands)
    asked = {"scene": world, "commands": commands.tolist()}
    answer = node("physics.mjs", arm, asked)
    found = [each["positions"] for each in answer["found"]]
    difference = np.abs(np.array(found) - expected).max()
    print(f"{arm}: positions differ by {difference:.1e}")
    assert difference < BOUND
    assert answer["again"] == world["start"]["qpos"]
    found = [each["sensed"] for each in answer["found"]]
    assert np.array(found) == pytest.approx(sensed, rel=1e-5, abs=1e-7)

    # Another scene would be noticed
    assert np.ptp(expected, axis=0).max() > 0.1
    still = np.zeros_like(expected[0])
    other = dict(world, start=world["start"] | {"qvel": (still + 1e-6).tolist()})
    assert np.abs(here(moved, other, commands)[0] - expected).max() > BOUND
