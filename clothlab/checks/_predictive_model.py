"""Checks of notebook 04."""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch

from clothlab.checks._check import apart, array, check, drawn, expect, number
from clothlab.method.model import DPMPB, Memory, predict


@check(array("position and speed at the end", 2))
def arrival(answer: Callable, rng: np.random.Generator) -> None:
    """Where a swing arrives, `[2]`, with a plan that was made for another damping.

    Given are two matrices `[2, T]`, of the swing that was planned for and of the true
    one, and the goal `[2]`; column t says how far a push of 1 at step t moves position
    and speed at the end. Expected is the plan of least effort.
    """

    def draw() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        planned, true = rng.uniform(0.2, 4, 2)
        steps = int(rng.integers(12, 25))
        goal = np.array([rng.uniform(0.5, 2), 0.0])
        return _responses(planned, steps), _responses(true, steps), goal

    case = drawn(draw, lambda case: apart(_arrived(*case), _arrival_slips(*case), 0.05))
    otherwise = "wrong: first the pushes that reach the goal in the planned-for swing"
    found = answer(*case)
    expect(found, _arrived(*case), otherwise, _arrival_slips(*case), rtol=1e-4)


def _responses(damping: float, steps: int) -> np.ndarray:
    """How each of many pushes of 0.2 s moves a swing's end `[2, T]`."""
    columns = []
    for pushed in range(steps):
        x = 0.0
        v = 0.0
        for step in range(10 * steps):
            push = float(step // 10 == pushed)
            v += 0.02 * (push - x - damping * v)
            x += 0.02 * v
        columns.append((x, v))
    return np.array(columns).T


def _arrived(planned: np.ndarray, true: np.ndarray, goal: np.ndarray) -> np.ndarray:
    return true @ np.linalg.pinv(planned) @ goal


def _arrival_slips(
    planned: np.ndarray, true: np.ndarray, goal: np.ndarray
) -> dict[str, np.ndarray]:
    """What is easily taken for the arrival, by what is said of it."""
    return {
        "the two swings have changed places: plan with the first matrix, arrive with "
        "the second": _arrived(true, planned, goal),
        "that is the goal: the pushes go to the true swing, not to the one that they "
        "were planned for": goal,
        "the transpose is no inverse: use `np.linalg.pinv`": true @ planned.T @ goal,
    }


@check(array("a number of steps for each cell", 4))
def half_life(answer: Callable, rng: np.random.Generator) -> None:
    """Steps until half of each cell is left `[4]`, from gates `[20, 4]` of 20 steps.

    The gates are between 0.1 and 0.99; the numbers need not be whole.
    """

    def draw() -> np.ndarray:
        usual = rng.uniform(0.4, 0.8, 4)
        return np.clip(usual + rng.uniform(-0.35, 0.35, (20, 4)), 0.1, 0.99)

    gates = drawn(draw, lambda gates: apart(*_half_life(gates), rtol=0.02))
    truth, slips = _half_life(gates)
    otherwise = (
        "if φ is the one gate of a cell that stands for all steps, φⁿ is left after n "
        "of them; here yours is not a half"
    )
    expect(answer(gates), truth, otherwise, slips, rtol=1e-3)


def _half_life(gates: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Steps until a half is left, and what usual slips give."""
    phi = np.exp(np.log(gates).mean(axis=0))
    truth = np.log(0.5) / np.log(phi)
    plain = gates.mean(axis=0)
    return truth, {
        "gates multiply from step to step: the mean that stands for all is not their "
        "sum by their number": np.log(0.5) / np.log(plain),
        "it keeps the share φ, and loses 1 - φ": np.log(0.5) / np.log(1 - phi),
        "φ is multiplied at each step, not subtracted": 0.5 / (1 - phi),
        "that is one over it": 1 / truth,
        "the sign is wrong: logarithms of numbers below 1 are negative": -truth,
    }


@check(array("the predicted states", 4, 7))
def without_memory(answer: Callable, rng: np.random.Generator) -> None:
    """Each next state `[4, 7]`, predicted with an empty memory at every step.

    Given are a network of random weights, four states, four commands and a p.
    """

    def draw() -> tuple[DPMPB, torch.Tensor, torch.Tensor, torch.Tensor]:
        model, _, u, p, _ = _network(rng)
        # Large weights make a network without training listen to its memory
        for name, weight in model.named_parameters():
            weight.mul_(4 if "lstm" in name or "fc_out" in name else 1)
        return model, _normal(rng, 4, 7), u, p

    case = drawn(draw, lambda case: apart(*_forgotten(*case), rtol=0.02))
    truth, slips = _forgotten(*case)
    otherwise = "state and command of a step make a sequence of their own, of one step"
    expect(answer(*case), truth, otherwise, slips, rtol=1e-4)


def _forgotten(
    model: DPMPB, s: torch.Tensor, u: torch.Tensor, p: torch.Tensor
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The next states [T, D_s] without a memory, and what usual slips give."""
    alone = [predict(model, s[t], u[None, t : t + 1], p)[0, 0] for t in range(len(s))]
    whole, _ = model(s[None], u[None], p)
    return torch.stack(alone), {
        "the memory is handed on: one sequence of all steps has it, many sequences "
        "of one step have none": whole[0],
        "these are the states that were given, not the next ones": s,
    }


@check(array("two derivatives, ∂L/∂w and ∂L/∂r", 2))
def two_steps_by_hand(answer: Callable, rng: np.random.Generator) -> None:
    """The gradient of two steps of a memory by its two weights, `[2]`.

    Given are w and r, two inputs and the wanted output; h1 = tanh(w x1), h2 = tanh(w x2
    + r h1), L = (h2 - y)².
    """

    def draw() -> np.ndarray:
        signs = rng.choice([-1, 1], 5)
        return signs * rng.uniform(0.4, 1.2, 5)

    case = drawn(draw, lambda case: apart(*_two_steps(*case), rtol=0.02))
    truth, slips = _two_steps(*case)
    found = answer(*map(float, case))
    otherwise = "wrong: go from L back to h2, from there to w, to r and to h1"
    if np.isclose(found[1], truth[1]):
        otherwise = "∂L/∂r is right, ∂L/∂w is wrong"
    expect(found, truth, otherwise, slips, rtol=1e-4)


def _two_steps(
    w: float, r: float, x1: float, x2: float, y: float
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The gradient [2], and what usual slips give, by what is said of each."""
    # Forth
    h1 = np.tanh(w * x1)
    h2 = np.tanh(w * x2 + r * h1)

    # And back, by both ways on which w acts
    into_h2 = 2 * (h2 - y) * (1 - h2**2)
    by_now = into_h2 * x2
    by_memory = into_h2 * r * (1 - h1**2) * x1
    by_r = into_h2 * h1
    truth = np.array([by_now + by_memory, by_r])
    # As if tanh were a straight line
    flat = 2 * (h2 - y)
    return truth, {
        "w also acts in the first step, by way of h1": np.array([by_now, by_r]),
        "w also acts in the second step, where x2 comes in": np.array(
            [by_memory, by_r]
        ),
        "the square has a derivative with a factor of 2": truth / 2,
        "the slope of tanh is missing: 1 - h²": np.array(
            [flat * (x2 + r * x1), flat * h1]
        ),
    }


class _Batch(NamedTuple):
    """Three stretches of four steps, of two among three cloths."""

    s: torch.Tensor  # states [3, 5, 7]
    u: torch.Tensor  # commands [3, 4, 2]
    k: torch.Tensor  # which cloth [3]


# The loss at each of three updates, and what usual slips give
_Expected = list[tuple[float, dict[str, float]]]


@check(number("the loss of the batch, before the step"), moves=("p",))
def update(answer: Callable, rng: np.random.Generator) -> None:
    """One update of W and of three p by a batch of stretches; its loss, a number.

    Given are a network of random weights, p, the batch's states, commands and numbers
    of the cloths, and an optimizer that moves all weights and all p. Three updates by
    one batch show by their losses how each has moved.
    """

    def draw() -> tuple[DPMPB, torch.Tensor, _Batch, _Expected]:
        model, *_ = _network(rng)
        # Large weights make a network without training listen to p; and other spreads
        # than 1, as the sensors have them
        for name, weight in model.named_parameters():
            weight.mul_(4 if "lstm" in name or "fc_out" in name else 1)
            if name == "fc_in.0.weight":
                weight[:, -2:] *= 4
        model.s_std.copy_(torch.as_tensor(rng.uniform(0.3, 0.7, 7)))
        k = torch.as_tensor(rng.permutation([2, 0, 0]))
        s = 1 + _normal(rng, 3, 5, 7)
        batch = _Batch(s, 0.03 * _normal(rng, 3, 4, 2), k)
        model.requires_grad_()
        p = _normal(rng, 3, 2)
        return model, p, batch, _losses(model, p, batch)

    def holds(case: tuple[DPMPB, torch.Tensor, _Batch, _Expected]) -> bool:
        return all(apart(truth, slips, 0.005) for truth, slips in case[-1])

    model, p, batch, losses = drawn(draw, holds)

    # The reader's updates, by plain gradient steps
    p.requires_grad_()
    optimizer = _descent(model, p)
    for n, (truth, slips) in enumerate(losses):
        otherwise = "the loss is not L: look at its equation, and at k"
        if n:
            otherwise = f"L is right, and after step {n} it is not what it would be"
        found = answer(model, p, *batch, optimizer)
        expect(found, truth, otherwise, slips, rtol=1e-3)


def _descent(model: DPMPB, p: torch.Tensor | None) -> torch.optim.SGD:
    """Plain gradient steps, with a rate for W and another for p."""
    groups = [{"params": list(model.parameters()), "lr": 0.02}]
    if p is not None:
        groups.append({"params": [p], "lr": 1.0})
    return torch.optim.SGD(groups)


def _losses(model: DPMPB, p: torch.Tensor, batch: _Batch) -> _Expected:
    """The loss at each of three updates, and what usual slips give."""
    truth = _updates(model, p, batch)
    up = _updates(model, p, batch, sign=-1)
    still = "nothing has moved: first the gradients of L, then a step"
    second = {
        still: truth[0],
        "L rises: the step leads up, not down": up[1],
        "W has moved and p has not: L must know p": _updates(
            model, p, batch, p_moves=False
        )[1],
    }
    kept = _updates(model, p, batch, cleared=False)
    third = {"gradients add up until they are set to zero": kept[2]}
    slips = _batch_slips(model, p, batch), second, third
    return list(zip(truth, slips, strict=True))


def _batch_slips(model: DPMPB, p: torch.Tensor, batch: _Batch) -> dict[str, float]:
    """What usual slips give in place of the loss of a batch."""
    s, u, k = batch
    with torch.no_grad():
        predicted, _ = model(s[:, :-1], u, p[k])
        in_order, _ = model(s[:, :-1], u, p)
        error = predicted - s[:, 1:]
        squares = (error / model.s_std).square()
        of_others = ((in_order - s[:, 1:]) / model.s_std).square()
        given = ((predicted - s[:, :-1]) / model.s_std).square()
    return {
        "each stretch takes the p of its own cloth: k says which": of_others.mean(),
        "the error of each sensor is divided by its standard deviation, "
        "`network.s_std`": error.square().mean(),
        "the prediction is compared with the state that was put in: it is the next "
        "one": given.mean(),
        "L is a mean over stretches, steps and sensors, not a sum": squares.sum(),
    }


def _updates(
    model: DPMPB,
    start: torch.Tensor,
    batch: _Batch,
    *,
    sign: int = 1,
    p_moves: bool = True,
    cleared: bool = True,
) -> list[float]:
    """The loss at each of three updates by one batch."""
    own = copy.deepcopy(model)
    p = start.clone().requires_grad_()
    optimizer = _descent(own, p if p_moves else None)

    # The loss, its gradients, a step
    losses = []
    for _ in range(3):
        if cleared:
            optimizer.zero_grad()
        predicted, _ = own(batch.s[:, :-1], batch.u, p[batch.k])
        error = (predicted - batch.s[:, 1:]) / own.s_std
        loss = error.square().mean()
        (sign * loss).backward()
        optimizer.step()
        losses.append(loss.item())
    return losses


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
