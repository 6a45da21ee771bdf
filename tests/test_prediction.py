"""Laws of `predict`: whatever is computed once, it is the network, step by step."""

import pytest
import torch

from clothlab.method.model import DPMPB, Memory, predict

P = torch.tensor([0.3, -0.2], dtype=torch.float64)


def numbers(*shape, seed=5):
    return torch.randn(
        shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64
    )


def step_by_step(model, s, u, p, memory):
    """The network itself, called with one step after the other."""
    memory = Memory(*(part.expand(-1, len(u), -1).contiguous() for part in memory))
    s = s.expand(len(u), -1)[:, None]
    states = []
    for command in u.split(1, dim=1):
        s, memory = model(s, command, p, memory)
        states.append(s)
    return torch.cat(states, dim=1)


def gradients(function, *inputs):
    """Gradient of an arbitrary weighting of what a function returns, with respect to
    all its inputs.
    """
    inputs = [each.clone().requires_grad_() for each in inputs]
    output = function(*inputs)
    return torch.autograd.grad((output * numbers(*output.shape, seed=6)).sum(), inputs)


@pytest.mark.parametrize("bias_size", [0, 2])
def test_it_equals_the_network(model, memory, bias_size):
    if not bias_size:
        model = DPMPB(7, 2, bias_size=0).double()
    s, u, p = numbers(7), numbers(30, 8, 2), P[:bias_size]
    with torch.no_grad():
        found = predict(model, s, u, p, memory)
        expected = step_by_step(model, s, u, p, memory)
    assert torch.allclose(found, expected, rtol=0, atol=1e-12)


def test_its_gradients_equal_those_of_the_network(model, memory):
    inputs = numbers(7), numbers(4, 8, 2), P, *memory
    found = gradients(
        lambda s, u, p, h, c: predict(model, s, u, p, Memory(h, c)), *inputs
    )
    expected = gradients(
        lambda s, u, p, h, c: step_by_step(model, s, u, p, Memory(h, c)), *inputs
    )
    for one, other in zip(found, expected, strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)
        assert other.abs().min() > 1e-9


def test_values_are_the_same_with_a_gradient_and_without(model, memory):
    s, u = numbers(7), numbers(4, 8, 2)
    plain = predict(model, s, u, P, memory)
    assert torch.equal(predict(model, s, u.clone().requires_grad_(), P, memory), plain)
    with torch.no_grad():
        assert torch.equal(predict(model, s, u, P, memory), plain)


def test_sequences_may_have_starts_of_their_own_and_do_not_see_each_other(model):
    s, u = numbers(5, 7), numbers(5, 8, 2)
    memory = Memory(0.3 * numbers(2, 5, 30), 0.3 * numbers(2, 5, 30, seed=4))
    alone = []
    for k in range(5):
        own = Memory(*(part[:, k : k + 1] for part in memory))
        alone.append(predict(model, s[k], u[k : k + 1], P, own))
    together = predict(model, s, u, P, memory)
    assert torch.allclose(together, torch.cat(alone), rtol=0, atol=1e-12)
    first = Memory(*(part[:, :1] for part in memory))
    assert not torch.allclose(alone[0], predict(model, s[1], u[:1], P, first))


def test_a_model_with_a_forward_of_its_own_is_refused():
    class Other(DPMPB):
        def forward(self, s, u, p, memory=None):
            return s, self.initial_memory()

    model = Other(3, 2)
    with pytest.raises(TypeError, match="Other has a `forward` of its own"):
        predict(model, torch.zeros(3), torch.zeros(1, 4, 2), torch.zeros(2))
