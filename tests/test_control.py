"""Laws of the controller."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import (
    ControlPolicy,
    ControlSettings,
    control_loss,
    nearest_plans,
    optimise_commands,
    period_mask,
    recorded_plans,
    shift_left,
    step_sizes,
)
from clothlab.learning.dpmpb import DPMPB, Sequences, to_sequences
from clothlab.learning.estimation import BiasEstimator, EstimatingPolicy, EstimationSettings
from clothlab.learning.fast_rollout import FastDPMPB
from clothlab.simulation.arm import MuscleArm, TorqueArm
from clothlab.trials import rollout

LOWER, UPPER = torch.tensor([-0.8, -1.6]), torch.tensor([1.0, 0.0])


@pytest.fixture
def controller(square):
    def make(plans=None, p=(0.0, 0.0), target=square, arm="torque", sizes=(7, 2), **change):
        torch.manual_seed(0)
        model = DPMPB(*sizes).eval()
        settings = replace(ControlSettings(candidates=5, iterations=1), **change)
        return ControlPolicy(model, Autoencoder().eval(), arm, target, p, settings, plans)

    return make


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


@pytest.mark.parametrize("seed", range(6))
def test_a_solve_stays_in_range_and_never_gets_worse(model, memory, seed):
    generator = torch.Generator().manual_seed(seed)
    frozen = FastDPMPB(model, torch.zeros(2, dtype=torch.float64))
    z_ref, s = (3 * torch.randn(size, generator=generator, dtype=torch.float64) for size in (3, 7))
    start = 2 * torch.randn(8, 2, generator=generator, dtype=torch.float64)  # mostly outside the range
    given = start.clone()
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
    assert torch.equal(start, given)


def test_where_nothing_can_be_gained_nothing_is_done():
    start = torch.tensor([[0.1, -0.2]])
    settings = ControlSettings(iterations=2)
    u, trace = optimise_commands(
        lambda u: u, lambda s: 0 * s.sum(dim=(1, 2)), start, LOWER, UPPER, torch.ones(2), settings
    )
    assert torch.equal(u, start)
    assert trace.tolist() == [0, 0, 0]


def test_a_second_run_with_the_same_controller_is_the_first_one(env, controller):
    policy = controller(iterations=2)
    first, second = rollout(env, policy, 10), rollout(env, policy, 10)
    anew = rollout(env, controller(iterations=2), 10)
    assert np.array_equal(first.commands, second.commands)
    assert np.array_equal(first.images, second.images)
    assert np.array_equal(first.commands, anew.commands)
    assert np.ptp(first.commands, axis=0).max() > 0
    assert len(policy.trace) == 10
    assert policy.name == first.policy == "control"


def test_estimating_while_controlling_twice_is_the_same(env, controller):
    inner = controller()
    estimator = BiasEstimator(inner.model, settings=EstimationSettings(window=5, warmup=1))
    policy = EstimatingPolicy(inner, estimator, inner.autoencoder)
    first, second = rollout(env, policy, 6), rollout(env, policy, 6)
    assert np.array_equal(first.commands, second.commands)
    assert np.array_equal(inner.p, policy.trace[-1])
    assert inner.p.any()


def test_the_memory_follows_the_observations(env, controller):
    policy = controller()
    trial = rollout(env, policy, 4)
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
    assert len(policy.trace) == 2


def test_without_a_plan_there_is_nothing_to_coast_on(env, controller):
    policy = controller()
    policy.coast(env.observe())
    assert len(policy.trace) == 1


def test_what_the_model_promises_for_the_end_of_the_period(muscle_env, controller):
    policy = controller(arm=MuscleArm(), sizes=(15, 3), tension_weight=0.0)
    assert policy.promise is None
    for k in range(16):
        assert not policy.period_ended or k == 8
        muscle_env.advance(policy(muscle_env.observe()))
        assert policy.promise == pytest.approx(policy.trace[-1][-1], rel=1e-4)  # where tensions cost nothing
    assert policy.period_ended
    policy.coast(muscle_env.observe())
    assert policy.promise > 0
    policy.reset()
    assert policy.promise is None


def test_beyond_the_horizon_nothing_is_promised(env, controller):
    policy = controller(horizon=3, period=5)
    promised = []
    for _ in range(5):
        env.advance(policy(env.observe()))
        promised.append(policy.promise is not None)
    assert promised == [False, False, True, True, True]


def test_p_and_target_can_be_changed_while_controlling(env, controller, square):
    policy = controller()
    observation, _ = env.reset()
    policy(observation)
    given = np.array([0.5, -0.5], np.float32)
    policy.set_bias(given)
    given[:] = 99
    assert policy.p == pytest.approx([0.5, -0.5])
    before = policy.z_ref.clone()
    policy.set_target(np.roll(square, 20, axis=1))
    assert not torch.equal(policy.z_ref, before)
    policy(observation)
    policy.reset()
    assert policy.p == pytest.approx([0.5, -0.5]), "a reset forgets the run, not what was told"


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
    assert plans.shape == (20, 5, 2)
    assert all(any(np.array_equal(plan, window) for window in windows) for plan in plans)
    assert np.array_equal(plans, recorded_plans([trial], horizon=5, count=20))
    assert not np.array_equal(plans, recorded_plans([trial], horizon=5, count=20, seed=1))


@pytest.mark.parametrize("change", [{"horizon": 13}, {"horizon": 0}, {"horizon": 2.5}, {"count": 0}, {"count": None}])
def test_plans_that_nobody_recorded_are_refused(trial, change):
    with pytest.raises(ValueError, match=r"at least as long|horizon|count"):
        recorded_plans([trial], **change)
    with pytest.raises(ValueError, match=r"need recorded trials"):
        recorded_plans([])


def test_another_search_may_take_the_place_of_the_descent(env, controller):
    policy, found = controller(), torch.full((8, 2), -0.5)
    policy.search = lambda predict, loss, start: (found, loss(predict(found[None])).detach().numpy())
    assert (rollout(env, policy, 3).commands == -0.5).all()
    assert [len(trace) for trace in policy.trace] == [1, 1, 1]


def test_a_fixed_stiffness_stays_fixed(muscle_env, controller):
    policy = controller(arm=MuscleArm().with_stiffness(10), sizes=(15, 3))
    commands = rollout(muscle_env, policy, 3).commands
    assert (commands[:, 2] == 10.0).all()
    assert np.ptp(commands[:, :2], axis=0).max() > 0


def test_a_longer_period_than_horizon_waits_without_harm(env, controller):
    commands = rollout(env, controller(horizon=2, period=6), 6).commands
    assert np.isfinite(commands).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"p": np.zeros(3)}, r"p is \[2\] and finite, got the shape \[3\]"),
        ({"p": [np.nan, 0]}, r"p is \[2\] and finite, got nan"),
        ({"p": [1e39, 0]}, r"p is \[2\] and finite, got inf"),
        ({"p": "soft-1"}, r"p is \[2\]"),
        ({"target": np.zeros((96, 128))}, "no cloth in the image"),
        ({"target": np.ones((48, 64))}, "cloth images are"),
        ({"target": np.full((96, 128), 0.3)}, "0 and 1 only"),
        ({"plans": np.zeros((3, 5, 2))}, r"plans is \[N, 8, 2\] and finite, got the shape \[3, 5, 2\]"),
        ({"plans": np.full((3, 8, 2), np.nan)}, r"plans is \[N, 8, 2\] and finite, got nan"),
        ({"sizes": (15, 3)}, "the model has 15 states and 3 commands, the torque arm has 7 and 2; load the weights"),
        ({"arm": "muscle"}, "the muscle arm has 15 and 3; load the weights of this arm"),
        ({"arm": TorqueArm(), "sizes": (7, 3)}, "load the weights of this arm"),
    ],
)
def test_what_does_not_belong_together_is_refused(controller, wrong, message):
    with pytest.raises(ValueError, match=message):
        controller(**wrong)


@pytest.mark.parametrize("p", [np.zeros(3), [np.nan, 0], None])
def test_a_p_that_is_refused_leaves_the_one_in_use(env, controller, p):
    policy = controller(p=[0.1, 0.2])
    with pytest.raises(ValueError, match=r"p is \[2\]"):
        policy.set_bias(p)
    with pytest.raises(ValueError, match=r"no cloth"):
        policy.set_target(np.zeros((96, 128)))
    assert policy.p == pytest.approx([0.1, 0.2])
    assert np.isfinite(policy(env.observe())).all()


def test_nearest_plans_are_those_after_which_the_cloth_was_nearest_best_first_and_hardly_overlapping():
    s, u = np.full((40, 7), 9.0), np.arange(40.0)[:, None].repeat(2, 1)
    s[20, :3], s[21, :3], s[35, :3] = 1.0, 1.1, 1.2
    plans = nearest_plans([Sequences(s, u, "a"), Sequences(s + 5, u, "b")], [1.0, 1.0, 1.0], horizon=8, count=4)
    assert plans[:2, 0, 0].tolist() == [12.0, 27.0]  # eight commands before steps 20 and 35; 21 is too near to 20
    assert plans.shape == (4, 8, 2)


@pytest.mark.parametrize("count", [0, 1.5])
def test_nearest_plans_need_a_number_and_runs(count):
    with pytest.raises(ValueError, match="count"):
        nearest_plans([], [0.0, 0.0, 0.0], count=count)
    with pytest.raises(ValueError, match="longer"):
        nearest_plans([], [0.0, 0.0, 0.0])
