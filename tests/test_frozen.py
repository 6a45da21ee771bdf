"""Laws of the fast model: whatever is rearranged, folded or computed together, it is the function of the plain one."""

import pytest
import torch

from clothlab.learning.dpmpb import DPMPB, Memory, predict
from clothlab.learning.fast_rollout import FastDPMPB, FrozenEnsemble

P = torch.tensor([0.3, -0.2], dtype=torch.float64)


def numbers(*shape, seed=5):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def gradients(function, *inputs):
    """Gradient of an arbitrary weighting of what a function returns, with respect to all its inputs."""
    inputs = [each.clone().requires_grad_() for each in inputs]
    output = function(*inputs)
    return torch.autograd.grad((output * numbers(*output.shape, seed=6)).sum(), inputs)


@pytest.fixture
def ensemble(model):
    """Three models that differ in weights and normalisation, each with a p and a memory of its own."""
    models = [model]
    for seed in (1, 2):
        torch.manual_seed(seed)
        other = DPMPB(7, 2).double().requires_grad_(False)
        for name, buffer in other.named_buffers():
            buffer.copy_(numbers(len(buffer), seed=seed) if "mean" in name else 0.5 + torch.rand(len(buffer)))
        models.append(other)
    return models, numbers(3, 2, seed=3), Memory(0.3 * numbers(2, 3, 1, 30), 0.3 * numbers(2, 3, 1, 30, seed=4))


def of_member(memory, k):
    return Memory(memory.h[:, k], memory.c[:, k])


def test_it_equals_the_plain_model(model, memory):
    s, u = numbers(7), numbers(30, 8, 2)
    assert torch.allclose(FastDPMPB(model, P)(s, u, memory), predict(model, s, u, P, memory), rtol=0, atol=1e-12)


def test_single_precision_is_enough(model, memory):
    s, u = numbers(7), numbers(30, 8, 2)
    exact = predict(model, s, u, P, memory)
    frozen = FastDPMPB(model.float(), P.float())
    found = frozen(s.float(), u.float(), Memory(memory.h.float(), memory.c.float()))
    assert found.dtype == torch.float32
    assert (found - exact).abs().max() < 1e-5


def test_a_model_without_p_is_one_too(memory):
    model, nothing = DPMPB(7, 2, bias_size=0).double(), torch.zeros(0, dtype=torch.float64)
    s, u = numbers(7), numbers(3, 4, 2)
    found = FastDPMPB(model, nothing)(s, u, memory)
    assert torch.allclose(found, predict(model, s, u, nothing, memory), rtol=0, atol=1e-12)


def test_its_gradients_equal_the_plain_ones(model, memory):
    frozen = FastDPMPB(model, P)
    inputs = numbers(7), numbers(4, 8, 2), *memory
    found = gradients(lambda s, u, h, c: frozen(s, u, Memory(h, c)), *inputs)
    expected = gradients(lambda s, u, h, c: predict(model, s, u, P, Memory(h, c)), *inputs)
    for one, other in zip(found, expected, strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)
        assert other.abs().min() > 1e-9


def test_gradients_on_the_state_alone_equal_the_plain_ones(model, memory):
    frozen, s, u = FastDPMPB(model, P), numbers(7), numbers(4, 8, 2)
    (found,) = gradients(lambda s: frozen(s, u, memory), s)
    (expected,) = gradients(lambda s: predict(model, s, u, P, memory), s)
    assert torch.allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_one_command_sequence_does_not_see_the_others(model, memory):
    frozen, s, u = FastDPMPB(model, P), numbers(7), numbers(5, 8, 2)
    (together,) = gradients(lambda u: frozen(s, u, memory)[1:2], u)
    assert together[1].abs().min() > 0
    assert not together[[0, 2, 3, 4]].any()


def test_sequences_may_have_starts_of_their_own(model):
    frozen, s, u = FastDPMPB(model, P), numbers(5, 7), numbers(5, 8, 2)
    memory = Memory(0.3 * numbers(2, 5, 30), 0.3 * numbers(2, 5, 30, seed=4))
    alone = [frozen(s[k], u[k : k + 1], Memory(*(part[:, k : k + 1] for part in memory))) for k in range(5)]
    assert torch.allclose(frozen(s, u, memory), torch.cat(alone), rtol=0, atol=1e-12)
    assert not torch.allclose(alone[0], frozen(s[1], u[:1], Memory(*(part[:, :1] for part in memory))))


