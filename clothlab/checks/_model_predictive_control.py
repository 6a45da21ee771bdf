"""Checks of notebook 07."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import CheckFailed, array, check, expect
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings


@check(array("a list of 0 and 1", None))
def my_mask(answer: Callable, rng: np.random.Generator) -> None:
    """The paper's example, then any horizon and period."""
    for t, wanted in ((2, [0, 1, 0, 0]), (3, [1, 0, 0, 0]), (4, [0, 0, 0, 1])):
        found = answer(t, 4, 4)
        assert len(found) == 4, (
            f"one number for each of the 4 predicted steps, not {len(found)}"
        )
        now = np.roll(wanted, 1).tolist()
        message = (
            f"for t = {t} the paper's example has {wanted}, got {_integers(found)}"
        )
        expect(
            found,
            wanted,
            message,
            {message + "; the first number is that of step t + 1, not of step t": now},
        )
    cases = [
        (int(rng.integers(9)), int(rng.integers(4, 9)), 1),
        (int(rng.integers(9)), 3, int(rng.integers(8, 12))),
    ]
    for period in rng.permutation(
        [2, 3, 5, 6, 7]
    ).tolist():  # longer than a period, at any of its steps
        cases.insert(
            0,
            (
                int(rng.integers(40)),
                int(rng.integers(2 * period, 2 * period + 5)),
                period,
            ),
        )
    for t, horizon, period in cases:
        found, case = (
            answer(t, horizon, period),
            f"t = {t}, horizon = {horizon}, period = {period}",
        )
        assert len(found) == horizon, (
            f"{case}: one number for each of the {horizon} predicted steps, not {len(found)}"
        )
        wanted = period_mask(
            t, ControlSettings(horizon=horizon, period=period)
        ).tolist()
        message = f"{case}: 1 is where the step is a multiple of {period}; got {_integers(found)}"
        expect(found, wanted, message)


def _integers(found: np.ndarray) -> list[float]:
    return [int(value) if value == int(value) else value for value in found.tolist()]


@check(array("one sequence of commands for each γ", None, 8, 2))
def steps_along(answer: Callable, rng: np.random.Generator) -> None:
    """Shape, length, direction, range."""
    u, g = rng.uniform(-0.2, 0.2, (8, 2)), rng.normal(size=(8, 2))
    gammas = np.array([0.0, rng.uniform(0.01, 0.02), rng.uniform(0.08, 0.12)])
    # Farther from u than the longest step; an answer that clips to -1 and 1 is seen by
    # the longer one below.
    lower = np.array([-1.5, -0.4]) + rng.uniform(-0.05, 0.05)
    upper = np.array([0.5, 0.6]) + rng.uniform(-0.05, 0.05)

    def step(g: np.ndarray, gammas: np.ndarray) -> np.ndarray:
        return answer(u.copy(), g.copy(), gammas.copy(), lower, upper)

    found, way = step(g, gammas), gammas[:, None, None]
    assert len(found) == 3, (
        f"one sequence of commands for each γ: three, not {len(found)}"
    )
    assert not np.allclose(found, u + way * g / np.linalg.norm(g)), (
        "the step goes uphill"
    )
    moved = np.linalg.norm(found - u, axis=(1, 2))
    as_long_as_g = np.clip(u - way * g, lower, upper)
    assert not np.allclose(found, as_long_as_g), (
        "the length of g must not matter, only its direction"
    )
    message = f"a step must be as long as its γ, {gammas}; yours are {moved.round(3)}"
    assert np.allclose(moved, gammas, atol=1e-6), message
    truth = u - way * g / np.linalg.norm(g)
    expect(
        found,
        truth,
        "the steps have the right lengths, but another direction than straight down along g",
    )
    expect(
        step(5 * g, gammas),
        truth,
        "the length of g must not matter, only its direction",
    )
    far, clipped = (
        step(g, np.array([3.0]))[0],
        np.clip(u - 3 * g / np.linalg.norm(g), lower, upper),
    )
    outside = "a command left its range: use numpy.clip, with the lower and the upper that you are given"
    assert np.all((far >= lower - 1e-6) & (far <= upper + 1e-6)), outside
    expect(
        far,
        clipped,
        "only the commands that leave their range are changed: use numpy.clip",
    )


