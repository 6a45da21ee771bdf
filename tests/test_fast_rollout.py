"""Laws of the fast model: whatever is rearranged or folded, it is the function of the
plain one.
"""

import pytest
import torch
from torch import nn

from clothlab.method._rollouts import PlainRollout, rollout_of
from clothlab.method.control import Controller
from clothlab.method.fast_rollout import FastDPMPB
from clothlab.method.model import DPMPB, Memory, predict

P = torch.tensor([0.3, -0.2], dtype=torch.float64)


def numbers(*shape, seed=5):
    return torch.randn(
        shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64
    )


def gradients(function, *inputs):
    """Gradient of an arbitrary weighting of what a function returns, with respect to
    all its inputs.
    """
    inputs = [each.clone().requires_grad_() for each in inputs]
    output = function(*inputs)
    return torch.autograd.grad((output * numbers(*output.shape, seed=6)).sum(), inputs)


@pytest.mark.parametrize("bias_size", [0, 2])
def test_it_equals_the_plain_model(model, memory, bias_size):
    if not bias_size:
        model = DPMPB(7, 2, bias_size=0).double()
    s, u, p = numbers(7), numbers(30, 8, 2), P[:bias_size]
    with torch.no_grad():
        found, expected = (
            FastDPMPB(model, p)(s, u, memory),
            predict(model, s, u, p, memory),
        )
    assert torch.allclose(found, expected, rtol=0, atol=1e-12)


def test_its_gradients_equal_the_plain_ones(model, memory):
    fast = FastDPMPB(model, P)
    inputs = numbers(7), numbers(4, 8, 2), *memory
    found = gradients(lambda s, u, h, c: fast(s, u, Memory(h, c)), *inputs)
    expected = gradients(
        lambda s, u, h, c: predict(model, s, u, P, Memory(h, c)), *inputs
    )
    for one, other in zip(found, expected, strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)
        assert other.abs().min() > 1e-9


def test_values_are_the_same_with_a_gradient_and_without(model, memory):
    fast, s, u = FastDPMPB(model, P), numbers(7), numbers(4, 8, 2)
    assert torch.equal(fast(s, u.clone().requires_grad_(), memory), fast(s, u, memory))
    with torch.no_grad():
        assert torch.equal(
            fast(s, u, memory), fast(s, u.clone().requires_grad_(), memory)
        )


def test_sequences_may_have_starts_of_their_own_and_do_not_see_each_other(model):
    fast, s, u = FastDPMPB(model, P), numbers(5, 7), numbers(5, 8, 2)
    memory = Memory(0.3 * numbers(2, 5, 30), 0.3 * numbers(2, 5, 30, seed=4))
    alone = [
        fast(s[k], u[k : k + 1], Memory(*(part[:, k : k + 1] for part in memory)))
        for k in range(5)
    ]
    assert torch.allclose(fast(s, u, memory), torch.cat(alone), rtol=0, atol=1e-12)
    assert not torch.allclose(
        alone[0], fast(s[1], u[:1], Memory(*(part[:, :1] for part in memory)))
    )


@pytest.mark.parametrize("runs", [1, 4])
def test_its_memory_follows_what_was_observed(model, runs):
    fast, s, u = FastDPMPB(model, P), numbers(runs, 6, 7), numbers(runs, 6, 2)
    memory = Memory(*(part.double() for part in model.initial_memory()))
    for k in range(6):
        memory = fast.follow(s[:, k], u[:, k], memory)
    _, expected = model(s, u, P)
    assert torch.allclose(memory.h, expected.h, rtol=0, atol=1e-12)
    assert torch.allclose(memory.c, expected.c, rtol=0, atol=1e-12)


class Residual(DPMPB):
    """Predicts the change of the state, as a user's own network might."""

    def forward(self, s, u, p, memory=None):
        change, memory = super().forward(s, u, p, memory)
        return s + change, memory


def with_relu(model):
    model.fc_in[3] = nn.ReLU()
    return model


def with_norm(model):
    model.fc_out.insert(1, nn.LayerNorm(30))
    return model


def with_hook(model):
    model.fc_out.register_forward_hook(lambda module, given, output: 1.1 * output)
    return model


OWN = {
    "residual": lambda: Residual(7, 2),
    "relu": lambda: with_relu(DPMPB(7, 2)),
    "norm": lambda: with_norm(DPMPB(7, 2)),
    "hook": lambda: with_hook(DPMPB(7, 2)),
}


@pytest.mark.parametrize("name", OWN)
def test_a_network_of_ones_own_is_planned_with_as_it_is(name):
    torch.manual_seed(0)
    own = OWN[name]().eval()
    assert rollout_of(own) is PlainRollout
    if name != "hook":  # which shows in no layer, only in what comes out
        with pytest.raises(ValueError, match="has a forward or layers of its own"):
            FastDPMPB(own, torch.zeros(2))

    foreseen = []

    def loss(states, commands, t):
        foreseen.append(states[0].detach())
        return states[..., 0].square().sum(1)

    command, p = torch.tensor([0.4, -0.2]), torch.tensor([0.3, -0.2])
    controller = Controller(own, loss, p.numpy(), command, command)  # only one plan
    plan, memory = command.expand(1, 8, 2), None
    for s in (torch.linspace(-1, 1, 7), torch.linspace(2, -1, 7)):
        sent = torch.as_tensor(controller.act(s), dtype=torch.float32)
        assert torch.equal(sent, command)
        with torch.no_grad():
            expected = predict(own, s, plan, p, memory)
            _, memory = own(s[None, None], command[None, None], p, memory)
        assert torch.allclose(foreseen[-1], expected[0], atol=1e-5)


def test_the_papers_network_is_planned_with_fast():
    assert rollout_of(DPMPB(7, 2)) is FastDPMPB
    assert rollout_of(DPMPB(7, 2, bias_size=0)) is FastDPMPB
    assert rollout_of(DPMPB(15, 3).double()) is FastDPMPB


def test_the_plain_rollout_takes_starts_and_memories_as_the_fast_one_does(model):
    fast, plain = FastDPMPB(model, P), PlainRollout(model, P)
    s, u = numbers(5, 7), numbers(5, 8, 2)
    memory = Memory(0.3 * numbers(2, 5, 30), 0.3 * numbers(2, 5, 30, seed=4))
    with torch.no_grad():
        assert torch.allclose(
            plain(s, u, memory), fast(s, u, memory), rtol=0, atol=1e-12
        )
        followed = zip(
            plain.follow(s, u[:, 0], memory),
            fast.follow(s, u[:, 0], memory),
            strict=True,
        )
    assert all(
        torch.allclose(one, other, rtol=0, atol=1e-12) for one, other in followed
    )
