"""Recorded runs: what they hold, that they repeat, that they survive being written; and
how the arm moved in them.
"""

import json
import tracemalloc
import zipfile
from dataclasses import asdict, replace

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


@pytest.mark.parametrize("steps", [0, 2.5, None])
def test_a_run_has_steps(env, steps):
    with pytest.raises(
        ValueError, match=r"steps (must be at least 1|is a whole number)"
    ):
        rollout(env, RandomPolicy(env.arm), steps)


@pytest.mark.parametrize("answer", [None, [0.0], [np.nan, 0.0], [9.0, 0.0]])
def test_a_policy_that_answers_nonsense_is_refused(env, answer):
    with pytest.raises(ValueError, match=r"command"):
        rollout(env, lambda _: answer, 2)


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
    # Older files said it behind the policy's name
    rewritten(trial, path, about=about(trial, policy="throw, spread"))
    old = load_trial(path)
    assert (old.policy, old.outcome) == ("throw", "spread")
    rewritten(trial, path, about=about(trial, policy="throw"))
    assert load_trial(path).outcome == ""


@pytest.mark.parametrize("name", ["run1", "run1.npy", ".npz"])
def test_a_trial_is_saved_where_it_is_looked_for(trial, tmp_path, name):
    (tmp_path / name).write_text("old")
    with pytest.raises(ValueError, match=r"a trial's file ends in .npz, got"):
        save_trial(trial, tmp_path / name)
    assert (tmp_path / name).read_text() == "old"


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


@pytest.mark.parametrize(
    "change",
    [
        lambda trial: {"about": np.array("{")},
        lambda trial: {"about": None},
        lambda trial: {
            "about": np.array({"format": 1}, dtype=object)
        },  # a pickle, which is not read
        lambda trial: {"about": about(trial, cloth={"name": "x", "colour": "red"})},
        lambda trial: {"about": about(trial, seed=None)},
        lambda trial: {"images": None},
        lambda trial: {"images": np.zeros((12, 96, 15), np.uint8)},
        lambda trial: {"images": np.zeros((11, 96, 16), np.uint8)},
        lambda trial: {"robot": trial.robot[:, :3]},
        lambda trial: {"robot": trial.robot * np.nan},
        lambda trial: {"robot": trial.robot + 1j},
        lambda trial: {
            name: np.zeros((0, *shape), kind) for name, shape, kind in EMPTY
        },
    ],
)
def test_a_file_that_holds_something_else_is_no_trial(trial, tmp_path, change):
    rewritten(trial, tmp_path / "trial.npz", **change(trial))
    with pytest.raises(ValueError, match=r"trial.npz is damaged or holds no trial: .+"):
        load_trial(tmp_path / "trial.npz")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"format": 4}, "its format is 4, this version reads 1 to 3"),
        (
            {"arm": "octopus"},
            "its arm 'octopus' is unknown; known are torque, muscle, muscle-hand",
        ),
        (
            {"arm": {"class": "Octopus", "name": "torque"}},
            "its class of arms 'Octopus' is unknown",
        ),
    ],
)
def test_a_trial_of_another_kind_is_not_called_damaged(trial, tmp_path, change, reason):
    rewritten(trial, tmp_path / "trial.npz", about=about(trial, **change))
    with pytest.raises(
        ValueError, match=rf"trial.npz is no trial that can be read here: {reason}"
    ):
        load_trial(tmp_path / "trial.npz")


def test_a_small_file_that_would_take_gigabytes_is_refused_before_it_is_unpacked(
    trial, tmp_path
):
    path = tmp_path / "trial.npz"
    save_trial(trial, path)
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open("bomb.npy", "w") as member,
    ):
        np.lib.format.write_array_header_1_0(
            member, {"descr": "|u1", "fortran_order": False, "shape": (3 * 2**30,)}
        )
        for _ in range(200):
            member.write(bytes(2**20))
    tracemalloc.start()
    with pytest.raises(
        ValueError, match=r"it unpacks to 3,22\d MB, and 134 MB are the most"
    ):
        load_trial(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 20e6


class Crane(TorqueArm):
    """An arm of a reader's own."""


@pytest.mark.parametrize(
    "arm",
    [
        replace(TorqueArm(), link_length=0.35),  # which has kept its name
        replace(TorqueArm(), name="mine"),
        MuscleArm().with_stiffness(20.0),
        Crane(name="crane"),
    ],
    ids=["changed", "renamed", "fixed stiffness", "subclass"],
)
def test_a_run_of_a_changed_arm_is_recorded_and_read_as_one_of_that_arm(arm, tmp_path):
    env = ClothEnv(arm)
    trial = rollout(env, RandomPolicy(env.arm), 2)
    env.close()
    assert trial.arm == arm
    save_trial(trial, tmp_path / "trial.npz")
    assert_equal(load_trial(tmp_path / "trial.npz"), trial)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"env": "torque"},
            r"env is a Gymnasium environment, such as ClothEnv\(arm, cloth\), got str",
        ),
        ({"env": ClothEnv}, r"such as ClothEnv\(arm, cloth\), got type"),
        ({"options": {"random_start": "no"}}, "random_start is True or False, got no"),
        ({"options": ["random_start"]}, "options is a dict, got list"),
        ({"observe": np.asarray}, "observe makes states of a Run: name its material"),
        ({"material": 3}, "material is a str, got int 3"),
        (
            {"material": "any", "watch": print},
            "only an environment's own record can be watched",
        ),
        ({"samples": 101}, "samples must be at most 100"),
        ({"seed": 1.5}, "seed is a whole number"),
    ],
)
def test_a_plausible_mistake_is_answered_before_a_step_is_made(env, wrong, message):
    with pytest.raises(ValueError, match=message):
        rollout(**{"env": env, "policy": RandomPolicy("torque"), "steps": 1} | wrong)


EMPTY = (
    ("images", (96, 16), np.uint8),
    ("robot", (4,), float),
    ("commands", (2,), float),
)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"text", b"\x93NUMPY\x01\x00"])
def test_a_cut_or_foreign_file_is_no_trial(tmp_path, content):
    (tmp_path / "trial.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"trial.npz is damaged or holds no trial: .+"):
        load_trial(tmp_path / "trial.npz")


def test_a_folder_is_no_trial_and_a_missing_file_is_missing(tmp_path):
    with pytest.raises(ValueError, match=r"damaged or holds no trial"):
        load_trial(tmp_path)
    with pytest.raises(FileNotFoundError):
        load_trial(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda trial: {"commands": trial.commands[:5]},
            r"one row for each of the 12 images, got 5",
        ),
        (
            lambda trial: {"robot": trial.robot * np.nan},
            r"robot of the torque arm is \[T, 4\] and finite, got nan",
        ),
        (lambda trial: {"images": trial.images[0]}, r"images are \[T, H, W\]"),
        (
            lambda trial: {"images": trial.images[:0]},
            r"images are \[T, H, W\] of at least one step",
        ),
        (lambda trial: {"images": trial.images * 255}, r"0 and 1 only"),
        (lambda trial: {"cloth": "soft-1"}, r"Trial.cloth is a Cloth, got soft-1"),
        (lambda trial: {"seed": 1.5}, r"Trial.seed is a whole number"),
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
    with pytest.raises(ValueError, match="at least one step"):
        trial[20:]
