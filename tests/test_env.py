"""The environment: Gymnasium's own checks, reproducibility, and what it refuses."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from clothlab import vision
from clothlab.arm import ARMS
from clothlab.cloth import get_cloth
from clothlab.env import ClothEnv, _make_renderer
from clothlab.trials import OperatorPolicy, RandomPolicy, replay, rollout


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")  # commands are in the arm's units on purpose
@pytest.mark.filterwarnings("ignore:.*observation space (min|max)imum value is")  # a velocity has no bound
@pytest.mark.parametrize("arm", ARMS)
def test_gymnasium_accepts_it(arm):
    env = ClothEnv(arm)
    check_env(env, skip_render_check=True)  # that one only repeats `gymnasium.make`, with names that are not registered
    env.close()


def test_pictures_for_people(env):
    env.reset()
    picture = env.render()
    assert picture.shape == (480, 640, 3)
    assert picture.dtype == np.uint8
    assert picture.std() > 10
    assert ClothEnv(render_mode=None).render() is None


def test_another_cloth_in_the_hand_is_like_a_new_scene(env):
    env.reset()
    env.render()
    for cloth in (get_cloth("damp0.03-mass0.15"), replace(env.cloth, rows=8, length=0.4)):
        env.hold(cloth)
        fresh = ClothEnv(env.arm, cloth)
        held, anew = (rollout(each, RandomPolicy(env.arm, seed=1), 5, seed=1) for each in (env, fresh))
        assert np.array_equal(held.images, anew.images)
        assert np.array_equal(held.robot, anew.robot)
        assert np.array_equal(env.render(), fresh.render())
        fresh.close()


def test_threads_may_take_turns_at_drawing(env):
    env.reset()
    with ThreadPoolExecutor(1) as another:
        for _ in range(2):
            here = [env.camera_picture(), env.render()]
            there = another.submit(lambda: [env.camera_picture(), env.render()]).result()
            assert all(map(np.array_equal, here, there))
        env.render()
        another.submit(env.close).result()


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("policy", [RandomPolicy, OperatorPolicy])
def test_same_seed_same_trial_bit_for_bit(arm, policy):
    trials = []
    for _ in range(2):
        env = ClothEnv(arm)
        trials.append(rollout(env, policy(env.arm, seed=3), 20, seed=3, random_start=True))
        env.close()
    for name in ("images", "robot", "commands"):
        assert np.array_equal(getattr(trials[0], name), getattr(trials[1], name))


def test_another_seed_starts_elsewhere(env):
    starts = [env.reset(seed=seed, options={"random_start": True})[0]["robot"] for seed in (0, 1)]
    assert not np.allclose(*starts)


@pytest.mark.parametrize("policy", [RandomPolicy, OperatorPolicy])
def test_policies_stay_in_range(env, policy):
    chosen = policy(env.arm, seed=0)
    commands = np.array([chosen({}) for _ in range(500)])
    assert (commands >= env.arm.command_lower).all()
    assert (commands <= env.arm.command_upper).all()


@pytest.mark.parametrize(
    ("u", "message"),
    [
        ([0.0], r"shape \(2,\), got \(1,\)"),
        ([0.0, np.nan], "must be finite"),
        ([3.0, 0.0], "outside the torque arm's range"),
    ],
)
def test_bad_commands_are_refused(env, u, message):
    env.reset()
    before = env.data.time
    with pytest.raises(ValueError, match=message):
        env.step(np.array(u))
    assert env.data.time == before


def test_reward_is_minus_the_chamfer_distance(square):
    env = ClothEnv(target=square)
    env.reset()
    observation, reward, *_ = env.step(env.arm.home_command)
    assert reward == pytest.approx(-vision.chamfer_distance(observation["image"], square))
    env.close()


def test_unknown_names_list_the_choices():
    with pytest.raises(KeyError, match="unknown arm 'octopus'; choose from torque"):
        ClothEnv("octopus")
    with pytest.raises(KeyError, match="unknown cloth 'felt'; choose from"):
        ClothEnv(cloth="felt")
    with pytest.raises(ValueError, match="choose from None, rgb_array"):
        ClothEnv(render_mode="human")


@pytest.mark.parametrize("first", ["import mujoco", "import clothlab"])
def test_it_draws_in_whatever_order_it_is_imported(first):
    environment = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    code = f"{first}; from clothlab.env import ClothEnv; print(ClothEnv().reset()[0]['image'].sum() > 100)"
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "True"


def test_without_opengl_the_package_to_install_is_named(env, monkeypatch):
    def no_display(*_):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr("mujoco.Renderer", no_display)
    with pytest.raises(RuntimeError, match="apt-get install libegl1"):
        _make_renderer(env.model, 96, 128)


@pytest.mark.parametrize("arm", ARMS)
def test_a_replay_repeats_the_recorded_run(arm):
    env = ClothEnv(arm)
    trial = rollout(env, RandomPolicy(env.arm, seed=2), 8)
    env.close()
    motion = replay(trial)
    assert len(motion.time) == 8 * 50
    if arm == "torque":
        assert motion.theta[49::50][:-1] == pytest.approx(trial.robot[1:, :2], abs=1e-6)
    moved = np.linalg.norm(np.diff(motion.hand, axis=0), axis=1).sum()
    assert np.trapezoid(motion.hand_speed, motion.time) == pytest.approx(moved, rel=0.01)


def test_a_replay_that_starts_elsewhere_is_refused(env):
    trial = rollout(env, RandomPolicy(env.arm, seed=2), 5, random_start=True)
    with pytest.raises(ValueError, match="started elsewhere"):
        replay(trial)
