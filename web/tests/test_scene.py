"""A scene as MJCF for another MuJoCo: it loads again, and moves as the scene does."""

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

from clothlab import CLOTHS, ClothEnv
from clothlab.simulation.arm import ARMS
from clothlab.simulation.cloth import FOAMS, Cloth
from clothlab.simulation.scene import build_spec
from web.scene import any_cloth_scene, portable_mjcf

PERIODS = 2
FIRST = {"torque": "damp0.05-mass0.10", "muscle": "soft-1"}
OWN = Cloth("own", damping=0.035, mass=0.06)
WORLDS = [("torque", cloth) for cloth in [*list(CLOTHS.values())[::4], OWN]]
WORLDS += [("muscle", cloth) for cloth in FOAMS.values()]


def filled(template, cloth):
    """The MJCF of a scene with a cloth."""
    numbers = {
        "damping": cloth.damping,
        "mass": cloth.point_mass,
        "stiffness": cloth.stiffness,
        "bending": cloth.bending,
        "spring_damping": cloth.spring_damping,
    }
    text = template["mjcf"]
    for name, value in numbers.items():
        text = text.replace(f"{{{name}}}", str(value))
    return text


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
def test_a_scene_loads_again_and_moves_as_the_environment_does(arm, cloth):
    env = ClothEnv(arm, cloth)
    model = mujoco.MjModel.from_xml_string(
        portable_mjcf(build_spec(env.arm, env.cloth))
    )
    rng = np.random.default_rng(0)
    lower = env.arm.command_lower
    upper = env.arm.command_upper
    commands = rng.uniform(lower, upper, (PERIODS, len(lower)))
    there = moved(model, env, commands)
    here = moved(env.model, env, commands)
    assert np.abs(here - env.data.qpos).max() > 0.01
    assert there == pytest.approx(here, abs=1e-4)


@pytest.mark.parametrize(("arm", "cloth"), WORLDS)
def test_the_scene_of_any_cloth_is_that_of_each(arm, cloth):
    text = filled(any_cloth_scene(arm, FIRST[arm]), cloth)
    found = mujoco.MjModel.from_xml_string(text)
    spec = build_spec(ARMS[arm], cloth)
    expected = mujoco.MjModel.from_xml_string(portable_mjcf(spec))
    for name in (
        *("body_mass", "body_inertia", "dof_damping"),
        *("tendon_stiffness", "tendon_damping", "tendon_lengthspring"),
    ):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-5)
    assert "{" not in "".join(ElementTree.fromstring(text).itertext())
