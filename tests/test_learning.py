"""Laws of the predictive model, and of estimating p with it."""

import numpy as np
import pytest
import torch

from clothlab.autoencoder import Autoencoder, AutoencoderTraining, decode, encode, iou, train_autoencoder
from clothlab.dpmpb import DPMPB, FrozenDPMPB, ModelTraining, Sequences, predict, to_sequences, train_dpmpb
from clothlab.estimation import BiasEstimator, EstimationSettings, estimate_bias


def finite_difference(function, x, step=1e-5):
    """Gradient of a scalar function by central differences."""
    gradient = torch.zeros_like(x)
    for k in range(x.numel()):
        shift = torch.zeros_like(x).view(-1)
        shift[k] = step
        shift = shift.view_as(x)
        gradient.view(-1)[k] = (function(x + shift) - function(x - shift)) / (2 * step)
    return gradient


def made_up_runs(model: DPMPB, biases: dict[str, torch.Tensor], steps: int = 80) -> list[Sequences]:
    """Runs that a model generates itself, each with its own p: data whose p is known."""
    generator = torch.Generator().manual_seed(2)
    runs = []
    for name, p in biases.items():
        u = torch.randn(1, steps, 2, generator=generator, dtype=torch.float64)
        s, memory, states = torch.zeros(1, 1, 7, dtype=torch.float64), None, []
        for t in range(steps):
            states.append(s[0, 0].numpy())
            s, memory = model(s, u[:, t : t + 1], p, memory)
        runs.append(Sequences(np.array(states, np.float32), u[0].numpy().astype(np.float32), name))
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


def test_gradient_on_u_equals_finite_differences(model, memory):
    torch.manual_seed(4)
    s, u = torch.randn(7, dtype=torch.float64), torch.randn(1, 8, 2, dtype=torch.float64)
    frozen = FrozenDPMPB(model, torch.tensor([0.3, -0.2], dtype=torch.float64))

    def loss(u):
        return frozen(s, u, memory)[..., :3].square().sum()

    (gradient,) = torch.autograd.grad(loss(u.requires_grad_()), u)
    assert torch.allclose(gradient, finite_difference(loss, u.detach()), rtol=1e-6, atol=1e-9)


def test_predictions_depend_on_p_and_on_memory(model, memory):
    s, u = torch.zeros(7, dtype=torch.float64), torch.zeros(1, 4, 2, dtype=torch.float64)
    zero, one = (torch.full((2,), value, dtype=torch.float64) for value in (0.0, 1.0))
    assert not torch.allclose(predict(model, s, u, zero), predict(model, s, u, one))
    assert not torch.allclose(predict(model, s, u, zero), predict(model, s, u, zero, memory))


def test_frozen_model_equals_the_plain_one(model, memory):
    torch.manual_seed(5)
    s, u, p = (torch.randn(*size, dtype=torch.float64) for size in ((7,), (30, 8, 2), (2,)))
    assert torch.allclose(FrozenDPMPB(model, p)(s, u, memory), predict(model, s, u, p, memory), atol=1e-12)


def test_one_long_call_equals_many_short_ones(model):
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


def test_with_w_fixed_estimation_recovers_the_p_that_generated_the_data(model):
    with torch.no_grad():  # random weights hardly listen to p; these do
        model.fc_in[0].weight[:, -2:] *= 10
        model.fc_out[-1].weight *= 5
    true = torch.tensor([0.4, -0.3], dtype=torch.float64)
    (run,) = made_up_runs(model, {"cloth": true})
    settings = EstimationSettings(rate=10.0, warmup=0)
    p = np.zeros(2)
    for _ in range(20):
        p, _ = estimate_bias(model.float(), run, p, settings)
    assert p == pytest.approx(true.numpy(), abs=0.02)


def test_estimation_touches_nothing_but_p(model, trial):
    model = model.float().requires_grad_(True)
    before = [parameter.clone() for parameter in model.parameters()]
    run = Sequences(np.random.default_rng(0).normal(size=(20, 7)).astype(np.float32), np.zeros((20, 2), np.float32), "")
    p, trace = estimate_bias(model, run)
    assert trace.shape == (20, 2)
    assert (p != 0).all()
    assert all(torch.equal(a, b) for a, b in zip(before, model.parameters(), strict=True))


