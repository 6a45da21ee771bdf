"""Throws: when the hand opens, who throws, and how a throw is planned, held back and learned from."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.dpmpb import DPMPB, Sequences
from clothlab.learning.estimation import EstimatingPolicy, NewtonEstimator
from clothlab.learning.iterative import IterativeLearningSettings
from clothlab.simulation.arm import get_arm
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.table_scene.table_env import TableEnv
from clothlab.table_scene.throwing import (
    OperatorSettings,
    OperatorThrow,
    RandomThrow,
    Swing,
    ThrowPolicy,
    ThrowSettings,
    closed_until,
    judged,
    laid_by_hand,
    look_at_spread,
    was_spread,
)

ARM = get_arm("muscle-hand")
STEPS = 4
SETTINGS = ThrowSettings(
    steps=STEPS, release=(1.0, 3.0), attempts=3, near=1e6, rest=2, starts=2, iterations=1, candidates=3
)
BIASES = {"hard-1": np.array([0.3, -0.2]), "soft-1": np.array([-0.5, 0.1])}


@pytest.fixture(scope="module")
def learned():
    """An untrained model that takes the release for something, and an untrained autoencoder."""
    torch.manual_seed(0)
    model = DPMPB(state_size=15, command_size=4).eval().requires_grad_(False)
    model.u_std.copy_(torch.tensor([0.5, 0.5, 20.0, 0.4]))
    return model, Autoencoder().eval().requires_grad_(False)


def thrown(material, release, seed=0):
    """A recorded throw that only has to be of the right sizes."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(ARM.command_lower, ARM.command_upper, (STEPS + 2, 4))
    u[:, 3] = closed_until(release, len(u))
    return Sequences(0.3 * rng.normal(size=(STEPS + 2, 15)), u, material)


RUNS = (thrown("hard-1", 2.4, 1), thrown("hard-1", 1.7, 2), thrown("soft-1", 2.9, 3))


def policy(learned, square, settings=SETTINGS, **options):
    return ThrowPolicy(*learned, ARM, square, np.zeros(2), RUNS, BIASES, settings, **options)


def sent(policy, square, steps):
    observation = {"image": square, "robot": np.zeros(12)}
    return np.array([policy(observation) for _ in range(steps)])


@pytest.mark.parametrize(
    ("release", "closed"), [(2.4, [1, 1, 0.4, 0]), (0.0, [0, 0, 0, 0]), (9.0, [1, 1, 1, 1]), (2.0, [1, 1, 0, 0])]
)
def test_the_hand_is_closed_until_it_opens(release, closed):
    assert closed_until(release, 4) == pytest.approx(closed)
    assert closed_until(release, 4).sum() == pytest.approx(min(release, 4))


def test_a_verdict_is_written_down_and_can_be_changed(muscle_trial):
    assert not was_spread(muscle_trial)
    spread = judged(muscle_trial, True)
    assert was_spread(spread)
    assert judged(spread, True).policy == spread.policy
    assert judged(spread, False).policy == muscle_trial.policy


def commands(policy, steps=20):
    return np.array([policy({}) for _ in range(steps)])


@pytest.mark.parametrize("kind", [OperatorThrow, RandomThrow])
def test_whoever_throws_opens_the_hand_once_and_never_closes_it(kind):
    thrower, released = kind(ARM), []
    for seed in range(30):
        thrower.reset(seed)
        u = commands(thrower)
        assert (u >= ARM.command_lower).all()
        assert (u <= ARM.command_upper).all()
        assert (np.diff(u[:, 3]) <= 0).all()
        assert ((u[:, 3] > 0) & (u[:, 3] < 1)).sum() <= 1
        assert u[0, 3] == 1
        released.append(u[-1, 3] == 0)
    assert 0.5 < np.mean(released) < 1  # sometimes it only swings


@pytest.mark.parametrize("kind", [OperatorThrow, RandomThrow])
def test_the_same_seed_throws_the_same(kind):
    throws = []
    for seed in (3, 3, 4):
        thrower = kind(ARM)
        thrower.reset(seed)
        throws.append(commands(thrower))
    assert np.array_equal(throws[0], throws[1])
    assert not np.allclose(throws[0], throws[2])


