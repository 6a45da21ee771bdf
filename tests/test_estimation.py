"""Laws of estimating p: it finds the p that made the data, touches nothing else, and forgets when told to."""

import numpy as np
import pytest
import torch

from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import DPMPB, Sequences
from clothlab.learning.estimation import (
    BiasEstimator,
    EstimatingPolicy,
    EstimationSettings,
    Fit,
    NewtonEstimator,
    NewtonSettings,
    estimate_bias,
    new_estimator,
    prediction_loss,
)
from clothlab.policies import RandomPolicy, Wrapper
from clothlab.trials import rollout

QUICK = EstimationSettings(window=20, warmup=2)


@pytest.fixture
def listening(model):
    """A model that listens to p, in single precision."""
    with torch.no_grad():
        model.fc_in[0].weight[:, -2:] *= 10
        model.fc_out[-1].weight *= 5
    return model.float()


@pytest.fixture
def run(listening):
    """A run that the model generates itself with p = (0.4, -0.3)."""
    u = torch.randn(1, 40, 2, generator=torch.Generator().manual_seed(2))
    s, memory, states = torch.zeros(1, 1, 7), None, []
    for t in range(40):
        states.append(s[0, 0].numpy())
        s, memory = listening(s, u[:, t : t + 1], torch.tensor([0.4, -0.3]), memory)
    return Sequences(np.array(states), u[0].numpy(), "cloth")


def test_with_w_fixed_estimation_recovers_the_p_that_generated_the_data(listening, run):
    p = np.zeros(2)
    for _ in range(6):
        p, _ = estimate_bias(listening, run, p, EstimationSettings(rate=40.0, warmup=0))
    assert p == pytest.approx([0.4, -0.3], abs=0.02)


def test_the_loss_is_lowest_at_the_p_that_generated_the_data(listening, run):
    s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
    around = torch.tensor([0.4, -0.3]) + torch.tensor([[0, 0], [0.1, 0], [-0.1, 0], [0, 0.1], [0, -0.1]])
    many = prediction_loss(listening, s, u, around)
    assert many[0] == pytest.approx(0, abs=1e-9)
    assert (many[1:] > 1e-7).all()
    one = prediction_loss(listening, s, u, around[1])
    assert one.shape == ()
    assert one == pytest.approx(float(many[1]), rel=1e-4)


def test_estimation_touches_nothing_but_p(listening, run):
    listening.requires_grad_(True)
    before = [parameter.clone() for parameter in listening.parameters()]
    start = np.zeros(2, np.float32)
    p, trace = estimate_bias(listening, run, start)
    assert trace.shape == (40, 2)
    assert np.array_equal(trace[-1], p)
    assert (p != 0).all()
    assert not start.any()
    assert all(torch.equal(a, b) for a, b in zip(before, listening.parameters(), strict=True))
    assert all(parameter.grad is None for parameter in listening.parameters())


def test_p_waits_for_the_warm_up_and_then_moves_with_every_step(listening, run):
    _, trace = estimate_bias(listening, run, settings=EstimationSettings(window=20, warmup=5))
    moved = np.abs(np.diff(trace, axis=0, prepend=0)).max(axis=1) > 0
    assert moved.tolist() == [False] * 6 + [True] * 34


def test_what_lies_before_the_window_is_forgotten(listening, run):
    late = Sequences(np.concatenate([run.s[::-1], run.s]), np.concatenate([run.u[::-1], run.u]), "cloth")
    settings = EstimationSettings(window=10, warmup=2, momentum=0.0)
    whole, alone = BiasEstimator(listening, settings=settings), BiasEstimator(listening, settings=settings)
    for k in range(60):
        whole.update(late.s[k], late.u[k])
    for k in range(60 - 10, 60):
        alone.update(late.s[k], late.u[k])
    step = late.s[60], late.u[60]  # both have seen the same eleven now
    moves = [each.update(*step) - before for each in (whole, alone) for before in [each.p]]
    assert np.abs(moves).max() > 0
    assert len(whole._seen) == len(alone._seen) == 11
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(whole._seen, alone._seen, strict=True))


