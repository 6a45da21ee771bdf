"""The environment: that it repeats, what it draws, and what it refuses."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.util import find_spec

import mujoco
import numpy as np
import pytest

from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import JOINTS, TorqueArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv, SimulationError
from clothlab.simulation.rendering import make_renderer, onlooker
from clothlab.simulation.scene import Scene, build_spec

# It diverges
STIFF = replace(
    get_cloth("damp0.03-mass0.05"), name="stiff", stiffness=1e7, spring_damping=0.0
)
HOME = TorqueArm().home_command


@pytest.fixture
def own() -> ClothEnv:
    """An environment of the test's own, to change."""
    env = ClothEnv()
    yield env
    env.close()


@pytest.fixture
def quiet_log(tmp_path, monkeypatch):
    # MuJoCo writes its warnings into a file where it stands
    monkeypatch.chdir(tmp_path)


def everything(env: ClothEnv) -> np.ndarray:
    """All that decides how the physics goes on."""
    return np.concatenate(
        [env.data.qpos, env.data.qvel, env.data.act, env.data.ctrl, [env.data.time]]
    )


def run(env: ClothEnv, steps: int, **options) -> np.ndarray:
    """All that there is after each step of a random run."""
    policy = RandomPolicy(env.arm)
    policy.reset(4)
    states = []
    for _ in range(steps):
        env.advance(policy({}), **options)
        states.append(everything(env))
    return np.array(states)


@pytest.mark.slow
def test_pictures_for_people_have_the_size_of_the_scene():
    env = ClothEnv(scene=Scene(picture_size=(720, 960)))
    assert env.picture().shape == (720, 960, 3)
    assert env.picture().std() > 10
    env.close()


def test_a_picture_without_pixels_is_refused(env):
    with pytest.raises(ValueError, match=r"height must be at least 1, got 0"):
        env.camera_picture(0, 128)


@pytest.mark.slow
def test_another_cloth_in_the_hand_is_like_a_new_scene(own):
    own.picture()
    for cloth in (
        get_cloth("damp0.03-mass0.15"),
        replace(own.cloth, rows=8, length=0.4),
    ):
        own.hold(cloth)
        fresh = ClothEnv(own.arm, cloth)
        assert np.array_equal(run(own, 5), run(fresh, 5))
        assert np.array_equal(own.camera_picture(), fresh.camera_picture())
        fresh.close()


def test_an_unknown_cloth_changes_nothing(own):
    own.advance(HOME)
    before, model, data, state = own.cloth, own.model, own.data, everything(own)
    with pytest.raises(KeyError):
        own.hold("felt")
    assert own.cloth is before
    assert own.model is model
    assert own.data is data
    assert np.array_equal(everything(own), state)
    assert own.step(HOME)[0]["image"].any()


@pytest.mark.usefixtures("quiet_log")
def test_another_cloth_can_be_held_after_one_that_diverged(own):
    before = own.cloth
    start = everything(own)
    with pytest.raises(SimulationError):
        own.hold(STIFF)
    own.hold(before)
    assert np.array_equal(everything(own), start)
    assert own.step(HOME)[0]["image"].any()


@pytest.mark.usefixtures("quiet_log")
def test_a_diverging_simulation_raises_and_names_what_would_help():
    with pytest.raises(
        SimulationError,
        match=r"cloth \(0.03, 0.05\) diverged; use a smaller time_step than 0.002 s",
    ):
        ClothEnv("torque", STIFF)


@pytest.mark.parametrize("samples", [1, 7, 100])
def test_watching_changes_nothing(env, samples):
    unwatched = run(env, 4)
    env.start()
    seen = []
    watched = run(env, 4, watch=lambda: seen.append(env.data.time), samples=samples)
    assert np.array_equal(watched, unwatched)
    assert len(seen) == 4 * samples
    assert seen[samples - 1 :: samples] == pytest.approx(
        CONTROL_PERIOD * np.arange(1, 5)
    )
    assert np.diff(seen) == pytest.approx(
        CONTROL_PERIOD / samples, abs=env.scene.time_step
    )


def test_what_is_watched_is_up_to_date(env):
    hands, pictures = [], []

    def look():
        forward, up = env.arm.hand(env.arm.angles(env.data))
        hands.append(env.data.site("hand").xpos - [forward, 0, 1 + up])
        pictures.append(env.camera_picture())
        mujoco.mj_forward(env.model, env.data)  # all that there is to bring up to date
        assert np.array_equal(pictures[-1], env.camera_picture())

    env.advance([-0.5, -1.0], look, 2)
    assert np.abs(hands).max() < 1e-9
    assert np.array_equal(pictures[-1], env.camera_picture())
    assert not np.array_equal(*pictures)


def test_more_looks_than_time_steps_are_refused(env):
    with pytest.raises(ValueError, match=r"samples must be at most 100"):
        env.advance(HOME, lambda: None, 101)


