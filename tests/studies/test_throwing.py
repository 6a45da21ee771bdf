"""Throws: when the hand opens, the policies that throw, and how a throw is planned,
held back and learned from.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.data import Run
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import get_arm
from studies.table_scene.table_env import TableEnv
from studies.table_scene.throwing import (
    ExcitationPolicy,
    OperatorThrow,
    RandomThrow,
    ThrowPolicy,
    ThrowSettings,
    label_spread,
    laid_by_hand,
    see_cloth_pose,
    was_spread,
)

ARM = get_arm("muscle-hand")
STEPS = 4
SETTINGS = ThrowSettings(steps=STEPS, release=(1.0, 3.0), attempts=3, near=1e6, rest=2)
BIASES = {"hard-1": np.array([0.3, -0.2]), "soft-1": np.array([-0.5, 0.1])}


@pytest.fixture(scope="module")
def learned():
    """An untrained model that takes the release for something, and an untrained
    autoencoder.
    """
    torch.manual_seed(0)
    model = DPMPB(state_size=15, command_size=4).eval().requires_grad_(False)
    model.u_std.copy_(torch.tensor([0.5, 0.5, 20.0, 0.4]))
    return model, Autoencoder().eval().requires_grad_(False)


def thrown(material, release, seed):
    """A recorded throw that only has to be of the right sizes."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(ARM.command_lower, ARM.command_upper, (STEPS + 2, 4))
    u[:, 3] = np.clip(release - np.arange(len(u)), 0, 1)
    return Run(0.3 * rng.normal(size=(STEPS + 2, 15)), u, material)


RUNS = (thrown("hard-1", 2.4, 1), thrown("hard-1", 1.7, 2), thrown("soft-1", 2.9, 3))


def new_policy(learned, square, settings=SETTINGS):
    return ThrowPolicy(*learned, ARM, square, np.zeros(2), RUNS, BIASES, settings)


def sent(policy, square, steps):
    observation = {"image": square, "robot": np.zeros(12)}
    return np.array([policy(observation) for _ in range(steps)])


def commands(policy, steps=20):
    return np.array([policy({}) for _ in range(steps)])


def test_a_label_is_written_down_and_can_be_changed(muscle_trial):
    assert not was_spread(muscle_trial)
    spread = label_spread(muscle_trial, True)
    assert was_spread(spread)
    assert spread.policy == muscle_trial.policy
    assert was_spread(label_spread(spread, True))
    assert not was_spread(label_spread(spread, False))


@pytest.mark.parametrize("kind", [OperatorThrow, RandomThrow])
def test_a_throw_opens_the_hand_once_never_closes_it_and_depends_on_the_seed(kind):
    thrower, released, throws = kind(ARM), [], []
    for seed in range(30):
        thrower.reset(seed)
        u = commands(thrower)
        assert (u >= ARM.command_lower).all()
        assert (u <= ARM.command_upper).all()
        assert (np.diff(u[:, 3]) <= 0).all()
        assert ((u[:, 3] > 0) & (u[:, 3] < 1)).sum() <= 1
        assert u[0, 3] == 1
        released.append(u[-1, 3] == 0)
        throws.append(u)
    assert 0.5 < np.mean(released) < 1  # sometimes it only swings
    thrower.reset(3)
    assert np.array_equal(commands(thrower), throws[3])
    assert not np.allclose(throws[3], throws[4])


def test_the_excitation_is_lively_holds_the_cloth_above_the_table_and_is_the_same_each_time():
    policy = ExcitationPolicy(ARM)
    first = commands(policy)
    policy.reset(7)
    assert np.array_equal(first, commands(policy))
    assert (first[:, 3] == 1).all()
    assert np.ptp(first[:, 1]) > 1  # of the elbow
    env, lowest = TableEnv("muscle-hand", "hard-3", start_in="hand"), []
    env.start(seed=0)
    for u in first:
        env.advance(u, lambda: lowest.append(env.cloth_points()[..., 2].min()), 5)
    env.close()
    assert min(lowest) > env.furniture.height + 0.03


