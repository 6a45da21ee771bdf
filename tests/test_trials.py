"""Recorded runs: what they hold, that they repeat, that they survive being written; and the policies."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from clothlab.policies import Noisy, OperatorPolicy, Policy, RandomPolicy, ReplayPolicy, Timed, Wrapper, as_policy
from clothlab.simulation.arm import ARMS, MuscleArm, get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, load_trial, replay, rollout, save_trial, sensed_by, watch_motion

ARRAYS = ("images", "robot", "commands")
POLICIES = {
    "random": RandomPolicy,
    "operator": OperatorPolicy,
    "noisy": lambda arm: Noisy(RandomPolicy(arm), arm, 0.2),
    "timed": lambda arm: Timed(OperatorPolicy(arm)),
}


def assert_equal(a: Trial, b: Trial) -> None:
    for name in ARRAYS:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    assert (a.cloth, a.arm, a.policy, a.seed) == (b.cloth, b.arm, b.policy, b.seed)


class Told(Policy):
    """Remembers what it was told."""

    def __init__(self):
        self.heard = []

    def reset(self, seed=0):
        self.heard.append(("reset", seed))

    def set_target(self, mask):
        self.heard.append(("target", mask))

    def set_bias(self, p):
        self.heard.append(("bias", p))

    def __call__(self, observation):
        return np.array([0.4, -0.4])


@pytest.mark.parametrize("arm", ["torque", "muscle"])
@pytest.mark.parametrize("policy", POLICIES)
def test_a_second_run_with_the_same_policy_is_the_first_one_bit_for_bit(arm, policy, env, muscle_env):
    env = env if arm == "torque" else muscle_env
    policy = POLICIES[policy](env.arm)
    first, second, other = (rollout(env, policy, 8, seed=seed, random_start=True) for seed in (3, 3, 4))
    assert_equal(first, second)
    assert not np.array_equal(first.commands, other.commands)


def test_a_new_scene_and_a_new_policy_give_the_same_trial(trial):
    env = ClothEnv(trial.arm, trial.cloth)
    assert_equal(rollout(env, RandomPolicy(env.arm), len(trial)), trial)
    env.close()


def test_a_watched_run_is_the_same(env):
    looks = []
    plain, watched = rollout(env, RandomPolicy(env.arm), 4), None
    watched = rollout(env, RandomPolicy(env.arm), 4, watch=lambda: looks.append(1), samples=3)
    assert_equal(plain, watched)
    assert len(looks) == 12


def test_a_policy_that_changes_its_arrays_in_place_does_not_rewrite_the_past(env):
    u = env.arm.home_command

    def scribbles(observation):
        u[0] -= 0.05
        observation["image"][:] = 0
        observation["robot"][:] = 99.0
        return u

    trial = rollout(env, scribbles, 4)
    assert trial.commands[:, 0] == pytest.approx(0.4 - 0.05 * np.arange(1, 5))
    assert trial.images.any(axis=(1, 2)).all()
    assert np.abs(trial.robot).max() < 99
    assert trial.policy == "scribbles"


def test_a_trial_records_what_was_sent(env):
    trial = rollout(env, lambda _: np.float32([-0.8, -1.6]), 2, name="edge")
    assert (trial.commands == env.arm.command_lower).all()
    assert (trial.policy, trial.seed, len(trial)) == ("edge", 0, 2)
    assert trial.time.tolist() == pytest.approx([0.0, 0.2])


@pytest.mark.parametrize("steps", [0, -3, 2.5, None, "3", np.nan])
def test_a_run_has_steps(env, steps):
    with pytest.raises(ValueError, match=r"steps (must be at least 1|is a whole number)"):
        rollout(env, RandomPolicy(env.arm), steps)


@pytest.mark.parametrize("answer", [None, "left", [0.0], [np.nan, 0.0], [9.0, 0.0]])
def test_a_policy_that_answers_nonsense_is_refused(env, answer):
    with pytest.raises(ValueError, match=r"command"):
        rollout(env, lambda _: answer, 2)


@pytest.mark.parametrize("wrong", [None, 3, "random", RandomPolicy])
def test_what_cannot_be_called_with_an_observation_is_no_policy(env, wrong):
    for use in (as_policy, Wrapper, lambda policy: rollout(env, policy, 1)):
        with pytest.raises(TypeError, match=r"a policy is called with an observation and returns a command, got"):
            use(wrong)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("arm", ARMS)
def test_policies_stay_in_range(policy, arm):
    arm = get_arm(arm)
    chosen = POLICIES[policy](arm)
    commands = np.array([chosen({}) for _ in range(300)])
    assert (commands >= arm.command_lower).all()
    assert (commands <= arm.command_upper).all()
    assert commands.std(axis=0).min() > 0.1


def test_random_commands_are_held_for_one_to_so_many_steps():
    policy = RandomPolicy("torque", longest_hold=3)
    commands = np.array([policy({}) for _ in range(600)])
    changes = np.flatnonzero((np.diff(commands, axis=0) != 0).any(axis=1))
    assert set(np.diff(changes)) == {1, 2, 3}


def test_a_command_belongs_to_whom_it_was_given():
    policy = RandomPolicy("torque", longest_hold=50)
    policy({})[:] = 99
    assert np.abs(policy({})).max() < 2


def test_the_operator_lifts_slowly_and_throws_down_fast():
    policy = OperatorPolicy("torque")
    speed = np.diff([policy({})[0] for _ in range(400)])  # positive is downwards
    assert speed[speed > 1e-6].mean() > 1.5 * -speed[speed < -1e-6].mean()


def test_noise_shakes_angles_and_leaves_stiffness_alone():
    arm = MuscleArm()
    still = lambda _: arm.home_command  # noqa: E731
    shaken, calm = Noisy(still, arm, 0.1), Noisy(still, arm, 0)
    commands = np.array([shaken({}) for _ in range(500)])
    assert commands[:, :2].std(axis=0) == pytest.approx([0.1, 0.1], rel=0.15)
    assert (commands[:, 2] == arm.home_tension).all()
    assert np.array_equal(calm({}), arm.home_command)


@pytest.mark.parametrize("sigma", [-0.1, np.nan, np.inf, None, "1"])
def test_noise_has_a_size(sigma):
    with pytest.raises(ValueError, match=r"sigma (must be at least 0|is a finite number)"):
        Noisy(RandomPolicy("torque"), "torque", sigma)


@pytest.mark.parametrize("hold", [0, -1, 1.5, None])
def test_a_command_is_held_for_a_step_at_least(hold):
    with pytest.raises(ValueError, match=r"longest_hold"):
        RandomPolicy("torque", longest_hold=hold)


def test_a_wrapper_passes_on_all_that_it_is_told():
    told = Told()
    wrapper = Timed(Noisy(Wrapper(told), "torque", 0.0))
    wrapper.set_target("mask")
    wrapper.set_bias("p")
    wrapper.reset(5)
    assert told.heard[-3:] == [("target", "mask"), ("bias", "p"), ("reset", 5)]
    assert wrapper.name == told.name
    wrapper({})
    assert len(wrapper.seconds) == 1
    wrapper.reset()
    assert wrapper.seconds == []


def test_a_policy_need_not_listen_but_must_choose():
    policy = Policy()
    policy.reset(3)
    policy.set_target(None)
    policy.set_bias(None)
    with pytest.raises(NotImplementedError):
        policy({})


def test_recorded_commands_are_sent_again_and_no_more(env, trial):
    policy = ReplayPolicy(trial.commands)
    for _ in range(2):
        assert np.array_equal(rollout(env, policy, 12).robot, trial.robot)
    with pytest.raises(ValueError, match=r"only 12 commands were recorded"):
        rollout(env, policy, 13)


@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_a_replay_repeats_the_recorded_run(arm, trial, muscle_trial):
    trial = (trial if arm == "torque" else muscle_trial)[:8]
    motion = replay(trial)
    assert len(motion.time) == 8 * 50
    assert motion.time == pytest.approx(0.004 * np.arange(1, 401))
    if arm == "torque":
        assert motion.theta[49::50][:-1] == pytest.approx(trial.robot[1:, :2], abs=1e-6)
    moved = np.linalg.norm(np.diff(motion.hand, axis=0), axis=1).sum()
    assert np.trapezoid(motion.hand_speed, motion.time) == pytest.approx(moved, rel=0.01)


def test_a_replay_with_another_arm_is_another_run(muscle_trial):
    stiffer = replace(get_arm("muscle"), spring_linear=2000.0)
    same, other = replay(muscle_trial[:3]), replay(muscle_trial[:3], arm=stiffer)
    assert not np.allclose(same.hand, other.hand)


def test_a_motion_goes_on_from_where_the_scene_stands(env, trial):
    whole = replay(trial[:4])
    parts = [watch_motion(env, trial.commands[steps]) for steps in (slice(0, 2), slice(2, 4))]
    assert np.array_equal(np.concatenate([part.hand for part in parts]), whole.hand)
    assert np.array_equal(np.concatenate([part.time for part in parts]), whole.time)
    with pytest.raises(ValueError, match="needs commands"):
        watch_motion(env, trial.commands[:0])


def test_what_an_arm_that_feels_would_have_recorded_is_what_it_records(trial):
    env = ClothEnv("torque-feeling", trial.cloth)
    felt = rollout(env, ReplayPolicy(trial.commands), len(trial), seed=trial.seed, name=trial.policy)
    env.close()
    told = sensed_by(trial, "torque-feeling")
    assert told.robot == pytest.approx(felt.robot, abs=1e-9)
    assert np.ptp(told.robot[:, 4:], axis=0).min() > 1  # [N m]
    assert (told.arm, told.cloth, told.policy, told.seed) == ("torque-feeling", trial.cloth, trial.policy, trial.seed)
    assert np.array_equal(told.images, felt.images)
    assert np.array_equal(told.commands, trial.commands)
    assert sensed_by(trial, "torque") is trial


def test_what_does_not_follow_from_a_recording_is_refused(trial, muscle_trial):
    with pytest.raises(ValueError, match=r"the torque-feeling arm senses does not follow from .* the muscle arm"):
        sensed_by(muscle_trial, "torque-feeling")
    with pytest.raises(ValueError, match=r"the muscle arm senses does not follow from .* the torque arm"):
        sensed_by(trial, "muscle")
    with pytest.raises(ValueError, match="did not start from the arm's home"):
        sensed_by(trial[6:], "torque-feeling")
    with pytest.raises(KeyError, match="choose from torque, muscle, torque-feeling"):
        sensed_by(trial, "tail")


def test_a_replay_that_starts_elsewhere_is_refused(env):
    trial = rollout(env, RandomPolicy(env.arm), 2, random_start=True)
    with pytest.raises(ValueError, match=r"started elsewhere"):
        replay(trial)


@pytest.mark.parametrize("interval", [0.006, 0.0, -0.004, np.nan, 0.3, 0.001, np.inf, None, "0.004"])
def test_a_replay_looks_at_whole_time_steps(trial, interval):
    with pytest.raises(ValueError, match=r"interval (must be|is a finite number)"):
        replay(trial, interval=interval)


def test_a_trial_survives_the_round_trip(trial, muscle_trial, tmp_path):
    for each in (trial, replace(muscle_trial, seed=np.int64(7), policy="großartig")):
        save_trial(each, tmp_path / "trial.npz")
        assert_equal(load_trial(str(tmp_path / "trial.npz")), each)


def test_a_file_of_a_trial_holds_no_pickles_and_says_its_format(trial, tmp_path):
    save_trial(trial, tmp_path / "trial.npz")
    with np.load(tmp_path / "trial.npz", allow_pickle=False) as file:
        about = json.loads(str(file["about"]))
        assert file["images"].dtype == np.uint8
    assert about == {"format": 1, "cloth": asdict(trial.cloth), "arm": "torque", "policy": "random", "seed": 0}


@pytest.mark.parametrize("name", ["run1", "run1.npy", ".npz", "run1.npz.bak"])
def test_a_trial_is_saved_where_it_is_looked_for(trial, tmp_path, name):
    (tmp_path / name).write_text("old")
    with pytest.raises(ValueError, match=r"a trial's file ends in .npz, got"):
        save_trial(trial, tmp_path / name)
    assert (tmp_path / name).read_text() == "old"


def test_on_a_full_disk_the_old_trial_stays(trial, tmp_path, full_disk):
    path = tmp_path / "trial.npz"
    save_trial(trial, path)
    with full_disk(), pytest.raises(OSError, match=r"File too large"):
        save_trial(trial[:3], path)
    assert_equal(load_trial(path), trial)
    assert list(tmp_path.iterdir()) == [path]


def rewritten(trial: Trial, path, **change) -> None:
    """Write a file of a trial with something changed, or left out where it is None."""
    save_trial(trial, path)
    with np.load(path) as file:
        content = {name: change.get(name, file[name]) for name in file.files}
    np.savez(path, **{name: array for name, array in content.items() if array is not None})


def about(trial: Trial, **change) -> np.ndarray:
    content = {"format": 1, "cloth": asdict(trial.cloth), "arm": "torque", "policy": "random", "seed": 0} | change
    return np.array(json.dumps({key: value for key, value in content.items() if value != "none"}))


@pytest.mark.parametrize(
    "change",
    [
        lambda trial: {"about": np.array("{")},
        lambda trial: {"about": np.array("[]")},
        lambda trial: {"about": None},
        lambda trial: {"about": about(trial, format=2)},
        lambda trial: {"about": about(trial, format="none")},
        lambda trial: {"about": about(trial, cloth="soft-1")},
        lambda trial: {"about": about(trial, cloth={"name": "x", "mass": -1})},
        lambda trial: {"about": about(trial, cloth={"name": "x", "colour": "red"})},
        lambda trial: {"about": about(trial, arm="octopus")},
        lambda trial: {"about": about(trial, arm="muscle")},
        lambda trial: {"about": about(trial, policy=None)},
        lambda trial: {"about": about(trial, seed=None)},
        lambda trial: {"about": about(trial, seed="none")},
        lambda trial: {"about": about(trial, more=1)},
        lambda trial: {"images": None},
        lambda trial: {"images": np.zeros((12, 96, 15), np.uint8)},
        lambda trial: {"images": np.zeros((11, 96, 16), np.uint8)},
        lambda trial: {"images": np.zeros((12, 96, 16))},
        lambda trial: {"robot": trial.robot[:, :3]},
        lambda trial: {"robot": np.zeros((12, 12))},
        lambda trial: {"robot": trial.robot * np.nan},
        lambda trial: {"robot": np.array(["a"] * 12)},
        lambda trial: {"commands": trial.commands[:5]},
        lambda trial: {"commands": None},
    ],
)
def test_a_file_that_holds_something_else_is_no_trial(trial, tmp_path, change):
    rewritten(trial, tmp_path / "trial.npz", **change(trial))
    with pytest.raises(ValueError, match=r"trial.npz is damaged or holds no trial: .+"):
        load_trial(tmp_path / "trial.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"text", b"\x93NUMPY\x01\x00"])
def test_a_cut_or_foreign_file_is_no_trial(tmp_path, content):
    (tmp_path / "trial.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"trial.npz is damaged or holds no trial: .+"):
        load_trial(tmp_path / "trial.npz")


def test_a_folder_is_no_trial_and_a_missing_file_is_missing(tmp_path):
    with pytest.raises(ValueError, match=r"damaged or holds no trial"):
        load_trial(tmp_path)
    (tmp_path / "dangling.npz").symlink_to(tmp_path / "nowhere.npz")
    for name in ("none.npz", "dangling.npz"):
        with pytest.raises(FileNotFoundError):
            load_trial(tmp_path / name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda trial: {"commands": trial.commands[:5]}, r"one row for each of the 12 images, got 5"),
        (lambda trial: {"robot": trial.robot * np.nan}, r"robot of the torque arm is \[T, 4\] and finite, got nan"),
        (lambda trial: {"robot": trial.robot[:, :3]}, r"got the shape \[12, 3\]"),
        (lambda trial: {"images": trial.images[:, :48]}, r"cloth images are"),
        (lambda trial: {"images": trial.images[0]}, r"images are \[T, H, W\]"),
        (lambda trial: {"images": trial.images * 255}, r"0 and 1 only"),
        (lambda trial: {"cloth": "soft-1"}, r"Trial.cloth is a Cloth, got soft-1"),
        (lambda trial: {"policy": None}, r"Trial.policy is a str, got None"),
        (lambda trial: {"seed": None}, r"Trial.seed is a whole number"),
        (lambda trial: {"seed": 1.5}, r"Trial.seed is a whole number"),
        (lambda trial: {"arm": get_arm("torque")}, r"Trial.arm is a str"),
    ],
)
def test_what_does_not_belong_together_is_no_trial(trial, change, message):
    with pytest.raises(ValueError, match=message):
        replace(trial, **change(trial))


def test_a_trial_names_an_arm_that_there_is(trial):
    with pytest.raises(KeyError, match=r"unknown arm 'octopus'; choose from torque"):
        replace(trial, arm="octopus")


def test_lists_will_do(trial):
    assert_equal(trial, replace(trial, **{name: getattr(trial, name).tolist() for name in ARRAYS}))


def test_a_stretch_of_a_trial_is_a_trial_and_a_step_is_none(trial):
    assert len(trial[2:5]) == 3
    assert np.array_equal(trial[2:5].robot, trial.robot[2:5])
    assert trial[2:5].cloth is trial.cloth
    assert get_cloth(trial.cloth) is trial.cloth
    with pytest.raises(TypeError, match=r"cut with a slice, such as trial\[:100\], not with 3"):
        trial[3]
