"""Recorded runs: what they hold, that they repeat, that they survive being written; and
how the arm moved in them.
"""

import base64
import json
import re
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import MuscleArm, TorqueArm
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, load_trial, rollout, save_trial
from studies.motion import replay

ARRAYS = ("images", "robot", "commands")


def assert_equal(a: Trial, b: Trial) -> None:
    for name in ARRAYS:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    assert (a.cloth, a.arm, a.policy, a.seed) == (b.cloth, b.arm, b.policy, b.seed)
    assert a.outcome == b.outcome


@pytest.mark.slow
def test_a_new_scene_and_a_new_policy_give_the_same_trial(trial):
    env = ClothEnv(trial.arm, trial.cloth)
    assert_equal(rollout(env, RandomPolicy(env.arm), len(trial)), trial)
    env.close()


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


def test_a_policy_that_returns_nothing_is_refused(env):
    with pytest.raises(ValueError, match=r"command"):
        rollout(env, lambda _: None, 2)


@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_a_replay_repeats_the_recorded_run(arm, trial, muscle_trial):
    trial = (trial if arm == "torque" else muscle_trial)[:8]
    motion = replay(trial)
    assert motion.time == pytest.approx(0.004 * np.arange(1, 401))
    if arm == "torque":
        assert motion.theta[49::50][:-1] == pytest.approx(trial.robot[1:, :2], abs=1e-6)
    moved = np.linalg.norm(np.diff(motion.hand, axis=0), axis=1).sum()
    assert np.trapezoid(motion.hand_speed, motion.time) == pytest.approx(
        moved, rel=0.01
    )


def test_a_replay_that_starts_elsewhere_is_refused(env):
    trial = rollout(env, RandomPolicy(env.arm), 2, options={"random_start": True})
    with pytest.raises(ValueError, match=r"started elsewhere"):
        replay(trial)


def test_a_trial_survives_the_round_trip(trial, muscle_trial, tmp_path):
    for each in (trial, replace(muscle_trial, seed=np.int64(7), policy="großartig")):
        save_trial(each, tmp_path / "trial.npz")
        assert_equal(load_trial(str(tmp_path / "trial.npz")), each)


def test_a_file_of_a_trial_holds_no_pickles_and_says_its_format(trial, tmp_path):
    save_trial(trial, tmp_path / "trial.npz")
    with np.load(tmp_path / "trial.npz", allow_pickle=False) as file:
        about = json.loads(str(file["about"]))
        assert file["images"].dtype == np.uint8
    assert about == {
        "format": 1,
        "cloth": asdict(trial.cloth),
        "arm": "torque",
        "policy": "random",
        "seed": 0,
    }


def test_what_came_of_a_trial_is_stored_apart_from_its_policy(trial, tmp_path):
    path = tmp_path / "trial.npz"
    spread = replace(trial, outcome="spread", policy="mine, spread")
    save_trial(spread, path)
    assert_equal(load_trial(path), spread)


def test_a_trial_is_saved_where_it_is_looked_for(trial, tmp_path):
    with pytest.raises(ValueError, match=r"a trial's file ends in .npz, got"):
        save_trial(trial, tmp_path / "run1")


def rewritten(trial: Trial, path, **change) -> None:
    """Write a file of a trial with something changed, or left out where it is None."""
    save_trial(trial, path)
    with np.load(path) as file:
        content = {name: change.get(name, file[name]) for name in file.files}
    np.savez(
        path, **{name: array for name, array in content.items() if array is not None}
    )


def about(trial: Trial, **change) -> np.ndarray:
    content = {
        "format": 1,
        "cloth": asdict(trial.cloth),
        "arm": "torque",
        "policy": "random",
        "seed": 0,
    } | change
    return np.array(json.dumps(content))


def test_a_file_that_holds_something_else_is_no_trial(trial, tmp_path):
    path = tmp_path / "trial.npz"
    rewritten(trial, path, robot=trial.robot[:, :3])
    with pytest.raises(ValueError, match=r"trial.npz is damaged or holds no trial: .+"):
        load_trial(path)
    path.write_bytes(b"text")
    with pytest.raises(ValueError, match=r"trial.npz is damaged or holds no trial: .+"):
        load_trial(path)


def test_a_trial_of_another_version_says_so(trial, tmp_path):
    rewritten(trial, tmp_path / "trial.npz", about=about(trial, format=4))
    with pytest.raises(
        ValueError, match=r"trial.npz .*: its format is 4, this version reads 1"
    ):
        load_trial(tmp_path / "trial.npz")


@pytest.mark.parametrize(
    "arm",
    [
        replace(TorqueArm(), link_length=0.35),  # which has kept its name
        replace(TorqueArm(), name="mine"),
        MuscleArm().with_stiffness(20.0),
        replace(TorqueArm(), name="crane", gripper=True),
    ],
    ids=["changed", "renamed", "fixed stiffness", "gripper"],
)
def test_a_run_of_a_changed_arm_is_recorded_and_read_as_one_of_that_arm(arm, tmp_path):
    env = ClothEnv(arm)
    trial = rollout(env, RandomPolicy(env.arm), 2)
    env.close()
    assert trial.arm == arm
    save_trial(trial, tmp_path / "trial.npz")
    assert_equal(load_trial(tmp_path / "trial.npz"), trial)


def test_an_environment_s_name_is_no_environment():
    message = r"env is a Gymnasium environment, such as ClothEnv\(arm, cloth\), got str"
    with pytest.raises(ValueError, match=message):
        rollout("torque", RandomPolicy("torque"), 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda trial: {"commands": trial.commands[:5]},
            r"one row for each of the 12 images, got 5",
        ),
        (lambda trial: {"images": trial.images * 255}, r"0 and 1 only"),
    ],
)
def test_what_does_not_belong_together_is_no_trial(trial, change, message):
    with pytest.raises(ValueError, match=message):
        replace(trial, **change(trial))


def test_the_time_of_a_trial_starts_at_zero_and_ends_a_step_before_its_length(trial):
    assert trial.time == pytest.approx(0.2 * np.arange(len(trial)))


def test_a_part_of_a_trial_is_a_trial_and_a_step_is_none(trial):
    assert len(trial[2:5]) == 3
    assert np.array_equal(trial[2:5].robot, trial.robot[2:5])
    assert trial[2:5].cloth is trial.cloth
    with pytest.raises(
        TypeError, match=r"cut with a slice, such as trial\[:100\], not with 3"
    ):
        trial[3]


def test_a_notebook_shows_the_film_strip_of_a_trial(trial):
    page = trial._repr_html_()
    words, png = re.fullmatch(
        r'(.*)<br><img src="data:image/png;base64,(.*)" alt=".*">', page
    ).groups()
    assert words == repr(trial)
    strip = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), -1)
    assert strip.shape == (50, 10 * 66)
    first = trial.images[0, ::2, ::2]
    assert np.array_equal(strip[1:-1, 1:65] > 200, first)
    last = trial.images[-1, ::2, ::2]
    assert np.array_equal(strip[1:-1, -65:-1] > 200, last)
