"""Laws of iterative learning control: what is learned from outcomes, and what is done
with it.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from clothlab.method import control
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.data import Run
from clothlab.method.iterative import (
    Attempt,
    IterativeLearningPolicy,
    IterativeLearningSettings,
    ResidualModel,
    nearest_plans,
)
from clothlab.method.model import DPMPB
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
        settings = replace(IterativeLearningSettings(iterations=2, starts=2), **change)
        model, autoencoder = DPMPB(7, 2).eval(), Autoencoder().eval()
        return IterativeLearningPolicy(
            model,
            autoencoder,
            get_arm("torque"),
            square,
            (0.0, 0.0),
            runs,
            settings,
            biases=biases,
        )

    return make


def attempts(policy, residual, count=3):
    """Periods from random states, whose outcomes are the predictions plus `residual`."""
    generator, made = torch.Generator().manual_seed(1), []
    for _ in range(count):
        s, memory = torch.randn(7, generator=generator), policy.model.initial_memory()
        u = policy.lower + (policy.upper - policy.lower) * torch.rand(
            8, 2, generator=generator
        )
        with torch.no_grad():
            z = policy._predict(s, u[None], memory)[0, :, :3]
        made.append(Attempt(s, memory, u, policy.p, z + torch.as_tensor(residual)))
    return made


def test_where_a_plan_was_tried_its_outcome_is_expected_and_far_away_the_prediction(
    iterative,
):
    policy = iterative(noise=1e-4)
    policy.attempts = attempts(policy, [0.5, -0.3, 0.2])
    first, residuals = policy.attempts[0], policy.residual_model()
    mean, variance = residuals(policy._features(first.s[None], first.u[None]))
    assert torch.allclose(mean[0, -1], torch.tensor([0.5, -0.3, 0.2]), atol=0.01)
    assert variance < 0.01 * residuals.variance
    mean, variance = residuals(policy._features(first.s[None] + 100, first.u[None]))
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
    policy = iterative(noise=1e-4, lookahead=1)
    policy.attempts = attempts(policy, 3.0)
    best = policy.attempts[1]
    policy.attempts[1] = replace(best, z=policy.z_ref.expand(8, -1))
    policy.exploring = False
    u, distance = policy._plan(best.s)
    assert torch.equal(u, best.u)
    assert distance < 0.2


@pytest.mark.slow
def test_a_plan_is_sent_unchanged_for_a_period_and_the_same_seed_gives_the_same_run(
    iterative, env
):
    policy = iterative(remembered=1)
    first, second = (rollout(env, policy, 25, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.commands, second.commands)
    assert len(policy.predicted_distances) == 4
    (last,) = policy.attempts  # as many as are remembered
    np.testing.assert_allclose(first.commands[16:24], last.u, atol=1e-6)
    assert ((last.u >= policy.lower) & (last.u <= policy.upper)).all()


@pytest.mark.slow
def test_a_step_without_solving_at_the_start_of_a_period_sends_the_plan_once_more(
    iterative, env
):
    policy, commands = iterative(), []
    for k in range(25):
        step = policy.step_without_solving if k in (0, 3, 8, 13, 14, 15) else policy
        commands.append(step(env.observe()))
        env.advance(commands[-1])
        if k == 8:
            expected = policy.expected_distance(
                policy._begun[0], policy._begun[2][None], policy.residual_model()
            )
            assert (
                policy.predicted_distance
                == policy.predicted_distances[1]
                == pytest.approx(float(expected))
            )
    np.testing.assert_array_equal(commands[:8], commands[8:16])
    assert [len(trace) for trace in policy.trace] == [
        3
    ] * 3  # the start and two iterations, in three of four periods
    assert len(policy.predicted_distances) == 4
    for k, attempt in enumerate(policy.attempts):
        np.testing.assert_allclose(attempt.u, commands[8 * k : 8 * k + 8], atol=1e-6)
        assert attempt.z.shape == (8, 3)
    assert torch.equal(policy.attempts[1].s[:3], policy.attempts[0].z[-1])
    assert len(policy.attempts) == 3


@pytest.mark.slow
def test_after_the_arm_was_moved_a_period_begins_anew_and_what_was_learned_stays(
    iterative, env
):
    policy = iterative()
    for _ in range(11):
        env.advance(policy(env.observe()))
    learned = list(policy.attempts)
    policy.resume()
    assert policy.predicted_distance is None
    for _ in range(9):
        env.advance(policy(env.observe()))
    assert policy.attempts[0] is learned[0]
    assert [len(each.z) for each in policy.attempts] == [8, 8]


def test_a_new_target_has_other_starts_and_no_prediction_and_what_was_learned_stays(
    iterative, env, square
):
    policy = iterative(recorded=2)
    policy(env.observe())
    assert policy.predicted_distance == policy.predicted_distances[-1] > 0
    policy.attempts = attempts(policy, 0.3)
    policy.set_target(np.roll(square, 30, axis=1))
    assert policy.predicted_distance is None
    plans = torch.as_tensor(
        nearest_plans([RUN], policy.z_ref, count=2).u, dtype=torch.float32
    )
    assert torch.equal(policy._plans, plans.clamp(policy.lower, policy.upper))
    assert len(policy.attempts) == 3
    policy.reset()
    assert policy.residual_model() is None


def test_caution_grows_when_outcomes_get_better(iterative):
    policy = iterative(recent=1)
    assert policy._caution() == policy.learning.least_caution
    found = []
    for distance in (2.0, 0.2, 0.05):
        z = policy.z_ref + torch.tensor([distance, 0.0, 0.0]).expand(8, 3)
        policy.attempts = [replace(attempts(policy, 0.0, count=1)[0], z=z)]
        found.append(policy._caution())
    assert found == pytest.approx([0.05, 0.25, 1.0], rel=1e-3)


@pytest.mark.parametrize("runs", [(), (RUN[:8],)])
def test_there_must_be_something_to_begin_with(iterative, runs):
    with pytest.raises(ValueError, match="need recorded runs that are longer"):
        iterative(runs=runs)


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
        assert len(policy.attempts) == left


def test_without_trust_or_biases_the_model_alone_chooses(iterative, env):
    alone, unknown = iterative(biases=BIASES, trust=0), iterative()
    assert (rollout(env, alone, 9).commands == rollout(env, unknown, 9).commands).all()


class Interrupt:
    """Raises a KeyboardInterrupt at the n-th call within `clothlab.method`, as Ctrl-C
    might.
    """

    folder = str(Path(control.__file__).parent)

    def __init__(self, n):
        self.left = n

    def __call__(self, frame, event, argument):
        if event == "call" and frame.f_code.co_filename.startswith(self.folder):
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt

    def __enter__(self):
        sys.setprofile(self)

    def __exit__(self, *error):
        sys.setprofile(None)


@pytest.mark.parametrize("biases", [None, BIASES])
def test_an_interrupt_at_any_call_leaves_it_as_it_was(iterative, env, biases):
    """At the steps that begin a period, which do most, and at one within."""
    quick = {"recorded": 4, "starts": 1, "iterations": 1}
    policy, reference = (
        iterative((RUN, replace(RUN, material="b")), biases, **quick) for _ in range(2)
    )
    interrupted = 0
    for step in range(26):
        observation = env.observe()
        expected = reference(observation)
        for n in range(1, 1000):
            if step not in (0, 5, 8, 16, 24):
                break
            try:
                with Interrupt(n):
                    found = policy(observation)
                break
            except KeyboardInterrupt:
                interrupted += 1
        else:
            pytest.fail("the step has more calls than were tried")
        if step not in (0, 5, 8, 16, 24):
            found = policy(observation)
        assert np.array_equal(found, expected), f"step {step}"
        env.advance(expected)
    assert interrupted > 100
    assert len(policy.attempts) == len(reference.attempts) == 3


def test_a_plan_goes_on_where_its_attempt_was_forgotten(iterative, env):
    policy = iterative((RUN, replace(RUN, material="b")), BIASES)
    sent = [policy(env.observe()) for _ in range(8)]
    # So far that the attempt which now ends is of another material
    policy.set_bias((9.0, 0.0))
    again = [policy.step_without_solving(env.observe()) for _ in range(8)]
    assert policy.attempts == []
    assert np.array_equal(again, sent)