@pytest.mark.slow
def test_threads_may_take_turns_at_drawing(own):
    with ThreadPoolExecutor(1) as another:
        for _ in range(2):
            here = [own.camera_picture(), own.picture()]
            there = another.submit(
                lambda: [own.camera_picture(), own.picture()]
            ).result()
            assert all(map(np.array_equal, here, there))
        another.submit(own.close).result()


@pytest.mark.slow
def test_it_can_be_closed_twice_and_draws_again_afterwards(own):
    picture = own.camera_picture()
    own.close()
    own.close()
    assert np.array_equal(own.camera_picture(), picture)


@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_the_same_seed_gives_the_same_start_bit_for_bit(arm):
    starts = []
    for seed in (3, 3, 4):
        env = ClothEnv(arm)
        env.start(seed=seed, random_start=True)
        starts.append(everything(env))
    assert np.array_equal(starts[0], starts[1])
    assert not np.allclose(starts[0], starts[2])


def test_a_start_from_home_draws_nothing_at_random(env):
    first = everything(env)
    run(env, 2)
    env.start(seed=7)
    assert np.array_equal(everything(env), first)
    assert env.data.time == 0
    assert np.abs(env.data.qvel).max() < 1e-3


def test_a_command_that_is_refused_changes_nothing(env):
    before = everything(env)
    with pytest.raises(ValueError, match="outside the torque arm's"):
        env.step([3.0, 0.0])
    assert np.array_equal(everything(env), before)


def test_a_time_step_fills_the_control_period():
    with pytest.raises(
        ValueError, match=r"Scene.time_step must divide the control period of 0.2 s"
    ):
        Scene(time_step=0.003)


def test_a_scene_can_be_read_as_mjcf():
    assert "cloth_5_2" in build_spec(TorqueArm(), get_cloth("soft-1")).to_xml()


def test_without_opengl_the_package_to_install_is_named(env, monkeypatch):
    def no_display(*_):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr("mujoco.Renderer", no_display)
    with pytest.raises(RuntimeError, match=r"apt-get install libegl1"):
        make_renderer(env.model, 96, 128)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="a display is there")
def test_without_a_display_each_attempt_to_draw_says_what_to_do():
    code = """
from clothlab import ClothEnv
for _ in range(2):
    try:
        ClothEnv().camera_picture()
    except RuntimeError as error:
        print(error)
"""
    environment = os.environ | {
        "MUJOCO_GL": "glfw",
        "DISPLAY": "",
        "WAYLAND_DISPLAY": "",
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (
        done.stdout.count("MUJOCO_GL=glfw is set, and does not draw here: unset") == 2
    )


def test_triton_is_loaded_before_the_first_picture(env, monkeypatch, tmp_path):
    """Else a training after a picture ends Python, with a PyTorch that has CUDA."""
    (tmp_path / "triton.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "triton", raising=False)

    def loaded(*_):
        raise AssertionError("triton" in sys.modules)

    monkeypatch.setattr("mujoco.Renderer", loaded)
    with pytest.raises(RuntimeError) as raised:
        make_renderer(env.model, 96, 128)
    assert raised.value.__cause__.args == (True,)
    del sys.modules["triton"]


@pytest.mark.slow
@pytest.mark.skipif(find_spec("triton") is None, reason="PyTorch is without CUDA")
def test_a_training_may_follow_a_picture():
    code = (
        "import torch; from clothlab import ClothEnv; ClothEnv().camera_picture(); "
        "torch.optim.Adam([torch.zeros(1, requires_grad=True)])"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def on_picture(env, view, points):
    """Where points of the world `[N, 3]` are in a picture: 0 to 1 from left and from
    top, `[N, 2]`.
    """
    renderer = env._renderers[env.scene.picture_size]
    renderer.update_scene(env.data, view)
    left, right = renderer.scene.camera  # one for each eye
    position, forward = (
        np.mean([getattr(left, name), getattr(right, name)], axis=0)
        for name in ("pos", "forward")
    )
    up, aspect = (
        np.array(left.up),
        env.scene.picture_size[1] / env.scene.picture_size[0],
    )
    sideways = np.cross(forward, up)
    away = points - position
    half = left.frustum_top / left.frustum_near
    scaled = np.stack([away @ sideways / aspect, -(away @ up)], axis=1) / (
        half * (away @ forward)[:, None]
    )
    return (1 + scaled) / 2


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_an_onlooker_sees_robot_and_cloth_wherever_the_arm_is(arm):
    env = ClothEnv(arm, "soft-1" if arm == "muscle" else "damp0.05-mass0.10")
    policy, bodies = RandomPolicy(env.arm), (*JOINTS, "hand")
    policy.reset(0)
    seen = []
    env.picture()
    for _ in range(40):
        env.step(policy({}))
        points = np.concatenate(
            [
                [env.data.body(name).xpos for name in bodies],
                env.cloth_points().reshape(-1, 3),
            ]
        )
        seen.append(on_picture(env, onlooker(env.arm), points))
    env.close()
    inside = (np.array(seen) > 0) & (np.array(seen) < 1)
    assert inside.all(axis=2)[:, : len(bodies)].all()  # the robot always
    # And the cloth, unless a corner of it flies out
    assert inside.all(axis=2).mean() > 0.97
