"""A scene as MJCF for another MuJoCo: it loads again, and moves as the scene does."""

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

from clothlab.simulation._mjcf import build_spec, portable_mjcf
from clothlab.simulation.arm import ARMS
from clothlab.simulation.cloth import CLOTHS, FOAMS
from clothlab.simulation.env import ClothEnv

WORLDS = [("torque", cloth) for cloth in CLOTHS] + [
    ("muscle", cloth) for cloth in FOAMS
]
PERIODS = 2


def moved(model, env, commands):
    """Positions after the commands, from where the cloth hangs in `env`."""
    data = mujoco.MjData(model)
    for name in ("qpos", "qvel", "act"):
        getattr(data, name)[:] = getattr(env.data, name)
    for u in commands:
        env.arm.command(data, u)
        mujoco.mj_step(model, data, env.scene.substeps)
    return data.qpos


@pytest.mark.parametrize(("arm", "cloth"), WORLDS)
def test_what_is_exported_loads_again_and_moves_as_the_scene_does(arm, cloth):
    env = ClothEnv(arm, cloth)
    model = mujoco.MjModel.from_xml_string(portable_mjcf(env._spec()))
    rng = np.random.default_rng(0)
    lower = env.arm.command_lower
    upper = env.arm.command_upper
    commands = rng.uniform(lower, upper, (PERIODS, len(lower)))
    there = moved(model, env, commands)
    here = moved(env.model, env, commands)
    assert np.abs(here - env.data.qpos).max() > 0.01
    assert there == pytest.approx(here, abs=1e-4)


@pytest.mark.parametrize(("arm", "cloth"), [WORLDS[0], WORLDS[-1]])
def test_only_actuators_with_several_inputs_name_them(arm, cloth):
    spec = build_spec(ARMS[arm], ClothEnv(arm, cloth).cloth)
    root = ElementTree.fromstring(portable_mjcf(spec))
    kinds = {each.get("dyntype"): each.get("input") for each in root.iter("general")}
    assert kinds == {"torque": {None: None}, "muscle": {"pid": "pos ff"}}[arm]
