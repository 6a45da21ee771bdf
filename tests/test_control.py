"""Laws of the controller."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import (
    ControlPolicy,
    EstimatingPolicy,
    control_loss,
    observe,
    period_mask,
)
from clothlab.method.control import (
    Controller,
    ControlSettings,
    Limits,
    best_step,
    optimise_commands,
    steepest_ascent,
)
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, EstimationSettings
from clothlab.method.iterative import nearest_plans
from clothlab.method.model import DPMPB, predict
from clothlab.simulation.arm import MuscleArm, get_arm
from clothlab.trials import recorded_plans, rollout, to_run

LOWER, UPPER = torch.tensor([-0.8, -1.6]), torch.tensor([1.0, 0.0])


@pytest.fixture
def controller(square):
    def make(
        plans=None, p=(0.0, 0.0), target=square, arm="torque", sizes=(7, 2), **change
    ):
        torch.manual_seed(0)
        model = DPMPB(*sizes).eval()
        settings = replace(ControlSettings(candidates=5, iterations=1), **change)
        return ControlPolicy(
            model, Autoencoder().eval(), get_arm(arm), target, p, settings, plans=plans
        )

    return make


def test_the_mask_shifts_as_in_the_papers_example_and_marks_each_end_of_a_period():
    settings = ControlSettings(horizon=4, period=4)
    assert [tuple(period_mask(t, settings)) for t in (2, 3, 4)] == [
        (0, 1, 0, 0),
        (1, 0, 0, 0),
        (0, 0, 0, 1),
    ]
    assert list(period_mask(1, ControlSettings(horizon=8, period=3))) == [
        0,
        1,
        0,
        0,
        1,
        0,
        0,
        1,
    ]


def test_the_loss_counts_masked_steps_and_tensions_where_the_arm_has_them():
    z_ref, mask = torch.tensor([1.0, 2.0, 3.0]), torch.tensor([0.0, 1.0, 0.0, 0.0])
    s = torch.zeros(2, 4, 7)
    s[:, 1, :3] = z_ref
    s[1, 1, 0] += 2
    s[1, 0, 3:5] = torch.tensor([30.0, 40.0])
    assert control_loss(s, z_ref, mask, slice(3, 3), 0.001).tolist() == pytest.approx(
        [0, 2]
    )
    assert control_loss(s, z_ref, mask, slice(3, 5), 0.001).tolist() == pytest.approx(
        [0, 2.05]
    )


def test_each_plan_goes_down_its_own_gradient_by_the_step_that_is_best_for_it():
    goals = torch.tensor([[[0.5, 0.0]], [[0.0, 0.5]]])
    plans, scale = torch.zeros(2, 1, 2), torch.tensor([1.0, 0.5])

    def loss(u):
        return (u.unflatten(0, (-1, 2)) - goals).square().sum(dim=(2, 3)).flatten()

    losses, direction = steepest_ascent(loss, plans, scale)
    assert losses.tolist() == [0.25, 0.25]
    assert direction.tolist() == [[[-1, 0]], [[0, -1]]]
    steps = torch.tensor([0.0, 0.3, 0.6])[:, None, None, None] * direction
    limits = Limits(torch.tensor([-1.0, -1.0]), torch.tensor([1.0, 0.2]), torch.ones(2))
    best, losses = best_step(loss, plans, steps, limits)
    # The second ends at its limit
    assert best.flatten().tolist() == pytest.approx([0.6, 0, 0, 0.2])
    assert losses.tolist() == pytest.approx([0.01, 0.09])


@pytest.mark.parametrize("seed", range(3))
def test_a_solve_stays_in_range_and_never_gets_worse(model, memory, seed):
    generator = torch.Generator().manual_seed(seed)
    p = torch.zeros(2, dtype=torch.float64)
    z_ref, s = (
        3 * torch.randn(size, generator=generator, dtype=torch.float64)
        for size in (3, 7)
    )
    # Mostly outside the range
    start = 2 * torch.randn(8, 2, generator=generator, dtype=torch.float64)
    given = start.clone()
    mask = torch.ones(8)

    def loss(plans):
        states = predict(model, s, plans, p, memory)
        return control_loss(states, z_ref, mask, slice(0, 0), 0.0)

    scale = torch.tensor([0.5, 0.5], dtype=torch.float64)
    limits = Limits(LOWER.double(), UPPER.double(), scale)
    u, trace = optimise_commands(loss, start, limits, ControlSettings())
    assert ((u >= LOWER) & (u <= UPPER)).all()
    assert len(trace) == 4
    assert (np.diff(trace) <= 1e-12).all()
    assert torch.equal(start, given)


@pytest.mark.slow
def test_a_candidate_whose_loss_is_not_a_number_is_not_chosen():
    """Far from the start the loss can't be said; near it, less is better."""

    def loss(plans):
        x = plans[:, 0, 0]
        return torch.where(x < 0.5, torch.sqrt(x - 0.5), x)

    limits = Limits(torch.zeros(1), torch.ones(1), torch.ones(1))
    u, trace = optimise_commands(loss, torch.ones(1, 1), limits, ControlSettings())
    assert 0.5 <= u.item() < 0.6
    assert trace[-1] == pytest.approx(u.item())


