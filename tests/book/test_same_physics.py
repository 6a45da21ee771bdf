"""MuJoCo in WebAssembly moves a scene as MuJoCo in Python does."""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import ARMS
from course.lab_gates import GATES
from course.lab_page import scene

pytestmark = pytest.mark.book

PERIODS = 20  # of 100 time steps
BOUND = GATES["places torque"].bound  # [rad], [m]
WORLDS = [("torque", "damp0.05-mass0.10"), ("muscle", "soft-1")]


def some_commands(arm, model):
    """What actuators are sent in each period `[PERIODS, nu]`."""
    rng = np.random.default_rng(0)
    data = mujoco.MjData(model)
    sent = []
    for _ in range(PERIODS):
        arm.command(data, rng.uniform(arm.command_lower, arm.command_upper))
        sent.append(data.ctrl.tolist())
    return sent


def here(world, commands):
    """Positions at the end of each period, by Python's MuJoCo."""
    model = mujoco.MjModel.from_xml_string(world["mjcf"])
    data = mujoco.MjData(model)
    for name, values in world["start"].items():
        getattr(data, name)[:] = values
    mujoco.mj_forward(model, data)
    positions = []
    for ctrl in commands:
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data, world["substeps"])
        mujoco.mj_forward(model, data)
        positions.append(data.qpos.copy())
    return np.array(positions)


@pytest.mark.parametrize(("arm", "cloth"), WORLDS)
def test_2000_time_steps_are_the_same(node, gate, arm, cloth):
    world = scene(arm, cloth)
    model = mujoco.MjModel.from_xml_string(world["mjcf"])
    commands = some_commands(ARMS[arm], model)
    expected = here(world, commands)
    found = node("physics.mjs", {"scene": world, "commands": commands})
    difference = np.abs(np.array(found["positions"]) - expected).max()
    gate(f"places {arm}", difference)
    assert found["again"] == world["start"]["qpos"]

    # Another scene would be noticed
    assert np.ptp(expected, axis=0).max() > 0.1
    other = dict(world, start=world["start"] | {"qvel": [1e-6] * model.nv})
    assert np.abs(here(other, commands) - expected).max() > BOUND
