"""Checks of notebook 04: what is drawn, what is right, and what usual slips give."""

import copy
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from clothlab.checks.ask import Question, exercise
from clothlab.method.model import DPMPB, Memory, one_thread, predict

_UPDATES = 3  # by one batch
_Loss = Callable[[DPMPB, Tensor, Tensor, Tensor, Tensor], Tensor]


@exercise(
    "the loss of the batch, before the step", rtol=1e-4, moves=(0, 1), times=_UPDATES
)
def update(rng: np.random.Generator) -> Question:
    """The loss at each of three updates `[3]` of W and p by one batch.

    Given are a network of random weights, p of three cloths, states `[3, 5, 7]`,
    commands `[3, 4, 2]`, the numbers of the cloths `[3]`, and an optimizer that moves
    all weights and all p by plain gradient steps.
    """
    model = _network(rng)
    # Large weights make a network without training listen to p; and other spreads than
    # 1, as the sensors have them
    for name, weight in model.named_parameters():
        weight.mul_(4 if "lstm" in name or "fc_out" in name else 1)
        if name == "fc_in.0.weight":
            weight[:, -2:] *= 8
    model.s_std.copy_(torch.as_tensor(rng.uniform(0.3, 0.7, 7)))
    model.requires_grad_()
    p = _normal(rng, 3, 2).requires_grad_()
    s = 1 + _normal(rng, 3, 5, 7)
    u = 0.03 * _normal(rng, 3, 4, 2)
    k = torch.as_tensor(rng.permutation([2, 0, 0]))

    def losses(loss: _Loss = _loss, **how: float) -> np.ndarray:
        return _losses(model, p, (s, u, k), loss, **how)

    truth = losses()
    slips = {
        "nothing has moved: first the gradients of L, then a step": losses(rate=0),
        "L rises: the step leads up, not down": losses(rate=-1),
        "W has moved and p has not: L must know p": losses(rate_of_p=0),
        "gradients add up until they are set to zero": losses(kept=1),
        "each stretch takes the p of its own cloth: k says which": losses(_in_order),
        "the error of each sensor is divided by its standard deviation, "
        "`network.s_std`": losses(_undivided),
        "the prediction is compared with the state that was put in: it is the next "
        "one": losses(_with_given),
        "L is a mean over stretches, steps and sensors, not a sum": losses(_summed),
    }

    def otherwise(found: np.ndarray) -> str:
        if not np.isclose(found[0], truth[0], rtol=1e-4):
            return "the loss is not L: look at its equation, and at k"
        return "L is right, and after a step it is not what it would be"

    optimizer = _descent(model, p)
    return Question((model, p, s, u, k, optimizer), truth, slips, otherwise)


def _errors(model: DPMPB, p: Tensor, s: Tensor, u: Tensor) -> Tensor:
    """Of every next state, in physical units."""
    predicted, _ = model(s[:, :-1], u, p)
    return predicted - s[:, 1:]


def _loss(model: DPMPB, p: Tensor, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
    return (_errors(model, p[k], s, u) / model.s_std).square().mean()


def _in_order(model: DPMPB, p: Tensor, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
    return (_errors(model, p, s, u) / model.s_std).square().mean()


def _undivided(model: DPMPB, p: Tensor, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
    return _errors(model, p[k], s, u).square().mean()


def _with_given(model: DPMPB, p: Tensor, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
    predicted, _ = model(s[:, :-1], u, p[k])
    return ((predicted - s[:, :-1]) / model.s_std).square().mean()


def _summed(model: DPMPB, p: Tensor, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
    return (_errors(model, p[k], s, u) / model.s_std).square().sum()


def _descent(
    model: DPMPB, p: Tensor, rate: float = 1.0, rate_of_p: float = 1.0
) -> torch.optim.SGD:
    """Plain gradient steps, with a rate for W and another for p."""
    weights = {"params": list(model.parameters()), "lr": 0.02 * rate}
    biases = {"params": [p], "lr": rate * rate_of_p}
    return torch.optim.SGD([weights, biases])


def _losses(
    model: DPMPB,
    p: Tensor,
    batch: tuple[Tensor, Tensor, Tensor],
    loss_of: _Loss,
    *,
    rate: float = 1.0,
    rate_of_p: float = 1.0,
    kept: float = 0.0,
) -> np.ndarray:
    """The loss at each of three updates by one batch."""
    model, p = copy.deepcopy((model, p))
    optimizer = _descent(model, p, abs(rate), rate_of_p)
    losses = []
    with one_thread():
        for _ in range(_UPDATES):
            if not kept:
                optimizer.zero_grad()
            loss = loss_of(model, p, *batch)
            (-loss if rate < 0 else loss).backward()
            optimizer.step()
            losses.append(loss.item())
    return np.array(losses)


@exercise("the states", 1, 4, 7, rtol=1e-4)
def closed_loop(rng: np.random.Generator) -> Question:
    """The states `[1, 4, 7]` that a network predicts, each from the one before.

    Given are a network of random weights, a state `[7]`, commands `[1, 4, 2]`, a p
    `[2]` and a memory that is not empty.
    """
    model = _network(rng)
    s = _normal(rng, 7)
    u = _normal(rng, 1, 4, 2)
    p = _normal(rng, 2)
    memory = Memory(*_normal(rng, 2, 2, 1, 30))

    # Without the memory, each step begins anew from the state before
    forgetful = []
    state = s
    for command in u[0]:
        state = predict(model, state, command[None, None], p)[0, 0]
        forgetful.append(state)

    slips = {
        "pass the memory on to the model, in each step": torch.stack(forgetful)[None],
        "the first step has a memory, too: the one that is given": predict(
            model, s, u, p
        ),
        "s stays what it was: the prediction is the next s": s.expand(1, 4, -1),
    }
    truth = predict(model, s, u, p, memory)
    otherwise = "in each step, take u[t] and the memory before it"
    return Question((model, s, u, p, memory), truth, slips, otherwise)


def _normal(rng: np.random.Generator, *shape: int) -> Tensor:
    return torch.as_tensor(rng.normal(size=shape), dtype=torch.float32)


def _network(rng: np.random.Generator) -> DPMPB:
    """A network of random weights that cannot be moved."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**31)))
        model = DPMPB(state_size=7, command_size=2).requires_grad_(False)

    # Large inputs make a network without training listen to its commands, and a state
    # away from zero has a square whose gradient does not vanish
    model.u_std.fill_(0.03)
    model.s_mean.fill_(1.0)
    return model