def test_a_second_run_with_the_same_controller_is_the_first_one(env, controller):
    policy = controller(iterations=2)
    first, second = rollout(env, policy, 10), rollout(env, policy, 10)
    assert np.array_equal(first.commands, second.commands)
    assert np.array_equal(first.images, second.images)
    assert np.ptp(first.commands, axis=0).max() > 0
    assert len(policy.controller.trace) == 10
    assert policy.name == first.policy == "control"


@pytest.mark.slow
def test_a_policy_uses_each_estimate_and_a_second_run_is_the_first_one(env, controller):
    inner = controller()
    estimator = BiasEstimator(
        inner.controller.model, [0.1, 0.2], EstimationSettings(window=5, warmup=1)
    )
    policy = EstimatingPolicy(inner, estimator, inner.autoencoder)
    first, second = rollout(env, policy, 6), rollout(env, policy, 6)
    assert np.array_equal(first.commands, second.commands)
    assert np.array_equal(inner.controller.p, policy.trace[-1])
    assert np.ptp(policy.trace, axis=0).min() > 0


def test_a_cloth_is_recorded_by_the_same_call_as_any_robot(env, controller):
    policy = controller()
    run = to_run(policy.autoencoder, rollout(env, policy, 4))
    policy.reset()
    see = partial(observe, policy.autoencoder)
    same = rollout(env, policy.controller.act, 4, material="same", observe=see)
    assert same.s == pytest.approx(run.s, abs=1e-5)


def test_the_memory_follows_the_observations(env, controller):
    policy = controller()
    run = to_run(policy.autoencoder, rollout(env, policy, 5))
    s = torch.as_tensor(run.s)[None]
    u = torch.as_tensor(run.u)[None]
    model = policy.controller.model
    p = torch.zeros(2)
    _, memory = model(s[:, :4], u[:, :4], p)
    expected = predict(model, s[0, 4], u[:, 4:], p, memory)

    policy.reset()
    for state, command in zip(run.s, run.u, strict=True):
        policy.controller.follow(state, command)
    policy.controller.plan = u[0, 4:]
    found = policy.controller.predicted()
    assert torch.allclose(found, expected[0], atol=1e-5)


@pytest.mark.parametrize(("warm_start", "steps_ago"), [("last", 1), ("earlier", 8)])
def test_a_plan_goes_on_with_its_last_command_or_with_that_of_a_period_ago(
    controller, warm_start, steps_ago
):
    policy = controller(warm_start=warm_start, period=8)
    states = np.random.default_rng(0).normal(size=(10, 7))
    sent = [policy.controller.act(s) for s in states]
    policy.controller.act(states[0], solve=False)
    plan = policy.controller.plan
    before = plan[-2].numpy() if steps_ago == 1 else sent[-steps_ago]
    assert plan[-1].numpy() == pytest.approx(before, abs=1e-7)


