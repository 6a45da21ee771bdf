"""Laws that the cloth obeys, whatever its parameters."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.cloth import CLOTHS, Cloth, add_cloth, get_cloth
from clothlab.env import ClothEnv, Scene, SimulationError
from clothlab.trials import RandomPolicy

GRAVITY = 9.81


def falling(cloth: Cloth) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A cloth that nobody holds: its bar slides down with the drag of the points tied to it."""
    spec = mujoco.MjSpec()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    bar = spec.worldbody.add_body(name="bar")
    bar.add_joint(
        name="bar", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], damping=[cloth.columns * cloth.damping, 0, 0]
    )
    add_cloth(spec, cloth, bar, np.zeros(3))
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("name", ["damp0.03-mass0.05", "damp0.07-mass0.15"])
def test_terminal_speed_is_weight_over_drag(name):
    cloth = get_cloth(name)
    model, data = falling(cloth)
    mujoco.mj_step(model, data, 2000)
    assert -data.joint("bar").qvel[0] == pytest.approx(cloth.point_mass * GRAVITY / cloth.damping, rel=1e-3)


def test_a_cloth_weighs_what_it_says():
    for cloth in CLOTHS.values():
        model, _ = falling(cloth)
        assert model.body_subtreemass[0] == pytest.approx(cloth.mass)


def test_a_cloth_at_rest_stays_at_rest(env):
    env.reset()
    before = env.cloth_points()
    for _ in range(10):
        env.step(env.arm.home_command)
    assert np.abs(env.cloth_points() - before).max() < 1e-3
    assert np.abs(env.data.qvel).max() < 1e-3


def test_a_hanging_cloth_stretches_by_its_weight(env):
    env.reset()
    points = env.cloth_points()
    drop = points[0, :, 2].mean() - points[-1, :, 2].mean()
    assert env.cloth.length < drop < 1.02 * env.cloth.length


def motion(cloth: Cloth, time_step: float = 0.002) -> np.ndarray:
    """Where the points are after each of 15 steps of three random runs, `[45, rows, columns, 3]` [m]."""
    env = ClothEnv("torque", cloth, scene=Scene(time_step=time_step))
    moments = []
    for seed in range(3):
        env.reset()
        policy = RandomPolicy(env.arm, seed=seed)
        for _ in range(15):
            env.step(policy({}))
            moments.append(env.cloth_points())
    env.close()
    return np.array(moments)


def mean_shift(a: np.ndarray, b: np.ndarray) -> float:
    return np.linalg.norm(a - b, axis=-1).mean()


def test_materials_matter_more_than_the_time_step():
    cloth = get_cloth("damp0.05-mass0.10")
    base = motion(cloth)
    halved = mean_shift(base, motion(cloth, time_step=0.001))
    for change in ({"damping": 0.07}, {"damping": 0.03}, {"mass": 0.15}, {"mass": 0.05}):
        assert mean_shift(base, motion(replace(cloth, **change))) > 2 * halved


def test_the_arm_reaches_its_command(env):
    env.reset()
    u = np.array([0.2, -1.0])
    for _ in range(15):
        observation, *_ = env.step(u)
    assert observation["robot"][:2] == pytest.approx(u, abs=0.12)  # a servo without integral part sags under weight


def test_the_hand_is_where_the_joints_put_it(env):
    env.reset()
    for _ in range(15):
        env.step(np.array([0.3, -0.8]))
    shoulder, elbow = env.arm.state(env.data)[:2]
    length = env.arm.link_length
    forward = length * (np.cos(shoulder) + np.cos(shoulder + elbow))
    down = length * (np.sin(shoulder) + np.sin(shoulder + elbow))
    assert env.data.site("hand").xpos == pytest.approx([forward, 0, 1 - down], abs=1e-9)


def test_a_diverging_simulation_raises(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file where it stands
    stiff = replace(get_cloth("damp0.03-mass0.05"), stiffness=1e7, spring_damping=0.0)
    env = ClothEnv("torque", stiff, scene=Scene(time_step=0.02))
    with pytest.raises(SimulationError, match="smaller time_step"):
        env.reset()
    env.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass must be above zero"),
        ({"mass": float("nan")}, "mass must be above zero"),
        ({"damping": -0.1}, "damping must not be negative"),
        ({"rows": 1}, "at least 2"),
    ],
)
def test_impossible_cloths_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(get_cloth("damp0.03-mass0.05"), **change)


def test_an_unknown_cloth_lists_the_choices():
    with pytest.raises(KeyError, match=r"unknown cloth 'felt'; choose from damp0.03-mass0.05"):
        get_cloth("felt")
