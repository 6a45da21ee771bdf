"""What Gymnasium's own tools may ask of the environments, and recording through them."""

import subprocess
import sys
import types

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo, RescaleAction, TimeLimit

import studies.table_scene  # noqa: F401, which registers its environment
from clothlab.method.rollout import EpisodeEnded
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from clothlab.trials import Trial, rollout

SMALL = Scene(settle_time=0.2, picture_size=(96, 128))
ARRAYS = ("images", "robot", "commands")

# Two of Gymnasium's recommendations are not for this robot: commands are in the arm's
# units on purpose, and a velocity or a tension has no bound.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*symmetric and normalized space"),
    pytest.mark.filterwarnings("ignore:.*observation space (min|max)imum value is"),
]


@pytest.fixture
def small():
    env = ClothEnv(scene=SMALL, render_mode="rgb_array")
    yield env
    env.close()


def assert_equal(a, b):
    for name in ARRAYS:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_it_can_be_made_by_its_name_alone():
    code = (
        "import gymnasium; "
        'env = gymnasium.make("clothlab.simulation:clothlab/Cloth-v0", arm="muscle"); '
        "print(env.unwrapped.arm.name, env.action_space.shape)"
    )
    process = [sys.executable, "-W", "error", "-c", code]
    told = subprocess.run(process, capture_output=True, text=True, check=True).stdout
    assert told == "muscle (3,)\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    "imports", ["gymnasium, clothlab", "clothlab.simulation, gymnasium"]
)
def test_the_plain_name_is_known_once_the_package_is_imported(imports):
    code = f"import {imports}; gymnasium.make('clothlab/Cloth-v0')"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "arm"),
    [
        ("clothlab/Cloth-v0", "torque"),
        ("clothlab/Cloth-v0", "muscle"),
        ("clothlab/Table-v0", "muscle-hand"),
    ],
)
def test_gymnasium_accepts_it(name, arm):
    env = gymnasium.make(name, arm=arm, scene=SMALL, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.reset()
    home = env.unwrapped.arm.home_command
    observation, reward, terminated, truncated, info = env.step(home)
    assert observation in env.observation_space
    assert (reward, terminated, truncated, info) == (0.0, False, False, {})
    env.close()


def test_what_is_rendered_is_the_picture_of_the_scene(small):
    assert np.array_equal(small.render(), small.picture())
    assert small.metadata["render_fps"] == 5
    small.render_mode = None
    assert small.render() is None


@pytest.mark.parametrize("name", ["Cloth", "Table"])
def test_what_an_environment_cannot_be_made_with_is_named(name):
    with pytest.raises(KeyError, match="unknown arm 'octopus'; choose from torque"):
        gymnasium.make(f"clothlab/{name}-v0", arm="octopus")


def test_an_unknown_option_of_reset_is_named_and_changes_nothing(env):
    before = env.data.qpos.copy()
    message = "unknown option of reset 'place'; choose from random_start"
    with pytest.raises(KeyError, match=message):
        env.reset(options={"place": 3})
    assert np.array_equal(env.data.qpos, before)


def test_a_trial_is_recorded_through_wrappers(small):
    policy = RandomPolicy("torque")
    bare = rollout(small, policy, 4, seed=2)
    assert isinstance(bare, Trial)
    assert_equal(rollout(TimeLimit(small, 4), policy, 4, seed=2), bare)


def test_a_time_limit_ends_a_run_and_what_was_recorded_is_kept(small):
    policy = RandomPolicy("torque")
    whole = rollout(small, policy, 5, seed=2)
    message = r"time limit .* after 3 of 5 steps.*raise its `max_episode_steps`"
    with pytest.raises(EpisodeEnded, match=message) as told:
        rollout(TimeLimit(small, 3), policy, 5, seed=2)
    assert_equal(told.value.run, whole[:3])


def test_a_trial_holds_what_reached_the_arm_whatever_a_wrapper_made_of_it(small):
    unit = RescaleAction(small, np.float64(-1.0), np.float64(1.0))
    trial = rollout(unit, lambda observation: np.array([1.0, -1.0]), 3)
    arm = small.arm
    expected = [arm.command_upper[0], arm.command_lower[1]]
    assert trial.commands == pytest.approx(np.tile(expected, (3, 1)))
    assert_equal(rollout(small, ReplayPolicy(trial.commands), 3), trial)


@pytest.mark.parametrize("wrap", [lambda env: env, lambda env: TimeLimit(env, 9)])
def test_what_is_filmed_is_filmed_through_wrappers_and_changes_nothing(small, wrap):
    policy = RandomPolicy("torque")
    moments = []
    watched = rollout(
        wrap(small), policy, 2, watch=lambda: moments.append(small.data.time), samples=4
    )
    assert moments == pytest.approx(0.05 * np.arange(1, 9))
    assert_equal(watched, rollout(small, policy, 2))
    small.step(small.arm.home_command)
    assert len(moments) == 8, "only a rollout is watched"


@pytest.mark.slow
def test_a_video_has_every_step(small, tmp_path, monkeypatch):
    class Clip:
        """Takes the place of moviepy, which only writes the file."""

        def __init__(self, frames, fps):
            written.append((np.array(frames), fps))

        def write_videofile(self, path, logger):
            pass

    written = []
    module = "moviepy.video.io.ImageSequenceClip"
    for k in range(4):
        name = ".".join(module.split(".")[: k + 1])
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules[module].ImageSequenceClip = Clip

    policy = RandomPolicy("torque")
    filmed = RecordVideo(small, str(tmp_path / "films"), video_length=0)
    trial = rollout(filmed, policy, 3)
    filmed.stop_recording()
    ((frames, fps),) = written
    assert fps == 5
    assert frames.shape == (4, 96, 128, 3)  # the start, and after each step
    assert np.array_equal(frames[-1], small.render())
    assert_equal(rollout(small, policy, 3), trial)


def test_a_record_of_states_is_a_run_of_any_environment(small):
    trial = rollout(small, RandomPolicy("torque"), 3)
    see = lambda observation: observation["robot"]  # noqa: E731
    run = rollout(small, RandomPolicy("torque"), 3, material="any", observe=see)
    assert run.s == pytest.approx(trial.robot, abs=1e-6)
    assert run.u == pytest.approx(trial.commands, abs=1e-6)
    assert run.material == "any"


def test_a_robot_without_a_record_of_its_own_needs_a_name_for_its_material():
    env = gymnasium.make("Pendulum-v1")
    with pytest.raises(ValueError, match=r"makes no record of its own: name the mat"):
        rollout(env, lambda observation: [0.0], 2)
    assert len(rollout(env, lambda s: [0.0], 2, material="light")) == 2


def test_a_command_of_nan_is_refused_before_it_is_sent():
    env = gymnasium.make("Pendulum-v1")
    sent = []
    env.step = sent.append
    message = r"the command of .* is \[1\] and finite, got nan"
    with pytest.raises(ValueError, match=message):
        rollout(env, lambda s: [np.nan], 2, material="light")
    assert sent == []


def test_a_policy_of_another_library_is_reset_with_the_seed():
    class Counts:
        def reset(self, seed):
            self.seed = seed

        def __call__(self, s):
            return [0.0]

    policy = Counts()
    rollout(gymnasium.make("Pendulum-v1"), policy, 1, seed=7, material="any")
    assert policy.seed == 7
