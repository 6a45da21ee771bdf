"""Checks of notebook 05."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import array, check, expect
from clothlab.learning.dpmpb import DPMPB, Memory, predict


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
