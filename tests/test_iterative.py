"""Laws of practice: what is learned from outcomes, and what is done with it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import nearest_plans
from clothlab.learning.dpmpb import DPMPB, Sequences
from clothlab.learning.iterative import Attempt, Correction, IterativeLearningPolicy, IterativeLearningSettings
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout

RNG = np.random.default_rng(0)
RUN = Sequences(RNG.normal(size=(40, 7)), RNG.uniform((-0.8, -1.6), (1.0, 0.0), (40, 2)), "damp0.05-mass0.10")


@pytest.fixture
def practice(square):
    def make(runs=(RUN,), p=(0.0, 0.0), arm="torque", sizes=(7, 2), **change):
        torch.manual_seed(0)
        settings = replace(IterativeLearningSettings(iterations=2, starts=2), **change)
        return IterativeLearningPolicy(DPMPB(*sizes).eval(), Autoencoder().eval(), arm, square, p, runs, settings)

    return make


def attempts(policy, missed, count=3):
    """Periods from random states, whose outcomes are the promises plus `missed(u)`."""
    generator = torch.Generator().manual_seed(1)
    made = []
    for _ in range(count):
        s, memory = torch.randn(7, generator=generator), policy.model.initial_memory()
        u = policy.lower + (policy.upper - policy.lower) * torch.rand(8, 2, generator=generator)
        with torch.no_grad():
            z = policy._frozen(s, u[None], memory)[0, :, :3]
        made.append(Attempt(s, memory, u, z + missed(u)))
    return made


def test_with_a_perfect_model_there_is_nothing_to_learn(practice):
    policy = practice()
    policy.attempts = attempts(policy, lambda u: 0.0)
    mean, _ = policy.correction()(torch.randn(5, 23))
    assert mean.abs().max() < 1e-5
    policy.attempts = attempts(policy, lambda u: 0.0, count=40)
    assert policy.correction().variance < 0.1 * policy.practice.prior_error**2


def test_where_a_plan_was_tried_its_outcome_is_expected_and_far_away_the_promise(practice):
    policy = practice(noise=1e-4)
    policy.attempts = attempts(policy, lambda u: torch.tensor([0.5, -0.3, 0.2]))
    first, correction = policy.attempts[0], policy.correction()
    mean, variance = correction(policy._features(first.s[None], first.u[None]))
    assert torch.allclose(mean[0, -1], torch.tensor([0.5, -0.3, 0.2]), atol=0.01)
    assert variance < 0.01 * correction.variance
    mean, variance = correction(policy._features(first.s[None] + 100, first.u[None]))
    assert mean.abs().max() < 1e-6
    assert variance == pytest.approx(float(correction.variance))


def test_the_correction_says_what_a_textbook_says():
    x, y = torch.tensor([[0.0], [1.0]]), torch.tensor([1.0, 2.0])
    settings = IterativeLearningSettings(noise=0.1)
    mean, variance = Correction(x, y[:, None, None], settings)(torch.tensor([[0.5]]))
    k, kernel = np.exp(-0.125) * np.ones(2), np.array([[1.1, np.exp(-0.5)], [np.exp(-0.5), 1.1]])
    scale = (settings.prior_count * settings.prior_error**2 + 5) / (settings.prior_count + 2)
    assert float(mean) == pytest.approx(k @ np.linalg.solve(kernel, y.numpy()), rel=1e-5)
    assert float(variance) == pytest.approx(scale * (1 - k @ np.linalg.solve(kernel, k)), rel=1e-4)


def test_another_p_makes_other_promises_of_the_same_attempts(practice):
    policy = practice()
    policy.attempts = attempts(policy, lambda u: 0.0)
    policy.set_bias([1.0, -1.0])
    x = policy._features(torch.stack([a.s for a in policy.attempts]), torch.stack([a.u for a in policy.attempts]))
    assert policy.correction()(x)[0].abs().max() > 1e-3


def test_who_does_not_practise_repeats_the_best_known_plan(practice):
    policy = practice(noise=1e-4, lookahead=1)
    policy.attempts = attempts(policy, lambda u: 3.0)
    best = policy.attempts[1]
    policy.attempts[1] = replace(best, z=policy.z_ref.expand(8, -1))
    policy.practising = False
    u, promise = policy._plan(best.s)
    assert torch.equal(u, best.u)
    assert promise < 0.2


def test_a_plan_is_sent_unchanged_for_a_period_and_the_same_seed_gives_the_same_run(practice):
    policy, env = practice(), ClothEnv("torque", "damp0.05-mass0.10")
    first, second = (rollout(env, policy, 17, seed=3) for _ in range(2))
    env.close()
    np.testing.assert_array_equal(first.commands, second.commands)
    assert len(policy.attempts) == 2
    assert len(policy.promises) == 3
    np.testing.assert_allclose(first.commands[8:16], policy.attempts[1].u, atol=1e-6)
    for attempt in policy.attempts:
        assert ((attempt.u >= policy.lower) & (attempt.u <= policy.upper)).all()


def test_coasting_at_the_start_of_a_period_sends_the_plan_once_more(practice, env):
    policy, commands = practice(), []
    for k in range(25):
        choose = policy.coast if k in (3, 8, 13, 14, 15) else policy
        commands.append(choose(env.observe()))
        env.advance(commands[-1])
    np.testing.assert_array_equal(commands[:8], commands[8:16])
    assert len(policy.trace) == 3  # of four periods
    assert len(policy.promises) == 4
    for k, attempt in enumerate(policy.attempts):
        np.testing.assert_allclose(attempt.u, commands[8 * k : 8 * k + 8], atol=1e-6)
        assert attempt.z.shape == (8, 3)
    assert torch.equal(policy.attempts[1].s[:3], policy.attempts[0].z[-1])
    assert len(policy.attempts) == 3


def test_what_is_expected_of_a_repeated_plan_is_promised(practice, env):
    policy = practice()
    for _ in range(8):
        env.advance(policy(env.observe()))
    policy.coast(env.observe())
    again = policy.attempts[0].u[None]
    expected = policy.expected(policy._begun[0], again, policy.correction())
    assert policy.promise == policy.promises[1] == pytest.approx(float(expected))


def test_without_a_plan_there_is_nothing_to_coast_on(practice, env):
    policy = practice()
    policy.coast(env.observe())
    assert [len(trace) for trace in policy.trace] == [3]  # the start and two iterations
    assert policy.trace[0][-1] == policy.promise


def test_after_somebody_else_has_moved_the_arm_a_period_begins_anew_and_what_was_learned_stays(practice, env):
    policy = practice()
    for _ in range(11):
        env.advance(policy(env.observe()))
    learned = list(policy.attempts)
    policy.resume()
    assert policy.promise is None
    for _ in range(9):
        env.advance(policy(env.observe()))
    assert [each is known for each, known in zip(policy.attempts, learned, strict=False)] == [True]
    assert len(policy.attempts) == 2
    assert len(policy.attempts[1].z) == 8


def test_a_promise_is_about_the_present_target(practice, env, square):
    policy = practice()
    assert policy.promise is None
    policy(env.observe())
    assert policy.promise == policy.promises[-1] > 0
    policy.set_target(np.roll(square, 20, axis=1))
    assert policy.promise is None


def test_what_was_learned_stays_when_the_target_changes_and_goes_with_a_reset(practice, square):
    policy = practice()
    policy.attempts = attempts(policy, lambda u: 0.3)
    policy.set_target(np.roll(square, 20, axis=1))
    assert len(policy.attempts) == 3
    policy.reset()
    assert policy.attempts == []
    assert policy.correction() is None


def test_caution_grows_when_outcomes_get_better(practice):
    policy = practice(recent=1)
    assert policy._caution() == policy.practice.least_caution
    found = []
    for distance in (2.0, 0.2, 0.05):
        policy.attempts = [
            replace(attempt, z=policy.z_ref + torch.tensor([distance, 0.0, 0.0]).expand(8, 3))
            for attempt in attempts(policy, lambda u: 0.0, count=1)
        ]
        found.append(policy._caution())
    assert found == pytest.approx([0.05, 0.25, 1.0], rel=1e-3)


def test_only_so_many_periods_are_remembered(practice):
    policy, env = practice(remembered=2, iterations=0), ClothEnv("torque", "damp0.05-mass0.10")
    rollout(env, policy, 33)
    env.close()
    assert len(policy.attempts) == 2


@pytest.mark.parametrize("runs", [(), (RUN[:8],)])
def test_practice_needs_something_to_begin_with(practice, runs):
    with pytest.raises(ValueError, match="need recorded runs that are longer"):
        practice(runs=runs)


def test_another_target_has_other_plans_to_begin_with(practice, square):
    policy = practice(recorded=2)
    for shift in (0, 30):
        policy.set_target(np.roll(square, shift, axis=1))
        plans = torch.as_tensor(nearest_plans([RUN], policy.z_ref, count=2), dtype=torch.float32)
        assert torch.equal(policy._plans, plans.clamp(policy.lower, policy.upper))


@pytest.mark.parametrize("change", [{"lookahead": 0}, {"noise": 0.0}, {"caution": -1.0}, {"plan_scale": float("nan")}])
def test_bad_settings_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        IterativeLearningSettings(**change)
