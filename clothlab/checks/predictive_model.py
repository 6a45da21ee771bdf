"""Checks of notebook 04."""

from collections.abc import Callable, Iterable
from itertools import accumulate

import numpy as np
import torch

from clothlab.checks._check import array, arrays, check, expect
from clothlab.learning.dpmpb import DPMPB, Memory, predict


@check(arrays("the new h and the new c", *[array("30 numbers", 1, 30)] * 2))
def lstm_step(answer: Callable) -> None:
    """One step of PyTorch's layer, from a memory that is not empty."""
    model, *_, memory = _network()
    (h, c), x = (part[0] for part in memory), torch.linspace(-1, 1, 30)[None]
    W, R, b, *_ = model.lstm.parameters()
    i, f, g, o = (x @ W.T + h @ R.T + b).chunk(4, dim=-1)
    i, f, g, o = i.sigmoid(), f.sigmoid(), g.tanh(), o.sigmoid()
    slips = {
        "the gates have changed places: f keeps, i adds": i * c + f * g,
        "the old cell state is missing": i * g,
        "the forget gate is missing: all of the old state stays": c + i * g,
    }
    new_h, new_c = answer(x, h, c, W, R, b)
    expect(new_c, f * c + i * g, "wrong: c keeps a part of the old c, and adds a part of g", slips)
    expect(new_h, o * (f * c + i * g).tanh(), "c is right, h is wrong: leave its line as it was")


@check(lambda _, found: found)
def parameter_groups(answer: Callable) -> None:
    """Handed to Adam, with p to be trained and with p fixed."""
    layer = torch.nn.Linear(2, 1)
    for fixed in (False, True):
        p = torch.zeros(3, 2, requires_grad=not fixed)
        try:
            groups = torch.optim.Adam([_of_tensors(**group) for group in answer(layer, p, 0.01, 0.1)]).param_groups
        except (TypeError, ValueError) as error:
            raise AssertionError(f"Adam takes no such groups: {error}") from None
        rates = {each.shape: group["lr"] for group in groups for each in group["params"]}
        assert all(rates.get(each.shape) == 0.01 for each in layer.parameters()), "W moves at `rate`: leave its group"
        otherwise = "p is fixed: it has no group then" if fixed else "the group of p needs `bias_rate` as its lr"
        expect(rates.get(p.shape, 0), 0 if fixed else 0.1, otherwise, {"p is in no group, and would stay at zero": 0})


def _of_tensors(params: Iterable, **rest: object) -> dict[str, object]:
    """A group whose parameters may be arrays, as they are where an answer ran in another process."""
    several = [params] if isinstance(params, np.ndarray | torch.Tensor) else params
    return {"params": [torch.as_tensor(each) for each in several], **rest}


@check(array("the states", 4, 7))
def closed_loop(answer: Callable) -> None:
    """A network of random weights and four commands."""
    model, s, u, p, memory = _network()
    truth = predict(model, s, u[None], p, memory)[0]
    forgetful = accumulate(u, lambda x, u_t: predict(model, x, u_t[None, None], p)[0, 0], initial=s)
    slips = {
        "pass the memory on to the model, in each step": torch.stack([*forgetful][1:]),
        "s stays what it was: the prediction is the next s": s.expand(4, -1),
    }
    expect(answer(model, s, u, p, memory), truth, "in each step, take u[t] and the memory before it", slips, rtol=1e-4)


@check(array("a length for each command", 4))
def influence(answer: Callable) -> None:
    """A network of random weights and four commands."""
    model, s, u, p, memory = _network()
    result = answer(model, s, u.clone(), p, memory)
    states, forgetful = (predict(model, s, u.requires_grad_()[None], p, each)[0] for each in (memory, None))
    values = {
        "": states[-1, :3].square().sum(),
        "the last image alone is asked for, not the sum over all steps": states[:, :3].square().sum(),
        "that is the gradient of ‖z‖, not of its square": states[-1, :3].norm(),
        "pass the memory on to `predict`": forgetful[-1, :3].square().sum(),
    }
    slips = {said: torch.autograd.grad(value, u, retain_graph=True)[0].norm(dim=1) for said, value in values.items()}
    expect(result, slips.pop(""), "wrong: of what is it the gradient, and with respect to what?", slips, rtol=0.05)


def _network() -> tuple[DPMPB, torch.Tensor, torch.Tensor, torch.Tensor, Memory]:
    """A network of random weights, and a state, four commands, a p and a memory for it."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = DPMPB(state_size=7, command_size=2).requires_grad_(False)
        s, u, p, memory = torch.randn(7), torch.randn(4, 2), torch.randn(2), Memory(*torch.randn(2, 2, 1, 30))
    model.u_std.fill_(0.03)  # large inputs make a network without training listen to its commands
    model.s_mean.fill_(1.0)  # away from zero, where the gradient of a square vanishes
    return model, s, u, p, memory