@pytest.mark.parametrize("kind", [OperatorThrow, RandomThrow, ExcitationPolicy])
def test_an_arm_that_cannot_let_go_is_refused(kind):
    with pytest.raises(
        ValueError,
        match="hand of the muscle arm does not open on command; use the arm muscle-hand",
    ):
        kind("muscle")


def test_plans_are_the_recorded_throws_and_what_they_led_to_is_expected_again(
    learned, square
):
    policy = new_policy(learned, square)
    assert policy.plans[:, 0, -1].tolist() == pytest.approx([2.4, 1.7, 2.9])
    for run, u in zip(RUNS, policy.commands(policy.plans), strict=True):
        assert u.numpy() == pytest.approx(run.u[:STEPS], abs=1e-5)
    policy.learning = replace(policy.learning, noise=1e-6)
    policy.set_bias(BIASES["hard-1"])
    z_ref = encode(learned[1], square)
    for k in (0, 1):  # those with this p
        with torch.no_grad():
            expected = policy.expected(
                torch.as_tensor(RUNS[k].s[0]),
                policy.plans[k : k + 1],
                policy.correction(),
            )
        assert float(expected) == pytest.approx(
            np.linalg.norm(RUNS[k].s[STEPS, :3] - z_ref), abs=0.02
        )


def test_the_cloth_hangs_and_then_it_is_thrown_if_that_looks_good(learned, square):
    policy = new_policy(learned, square)
    u = sent(policy, square, 30)
    assert [attempt.released for attempt in policy.attempts] == [True]
    assert policy.released
    assert policy.done
    assert u[: SETTINGS.rest] == pytest.approx(
        np.tile(ARM.home_command, (SETTINGS.rest, 1))
    )
    opens = np.flatnonzero(u[:, 3] < 1)[0]
    assert opens >= SETTINGS.rest
    assert (u[opens + 1 :, 3] == 0).all()
    assert u[-1, :3] == pytest.approx(ARM.home_command[:3])


def test_what_looks_bad_is_held_until_the_last_attempt_and_teaches_until_a_reset(
    learned, square
):
    policy = new_policy(learned, square, replace(SETTINGS, near=1e-9))
    s, plan = torch.zeros(15), policy.plans[:1]
    before = policy.expected(s, plan, policy.correction())
    sent(policy, square, 40)
    assert [attempt.released for attempt in policy.attempts] == [False, False, True]
    assert not torch.allclose(before, policy.expected(s, plan, policy.correction()))
    policy.reset()
    assert policy.attempts == []
    assert torch.allclose(before, policy.expected(s, plan, policy.correction()))


@pytest.mark.slow
def test_a_cloth_laid_by_hand_is_seen_as_spread():
    env = TableEnv("muscle-hand", start_in="hand")
    near, far = laid_by_hand(env, 0.62), laid_by_hand(env, 0.72)
    rows = [np.flatnonzero(mask.any(axis=1)).mean() for mask in (near, far)]
    assert rows[1] < rows[0]  # farther away is higher in the picture
    seen = see_cloth_pose(env)
    assert seen is not None
    assert seen.spread
    assert seen.centre[0] == pytest.approx(0.72, abs=0.02)
    env.close()


def test_of_a_throw_of_each_foam_its_own_outcome_is_expected(learned, square):
    """The same commands from the same start: only the foam makes the difference."""
    hard = thrown("hard-1", 2.4, 1)
    s = hard.s.copy()
    s[STEPS, :3] += 2.0
    runs = (hard, Run(s, hard.u, "soft-1"))
    given = (*learned, ARM, square, np.zeros(2), runs, BIASES, SETTINGS)
    policy = ThrowPolicy(*given)
    policy.learning = replace(policy.learning, noise=1e-6)
    z_ref = encode(learned[1], square)
    for run in runs:
        policy.set_bias(BIASES[run.material])
        with torch.no_grad():
            start = torch.as_tensor(run.s[0])
            found = policy.expected(start, policy.plans[:1], policy.correction())
        ended = np.linalg.norm(run.s[STEPS, :3] - z_ref)
        assert float(found) == pytest.approx(ended, abs=0.05)