def test_a_warm_start_has_a_name_that_is_known(controller):
    with pytest.raises(ValueError, match="choose from last, earlier"):
        controller(warm_start="none")


def test_a_step_without_solving_goes_on_with_the_plan_if_there_is_one(controller):
    policy = controller()
    states = np.random.default_rng(0).normal(size=(4, 7))
    act = policy.controller.act
    act(states[0], solve=False)  # a first plan needs a solve
    assert len(policy.controller.trace) == 1
    plan = policy.controller.plan[1:].numpy()
    assert act(states[1], solve=False) == pytest.approx(plan[0])
    assert act(states[2], solve=False) == pytest.approx(plan[1])
    assert len(policy.controller.trace) == 1
    act(states[3])  # and a solve goes on from there
    assert len(policy.controller.trace) == 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:limits of command 2")  # an untrained toy
def test_the_predicted_distance_is_that_of_the_end_of_the_period(
    muscle_env, controller
):
    policy = controller(arm=MuscleArm(), sizes=(15, 3), tension_weight=0.0)
    assert policy.predicted_distance is None
    for k in range(16):
        assert not policy.controller.period_ended or k == 8
        muscle_env.advance(policy(muscle_env.observe()))
        # Where tensions cost nothing
        assert policy.predicted_distance == pytest.approx(
            policy.controller.trace[-1][-1], rel=1e-4
        )
    assert policy.controller.period_ended
    policy.reset()
    assert policy.predicted_distance is None


def test_beyond_the_horizon_no_distance_is_predicted(env, controller):
    policy, predicted = controller(horizon=3, period=5), []
    for _ in range(5):
        env.advance(policy(env.observe()))
        predicted.append(policy.predicted_distance is not None)
    assert predicted == [False, False, True, True, True]


def test_p_and_target_can_be_changed_while_controlling(env, controller, square):
    policy, given = controller(), np.array([0.5, -0.5], np.float32)
    policy(env.observe())
    before = policy.z_ref.clone()
    policy.set_bias(given)
    given[:] = 99
    policy.set_target(np.roll(square, 20, axis=1))
    assert not torch.equal(policy.z_ref, before)
    for wrong in (np.zeros(3), [np.nan, 0]):
        with pytest.raises(ValueError, match=r"p is \[2\]"):
            policy.set_bias(wrong)
    with pytest.raises(ValueError, match="no cloth"):
        policy.set_target(np.zeros((96, 128)))
    policy(env.observe())
    policy.reset()
    assert policy.controller.p == pytest.approx([0.5, -0.5]), (
        "a reset forgets the run, not p"
    )


def test_a_period_starts_from_the_plan_with_the_lowest_loss(env, controller):
    plans, starts = np.random.default_rng(0).uniform(LOWER, UPPER, (50, 8, 2)), []
    for each in (None, plans, plans[::-1].copy()):
        policy = controller(each)
        policy(env.observe())
        starts.append(policy.controller.trace[0][0])
    assert starts[1] < starts[0]
    assert starts[2] == pytest.approx(starts[1])


def test_plans_are_stretches_of_recorded_commands(trial):
    plans = recorded_plans([trial], horizon=5, count=20)
    windows = [trial.commands[k : k + 5] for k in range(len(trial) - 4)]
    assert plans.shape == (20, 5, 2)
    assert all(
        any(np.array_equal(plan, window) for window in windows) for plan in plans
    )
    assert np.array_equal(plans, recorded_plans([trial], horizon=5, count=20))
    assert not np.array_equal(
        plans, recorded_plans([trial], horizon=5, count=20, seed=1)
    )
    with pytest.raises(ValueError, match="at least as long"):
        recorded_plans([trial], horizon=13)


