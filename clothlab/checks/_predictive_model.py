"""Checks of notebook 04."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch

from clothlab.checks._check import apart, array, arrays, check, drawn, expect
from clothlab.method.model import DPMPB, Memory, predict

_Z = slice(0, 3)  # the numbers of the state that are the image


@check(arrays("the new h and the new c", *[array("30 numbers", 1, 30)] * 2))
def lstm_step(answer: Callable, rng: np.random.Generator) -> None:
    """One step of an LSTM layer: the new h and the new c, each `[1, 30]`.

    Given are an input, an h and a c that are not zero, and the weights of PyTorch's
    layer; expected is what its equations say.
    """
    # A memory, an input and weights
    network = _network(rng)
    h, c = (part[0] for part in network.memory)
    x = _normal(rng, 1, 30)
    W, R, b, *_ = network.model.lstm.parameters()

    # The gates, in PyTorch's order, and the two new values
    i, f, g, o = (x @ W.T + h @ R.T + b).chunk(4, dim=-1)
    i = i.sigmoid()
    f = f.sigmoid()
    g = g.tanh()
    o = o.sigmoid()
    true_c = f * c + i * g
    true_h = o * true_c.tanh()

    # c first: a wrong one makes a wrong h
    slips = {
        "the gates have changed places: f keeps, i adds": i * c + f * g,
        "the old cell state is missing": i * g,
        "the forget gate is missing: all of the old state stays": c + i * g,
    }
    new_h, new_c = answer(x, h, c, W, R, b)
    otherwise = "wrong: c keeps a part of the old c, and adds a part of g"
    expect(new_c, true_c, otherwise, slips)
    expect(new_h, true_h, "c is right, h is wrong: leave its line as it was")


@check(lambda _, found: found)
def parameter_groups(answer: Callable, rng: np.random.Generator) -> None:
    """Parameter groups for Adam, in which W and p have rates of their own.

    Given are a layer, p `[3, 2]` and two learning rates; once p is to be trained, once
    it is fixed and has no group. Adam itself is asked what it makes of the groups.
    """
    layer = torch.nn.Linear(2, 1)
    for fixed in (False, True):
        p = torch.zeros(3, 2, requires_grad=not fixed)
        rate = rng.uniform(0.01, 0.02)
        bias_rate = rng.uniform(0.1, 0.2)
        rates = _rates_of_adam(answer(layer, p, rate, bias_rate))

        # W always moves
        w_moves = all(rates.get(id(each)) == rate for each in layer.parameters())
        assert w_moves, "W moves at `rate`: leave its group"

        # p moves where it is to be trained; a rate of 0 stands for no group
        if fixed:
            truth = 0.0
            otherwise = "p is fixed: it has no group then"
        else:
            truth = bias_rate
            otherwise = "the group of p needs `bias_rate` as its lr"
        slips = {"p is in no group, and would stay at zero": 0}
        expect(rates.get(id(p), 0), truth, otherwise, slips)


def _rates_of_adam(groups: object) -> dict[int, float]:
    """The learning rate of each parameter, by its id, once Adam has the groups."""
    try:
        adam = torch.optim.Adam(groups)  # type: ignore[arg-type]
    except Exception as error:  # whatever was returned
        words = str(error).strip().splitlines()[:1]
        refused = ": ".join(["Adam takes no such groups", *words])
        raise AssertionError(refused[:200]) from None
    rates = {}
    for group in adam.param_groups:
        for parameter in group["params"]:
            rates[id(parameter)] = group["lr"]
    return rates


class _Network(NamedTuple):
    """A network, and all that a prediction with it takes."""

    model: DPMPB
    s: torch.Tensor  # state [D_s]
    u: torch.Tensor  # four commands [4, D_u]
    p: torch.Tensor  # [D_p]
    memory: Memory  # that is not empty


@check(array("the states", 4, 7))
def closed_loop(answer: Callable, rng: np.random.Generator) -> None:
    """The states `[4, 7]` that a network predicts, each from the one before.

    Given are a network of random weights, a state, four commands, a p and a memory.
    """
    case = drawn(lambda: _network(rng), lambda case: apart(*_states(*case), rtol=0.02))
    truth, slips = _states(*case)
    otherwise = "in each step, take u[t] and the memory before it"
    expect(answer(*case), truth, otherwise, slips, rtol=1e-4)


def _states(
    model: DPMPB, s: torch.Tensor, u: torch.Tensor, p: torch.Tensor, memory: Memory
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The predicted states [T, D_s], and what usual slips give, by what is said."""
    truth = predict(model, s, u[None], p, memory)[0]

    # Without the memory, each step begins anew from the state before
    forgetful = []
    state = s
    for command in u:
        state = predict(model, state, command[None, None], p)[0, 0]
        forgetful.append(state)

    return truth, {
        "pass the memory on to the model, in each step": torch.stack(forgetful),
        "s stays what it was: the prediction is the next s": s.expand(len(u), -1),
    }


@check(array("a length for each command", 4))
def influence(answer: Callable, rng: np.random.Generator) -> None:
    """How much each of four commands moves the last image: lengths `[4]`.

    Given is the same as in `closed_loop`; expected is the length of the gradient of the
    last predicted z's square, with respect to each command.
    """
    case = drawn(lambda: _network(rng), lambda case: apart(*_lengths(*case), rtol=0.2))
    truth, slips = _lengths(*case)
    found = answer(*case._replace(u=case.u.clone()))
    otherwise = "wrong: of what is it the gradient, and with respect to what?"
    expect(found, truth, otherwise, slips, rtol=0.05)


def _lengths(
    model: DPMPB, s: torch.Tensor, u: torch.Tensor, p: torch.Tensor, memory: Memory
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The lengths of the gradients [T], and what usual slips give, by what is said."""
    u = u.clone().requires_grad_()
    z = predict(model, s, u[None], p, memory)[0, :, _Z]
    forgetful_z = predict(model, s, u[None], p)[0, :, _Z]

    def lengths(value: torch.Tensor) -> torch.Tensor:
        (gradient,) = torch.autograd.grad(value, u, retain_graph=True)
        return gradient.norm(dim=1)

    truth = lengths(z[-1].square().sum())
    return truth, {
        "the last image alone is asked for, not the sum over all steps": lengths(
            z.square().sum()
        ),
        "that is the gradient of ‖z‖, not of its square": lengths(z[-1].norm()),
        "pass the memory on to `predict`": lengths(forgetful_z[-1].square().sum()),
    }


def _normal(rng: np.random.Generator, *shape: int) -> torch.Tensor:
    return torch.as_tensor(rng.normal(size=shape), dtype=torch.float32)


def _network(rng: np.random.Generator) -> _Network:
    """A network of random weights, and random inputs for it."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**31)))
        model = DPMPB(state_size=7, command_size=2).requires_grad_(False)
    s = _normal(rng, 7)
    u = _normal(rng, 4, 2)
    p = _normal(rng, 2)
    memory = Memory(*_normal(rng, 2, 2, 1, 30))

    # Large inputs make a network without training listen to its commands, and a state
    # away from zero has a square whose gradient does not vanish
    model.u_std.fill_(0.03)
    model.s_mean.fill_(1.0)
    return _Network(model, s, u, p, memory)
