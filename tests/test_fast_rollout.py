"""Laws of the fast model: whatever is rearranged or folded, it is the function of the plain one."""

import pytest
import torch

from clothlab.learning.dpmpb import DPMPB, Memory, predict
from clothlab.learning.fast_rollout import FastDPMPB

P = torch.tensor([0.3, -0.2], dtype=torch.float64)


def numbers(*shape, seed=5):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def gradients(function, *inputs):
    """Gradient of an arbitrary weighting of what a function returns, with respect to all its inputs."""
    inputs = [each.clone().requires_grad_() for each in inputs]
    output = function(*inputs)
    return torch.autograd.grad((output * numbers(*output.shape, seed=6)).sum(), inputs)


@pytest.mark.parametrize("bias_size", [0, 2])
def test_it_equals_the_plain_model(model, memory, bias_size):
    if not bias_size:
        model = DPMPB(7, 2, bias_size=0).double()
    s, u, p = numbers(7), numbers(30, 8, 2), P[:bias_size]
    with torch.no_grad():
        found, expected = FastDPMPB(model, p)(s, u, memory), predict(model, s, u, p, memory)
    assert torch.allclose(found, expected, rtol=0, atol=1e-12)


def test_its_gradients_equal_the_plain_ones(model, memory):
    fast = FastDPMPB(model, P)
    inputs = numbers(7), numbers(4, 8, 2), *memory
    found = gradients(lambda s, u, h, c: fast(s, u, Memory(h, c)), *inputs)
    expected = gradients(lambda s, u, h, c: predict(model, s, u, P, Memory(h, c)), *inputs)
    for one, other in zip(found, expected, strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)
        assert other.abs().min() > 1e-9


def test_values_are_the_same_with_a_gradient_and_without(model, memory):
    fast, s, u = FastDPMPB(model, P), numbers(7), numbers(4, 8, 2)
    assert torch.equal(fast(s, u.clone().requires_grad_(), memory), fast(s, u, memory))
    with torch.no_grad():
        assert torch.equal(fast(s, u, memory), fast(s, u.clone().requires_grad_(), memory))


def test_sequences_may_have_starts_of_their_own_and_do_not_see_each_other(model):
    fast, s, u = FastDPMPB(model, P), numbers(5, 7), numbers(5, 8, 2)
    memory = Memory(0.3 * numbers(2, 5, 30), 0.3 * numbers(2, 5, 30, seed=4))
    alone = [fast(s[k], u[k : k + 1], Memory(*(part[:, k : k + 1] for part in memory))) for k in range(5)]
    assert torch.allclose(fast(s, u, memory), torch.cat(alone), rtol=0, atol=1e-12)
    assert not torch.allclose(alone[0], fast(s[1], u[:1], Memory(*(part[:, :1] for part in memory))))


@pytest.mark.parametrize("runs", [1, 4])
def test_its_memory_follows_what_was_observed(model, runs):
    fast, s, u = FastDPMPB(model, P), numbers(runs, 6, 7), numbers(runs, 6, 2)
    memory = Memory(*(part.double() for part in model.initial_memory()))
    for k in range(6):
        memory = fast.follow(s[:, k], u[:, k], memory)
    _, expected = model(s, u, P)
    assert torch.allclose(memory.h, expected.h, rtol=0, atol=1e-12)
    assert torch.allclose(memory.c, expected.c, rtol=0, atol=1e-12)
