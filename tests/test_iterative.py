"""Laws of iterative learning control: what is learned from outcomes, and what is done
with it.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import observe
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.iterative import (
    Attempt,
    IterativeController,
    IterativeLearningSettings,
    IterativePolicy,
    ResidualModel,
    nearest_plans,
)
from clothlab.method.model import DPMPB, Memory, predict
from clothlab.simulation.arm import get_arm
from clothlab.trials import rollout

RNG = np.random.default_rng(0)
RUN = Run(
    RNG.normal(size=(40, 7)),
    RNG.uniform((-0.8, -1.6), (1.0, 0.0), (40, 2)),
    "damp0.05-mass0.10",
)


@pytest.fixture
def iterative(square):
    def make(runs=(RUN,), biases=None, **change):
        torch.manual_seed(0)
        learning = replace(IterativeLearningSettings(iterations=2, starts=2), **change)
        model = DPMPB(7, 2).eval()
        arm = get_arm("torque")
        eyes = Autoencoder().eval()
        return IterativePolicy(
            model, eyes, arm, square, (0.0, 0.0), runs, learning, biases=biases
        )

    return make


def attempts_of(controller, residual, count=3):
    """Periods from random states, whose outcomes are the predictions plus `residual`."""
    generator = torch.Generator().manual_seed(1)
    limits, model = controller.limits, controller.model
    made = []
    for _ in range(count):
        s = torch.randn(7, generator=generator)
        h, c = torch.randn(2, *model.initial_memory().h.shape, generator=generator)
        memory = Memory(0.5 * h, c)
        share = torch.rand(8, 2, generator=generator)
        u = limits.lower + (limits.upper - limits.lower) * share
        with torch.no_grad():
            z = predict(model, s, u[None], controller.p, memory)[0, :, :3]
        z = z + torch.as_tensor(residual)
        made.append(Attempt(s, memory, u, controller.p, controller.z_ref, z))
    return made


def test_where_a_plan_was_tried_its_outcome_is_expected_and_far_away_the_prediction(
    iterative,
):
    controller = iterative(noise=1e-4).controller
    attempts = attempts_of(controller, [0.5, -0.3, 0.2])
    controller.attempts = attempts
    forecast = controller.forecast(torch.zeros(7))
    first, residuals = attempts[0], forecast.residuals
    mean, variance = residuals(forecast.features(first.s[None], first.u[None]))
    assert torch.allclose(mean[0, -1], torch.tensor([0.5, -0.3, 0.2]), atol=0.01)
    assert variance < 0.01 * residuals.variance
    mean, variance = residuals(forecast.features(first.s[None] + 100, first.u[None]))
    assert mean.abs().max() < 1e-6
    assert variance == pytest.approx(float(residuals.variance))


def test_the_residual_model_says_what_a_textbook_says():
    x, y = torch.tensor([[0.0], [1.0]]), torch.tensor([1.0, 2.0])
    settings = IterativeLearningSettings(noise=0.1)
    mean, variance = ResidualModel(x, y[:, None, None], settings)(torch.tensor([[0.5]]))
    k, kernel = (
        np.exp(-0.125) * np.ones(2),
        np.array([[1.1, np.exp(-0.5)], [np.exp(-0.5), 1.1]]),
    )
    scale = (settings.prior_count * settings.prior_error**2 + 5) / (
        settings.prior_count + 2
    )
    assert float(mean) == pytest.approx(
        k @ np.linalg.solve(kernel, y.numpy()), rel=1e-5
    )
    assert float(variance) == pytest.approx(
        scale * (1 - k @ np.linalg.solve(kernel, k)), rel=1e-4
    )


def test_without_exploring_the_best_known_plan_is_repeated(iterative):
    controller = iterative(noise=1e-4, lookahead=1).controller
    attempts = attempts_of(controller, 3.0)
    best = attempts[1]
    attempts[1] = replace(best, z=controller.z_ref.expand(8, -1))
    controller.attempts = attempts
    controller.exploring = False
    assert torch.equal(controller.search(best.s, controller.plan), best.u)
    assert controller.expected[-1] < 0.2


@pytest.mark.slow
def test_a_plan_is_sent_unchanged_for_a_period_and_the_same_seed_gives_the_same_run(
    iterative, env
):
    policy = iterative(remembered=1)
    first, second = (rollout(env, policy, 25, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.commands, second.commands)
    assert len(policy.controller.expected) == 4
    (last,) = policy.controller.attempts  # as many as are remembered
    np.testing.assert_allclose(first.commands[16:24], last.u, atol=1e-6)
    lower, upper, _ = policy.controller.limits
    assert ((last.u >= lower) & (last.u <= upper)).all()


@pytest.mark.slow
def test_a_step_without_solving_at_the_start_of_a_period_sends_the_plan_once_more(
    iterative, env
):
    policy, commands = iterative(), []
    for k in range(25):
        observation = env.observe()
        solve = k not in (0, 3, 8, 13, 14, 15)
        commands.append(policy(observation, solve=solve))
        env.advance(commands[-1])
        if k == 8:
            s = torch.as_tensor(observe(policy.autoencoder, observation))
            forecast = policy.controller.forecast(s)
            plan = policy.controller.attempts[0].u[None]
            expected = float(forecast.distance(plan).detach())
            assert policy.predicted_distance == pytest.approx(expected)
            assert policy.predicted_distance == policy.controller.expected[1]

    np.testing.assert_array_equal(commands[:8], commands[8:16])
    # The start and two iterations, in three of four periods.
    assert [len(trace) for trace in policy.controller.trace] == [3, 3, 3]
    learned = policy.controller
    assert len(learned.expected) == 4
    assert len(learned.attempts) == 3
    for k, attempt in enumerate(learned.attempts):
        np.testing.assert_allclose(attempt.u, commands[8 * k : 8 * k + 8], atol=1e-6)
        assert attempt.z.shape == (8, 3)
    assert torch.equal(learned.attempts[1].s[:3], learned.attempts[0].z[-1])


@pytest.mark.slow
def test_after_the_arm_was_moved_a_period_begins_anew_and_what_was_learned_stays(
    iterative, env
):
    policy = iterative()
    for _ in range(11):
        env.advance(policy(env.observe()))
    learned = policy.controller.attempts
    policy.controller.resume()
    assert policy.predicted_distance is None
    for _ in range(9):
        env.advance(policy(env.observe()))
    assert policy.controller.attempts[0] is learned[0]
    assert [len(each.z) for each in policy.controller.attempts] == [8, 8]


def test_after_the_arm_was_moved_a_plan_that_is_repeated_is_gone_on_with(
    iterative, env
):
    """With one attempt the plan is repeated, and no search says that there is one."""
    policy = iterative((RUN, replace(RUN, material="b")), BIASES)
    sent = [policy(env.observe()) for _ in range(9)][:8]
    policy.controller.resume()
    again = [policy(env.observe()) for _ in range(8)]
    assert np.array_equal(again, sent)
    assert np.ptp(sent, axis=0).max() > 0.1


def test_a_new_target_has_other_starts_and_no_prediction_and_what_was_learned_stays(
    iterative, env, square
):
    policy = iterative(recorded=2, iterations=0)
    for _ in range(9):
        env.advance(policy(env.observe()))
    assert policy.predicted_distance == policy.controller.expected[-1] > 0
    learned = policy.controller.attempts
    policy.set_target(np.roll(square, 30, axis=1))
    assert policy.predicted_distance is None
    assert policy.controller.attempts is learned
    nearest = nearest_plans([RUN], policy.z_ref, count=2)
    assert np.array_equal(policy.controller.recorded().u, nearest.u)
    policy.reset()
    assert policy.controller.attempts == []


def test_caution_grows_when_outcomes_get_better(iterative):
    """Where nothing was tried, what is expected is the doubt alone, weighed so."""
    controller = iterative(recent=1, lookahead=1, least_caution=0.05).controller
    s = torch.zeros(7)
    plan = controller.plan[None]
    weights = []
    for distance in (2.0, 0.2, 0.05):
        attempt = attempts_of(controller, 0.0, count=1)[0]
        z = controller.z_ref + torch.tensor([distance, 0.0, 0.0]).expand(8, 3)
        controller.attempts = [replace(attempt, z=z, s=attempt.s + 1000)]
        forecast = controller.forecast(s)
        with torch.no_grad():
            predicted = controller.predict(s, plan)[0, :, :3]
            nearest = (predicted - controller.z_ref).square().sum(-1).min()
            doubt = forecast.distance(plan) ** 2 - nearest
        weights.append(float(doubt) / (3 * float(forecast.residuals.variance)))
    assert weights == pytest.approx([0.05, 0.25, 1.0], rel=1e-3)


@pytest.mark.parametrize("runs", [(), (RUN[:8],)])
def test_there_must_be_something_to_begin_with(iterative, env, runs):
    with pytest.raises(ValueError, match="need recorded runs that are longer"):
        iterative(runs=runs)(env.observe())


def test_a_plan_is_as_long_as_a_period():
    settings = ControlSettings(horizon=8, period=5)
    task = (DPMPB(7, 2).eval(), np.zeros(3), (0, 0), (-1, -1), (1, 1), [RUN])
    with pytest.raises(ValueError, match="of 8 steps must be the period of 5"):
        IterativeController(*task, settings=settings)


BIASES = {"a": np.array([1.0, 0.0]), "b": np.array([-1.0, 0.0])}


def test_the_first_plan_led_near_with_a_material_like_this_one_and_is_sent_twice(
    iterative, env
):
    runs = [
        replace(RUN, s=RUN.s + shift, material=name)
        for name, shift in {"a": 0.0, "b": 3.0}.items()
    ]
    policy = iterative(runs, BIASES, difference=1e6)
    for p, material in ((BIASES["a"], "a"), (BIASES["b"], "b")):
        policy.set_bias(p)
        sent = rollout(env, policy, 17).commands
        assert (sent[:8] == sent[8:16]).all()
        assert len(policy.controller.trace[-1]) == 3, "the third plan is searched for"
        own = nearest_plans(
            [run for run in runs if run.material == material], policy.z_ref
        )
        assert np.isclose(own.u, sent[:8], atol=1e-5).all(axis=(1, 2)).any()


def test_attempts_with_another_material_are_forgotten(iterative, env):
    policy = iterative((RUN, replace(RUN, material="b")), BIASES)
    rollout(env, policy, 17)
    for moved, left in ((0.4, 3), (0.6, 1)):  # of three attempts, two with p = 0
        policy.set_bias((moved, 0.0))
        for _ in range(8):
            policy(env.observe())
        assert len(policy.controller.attempts) == left


def test_without_trust_or_biases_the_model_alone_chooses(iterative, env):
    alone, unknown = iterative(biases=BIASES, trust=0), iterative()
    assert (rollout(env, alone, 9).commands == rollout(env, unknown, 9).commands).all()


def test_a_plan_goes_on_where_its_attempt_was_forgotten(iterative, env):
    policy = iterative((RUN, replace(RUN, material="b")), BIASES)
    sent = [policy(env.observe()) for _ in range(8)]
    # So far that the attempt which now ends is of another material
    policy.set_bias((9.0, 0.0))
    again = [policy(env.observe(), solve=False) for _ in range(8)]
    assert policy.controller.attempts == []
    assert np.array_equal(again, sent)