@check(array("a gradient for each plan", 3, 4, 2))
def plan_gradients(answer: Callable, rng: np.random.Generator) -> None:
    """Plans whose losses differ in size."""
    parts = (
        torch.nn.Flatten(1),
        torch.nn.Linear(8, 4),
        torch.nn.Softplus(),
        torch.nn.Linear(4, 1),
        torch.nn.Flatten(0),
    )
    loss, u = (
        torch.nn.Sequential(*parts).requires_grad_(False),
        torch.as_tensor(rng.normal(size=(3, 4, 2))).float(),
    )
    for part in parts[1::2]:  # random weights, the same with every version of torch
        part.weight.copy_(torch.as_tensor(rng.normal(size=part.weight.shape)))
        part.bias.copy_(torch.as_tensor(rng.normal(size=part.bias.shape)))
    truth = torch.func.vmap(torch.func.grad(lambda plan: loss(plan[None])[0]))(
        u
    ).numpy()
    slips = {
        "these are the gradients over the number of plans: add the losses up, and don't average them": truth
        / 3,
        "only the first plan has a gradient: add up the losses of all": truth
        * np.eye(3)[0][:, None, None],
        "this points downhill: return the gradient itself": -truth,
    }
    expect(answer(loss, u), truth, "a plan's gradient is that of its own loss", slips)


@check(array("the commands that were sent", None, 2))
def receding_horizon(answer: Callable, rng: np.random.Generator) -> None:
    """What each solve saw and started from, and what was sent."""
    seen, starts, plans, sent = [], [], [], []

    def solve(observation: object, plan: np.ndarray) -> np.ndarray:
        seen.append(observation)
        starts.append(np.array(plan))
        plans.append(starts[-1] + 10 * len(seen) + rng.normal(size=starts[-1].shape))
        return plans[-1].copy()

    def step(u: np.ndarray) -> float:
        if np.shape(u) != (2,):
            raise CheckFailed(
                f"a step takes one command, of shape (2,), not {np.shape(u)}"
            )
        sent.append(np.array(u))
        return float(np.sum(u))

    steps, first = int(rng.integers(4, 7)), rng.normal()
    found = answer(solve, step, first, rng.normal(size=(4, 2)), steps)
    each = f"in each of {steps} steps, solve once and send one command"
    assert len(plans) == len(found) == len(sent) == steps, each
    slips = {
        "a command was sent that is not the first of its plan": [
            plan[-1] for plan in plans
        ]
    }
    expect(
        sent,
        [plan[0] for plan in plans],
        "send the first command of each new plan",
        slips,
    )
    expect(found, sent, "return the commands that were sent")
    assert seen[1] != first, (
        "the second solve sees the first observation again: look after each command"
    )
    assert seen[1:] == [float(u.sum()) for u in sent[:-1]], (
        "a solve sees what the command before it led to"
    )
    shift = [np.concatenate([plan[1:], plan[-1:]]) for plan in plans[:-1]]
    expect(
        starts[1:], shift, "each solve starts from the plan before, shifted by one step"
    )


@check(array("the start of the next solve", 4, 2))
def shifted(answer: Callable, rng: np.random.Generator) -> None:
    """Both warm starts, after fewer and after more commands than a period has."""
    period = int(rng.integers(2, 5))
    plan, others = rng.normal(size=(4, 2)), rng.normal(size=(2 * period, 2))
    counts = (
        (1, False),
        (period + 2, False),
        (2 * period + 1, True),
        (period, True),
        (period - 1, True),
    )
    for count, periodic in counts:
        sent = np.concatenate([others[: count - 1], plan[:1]])
        case = f"after {count} commands, with period={period} and periodic={periodic}"
        found = answer(plan.copy(), sent.copy(), period, periodic)
        expect(
            found[:-1],
            plan[1:],
            "all but the last are the plan's commands, moved by one step to the left",
        )
        repeats = periodic and count >= period
        slips = {
            f"{case}: the gap is filled by the command that was sent just now": sent[-1]
        }
        if repeats:
            slips[f"{case}: the gap is filled by the plan's last command"] = plan[-1]
        message = f"{case}: the gap is filled by " + (
            f"sent[{-period}]" if repeats else "the plan's last command"
        )
        expect(found[-1], sent[-period] if repeats else plan[-1], message, slips)
