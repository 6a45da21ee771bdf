"""Checks of notebook 04."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import array, arrays, check, expect
from clothlab.learning.dpmpb import DPMPB, Memory, predict


@check(arrays("the new h and the new c", *[array("30 numbers", 1, 30)] * 2))
def lstm_step(answer: Callable) -> None:
    """One step of PyTorch's layer, from a memory that is not empty."""
    model, *_, memory = _network()
    layer, (h, c), x = model.lstm, (part[0] for part in memory), torch.linspace(-1, 1, 30)[None]
    weights = layer.weight_ih_l0, layer.weight_hh_l0, layer.bias_ih_l0 + layer.bias_hh_l0
    i, f, g, o = (x @ weights[0].T + h @ weights[1].T + weights[2]).chunk(4, dim=-1)
    i, f, g, o = i.sigmoid(), f.sigmoid(), g.tanh(), o.sigmoid()
    slips = {
        "the gates have changed places: f keeps, i adds": i * c + f * g,
        "the old cell state is missing": i * g,
        "nothing new is added": f * c,
        "the forget gate is missing: all of the old state stays": c + i * g,
        "the input gate is missing": f * c + g,
        "the output gate does not act on the cell state": f * c + o * g,
    }
    new_h, new_c = answer(x, h, c, *weights)
    expect(new_c, f * c + i * g, "wrong: c keeps a part of the old c, and adds a part of g", slips)
    expect(new_h, o * (f * c + i * g).tanh(), "c is right, h is wrong: leave its line as it was")


@check(lambda _, found: found)
def parameter_groups(answer: Callable) -> None:
    """Handed to Adam, with p to be trained and with p fixed."""
    layer = torch.nn.Linear(2, 1)
    for fixed in (False, True):
        p = torch.zeros(3, 2, requires_grad=not fixed)
        try:
            groups = torch.optim.Adam(answer(layer, p, 0.01, 0.1)).param_groups
        except (TypeError, ValueError, KeyError) as error:
            raise AssertionError(f"Adam takes no such groups: {error}") from None
        rates = {id(each): group["lr"] for group in groups for each in group["params"]}
        assert all(rates.get(id(each)) == 0.01 for each in layer.parameters()), "W moves at `rate`: leave its group"
        if fixed:
            assert id(p) not in rates, "p is fixed: it has no group then"
        else:
            assert id(p) in rates, "p is in no group, and would stay at zero"
            assert rates[id(p)] == 0.1, f"p moves at {rates[id(p)]}: its group needs `bias_rate` as its lr"


@check(array("the states", 4, 7))
def closed_loop(answer: Callable) -> None:
    """A network of random weights and four commands."""
    model, s, u, p, memory = _network()
    truth = predict(model, s, u[None], p, memory)[0]
    empty, stuck, states = s, s, []
    for t in range(4):
        empty, stuck = (predict(model, x, u[None, t : t + 1], p, m)[0, 0] for x, m in ((empty, None), (stuck, memory)))
        states.append((empty, stuck, s))
    forgetful, repeated, still = (torch.stack(column) for column in zip(*states, strict=True))
    slips = {
        "pass the memory on to the model, in each step": forgetful,
        "the memory does not move on: keep the one that the model returns": repeated,
        "s stays what it was: the prediction is the next s": still,
        "the same command in each step: take u[t]": predict(model, s, u[:1].expand(1, 4, -1), p, memory)[0],
    }
    expect(answer(model, s, u, p, memory), truth, "these are not the states of the closed loop", slips, rtol=1e-4)


@check(array("a length for each command", 4))
def influence(answer: Callable) -> None:
    """A network of random weights and four commands."""
    model, s, u, p, memory = _network()

    commands = u.clone().requires_grad_()
    states, forgetful = (predict(model, s, commands[None], p, each)[0] for each in (memory, None))
    z = states[-1, :3]

    def lengths(value: torch.Tensor) -> np.ndarray:
        (gradient,) = torch.autograd.grad(value, commands, retain_graph=True)
        return gradient.norm(dim=1).numpy()

    truth = lengths(z.square().sum())
    slips = {
        "the last image alone is asked for, not the sum over all steps": lengths(states[:, :3].square().sum()),
        "that is the gradient of ‖z‖, not of its square": lengths(z.norm()),
        "that is the gradient of a mean square: ‖z‖² is a sum": lengths(z.square().mean()),
        "that is the whole state: z is its first three numbers": lengths(states[-1].square().sum()),
        "pass the memory on to `predict`": lengths(forgetful[-1, :3].square().sum()),
        "these are the squares of the lengths": truth**2,
    }
    result = answer(model, s, u.clone(), p, memory)
    wrong = [f"{k + 1}" for k in range(4) if not np.isclose(result[k], truth[k], rtol=0.05)]
    otherwise = f"wrong for command {', '.join(wrong)} of 4: of what is it the gradient, and with respect to what?"
    expect(result, truth, otherwise, slips, rtol=0.05)  # finite differences are right, too


def _network() -> tuple[DPMPB, torch.Tensor, torch.Tensor, torch.Tensor, Memory]:
    """A network of random weights, and a state, four commands, a p and a memory for it."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = DPMPB(state_size=7, command_size=2).requires_grad_(False)
        s, u, p, memory = torch.randn(7), torch.randn(4, 2), torch.randn(2), Memory(*torch.randn(2, 2, 1, 30))
    model.u_std.fill_(0.03)  # large inputs make a network without training listen to its commands
    model.s_mean.fill_(1.0)  # away from zero, where the gradient of a square vanishes
    return model, s, u, p, memory
