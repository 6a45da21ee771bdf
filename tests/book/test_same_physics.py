"""MuJoCo in WebAssembly moves a scene as MuJoCo in Python does."""

import json
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import playwright
import pytest

from clothlab.simulation.arm import ARMS
from course.lab_page import SOURCES, scene
from course.npm import packages

pytestmark = pytest.mark.book

# Playwright brings Node.js along
NODE = next((Path(playwright.__file__).parent / "driver").glob("node*"))
PERIODS = 20  # of 100 time steps
BOUND = 1e-9  # [rad], [m]
WORLDS = [("torque", "damp0.05-mass0.10"), ("muscle", "soft-1")]


@pytest.fixture(scope="module")
def library():
    """MuJoCo as JavaScript loads it."""
    file = packages()["@mujoco/mujoco"].folder / "mujoco.js"
    if not file.exists():
        pytest.skip("NO FILES OF NPM: run `make npm`")
    return file


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


def there(library, world, commands, folder):
    """The same in WebAssembly, and where a reset leads."""
    file = folder / "scene.json"
    file.write_text(json.dumps({"scene": world, "commands": commands}))
    script = Path(__file__).with_name("physics.mjs")
    sources = [script, library, SOURCES / "physics.js", file]
    done = subprocess.run(
        [NODE, *sources], capture_output=True, text=True, check=True, timeout=120
    )
    found = json.loads(done.stdout)
    return np.array(found["positions"]), found["again"]


@pytest.mark.parametrize(("arm", "cloth"), WORLDS)
def test_2000_time_steps_are_the_same(library, tmp_path, arm, cloth):
    world = scene(arm, cloth)
    model = mujoco.MjModel.from_xml_string(world["mjcf"])
    commands = some_commands(ARMS[arm], model)
    expected = here(world, commands)
    found, again = there(library, world, commands, tmp_path)
    difference = np.abs(found - expected).max()
    print(f"{arm}: {difference:.1e}")
    assert difference < BOUND
    assert again == world["start"]["qpos"]

    # Another scene would be noticed
    assert np.ptp(expected, axis=0).max() > 0.1
    other = dict(world, start=world["start"] | {"qvel": [1e-6] * model.nv})
    assert np.abs(here(other, commands) - expected).max() > BOUND
