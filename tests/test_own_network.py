"""Networks of one's own: trained, estimated and controlled as the paper's is."""

from dataclasses import replace

import numpy as np
import own_network
import pytest
import torch
from own_network import NETWORKS, Gru, Residual, record
from torch import nn

from clothlab import (
    DPMPB,
    Controller,
    ModelTraining,
    PredictiveModel,
    Run,
    estimate_bias,
    predict,
    train_dpmpb,
)
from clothlab.method._memories import expanded, joined
from clothlab.method._networks import _check
from clothlab.method._rollouts import PlainRollout, rollout_of
from clothlab.method.estimation import prediction_loss
from clothlab.method.fast_rollout import FastDPMPB
from clothlab.method.gauss_newton import best_bias

BRIEF = ModelTraining(
    epochs=25,
    batch_size=40,
    sequence_length=15,
    bias_size=1,
    learning_rate=0.02,
    bias_learning_rate=0.06,
)
SHORT = ModelTraining(epochs=3, batch_size=40, sequence_length=15, bias_size=1)
OWN = {name: made for name, made in NETWORKS.items() if made is not DPMPB}


def taught(network, settings=BRIEF, **options):
    runs = [record(stiffness, k) for k, stiffness in enumerate((0.05, 0.4))]
    return train_dpmpb(runs, settings, model=network, progress=False, **options)


@pytest.mark.parametrize("name", OWN)
def test_a_network_of_ones_own_goes_through_the_whole_method(name):
    model, biases, trace = taught(OWN[name])
    assert type(model) is OWN[name]
    assert not model.training
    assert trace.losses[-1] < trace.losses[0] / 2

    # An unknown run is nearer to the p of its material
    for right, wrong in (("0.05", "0.4"), ("0.4", "0.05")):
        run = record(float(right), seed=50, steps=200)
        p, _ = best_bias(model, run, [0])
        assert abs(p - biases[right]) < abs(p - biases[wrong])
    _, path = estimate_bias(model, run[:30], method="newton")
    assert np.abs(path[-1]).max() > 0

    # And a push towards the goal, as planned by the network itself
    assert rollout_of(model) is PlainRollout
    for goal in (-1.0, 1.0):
        controller = Controller(
            model,
            lambda states, commands, t, goal=goal: (
                (states[..., 0] - goal).square().sum(-1)
            ),
            p,
            [-1],
            [1],
        )
        assert controller.act([0, 0]) * goal > 0.05
        controller.follow([0, 0.1], [0.2])
        assert controller.foresee(3).shape == (3, 2)


@pytest.mark.parametrize("name", NETWORKS)
def test_many_steps_at_once_are_as_one_after_the_other(name):
    model = NETWORKS[name](2, 1, 1).eval()
    generator = torch.Generator().manual_seed(1)
    u = torch.randn(3, 5, 1, generator=generator)
    p = torch.tensor([0.3])
    s = torch.randn(3, 2, generator=generator)
    states = predict(model, s, u, p, expanded(model.initial_memory(), 1))

    # What was remembered in two batches is remembered in one
    _, after = model(s[:, None], u[:, :1], p)
    parts = [tuple(part[:, k : k + 1] for part in after) for k in range(3)]
    both = joined(parts) if after else ()
    following = predict(model, states[:, 0], u[:, 1:], p, both)
    assert torch.allclose(following, states[:, 1:], atol=1e-6)


@pytest.mark.parametrize("name", NETWORKS)
def test_what_never_changes_is_left_out_by_every_network(name):
    runs = []
    for k, stiffness in enumerate((0.05, 0.4)):
        run = record(stiffness, k)
        s = np.column_stack([run.s, np.full(len(run), 9.81)])
        u = np.column_stack([run.u, np.full(len(run), -3.0)])
        runs.append(Run(s, u, run.material))
    with pytest.warns(UserWarning, match="never changes"):
        model, _, _ = train_dpmpb(
            runs, SHORT, model=NETWORKS[name], device="cpu", progress=False
        )

    # Other readings of it say nothing, and it is foreseen as it was
    s = torch.tensor(runs[0].s[:20])[None]
    u = torch.tensor(runs[0].u[:20])[None].requires_grad_()
    p = torch.tensor([0.1])
    other = s + torch.tensor([0.0, 0.0, 50.0])
    predicted, _ = model(s, u, p)
    moved, _ = model(other, u, p)
    assert torch.allclose(predicted, moved, atol=1e-4)
    assert torch.allclose(predicted[..., 2], torch.tensor(9.81))
    (slope,) = torch.autograd.grad(predicted.sum(), u)
    assert (slope[..., 1] == 0).all()
    assert (slope[..., 0] != 0).any()


