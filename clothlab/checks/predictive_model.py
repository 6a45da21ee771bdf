"""Checks of notebook 05."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import array, check, number
from clothlab.dpmpb import DPMPB, Memory, predict

__all__ = ["extrapolate", "influence", "lstm_weights"]


@check(number("how many weights there are"))
def lstm_weights(answer: Callable) -> None:
    """Count what PyTorch has."""
    for inputs, units in ((30, 30), (1, 1), (7, 20)):
        truth = sum(p.numel() for p in torch.nn.LSTM(inputs, units).parameters())
        count = answer(inputs, units)
        assert count == truth, f"{inputs} inputs and {units} units: PyTorch has {truth} weights, you say {count}"


@check(array("a prediction for each step but the first two", None, 2))
def extrapolate(answer: Callable) -> None:
    """A motion at constant velocity."""
    line = np.outer(np.arange(6.0), [1.0, -2.0])
    result = answer(line)
    assert len(result) == 4, f"six states leave four predictions, got {len(result)}"
    assert np.allclose(result, line[2:]), "a motion at constant velocity must be predicted exactly"


@check(array("a length for each command", 3))
def influence(answer: Callable) -> None:
    """Compare the last command's gradient with central differences, in a network of random weights."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = DPMPB(state_size=7, command_size=2).requires_grad_(False)
        s, u, p, memory = torch.randn(7), torch.randn(3, 2), torch.randn(2), Memory(*torch.randn(2, 2, 1, 30))
    model.u_std.fill_(0.1)  # large inputs make a network without training listen to its commands
    model.s_mean.fill_(1.0)  # away from zero, where the gradient of a square vanishes
    result = answer(model, s, u, p, memory)
    squares, step = [], 1e-2
    for joint in range(2):
        ends = [u.index_put((torch.tensor(2), torch.tensor(joint)), u[2, joint] + sign * step) for sign in (1, -1)]
        with torch.no_grad():
            high, low = (predict(model, s, end[None], p, memory)[0, -1, :3].square().sum() for end in ends)
        squares.append(((high - low) / (2 * step)) ** 2)
    expected = sum(squares).sqrt()
    message = f"the last command: {result[-1]:.3f}, should be {expected:.3f}"
    assert np.isclose(result[-1], expected, rtol=0.05), message