def test_training_separates_materials_and_is_reproducible(model):
    with torch.no_grad():
        model.fc_in[0].weight[:, -2:] *= 10
        model.fc_out[-1].weight *= 5
    biases = {"a": torch.tensor([0.5, 0.0]).double(), "b": torch.tensor([-0.5, 0.0]).double()}
    runs = made_up_runs(model, biases)
    settings = ModelTraining(epochs=8, batch_size=20, sequence_length=10)
    trained, found, losses = train_dpmpb(runs, settings, device="cpu", progress=False)
    again, found_again, _ = train_dpmpb(runs, settings, device="cpu", progress=False)
    assert losses[-1] < losses[0]
    assert np.linalg.norm(found["a"] - found["b"]) > 0.01
    assert np.array_equal(found["a"], found_again["a"])
    assert all(torch.equal(a, b) for a, b in zip(trained.parameters(), again.parameters(), strict=True))


def test_bad_runs_are_refused():
    good = Sequences(np.zeros((40, 7), np.float32), np.zeros((40, 2), np.float32), "a")
    with pytest.raises(ValueError, match="no runs"):
        train_dpmpb([])
    with pytest.raises(ValueError, match="more than 30"):
        train_dpmpb([Sequences(good.s[:20], good.u[:20], "a")])
    with pytest.raises(ValueError, match="not finite"):
        train_dpmpb([Sequences(good.s + np.nan, good.u, "a")])
    with pytest.raises(ValueError, match="sizes differ"):
        train_dpmpb([good, Sequences(np.zeros((40, 9), np.float32), good.u, "b")])


def test_bad_biases_are_refused(model):
    with pytest.raises(ValueError, match=r"p is \[2\]"):
        BiasEstimator(model, np.zeros(3))
    with pytest.raises(ValueError, match="finite"):
        BiasEstimator(model, np.array([np.nan, 0.0]))


def test_autoencoder_learns_and_keeps_shapes(trial):
    images = np.concatenate([trial.images] * 6)
    model, losses = train_autoencoder(images, AutoencoderTraining(epochs=3, batch_size=24), progress=False)
    assert losses[-1] < losses[0]
    z = encode(model, images[0])
    assert z.shape == (3,)
    assert decode(model, z).shape == (96, 128)
    assert decode(model, encode(model, images[:5])).shape == (5, 96, 128)


def test_z_has_unit_scale_whatever_the_weights():
    images = torch.rand(64, 1, 96, 128).round()
    z = Autoencoder().train().encoder(images)
    assert torch.allclose(z.mean(0), torch.zeros(3), atol=1e-5)
    assert torch.allclose(z.std(0, correction=0), torch.ones(3), atol=0.05)


def test_autoencoder_refuses_other_sizes(trial):
    model = Autoencoder().eval()
    with pytest.raises(ValueError, match=r"images are \[96, 128\]"):
        encode(model, np.zeros((48, 64), bool))
    with pytest.raises(ValueError, match=r"z is \[3\]"):
        decode(model, np.zeros(4))
    with pytest.raises(ValueError, match="finite"):
        decode(model, np.full(3, np.nan))
    with pytest.raises(ValueError, match="fewer than one batch"):
        train_autoencoder(trial.images)


def test_iou(square):
    assert iou(square, square) == 1
    assert iou(square, ~square) == 0
    assert iou(np.zeros_like(square), np.zeros_like(square)) == 1
    assert iou(square, np.roll(square, 15, axis=1)) == pytest.approx(1 / 3)


def test_states_of_a_trial_are_z_and_robot(trial):
    run = to_sequences(Autoencoder().eval(), trial)
    assert run.s.shape == (12, 7)
    assert run.s[:, 3:] == pytest.approx(trial.robot, rel=1e-5)
    assert run.material == "damp0.05-mass0.10"