def test_a_loss_of_ones_own_is_what_trainings_and_estimates_go_down():
    class Robust(Residual):
        def loss(self, predicted, s):
            return ((predicted - s) / self.s_std).abs().mean()

    still = replace(SHORT, epochs=1, batch_size=1000, sequence_length=10)
    model, _, trace = taught(Robust, still)
    plain = taught(Residual, still)[2]
    assert trace.losses[0] != pytest.approx(plain.losses[0], rel=0.1)

    run = record(0.4, seed=51, steps=40)
    s = torch.tensor(run.s)
    u = torch.tensor(run.u)
    p = torch.zeros(1)
    predicted, _ = model(s[None, :-1], u[None, :-1], p)
    gaps = (predicted[0] - s[1:]) / model.s_std
    assert prediction_loss(model, s, u, p, warmup=0).item() == pytest.approx(
        gaps.abs().mean().item()
    )


def test_a_function_may_make_the_network():
    def wide(states, commands, bias):
        model = DPMPB(states, commands, bias)
        model.fc_out[-1] = nn.Linear(300, states)
        return model

    settings = ModelTraining(epochs=1, batch_size=100, bias_size=1)
    model, _, trace = taught(wide, settings)
    assert rollout_of(model) is FastDPMPB
    other = taught(DPMPB, settings)[2]
    assert trace.losses != other.losses  # other first weights
    repeated = taught(wide, settings)[2]
    assert np.array_equal(trace.losses, repeated.losses)


def _bidirectional(*sizes):
    model = Gru(*sizes)
    model.gru = nn.GRU(model.input_size, 16, batch_first=True, bidirectional=True)
    model.initial_memory = lambda: (torch.zeros(2, 1, 16),)
    return model


def _with(**changes):
    def make(*sizes):
        model = Gru(*sizes)
        for name, value in changes.items():
            setattr(model, name, value)
        return model

    return make


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            _bidirectional,
            "otherwise step by step than at once: a prediction may depend",
        ),
        (
            _with(initial_memory=lambda: (torch.ones(1, 1, 32),)),
            "None stands for `initial_memory",
        ),
        (
            _with(initial_memory=tuple),
            "the memory of Gru is a tuple of as many tensors",
        ),
        (
            _with(initial_memory=lambda: (torch.zeros(1, 32),)),
            r"tensors \[layers, B, ...\].* expected",
        ),
        (
            _with(forward=lambda s, u, p, memory=None: (s[..., :1], ())),
            r"predicts states \[B, T, D_s\], here \[2, 4, 2\], got \[2, 4, 1\]",
        ),
        (_with(forward=lambda s, u, p, memory=None: s), "returns next states, and the"),
        (
            _with(state_size=3),
            r"made for \(2, 1, 1\) states, commands and numbers of p",
        ),
        (
            lambda *sizes: nn.Linear(2, 2),
            "what `model` makes is a PredictiveModel, got",
        ),
        (PredictiveModel, "PredictiveModel has no forward"),
    ],
)
def test_a_network_that_can_not_be_used_is_refused_before_it_is_trained(make, message):
    with pytest.raises((ValueError, NotImplementedError), match=message):
        taught(make)


def test_names_of_the_papers_layers_are_those_of_stored_weights():
    names = list(DPMPB(3, 2).state_dict())
    assert names[:5] == ["s_mean", "s_std", "u_mean", "u_std", "fc_in.0.weight"]
    assert len(names) == 4 + 3 * 2 + 2 * 4 + 4 * 2


def test_a_checked_network_stays_in_training_and_takes_no_random_numbers():
    torch.manual_seed(0)
    expected = torch.get_rng_state()
    with_dropout = Residual(2, 1, 1)
    torch.set_rng_state(expected)
    with_dropout.net.append(nn.Dropout(0.5))
    _check(with_dropout)
    assert with_dropout.training
    assert torch.equal(torch.get_rng_state(), expected)


@pytest.mark.slow
def test_the_example_measures_each_training(monkeypatch):
    monkeypatch.setattr(own_network, "UNSEEN", (0.14,))
    monkeypatch.setattr(own_network, "GOALS", (0.5, 1.0))
    rows = own_network.measure(0, share=0.01)
    table = own_network.summary(rows)
    assert list(table.index) == list(own_network.TRAININGS)
    assert len(rows) == len(table) * 2
    assert table.loc["DPMPB", ["less DPMPB, from", "to"]].tolist() == [0, 0]
    assert (table[["distance", "act [ms]", "training [s]"]] > 0).all(axis=None)
