"""Laws of the predictive model with parametric bias, and of training W and p together."""

import numpy as np
import pytest
import torch

from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import (
    DPMPB,
    ModelTraining,
    Sequences,
    fit_normalisation,
    observe,
    predict,
    stretches,
    to_sequences,
    train_dpmpb,
)

BRIEF = ModelTraining(epochs=8, batch_size=20, sequence_length=10)
GOOD = Sequences(np.zeros((40, 7)), np.zeros((40, 2)), "a")


def finite_difference(function, x, step=1e-5):
    """Gradient of a scalar function by central differences."""
    gradient = torch.zeros_like(x)
    for k in range(x.numel()):
        shift = torch.zeros_like(x).view(-1)
        shift[k] = step
        shift = shift.view_as(x)
        gradient.view(-1)[k] = (function(x + shift) - function(x - shift)) / (2 * step)
    return gradient


@pytest.fixture
def made_up_runs(model):
    """Runs that a model generates itself, each with its own p: data whose p is known."""
    with torch.no_grad():  # random weights hardly listen to p; these do
        model.fc_in[0].weight[:, -2:] *= 10
        model.fc_out[-1].weight *= 5
    generator = torch.Generator().manual_seed(2)
    runs = []
    for name, p in (("a", [0.5, 0.0]), ("b", [-0.5, 0.0])):
        u = torch.randn(1, 80, 2, generator=generator, dtype=torch.float64)
        s, memory, states = torch.zeros(1, 1, 7, dtype=torch.float64), None, []
        for t in range(80):
            states.append(s[0, 0].numpy())
            s, memory = model(s, u[:, t : t + 1], torch.tensor(p).double(), memory)
        runs.append(Sequences(np.array(states), u[0].numpy(), name))
    return runs


def test_gradient_on_p_equals_finite_differences(model):
    torch.manual_seed(3)
    s, u = torch.randn(1, 6, 7, dtype=torch.float64), torch.randn(1, 6, 2, dtype=torch.float64)
    p = torch.tensor([0.3, -0.2], dtype=torch.float64)

    def loss(p):
        return model.loss(model(s[:, :-1], u[:, :-1], p)[0], s[:, 1:])

    (gradient,) = torch.autograd.grad(loss(p.requires_grad_()), p)
    assert torch.allclose(gradient, finite_difference(loss, p.detach()), rtol=1e-6, atol=1e-9)
    assert gradient.abs().min() > 1e-6


def test_predictions_depend_on_p_and_on_memory(model, memory):
    s, u = torch.zeros(7, dtype=torch.float64), torch.zeros(1, 4, 2, dtype=torch.float64)
    zero, one = (torch.full((2,), value, dtype=torch.float64) for value in (0.0, 1.0))
    assert not torch.allclose(predict(model, s, u, zero), predict(model, s, u, one))
    assert not torch.allclose(predict(model, s, u, zero), predict(model, s, u, zero, memory))


def test_the_initial_memory_is_no_memory(model):
    s, u, p = torch.randn(1, 3, 7).double(), torch.randn(1, 3, 2).double(), torch.zeros(2).double()
    memory = type(model.initial_memory())(*(part.double() for part in model.initial_memory()))
    assert torch.equal(model(s, u, p, memory)[0], model(s, u, p)[0])


def test_one_long_call_equals_many_short_ones(model):
    torch.manual_seed(6)
    s, u = torch.randn(1, 10, 7, dtype=torch.float64), torch.randn(1, 10, 2, dtype=torch.float64)
    p = torch.zeros(2, dtype=torch.float64)
    whole, memory_whole = model(s, u, p)
    first, memory = model(s[:, :4], u[:, :4], p)
    second, memory = model(s[:, 4:], u[:, 4:], p, memory)
    assert torch.allclose(whole, torch.cat([first, second], dim=1))
    assert torch.allclose(memory_whole.h, memory.h)


def test_units_of_the_state_do_not_matter_to_the_loss(model):
    model.s_std.copy_(torch.tensor([1.0, 10, 100, 1, 1, 1, 1]))
    s = torch.zeros(1, 1, 7, dtype=torch.float64)
    off_by_one_deviation = s + model.s_std
    assert model.loss(off_by_one_deviation, s) == pytest.approx(1.0)


def test_normalisation_comes_from_all_runs_and_never_divides_by_nothing():
    model = DPMPB(7, 2)
    s = np.arange(140.0).reshape(20, 7)
    s[:, 6] = 5.0  # a sensor that never changes
    runs = [Sequences(s[:10], np.zeros((10, 2)), "a"), Sequences(s[10:], np.ones((10, 2)), "b")]
    fit_normalisation(model, runs)
    assert model.s_mean.numpy() == pytest.approx(s.mean(0))
    assert model.s_std.numpy()[:6] == pytest.approx(s.std(0, ddof=1)[:6])
    assert model.s_std[6] > 0
    assert model.u_mean.tolist() == [0.5, 0.5]


