"""Checks of notebook 04."""

from collections.abc import Callable
from itertools import accumulate

import numpy as np
import torch

from clothlab.checks._check import apart, array, arrays, check, drawn, expect
from clothlab.method.model import DPMPB, Memory, predict


@check(arrays("the new h and the new c", *[array("30 numbers", 1, 30)] * 2))
def lstm_step(answer: Callable, rng: np.random.Generator) -> None:
    """One step of PyTorch's layer, from a memory that is not empty."""
    model, *_, memory = _network(rng)
    h, c = (part[0] for part in memory)
    x = _normal(rng, 1, 30)
    W, R, b, *_ = model.lstm.parameters()
    i, f, g, o = (x @ W.T + h @ R.T + b).chunk(4, dim=-1)
    i, f, g, o = i.sigmoid(), f.sigmoid(), g.tanh(), o.sigmoid()
    slips = {
        "the gates have changed places: f keeps, i adds": i * c + f * g,
        "the old cell state is missing": i * g,
        "the forget gate is missing: all of the old state stays": c + i * g,
    }
    new_h, new_c = answer(x, h, c, W, R, b)
    expect(
        new_c,
        f * c + i * g,
        "wrong: c keeps a part of the old c, and adds a part of g",
        slips,
    )
    expect(
        new_h,
        o * (f * c + i * g).tanh(),
        "c is right, h is wrong: leave its line as it was",
    )


@check(lambda _, found: found)
def parameter_groups(answer: Callable, rng: np.random.Generator) -> None:
    """Handed to Adam, with p to be trained and with p fixed."""
    layer = torch.nn.Linear(2, 1)
    for fixed in (False, True):
        p = torch.zeros(3, 2, requires_grad=not fixed)
        rate, bias_rate = rng.uniform(0.01, 0.02), rng.uniform(0.1, 0.2)
        try:
            groups = torch.optim.Adam(answer(layer, p, rate, bias_rate)).param_groups
        except Exception as error:  # whatever was returned
            words = str(error).strip().splitlines()[:1]
            raise AssertionError(
                ": ".join(["Adam takes no such groups", *words])[:200]
            ) from None
        rates = {id(each): group["lr"] for group in groups for each in group["params"]}
        assert all(rates.get(id(each)) == rate for each in layer.parameters()), (
            "W moves at `rate`: leave its group"
        )
        otherwise = (
            "p is fixed: it has no group then"
            if fixed
            else "the group of p needs `bias_rate` as its lr"
        )
        truth, slips = (
            0 if fixed else bias_rate,
            {"p is in no group, and would stay at zero": 0},
        )
        expect(rates.get(id(p), 0), truth, otherwise, slips)


@check(array("the states", 4, 7))
def closed_loop(answer: Callable, rng: np.random.Generator) -> None:
    """A network of random weights and four commands."""
    model, s, u, p, memory = drawn(
        lambda: _network(rng), lambda case: apart(*_states(*case), rtol=0.02)
    )
    truth, slips = _states(model, s, u, p, memory)
    expect(
        answer(model, s, u, p, memory),
        truth,
        "in each step, take u[t] and the memory before it",
        slips,
        rtol=1e-4,
    )


@check(array("a length for each command", 4))
def influence(answer: Callable, rng: np.random.Generator) -> None:
    """A network of random weights and four commands."""
    model, s, u, p, memory = drawn(
        lambda: _network(rng), lambda case: apart(*_lengths(*case), rtol=0.2)
    )
    truth, slips = _lengths(model, s, u, p, memory)
    result = answer(model, s, u.clone(), p, memory)
    expect(
        result,
        truth,
        "wrong: of what is it the gradient, and with respect to what?",
        slips,
        rtol=0.05,
    )


def _states(
    model: DPMPB, s: torch.Tensor, u: torch.Tensor, p: torch.Tensor, memory: Memory
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The predicted states [T, D_s], and what usual slips give: what the reader is
    told, and the value.
    """
    forgetful = accumulate(
        u, lambda x, u_t: predict(model, x, u_t[None, None], p)[0, 0], initial=s
    )
    return predict(model, s, u[None], p, memory)[0], {
        "pass the memory on to the model, in each step": torch.stack([*forgetful][1:]),
        "s stays what it was: the prediction is the next s": s.expand(4, -1),
    }


def _lengths(
    model: DPMPB, s: torch.Tensor, u: torch.Tensor, p: torch.Tensor, memory: Memory
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The lengths of the gradients [T], and what usual slips give."""
    u = u.clone().requires_grad_()
    states, forgetful = (
        predict(model, s, u[None], p, each)[0] for each in (memory, None)
    )
    values = {
        "": states[-1, :3].square().sum(),
        "the last image alone is asked for, not the sum over all steps": states[:, :3]
        .square()
        .sum(),
        "that is the gradient of ‖z‖, not of its square": states[-1, :3].norm(),
        "pass the memory on to `predict`": forgetful[-1, :3].square().sum(),
    }
    slips = {
        said: torch.autograd.grad(value, u, retain_graph=True)[0].norm(dim=1)
        for said, value in values.items()
    }
    return slips.pop(""), slips


def _normal(rng: np.random.Generator, *shape: int) -> torch.Tensor:
    return torch.as_tensor(rng.normal(size=shape), dtype=torch.float32)


def _network(
    rng: np.random.Generator,
) -> tuple[DPMPB, torch.Tensor, torch.Tensor, torch.Tensor, Memory]:
    """A network of random weights, and a state, four commands, a p and a memory for it."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**31)))
        model = DPMPB(state_size=7, command_size=2).requires_grad_(False)
    s, u, p, memory = (
        _normal(rng, 7),
        _normal(rng, 4, 2),
        _normal(rng, 2),
        Memory(*_normal(rng, 2, 2, 1, 30)),
    )
    # Large inputs make a network without training listen to its commands
    model.u_std.fill_(0.03)
    model.s_mean.fill_(1.0)  # away from zero, where the gradient of a square vanishes
    return model, s, u, p, memory