def test_nearest_plans_are_those_after_which_the_cloth_was_nearest_best_first_and_hardly_overlapping():
    s, u = np.full((40, 7), 9.0), np.arange(40.0)[:, None].repeat(2, 1)
    s[20, :3], s[21, :3], s[35, :3] = 1.0, 1.1, 1.2
    plans = nearest_plans(
        [Run(s, u, "a"), Run(s + 5, u, "b")], [1.0, 1.0, 1.0], horizon=8, count=4
    )
    # Eight commands before steps 20 and 35; 21 is too near to 20
    assert plans.u[:2, 0, 0].tolist() == [12.0, 27.0]
    assert plans.u.shape == (4, 8, 2)
    assert plans.distance[:2] == pytest.approx([0.0, 0.2 * 3**0.5])
    assert set(plans.material[:2]) == {"a"}


class Always(Controller):
    """Finds the same plan whatever is asked."""

    def search(self, s, plan, solve=True):
        return torch.full((8, 2), -0.5)


def test_another_search_may_take_the_place_of_the_descent(env, controller):
    policy = controller()
    policy.controller = Always(
        policy.controller.model, policy.loss, (0, 0), LOWER, UPPER
    )
    assert (rollout(env, policy, 3).commands == -0.5).all()
    assert policy.controller.t == 3


def test_a_fixed_stiffness_stays_fixed(muscle_env, controller):
    policy = controller(arm=MuscleArm().with_stiffness(10), sizes=(15, 3))
    commands = rollout(muscle_env, policy, 3).commands
    assert (commands[:, 2] == 10.0).all()
    assert np.ptp(commands[:, :2], axis=0).max() > 0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"p": np.zeros(3)}, r"p is \[2\] and finite, got the shape \[3\]"),
        ({"target": np.zeros((96, 128))}, "no cloth in the image"),
        ({"target": np.ones((48, 64))}, "cloth images are"),
        (
            {"plans": np.zeros((3, 5, 2))},
            r"plans is \[3, 8, 2\] and finite, got the shape \[3, 5, 2\]",
        ),
        (
            {"arm": "muscle"},
            "the muscle arm has 15 and 3: load the weights of this arm",
        ),
    ],
)
def test_what_does_not_belong_together_is_refused(controller, wrong, message):
    with pytest.raises(ValueError, match=message):
        controller(**wrong)


def test_an_error_in_the_loss_leaves_the_controller_as_it_was(env, controller):
    policy, reference = controller(), controller()
    right = policy.controller.loss

    def fails(states, commands, t):
        raise ZeroDivisionError

    for k in range(4):
        if k == 2:
            policy.controller.loss = fails
            with pytest.raises(ZeroDivisionError):
                policy(env.observe())
            policy.controller.loss = right
        assert np.array_equal(policy(env.observe()), reference(env.observe()))


def test_a_loss_may_count_commands(controller):
    """The nearest thing to no motion: commands that cost what they differ from one."""
    policy = controller(iterations=20, candidates=30)

    def effort(states, commands, t):
        return (commands - torch.tensor([0.4, -0.9])).square().sum((1, 2))

    limits = policy.controller.limits
    model = policy.controller.model
    settings = policy.controller.settings
    quiet = Controller(model, effort, (0, 0), limits.lower, limits.upper, settings)
    assert quiet.act(np.zeros(7)) == pytest.approx([0.4, -0.9], abs=1e-2)


def test_a_loss_of_another_shape_is_refused(controller):
    policy = controller()
    policy.controller.loss = lambda states, commands, t: states.sum()
    with pytest.raises(ValueError, match=r"a loss is \[B\], one number for each of"):
        policy.controller.act(np.zeros(7))


@pytest.mark.parametrize("without", [torch.no_grad, torch.inference_mode])
def test_a_caller_without_gradients_gets_the_same_command(controller, without):
    expected = controller().controller.act(np.ones(7))
    inside = controller().controller
    with without():
        found = inside.act(np.ones(7))
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("name", ["horizon", "period", "iterations"])
def test_settings_without_a_step_are_refused(name):
    with pytest.raises(ValueError, match=f"{name} is at least 1, got 0"):
        ControlSettings(**{name: 0})


def test_one_candidate_would_never_move_a_plan():
    with pytest.raises(ValueError, match="candidates are at least 2"):
        ControlSettings(candidates=1)