def test_training_separates_materials_and_is_reproducible(made_up_runs):
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    trained, found, trace = train_dpmpb(made_up_runs, BRIEF, device="cpu", progress=False)
    assert torch.equal(torch.rand(3), expected), "the random numbers of others were changed"
    again, found_again, _ = train_dpmpb(made_up_runs, BRIEF, device="cpu", progress=False)
    assert trace.losses[-1] < trace.losses[0]
    assert np.linalg.norm(found["a"] - found["b"]) > 0.01
    assert np.array_equal(found["a"], found_again["a"])
    assert all(torch.equal(a, b) for a, b in zip(trained.parameters(), again.parameters(), strict=True))
    assert not trained.training


def test_the_trace_leads_from_zero_to_what_was_found(made_up_runs):
    settings = ModelTraining(epochs=3, sequence_length=10, bias_size=3)
    _, found, trace = train_dpmpb(made_up_runs, settings, device="cpu", progress=False)
    assert list(found) == list(trace.biases) == ["a", "b"]
    assert len(trace.losses) == 3
    for name, path in trace.biases.items():
        assert path.shape == (4, 3)
        assert not path[0].any()
        assert np.array_equal(path[-1], found[name])


def test_stretches_overlap_and_belong_to_their_material():
    runs = [Sequences(np.arange(n)[:, None], 10.0 * np.arange(n)[:, None], name) for n, name in ((7, "a"), (5, "b"))]
    s, u, k = stretches([*runs, runs[0]], 3, 2)
    assert s[:, :, 0].tolist() == [[0, 1, 2, 3], [2, 3, 4, 5], [0, 1, 2, 3], [0, 1, 2, 3], [2, 3, 4, 5]]
    assert u[:, :, 0].tolist() == (10 * s[:, :-1, 0]).tolist()
    assert k.tolist() == [0, 0, 1, 0, 0]


def test_states_of_a_trial_are_z_and_robot(trial):
    autoencoder = Autoencoder().eval()
    run = to_sequences(autoencoder, trial)
    assert run.s.shape == (12, 7)
    assert run.s[:, 3:] == pytest.approx(trial.robot, rel=1e-5)
    assert run.material == "damp0.05-mass0.10"
    one = observe(autoencoder, {"image": trial.images[4], "robot": trial.robot[4]})
    assert one == pytest.approx(run.s[4], abs=1e-5)
    assert one.dtype == np.float32


def test_a_stretch_of_a_run_is_a_run():
    run = Sequences([[1.0], [2.0], [3.0]], [[4], [5], [6]], "a")
    assert (len(run), len(run[1:])) == (3, 2)
    assert run[1:].s.tolist() == [[2.0], [3.0]]
    assert run.s.dtype == run.u.dtype == np.float32


@pytest.mark.parametrize(
    ("s", "u", "message"),
    [
        (GOOD.s + np.nan, GOOD.u, r"s of a run of a is \[T, D_s\] and finite, got nan"),
        (GOOD.s, np.full((40, 2), np.inf), r"u of a run of a is \[T, D_u\] and finite"),
        (np.full((40, 7), 1e300), GOOD.u, "finite, got inf"),
        (GOOD.s[0], GOOD.u, r"got the shape \[7\]"),
        (GOOD.s[:5], GOOD.u, "as many states as commands, got 5 and 40"),
        (None, GOOD.u, "s of a run"),
        (GOOD.s[:0], GOOD.u, "got 0 and 40"),
        (GOOD.s, "left", "u of a run"),
    ],
)
def test_what_does_not_belong_together_is_no_run(s, u, message):
    with pytest.raises(ValueError, match=message):
        Sequences(s, u, "a")


def test_a_run_says_its_material():
    with pytest.raises(ValueError, match=r"Sequences.material is a str, got None"):
        Sequences(GOOD.s, GOOD.u, None)


def test_runs_that_no_model_can_learn_are_refused():
    with pytest.raises(ValueError, match=r"no runs"):
        train_dpmpb([])
    with pytest.raises(ValueError, match=r"more steps than the 30 of a sequence, got 20"):
        train_dpmpb([GOOD, GOOD[:20]])
    with pytest.raises(ValueError, match=r"sizes differ"):
        train_dpmpb([GOOD, Sequences(np.zeros((40, 9)), GOOD.u, "b")])


def test_a_p_that_is_known_is_used_as_it_is(made_up_runs):
    known = {"b": [-0.5, 0.25], "a": [0.5, 0.0]}
    _, biases, trace = train_dpmpb(made_up_runs, BRIEF, known=known, progress=False)
    for name, p in known.items():
        assert np.array_equal(biases[name], np.float32(p))
        assert np.array_equal(trace.biases[name], np.tile(np.float32(p), (BRIEF.epochs + 1, 1)))


def test_what_is_known_of_the_wrong_materials_or_size_is_refused(made_up_runs):
    with pytest.raises(KeyError, match="b"):
        train_dpmpb(made_up_runs, BRIEF, known={"a": [0.0, 0.0]}, progress=False)
    with pytest.raises(ValueError, match="p of b"):
        train_dpmpb(made_up_runs, BRIEF, known={"a": [0.0, 0.0], "b": [0.0]}, progress=False)