def test_an_operator_swings_low_then_high_then_down_and_ends_at_home():
    operator = OperatorThrow(ARM, OperatorSettings(back=(2, 2), up=(2, 2), down=(2, 2), only_swings=0.0))
    for seed in range(10):
        operator.reset(seed)
        u = commands(operator)
        assert u[1, 0] > 0.2
        assert u[3, 0] < -0.25
        assert u[5, 0] > 0.25
        assert 5 <= u[:, 3].sum() <= 9  # one to five periods after the way down begins
        assert u[-1, :2] == pytest.approx(ARM.home)
        assert len(set(u[:, 2])) == 1  # of one stiffness


def test_a_swing_is_lively_holds_the_cloth_and_is_the_same_each_time():
    swings = []
    for seed in (0, 7):
        swing = Swing(ARM)
        swing.reset(seed)
        swings.append(commands(swing))
    assert np.array_equal(*swings)
    assert (swings[0][:, 3] == 1).all()
    assert np.ptp(swings[0][:, 1]) > 1  # of the elbow


def test_a_cloth_that_swings_stays_clear_of_the_table():
    env, swing, lowest = TableEnv("muscle-hand", "hard-3", start_in="hand"), Swing(ARM), []
    env.start(seed=0)
    swing.reset()
    for _ in range(20):
        env.advance(swing({}), lambda: lowest.append(env.cloth_points()[..., 2].min()), 5)
    env.close()
    assert min(lowest) > env.furniture.height + 0.03


@pytest.mark.parametrize("kind", [OperatorThrow, RandomThrow, Swing])
def test_an_arm_that_cannot_let_go_is_refused(kind):
    with pytest.raises(
        ValueError, match="the hand of the muscle arm does not open on command; use the arm muscle-hand"
    ):
        kind("muscle")


def test_a_plan_s_end_has_a_derivative_by_the_release_time(learned, square):
    thrower = policy(learned, square)
    thrower.set_bias(BIASES["hard-1"])
    plan = thrower.starts[:1].clone()
    plan[..., -1] += 0.2  # near what was tried: the farther, the surer it is that it will be missed
    s, correction = torch.as_tensor(RUNS[0].s[0]), thrower.correction()
    plan.requires_grad_()
    (g,) = torch.autograd.grad(thrower.expected(s, plan, correction).sum(), plan)
    later, sooner = (plan.detach().clone() for _ in range(2))
    later[..., -1] += 0.01
    sooner[..., -1] -= 0.01
    with torch.no_grad():
        slope = (thrower.expected(s, later, correction) - thrower.expected(s, sooner, correction)) / 0.02
    assert float(g[..., -1].sum()) == pytest.approx(float(slope), rel=0.05, abs=1e-4)
    assert abs(float(slope)) > 1e-4


def test_recorded_throws_are_starts_with_their_release(learned, square):
    thrower = policy(learned, square)
    assert thrower.starts[:, 0, -1].tolist() == pytest.approx([2.4, 1.7, 2.9])
    for run, u in zip(RUNS, thrower.commands(thrower.starts), strict=True):
        assert u.numpy() == pytest.approx(run.u[:STEPS], abs=1e-5)


def test_what_a_recorded_throw_led_to_is_expected_of_it_again(learned, square):
    exact = replace(IterativeLearningSettings(), noise=1e-6)
    thrower = policy(learned, square, practice=exact)
    thrower.set_bias(BIASES["hard-1"])
    z_ref = encode(learned[1], square)
    for k in (0, 1):  # those with this p
        s = torch.as_tensor(RUNS[k].s[0])
        with torch.no_grad():
            expected = thrower.expected(s, thrower.starts[k : k + 1], thrower.correction())
        assert float(expected) == pytest.approx(np.linalg.norm(RUNS[k].s[STEPS, :3] - z_ref), abs=0.02)


def test_the_cloth_hangs_and_then_it_is_thrown_if_that_looks_good(learned, square):
    thrower = policy(learned, square)
    u = sent(thrower, square, 30)
    assert [attempt.released for attempt in thrower.attempts] == [True]
    assert thrower.released
    assert thrower.done
    hangs = slice(0, SETTINGS.rest)
    assert u[hangs] == pytest.approx(np.tile(ARM.home_command, (SETTINGS.rest, 1)))
    opens = np.flatnonzero(u[:, 3] < 1)[0]
    assert opens >= hangs.stop
    assert (u[:opens, 3] == 1).all()
    assert (u[opens + 1 :, 3] == 0).all()
    assert thrower.attempts[0].ended == opens + 1
    assert u[-1, :3] == pytest.approx(ARM.home_command[:3])