def test_a_reset_estimator_is_a_new_one(listening, run):
    estimator = BiasEstimator(listening, [0.1, 0.2], QUICK)
    traces = []
    for _ in range(2):
        traces.append([estimator.update(s, u) for s, u in zip(run.s[:15], run.u[:15], strict=True)])
        estimator.reset()
        assert estimator.p == pytest.approx([0.1, 0.2])
    assert np.array_equal(*traces)


def test_the_estimate_belongs_to_whom_it_was_given(listening):
    estimator = BiasEstimator(listening, [0.1, 0.2])
    estimator.p[:] = 99
    assert estimator.p == pytest.approx([0.1, 0.2])


@pytest.mark.parametrize(
    ("s", "u", "message"),
    [
        (np.full(7, np.nan), np.zeros(2), r"s is \[7\] and finite, got nan"),
        (np.zeros(7), [np.inf, 0], r"u is \[2\] and finite, got inf"),
        (np.zeros(15), np.zeros(2), r"s is \[7\] and finite, got the shape \[15\]"),
        (np.zeros(7), np.zeros(3), r"u is \[2\]"),
        (np.full(7, 1e39), np.zeros(2), "finite, got inf"),
        (np.full(7, 1e30), np.zeros(2), "so far from what the model was trained on"),
        (None, np.zeros(2), r"s is \[7\]"),
        ("s", np.zeros(2), r"s is \[7\]"),
    ],
)
def test_a_step_that_is_refused_leaves_the_estimate_and_what_it_rests_on(listening, run, s, u, message):
    estimator, spared = (BiasEstimator(listening, settings=QUICK) for _ in range(2))
    steps = list(zip(run.s, run.u, strict=True))
    for step in steps[:10]:
        estimator.update(*step)
        spared.update(*step)
    with pytest.raises(ValueError, match=message):
        estimator.update(s, u)
    assert np.array_equal(estimator.p, spared.p)
    for step in steps[10:20]:
        assert np.array_equal(estimator.update(*step), spared.update(*step))


@pytest.mark.parametrize("p", [np.zeros(3), [np.nan, 0.0], [1e39, 0], 0.0, "p", []])
def test_a_start_is_a_p(listening, p):
    with pytest.raises(ValueError, match=r"p is \[2\] and finite"):
        BiasEstimator(listening, p)


@pytest.mark.parametrize(("window", "warmup"), [(5, 10), (10, 10), (1, 1)])
def test_a_window_reaches_beyond_the_warm_up(window, warmup):
    with pytest.raises(ValueError, match=rf"window must be longer than the warmup of {warmup} steps, got {window}"):
        EstimationSettings(window=window, warmup=warmup)


def test_newton_finds_the_p_that_generated_the_data_while_momentum_is_on_its_way(listening, run):
    _, newton = estimate_bias(listening, run, settings=NewtonSettings())
    _, momentum = estimate_bias(listening, run)
    away = [np.linalg.norm(trace - (0.4, -0.3), axis=1) for trace in (newton, momentum)]
    assert away[0][20] < 0.01
    assert away[1][20] > 0.3
    moved = np.linalg.norm(np.diff(newton, axis=0), axis=1)
    assert moved[:4].tolist() == [0] * 4  # with two predictions there is nothing to judge
    assert moved.max() <= NewtonSettings.longest + 1e-6


def test_slopes_are_the_gradient_and_the_loss_is_the_loss(listening, run):
    s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
    p = torch.tensor([0.1, 0.2], requires_grad=True)
    loss = prediction_loss(listening, s, u, p, warmup=3)
    loss.backward()
    fit = Fit.of(listening, s, u, p.detach().numpy(), warmup=3)
    assert fit.loss == pytest.approx(loss.item(), rel=1e-4)
    gradient = -2 * np.einsum("td,tdi->i", fit.errors, fit.slopes) / fit.errors.size
    assert gradient == pytest.approx(p.grad.numpy(), rel=0.02)


