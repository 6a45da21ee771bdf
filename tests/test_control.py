"""Laws of the controller."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.arm import TorqueArm
from clothlab.autoencoder import Autoencoder
from clothlab.control import (
    ControlPolicy,
    ControlSettings,
    control_loss,
    optimise_commands,
    period_mask,
    recorded_plans,
    shift_left,
    step_sizes,
)
from clothlab.dpmpb import DPMPB, FrozenDPMPB
from clothlab.trials import rollout

LOWER, UPPER = torch.tensor([-0.8, -1.6]), torch.tensor([1.0, 0.0])


def test_mask_shifts_as_in_the_papers_example():
    settings = ControlSettings(horizon=4, period=4)
    masks = [tuple(period_mask(t, settings)) for t in (2, 3, 4)]
    assert masks == [(0, 1, 0, 0), (1, 0, 0, 0), (0, 0, 0, 1)]


def test_mask_marks_each_end_of_a_period_once():
    settings = ControlSettings(horizon=8, period=3)
    assert list(period_mask(0, settings)) == [0, 0, 1, 0, 0, 1, 0, 0]
    assert list(period_mask(1, settings)) == [0, 1, 0, 0, 1, 0, 0, 1]


def test_step_sizes_are_zero_and_then_logarithmic():
    gamma = step_sizes(ControlSettings())
    assert gamma.shape == (30,)
    assert gamma[0] == 0
    assert gamma[-1] == pytest.approx(1.0)
    ratios = gamma[2:] / gamma[1:-1]
    assert torch.allclose(ratios, ratios[0].expand_as(ratios), rtol=1e-4)


def test_loss_is_zero_at_the_target_and_counts_masked_steps_only():
    z_ref = torch.tensor([1.0, 2.0, 3.0])
    s = torch.zeros(1, 4, 7)
    s[0, 1, :3] = z_ref
    mask = torch.tensor([0.0, 1.0, 0.0, 0.0])
    none = slice(3, 3)
    assert control_loss(s, z_ref, mask, none, 0.001) == 0
    s[0, 1, 0] += 2
    assert control_loss(s, z_ref, mask, none, 0.001) == pytest.approx(2.0)


def test_loss_counts_tensions_where_the_arm_has_them():
    s = torch.zeros(2, 4, 7)
    s[0, 0, 3:5] = torch.tensor([30.0, 40.0])
    loss = control_loss(s, torch.zeros(3), torch.zeros(4), slice(3, 5), 0.001)
    assert loss.tolist() == pytest.approx([0.05, 0.0])


def test_the_warm_start_repeats_its_last_command():
    assert shift_left(torch.tensor([[1.0], [2.0], [3.0]])).tolist() == [[2.0], [3.0], [3.0]]


def test_a_quadratic_is_descended_to_its_minimum():
    goal = torch.tensor([[0.3, -0.5], [0.1, -1.0]])
    u, trace = optimise_commands(
        lambda u: u,
        lambda states: (states - goal).square().sum(dim=(1, 2)),
        torch.zeros(2, 2),
        LOWER,
        UPPER,
        torch.ones(2),
        ControlSettings(iterations=20),
    )
    assert torch.allclose(u, goal, atol=0.01)
    assert (np.diff(trace) <= 0).all()


@pytest.mark.parametrize("seed", range(10))
def test_a_solve_stays_in_range_and_never_gets_worse(model, memory, seed):
    generator = torch.Generator().manual_seed(seed)
    frozen = FrozenDPMPB(model, torch.zeros(2, dtype=torch.float64))
    z_ref, s = (3 * torch.randn(size, generator=generator, dtype=torch.float64) for size in (3, 7))
    start = 2 * torch.randn(8, 2, generator=generator, dtype=torch.float64)  # mostly outside the range
    u, trace = optimise_commands(
        lambda u: frozen(s, u, memory),
        lambda states: control_loss(states, z_ref, torch.ones(8), slice(0, 0), 0.0),
        start,
        LOWER.double(),
        UPPER.double(),
        torch.tensor([0.5, 0.5], dtype=torch.float64),
        ControlSettings(),
    )
    assert ((u >= LOWER) & (u <= UPPER)).all()
    assert len(trace) == 4
    assert (np.diff(trace) <= 1e-12).all()


@pytest.fixture
def controller(square):
    def make(plans=None, **change):
        torch.manual_seed(0)
        model = DPMPB(state_size=7, command_size=2).eval()
        settings = replace(ControlSettings(candidates=5, iterations=1), **change)
        return ControlPolicy(model, Autoencoder().eval(), TorqueArm(), square, np.zeros(2), settings, plans)

    return make


def test_the_policy_loop_gives_the_same_trial_twice(env, controller):
    trials = [rollout(env, controller(), 10) for _ in range(2)]
    assert np.array_equal(trials[0].commands, trials[1].commands)
    assert np.array_equal(trials[0].images, trials[1].images)


def test_the_memory_follows_the_observations(env, controller):
    policy = controller()
    trial = rollout(env, policy, 4)
    from clothlab.dpmpb import to_sequences

    run = to_sequences(policy.autoencoder, trial)
    s, u = torch.as_tensor(run.s)[None, :-1], torch.as_tensor(run.u)[None, :-1]
    _, memory = policy.model(s, u, torch.zeros(2))
    assert torch.allclose(policy._memory.h, memory.h, atol=1e-5)


def test_coasting_goes_on_with_the_plan(env, controller):
    policy = controller()
    observation, _ = env.reset()
    policy(observation)
    plan = policy._u.clone()
    for k in (1, 2):
        observation, *_ = env.step(policy.coast(observation))
        assert torch.equal(policy._u[0], plan[k])
    assert len(policy.trace) == 1
    policy(observation)  # and a solve goes on from there


def test_p_can_be_changed_while_controlling(env, controller):
    policy = controller()
    observation, _ = env.reset()
    policy(observation)
    policy.p = np.array([0.5, -0.5])
    assert policy.p == pytest.approx([0.5, -0.5])
    policy(observation)


def test_a_period_starts_from_the_most_promising_plan(env, controller):
    plans = np.random.default_rng(0).uniform(LOWER, UPPER, (50, 8, 2))
    observation, _ = env.reset()
    starts = []
    for each in (None, plans, plans[::-1].copy()):
        policy = controller(each)
        policy(observation)
        starts.append(policy.trace[0][0])
    assert starts[1] < starts[0]
    assert starts[2] == pytest.approx(starts[1])


def test_plans_are_stretches_of_recorded_commands(trial):
    plans = recorded_plans([trial], horizon=5, count=20)
    windows = [trial.commands[k : k + 5] for k in range(len(trial) - 4)]
    assert all(any(np.array_equal(plan, window) for window in windows) for plan in plans)


def test_plans_of_another_length_are_refused(controller):
    with pytest.raises(ValueError, match=r"plans are \[N, 8, 2\]"):
        controller(np.zeros((3, 5, 2)))


def test_another_search_may_take_the_place_of_the_descent(env, controller):
    policy, found = controller(), torch.full((8, 2), -0.5)
    policy.search = lambda predict, loss, start: (found, loss(predict(found[None])).detach().numpy())
    assert (rollout(env, policy, 3).commands == -0.5).all()
    assert [len(trace) for trace in policy.trace] == [1, 1, 1]


def test_weights_of_another_arm_are_refused(square):
    model = DPMPB(state_size=15, command_size=3)
    with pytest.raises(ValueError, match="load the weights of this arm"):
        ControlPolicy(model, Autoencoder(), TorqueArm(), square, np.zeros(2))


def test_targets_without_cloth_are_refused(controller):
    with pytest.raises(ValueError, match="no cloth in the image"):
        ControlPolicy(DPMPB(7, 2), Autoencoder(), TorqueArm(), np.zeros((96, 128)), np.zeros(2))