def test_what_looks_bad_is_held_until_the_last_attempt(learned, square):
    thrower = policy(learned, square, replace(SETTINGS, near=1e-9))
    sent(thrower, square, 40)
    assert [attempt.released for attempt in thrower.attempts] == [False, False, True]
    assert (np.diff([attempt.ended for attempt in thrower.attempts]) > SETTINGS.rest).all()


def test_a_held_swing_teaches_and_a_reset_forgets(learned, square):
    thrower = policy(learned, square, replace(SETTINGS, near=1e-9))
    s, plan = torch.zeros(15), thrower.starts[:1]
    before = thrower.expected(s, plan, thrower.correction())
    sent(thrower, square, 30)
    assert not torch.allclose(before, thrower.expected(s, plan, thrower.correction()))
    thrower.reset()
    assert thrower.attempts == []
    assert torch.allclose(before, thrower.expected(s, plan, thrower.correction()))


def test_the_descent_never_makes_a_plan_worse(learned, square):
    thrower = policy(learned, square, replace(SETTINGS, iterations=3, near=1e-9, attempts=2))
    sent(thrower, square, 30)
    assert len(thrower.trace) == 2
    for trace in thrower.trace:
        assert (np.diff(trace) <= 1e-6).all()
    for attempt in thrower.attempts:
        assert (attempt.plan >= thrower.lower).all()
        assert (attempt.plan <= thrower.upper).all()


def test_p_is_estimated_while_it_swings(learned, square):
    thrower = policy(learned, square)
    estimating = EstimatingPolicy(thrower, NewtonEstimator(learned[0]), learned[1])
    sent(estimating, square, 30)
    assert np.array_equal(thrower._p.numpy(), estimating.trace[-1])
    assert thrower.done


def test_throws_that_belong_to_nothing_are_refused(learned, square):
    with pytest.raises(ValueError, match="plans of 4 steps need recorded throws that are longer: none was given"):
        ThrowPolicy(*learned, ARM, square, np.zeros(2), [RUNS[0][:3]], BIASES, SETTINGS)
    with pytest.raises(KeyError, match="unknown material 'soft-1'; choose from hard-1"):
        ThrowPolicy(*learned, ARM, square, np.zeros(2), RUNS, {"hard-1": BIASES["hard-1"]}, SETTINGS)
    with pytest.raises(ValueError, match="load the weights of this arm"):
        ThrowPolicy(DPMPB(15, 3), learned[1], ARM, square, np.zeros(2), RUNS, BIASES, SETTINGS)
    with pytest.raises(ValueError, match="does not open on command"):
        ThrowPolicy(*learned, "muscle", square, np.zeros(2), RUNS, BIASES, SETTINGS)


def test_a_cloth_laid_by_hand_is_seen_as_spread():
    env = TableEnv("muscle-hand", start_in="hand")
    near, far = laid_by_hand(env, 0.62), laid_by_hand(env, 0.72)
    rows = [np.flatnonzero(mask.any(axis=1)).mean() for mask in (near, far)]
    assert rows[1] < rows[0]  # farther away is higher in the picture
    seen = look_at_spread(env)
    assert seen is not None
    assert seen.success
    assert seen.centre[0] == pytest.approx(0.72, abs=0.02)
    env.close()


def test_a_command_opens_the_hand_as_a_release_does():
    states = []
    for arm in ("muscle", "muscle-hand"):
        env = TableEnv(arm, start_in="hand")
        env.start(seed=0)
        u = env.arm.home_command
        for closed in (1.0, 0.4, 0.0):
            u[env.arm.closed_command] = closed
            after = closed * CONTROL_PERIOD if arm == "muscle" and closed == 0.4 else None
            env.advance(u, release_after=after)
        assert env.held == ()
        states.append(env.data.qpos.copy())
    assert np.array_equal(*states)