def test_its_memory_follows_what_was_observed(model):
    frozen, s, u = FastDPMPB(model, P), numbers(6, 7), numbers(6, 2)
    memory = Memory(*(part.double() for part in model.initial_memory()))
    for k in range(6):
        memory = frozen.follow(s[k], u[k], memory)
    _, expected = model(s[None], u[None], P)
    assert torch.allclose(memory.h, expected.h, rtol=0, atol=1e-12)
    assert torch.allclose(memory.c, expected.c, rtol=0, atol=1e-12)


def test_memories_of_several_runs_follow_together(model):
    frozen, s, u = FastDPMPB(model, P), numbers(4, 7), numbers(4, 2)
    memory = Memory(0.3 * numbers(2, 4, 30), 0.3 * numbers(2, 4, 30, seed=4))
    together = frozen.follow(s, u, memory)
    _, expected = model(s.unsqueeze(1), u.unsqueeze(1), P, memory)
    assert torch.allclose(together.h, expected.h, rtol=0, atol=1e-12)
    assert torch.allclose(together.c, expected.c, rtol=0, atol=1e-12)


@pytest.mark.parametrize("starts", [(), (4,)], ids=["one start", "starts of their own"])
def test_an_ensemble_is_each_of_its_members(ensemble, starts):
    models, p, memory = ensemble
    s, u = numbers(*starts, 7), numbers(4, 8, 2)
    together = FrozenEnsemble(models, p)(s, u, memory)
    assert together.shape == (3, 4, 8, 7)
    for k, model in enumerate(models):
        alone = FastDPMPB(model, p[k])(s, u, of_member(memory, k))
        assert torch.allclose(together[k], alone, rtol=0, atol=1e-12)


def test_permuting_members_permutes_predictions(ensemble):
    models, p, memory = ensemble
    s, u, order = numbers(7), numbers(4, 8, 2), [2, 0, 1]
    permuted = FrozenEnsemble([models[k] for k in order], p[order])(s, u, Memory(*(part[:, order] for part in memory)))
    assert torch.allclose(permuted, FrozenEnsemble(models, p)(s, u, memory)[order], rtol=0, atol=1e-12)
    assert not torch.allclose(permuted[0], permuted[1])


def test_the_gradient_of_an_ensemble_is_the_sum_of_its_members(ensemble):
    models, p, memory = ensemble
    s, u, weights = numbers(7), numbers(4, 8, 2).requires_grad_(), numbers(3, 4, 8, 7, seed=6)
    together = FrozenEnsemble(models, p)(s, u, memory)
    alone = [FastDPMPB(model, p[k])(s, u, of_member(memory, k)) for k, model in enumerate(models)]
    (found,) = torch.autograd.grad((weights * together).sum(), u)
    (expected,) = torch.autograd.grad((weights * torch.stack(alone)).sum(), u)
    assert torch.allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_memories_of_an_ensemble_follow_those_of_its_members(ensemble):
    models, p, _ = ensemble
    frozen, s, u = FrozenEnsemble(models, p), numbers(5, 7), numbers(5, 2)
    memory = frozen.initial_memory()
    for k in range(5):
        memory = frozen.follow(s[k], u[k], memory)
    for k, model in enumerate(models):
        _, alone = model(s[None], u[None], p[k])
        assert torch.allclose(memory.h[:, k], alone.h, rtol=0, atol=1e-12)
        assert torch.allclose(memory.c[:, k], alone.c, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("models", "count", "message"),
    [
        ([], 0, "the same D_s, D_u and D_p, got no models"),
        ([(7, 2), (15, 3)], 2, r"got \(7, 2, 2\) and \(15, 3, 2\)"),
        ([(7, 2), (7, 2, 3)], 2, r"got \(7, 2, 2\) and \(7, 2, 3\)"),
        ([(7, 2), (7, 2)], 3, "one p for each of its 2 models, got 3"),
    ],
)
def test_what_is_no_ensemble_is_refused(models, count, message):
    with pytest.raises(ValueError, match=message):
        FrozenEnsemble([DPMPB(*sizes) for sizes in models], torch.zeros(count, 2))
