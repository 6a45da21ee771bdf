"""Laws of estimating p: it finds the p that made the data, touches nothing else, and
forgets at a reset.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab.method.data import Run
from clothlab.method.estimation import (
    BiasEstimator,
    EstimationSettings,
    Linearisation,
    NewtonEstimator,
    NewtonSettings,
    estimate_bias,
    prediction_loss,
)
from clothlab.method.model import DPMPB, predict


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
    states = predict(listening, torch.zeros(7), u, torch.tensor([0.4, -0.3]))[0]
    return Run(np.vstack([np.zeros(7), states[:-1]]), u[0].numpy(), "cloth")


def follow(estimator, run):
    return np.array([estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)])


@pytest.mark.slow
def test_with_w_fixed_estimation_recovers_the_p_that_generated_the_data(listening, run):
    p = np.zeros(2)
    for _ in range(6):
        p, _ = estimate_bias(
            listening, run, p, settings=EstimationSettings(rate=40.0, warmup=0)
        )
    assert p == pytest.approx([0.4, -0.3], abs=0.02)


def test_estimation_touches_nothing_but_p(listening, run):
    listening.requires_grad_(True)
    before = [parameter.clone() for parameter in listening.parameters()]
    start = np.zeros(2, np.float32)
    p, trace = estimate_bias(listening, run, start)
    assert trace.shape == (40, 2)
    assert np.array_equal(trace[-1], p)
    assert (p != 0).all()
    assert not start.any()
    assert all(
        torch.equal(a, b) for a, b in zip(before, listening.parameters(), strict=True)
    )
    assert all(parameter.grad is None for parameter in listening.parameters())


def test_a_step_is_down_the_gradient_of_what_the_window_holds(listening, run):
    """Whatever lay before it: the loss of the last eleven steps alone says where to."""
    settings = EstimationSettings(window=10, warmup=2, momentum=0.0)
    estimator = BiasEstimator(listening, settings=settings)
    follow(estimator, Run(run.s[::-1], run.u[::-1], "cloth"))
    follow(estimator, run[:20])
    p = torch.tensor(estimator.p, requires_grad=True)
    s, u = torch.as_tensor(run.s[10:21]), torch.as_tensor(run.u[10:21])
    prediction_loss(listening, s, u, p, settings.warmup).backward()
    expected = (p - settings.rate * p.grad).detach().numpy()
    assert np.abs(expected - estimator.p).max() > 1e-6
    assert estimator.update(run.s[20], run.u[20]) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("kind", [BiasEstimator, NewtonEstimator])
def test_a_reset_estimator_is_a_new_one(listening, run, kind):
    estimator = kind(listening, [0.1, 0.2])
    first = follow(estimator, run[:15])
    estimator.reset()
    assert estimator.p == pytest.approx([0.1, 0.2])
    assert np.array_equal(first, follow(estimator, run[:15]))
    estimator.p[:] = 99
    assert estimator.p == pytest.approx(first[-1])


@pytest.mark.parametrize("kind", [BiasEstimator, NewtonEstimator])
@pytest.mark.parametrize(
    ("s", "u", "message"),
    [
        (np.full(7, np.nan), np.zeros(2), r"s is \[7\] and finite, got nan"),
        (np.zeros(7), np.zeros(3), r"u is \[2\]"),
        (np.full(7, 1e38), np.zeros(2), "so far from what the model was trained on"),
    ],
)
def test_a_step_that_is_refused_leaves_the_estimate_and_what_it_rests_on(
    listening, run, kind, s, u, message
):
    estimator, spared = kind(listening), kind(listening)
    for each in (estimator, spared):
        follow(each, run[:20])
    with pytest.raises(ValueError, match=message):
        estimator.update(s, u)
    assert np.array_equal(follow(estimator, run[20:]), follow(spared, run[20:]))


def test_a_start_is_a_p_and_a_window_reaches_beyond_the_warm_up(listening):
    for p in (np.zeros(3), [np.nan, 0.0]):
        with pytest.raises(ValueError, match=r"p is \[2\] and finite"):
            BiasEstimator(listening, p)
    for kind, settings in (
        (BiasEstimator, EstimationSettings(window=10, warmup=10)),
        (NewtonEstimator, NewtonSettings(window=14)),
    ):
        with pytest.raises(ValueError, match="is too short for the warm-up"):
            kind(listening, settings=settings)


def test_newton_finds_the_p_that_generated_the_data_while_momentum_is_on_its_way(
    listening, run
):
    _, newton = estimate_bias(listening, run, method="newton")
    _, momentum = estimate_bias(listening, run)
    distance = [
        np.linalg.norm(trace - (0.4, -0.3), axis=1) for trace in (newton, momentum)
    ]
    assert distance[0][20] < 0.01
    assert distance[1][20] > 0.3
    moved = np.linalg.norm(np.diff(newton, axis=0), axis=1)
    # With two predictions there is nothing to judge
    assert moved[:4].tolist() == [0] * 4
    assert moved.max() <= NewtonSettings.largest_step + 1e-6


def test_the_jacobian_gives_the_gradient_and_the_loss_is_the_loss(listening, run):
    s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
    p = torch.tensor([0.1, 0.2], requires_grad=True)
    loss = prediction_loss(listening, s, u, p, warmup=3)
    loss.backward()
    fit = Linearisation.of(listening, s, u, p.detach().numpy(), warmup=3)
    assert fit.loss == pytest.approx(loss.item(), rel=1e-4)
    gradient = -2 * np.einsum("td,tdi->i", fit.errors, fit.jacobian) / fit.errors.size
    assert gradient == pytest.approx(p.grad.numpy(), rel=0.02)


def test_outliers_move_newton_less_where_errors_are_weighted():
    rng = np.random.default_rng(0)
    errors, jacobian = rng.normal(size=(200, 1)), np.ones((200, 1, 1))
    errors[:3] += 100
    plain, weighted = (
        Linearisation(errors, jacobian).step(freedom)[0] for freedom in (1e9, 3)
    )
    assert plain == pytest.approx(errors.mean())
    assert abs(weighted) < abs(plain) / 2


def test_errors_that_follow_each_other_make_the_estimate_less_sure():
    rng = np.random.default_rng(1)
    jacobian = np.ones((3000, 1, 1))
    alone = rng.normal(size=(3000, 1))
    together = np.repeat(alone[:1000], 3, axis=0)
    apart, joined = (
        Linearisation(errors, jacobian).covariance(1e9, lag=30)[0, 0]
        for errors in (alone, together)
    )
    assert apart == pytest.approx(1 / 3000, rel=0.35)  # the law of the mean
    assert joined == pytest.approx(1 / 1000, rel=0.35)


@pytest.mark.parametrize("kind", [BiasEstimator, NewtonEstimator])
def test_an_estimator_knows_how_sure_it_is(listening, run, kind):
    noisy = Run(
        run.s + np.random.default_rng(2).normal(size=run.s.shape) * 0.01, run.u, "cloth"
    )
    estimator = kind(listening)
    follow(estimator, noisy[:2])
    assert estimator.linearisation() is None
    follow(estimator, noisy[2:])
    skipped = 0 if kind is NewtonEstimator else EstimationSettings.warmup
    whole = Linearisation.of(
        listening,
        torch.as_tensor(noisy.s),
        torch.as_tensor(noisy.u),
        estimator.p,
        skipped,
    )
    assert np.trace(estimator.linearisation().covariance()) > 0
    assert estimator.linearisation().covariance() == pytest.approx(whole.covariance())


def test_the_warm_up_counts_only_where_the_window_begins_in_a_motion(listening, run):
    settings = NewtonSettings(window=20, warmup=8)
    counted = {}
    for from_rest in (True, False):
        estimator, counted[from_rest] = (
            NewtonEstimator(listening, settings=replace(settings, from_rest=from_rest)),
            [],
        )
        for s, u in zip(run.s, run.u, strict=True):
            estimator.update(s, u)
            counted[from_rest].append(
                0
                if estimator.linearisation() is None
                else len(estimator.linearisation().errors)
            )
    assert counted[True][:21] == [0] * 5 + [*range(5, 20)] + [12]
    assert counted[False][12:21] == [0, *range(5, 13)]


@pytest.mark.parametrize("warmup", [-1, 38])
def test_a_warmup_outside_of_the_window_is_refused(listening, run, warmup):
    s, u = torch.as_tensor(run.s[:39]), torch.as_tensor(run.u[:39])
    with pytest.raises(ValueError, match="warmup"):
        prediction_loss(listening, s, u, torch.zeros(2), warmup)


def test_the_longest_warmup_leaves_one_step(listening, run):
    """Its loss is that of the last prediction alone."""
    s, u = torch.as_tensor(run.s[:39]), torch.as_tensor(run.u[:39])
    p = torch.zeros(2)
    predicted, _ = listening(s[None, :-1], u[None, :-1], p[None])

    found = prediction_loss(listening, s, u, p, warmup=37)

    last = ((predicted[0, -1] - s[-1]) / listening.s_std).square().mean()
    torch.testing.assert_close(found, last)


def test_degrees_are_noticed_where_the_model_learned_radians(listening, run):
    degrees = Run(np.rad2deg(run.s), run.u, "a", state_names=tuple("abcdefg"))
    listening.s_std /= 3  # so that the training's deviation is that of the run
    estimate_bias(listening, run)
    with pytest.warns(UserWarning, match=r"state . of a run of a is \d+ .*same unit\?"):
        estimate_bias(listening, degrees)


def test_few_steps_do_not_make_sure():
    """Of least squares over five steps of pure noise, the scatter of p is told at least
    in its order of magnitude. Over all steps the gradients add up to zero.
    """
    rng = np.random.default_rng(0)
    found, told = [], []
    for _ in range(2000):
        jacobian, errors = rng.normal(size=(5, 7, 2)), rng.normal(size=(5, 7))
        rows = jacobian.reshape(-1, 2)
        p, *_ = np.linalg.lstsq(rows, errors.ravel(), rcond=None)
        left = errors - jacobian @ p
        found.append(p)
        told.append(Linearisation(left, jacobian).covariance(1e9))
    share = np.trace(np.mean(told, axis=0)) / np.trace(np.cov(np.transpose(found)))
    assert 0.4 < share < 1.2


@pytest.mark.parametrize(("method", "least"), [("sgd", 12), ("newton", 6)])
def test_a_run_too_short_to_say_anything_says_so(listening, run, method, least):
    with pytest.warns(match=f"a run of {least - 1} steps is too short"):
        p, _ = estimate_bias(listening, run[: least - 1], method=method)
    assert p.tolist() == [0, 0]
    p, _ = estimate_bias(listening, run[:least], method=method)
    assert np.abs(p).max() > 0


def test_a_run_that_does_not_begin_at_rest_needs_its_first_steps(listening, run):
    short = run[10:22]
    moving = NewtonSettings(from_rest=False)
    with pytest.warns(match="too short"):
        estimate_bias(listening, short, method="newton", settings=moving)
    estimator = NewtonEstimator(listening, settings=moving)
    expected = follow(estimator, run[10:])
    _, path = estimate_bias(listening, run[10:], method="newton", settings=moving)
    assert np.array_equal(path, expected)


@pytest.mark.parametrize(
    ("method", "settings", "message"),
    [
        ("sgd", NewtonSettings(), 'method="sgd" is a EstimationSettings, got Newton'),
        (
            "newton",
            EstimationSettings(),
            'method="newton" is a NewtonSettings, got Est',
        ),
        ("newton", {"window": 60}, r"got dict: write NewtonSettings\(name=value\)"),
    ],
)
def test_settings_of_another_method_are_refused(method, settings, message):
    run = Run(np.zeros((30, 2)), np.zeros((30, 1)), "a")
    model = DPMPB(2, 1, 1).eval().requires_grad_(False)
    with pytest.raises(ValueError, match=message):
        estimate_bias(model, run, method=method, settings=settings)
