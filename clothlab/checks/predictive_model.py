"""Checks of notebook 05."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import array, check, expect, number
from clothlab.learning.dpmpb import DPMPB, Memory, predict


@check(number("how many weights there are"))
def lstm_weights(answer: Callable) -> None:
    """Count what PyTorch has."""
    for inputs, units in ((7, 20), (30, 30), (1, 1)):
        truth = sum(p.numel() for p in torch.nn.LSTM(inputs, units).parameters())
        count, seen, own = answer(inputs, units), units * inputs, units * units
        slips = {
            "that is one gate: an LSTM has more": seen + own + 2 * units,
            "that is a GRU, which has a gate fewer": 3 * (seen + own + 2 * units),
            "PyTorch has more offsets than one for each unit of a gate": 4 * (seen + own + units),
            "offsets are weights, too": 4 * (seen + own),
            "a gate looks at its layer's own last output, too": 4 * (seen + 2 * units),
            "a gate looks at the inputs, too": 4 * (own + 2 * units),
        }
        message = f"with {inputs} inputs and {units} units, PyTorch has {truth} weights, not {count:g}: "
        slips = {message + slip: value for slip, value in slips.items()}
        expect(count, truth, message + "matrices of which sizes, in how many gates?", slips)


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