def test_outliers_move_newton_less_where_errors_are_weighted():
    rng = np.random.default_rng(0)
    errors, slopes = rng.normal(size=(200, 1)), np.ones((200, 1, 1))
    errors[:3] += 100
    plain, weighted = (Fit(errors, slopes).step(freedom)[0] for freedom in (1e9, 3))
    assert plain == pytest.approx(errors.mean())
    assert abs(weighted) < abs(plain) / 2


def test_errors_that_follow_each_other_make_the_estimate_less_sure():
    rng = np.random.default_rng(1)
    slopes = np.ones((3000, 1, 1))
    alone = rng.normal(size=(3000, 1))
    together = np.repeat(alone[:1000], 3, axis=0)
    apart, joined = (Fit(errors, slopes).covariance(1e9, lag=30)[0, 0] for errors in (alone, together))
    assert apart == pytest.approx(1 / 3000, rel=0.35)  # the law of the mean
    assert joined == pytest.approx(1 / 1000, rel=0.35)


def test_an_estimator_knows_how_sure_it_is(listening, run):
    noisy = Sequences(run.s + np.random.default_rng(2).normal(size=run.s.shape) * 0.01, run.u, "cloth")
    for settings in (NewtonSettings(), QUICK):
        estimator, traces = new_estimator(listening, settings=settings), []
        for s, u in zip(noisy.s, noisy.u, strict=True):
            estimator.update(s, u)
            traces.append(None if estimator.covariance is None else np.trace(estimator.covariance))
        assert traces[1] is None
        assert traces[-1] > 0
    estimator = NewtonEstimator(listening)
    for s, u in zip(noisy.s, noisy.u, strict=True):
        estimator.update(s, u)
    whole = Fit.of(listening, torch.as_tensor(noisy.s), torch.as_tensor(noisy.u), estimator.p)
    assert estimator.covariance == pytest.approx(whole.covariance())


def test_the_warm_up_counts_only_where_the_window_begins_in_a_motion(listening, run):
    settings = NewtonSettings(window=20, warmup=8)
    counted = {}
    for from_rest in (True, False):
        estimator, counted[from_rest] = NewtonEstimator(listening, settings=settings, from_rest=from_rest), []
        for s, u in zip(run.s, run.u, strict=True):
            estimator.update(s, u)
            counted[from_rest].append(0 if estimator.fit is None else len(estimator.fit.errors))
    assert counted[True][:21] == [0] * 5 + [*range(5, 20)] + [12]
    assert counted[False][12:21] == [0, *range(5, 13)]


def test_a_newton_step_that_is_refused_leaves_the_estimate(listening, run):
    estimator = NewtonEstimator(listening)
    for s, u in zip(run.s[:10], run.u[:10], strict=True):
        estimator.update(s, u)
    before = estimator.p
    with pytest.raises(ValueError, match="so far from what the model was trained on"):
        estimator.update(np.full(7, 1e38), np.zeros(2))
    assert np.array_equal(estimator.p, before)
    assert len(estimator._seen) == 10


def test_a_newton_window_holds_something_to_judge():
    with pytest.raises(ValueError, match="window must hold the warmup and 5 steps more, got 12"):
        NewtonSettings(window=12)


class Listens(Wrapper):
    """Keeps every p that it is told."""

    def __init__(self, policy):
        self.told = []
        super().__init__(policy)

    def set_bias(self, p):
        self.told.append(p)


def test_a_policy_is_told_each_estimate_and_a_second_run_is_the_first_one(env):
    torch.manual_seed(0)
    model = DPMPB(7, 2).eval()
    listens = Listens(RandomPolicy(env.arm))
    policy = EstimatingPolicy(listens, BiasEstimator(model, [0.1, 0.2], QUICK), Autoencoder().eval())
    runs = []
    for _ in range(2):
        listens.told.clear()
        trial = rollout(env, policy, 8)
        runs.append((trial.commands, np.array(policy.trace)))
        assert len(policy.trace) == 8
        assert np.array_equal(listens.told, [np.float32([0.1, 0.2]), *policy.trace])
    assert all(map(np.array_equal, *runs))
    assert np.ptp(runs[0][1], axis=0).min() > 0
    assert policy.name == "random"
