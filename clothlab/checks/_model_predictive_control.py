"""Checks of notebook 07."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import array, check, expect, number
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings

# The paper's example, of a horizon and a period of 4: t, and what counts
_PAPERS_MASKS = [(2, [0, 1, 0, 0]), (3, [1, 0, 0, 0]), (4, [0, 0, 0, 1])]


@check(array("a list of 0 and 1", None))
def my_mask(answer: Callable, rng: np.random.Generator) -> None:
    """Which of the predicted steps t + 1, t + 2, … end a period: 0 and 1 `[T]`.

    Given are t, the horizon and the period, all in control steps: the paper's example,
    then others, in which horizons are longer and shorter than a period.
    """
    # The paper's example
    for t, wanted in _PAPERS_MASKS:
        found = answer(t, 4, 4)
        assert len(found) == 4, (
            f"one number for each of the 4 predicted steps, not {len(found)}"
        )
        otherwise = (
            f"for t = {t} the paper's example has {wanted}, got {_integers(found)}"
        )
        hint = f"{otherwise}; the first number is that of step t + 1, not of step t"
        from_t_on = np.roll(wanted, 1).tolist()
        expect(found, wanted, otherwise, {hint: from_t_on})

    # Any others
    for t, horizon, period in _mask_cases(rng):
        found = answer(t, horizon, period)
        case = f"t = {t}, horizon = {horizon}, period = {period}"
        assert len(found) == horizon, (
            f"{case}: one number for each of the {horizon} predicted steps, "
            f"not {len(found)}"
        )
        settings = ControlSettings(horizon=horizon, period=period)
        wanted = period_mask(t, settings).tolist()
        otherwise = (
            f"{case}: 1 is where the step is a multiple of {period}; "
            f"got {_integers(found)}"
        )
        expect(found, wanted, otherwise)


def _mask_cases(rng: np.random.Generator) -> list[tuple[int, int, int]]:
    """Cases of t, horizon and period."""
    every_step = (int(rng.integers(9)), int(rng.integers(4, 9)), 1)
    shorter = (int(rng.integers(9)), 3, int(rng.integers(8, 12)))
    longer = []
    for period in rng.permutation([2, 3, 5, 6, 7]).tolist():
        t = int(rng.integers(40))
        horizon = int(rng.integers(2 * period, 2 * period + 5))
        longer.append((t, horizon, period))
    return [*reversed(longer), every_step, shorter]


def _integers(found: np.ndarray) -> list[float]:
    return [int(value) if value == int(value) else value for value in found.tolist()]


@check(array("two rows of 0 and 1", 2, None))
def two_targets(answer: Callable, rng: np.random.Generator) -> None:
    """Masks of two targets in turn, `[2, T]`: which predicted steps show which.

    Given are t, the horizon and the period, in control steps. The first row counts the
    ends of the first, third, fifth, … period, the second those of the others.
    """
    cases = [(0, 8, 8), (8, 8, 8), (3, 20, 4), *_mask_cases(rng)]
    for t, horizon, period in cases:
        found = answer(t, horizon, period)
        case = f"t = {t}, horizon = {horizon}, period = {period}"
        assert found.shape[1] == horizon, (
            f"{case}: one column for each of the {horizon} predicted steps, "
            f"not {found.shape[1]}"
        )

        # Ends of periods, and which of them are odd
        steps = t + 1 + np.arange(horizon)
        ends = steps % period == 0
        odd = steps // period % 2 == 1
        wanted = np.array([ends & odd, ends & ~odd], dtype=float)
        slips = {
            f"{case}: the first period of a run ends at step {period}, and shows A; "
            "yours shows B there": wanted[::-1],
            f"{case}: each end of a period counts for one target, not for both": (
                np.array([ends, ends], dtype=float)
            ),
        }
        otherwise = (
            f"{case}: the ends are the multiples of {period}, and take turns; the "
            "first column is that of step t + 1"
        )
        expect(found, wanted, otherwise, slips)


@check(array("True or False for each command", None))
def has_slope(answer: Callable, rng: np.random.Generator) -> None:
    """Which commands of a plan can change an image that counts: booleans `[T]`.

    Given are t, the horizon and the period, in control steps. The truth is found by
    changing each command of a chain, in which a step keeps what came before.
    """
    cases = [(0, 8, 8), (5, 8, 8), (7, 8, 8), (8, 8, 8), *_mask_cases(rng)]
    for t, horizon, period in cases:
        found = answer(t, horizon, period)
        case = f"t = {t}, horizon = {horizon}, period = {period}"
        assert len(found) == horizon, (
            f"{case}: one for each of the {horizon} commands, not {len(found)}"
        )

        # A chain in which each step keeps what came before
        settings = ControlSettings(horizon=horizon, period=period)
        mask = torch.as_tensor(period_mask(t, settings))
        u = torch.zeros(horizon, requires_grad=True)
        (mask * u.cumsum(0)).sum().backward()
        assert u.grad is not None
        wanted = (u.grad > 0).numpy().astype(float)

        # What goes wrong easily
        slips = {
            f"{case}: a command acts on all later images, too, and not only on the "
            "one right after it": mask.numpy(),
            f"{case}: a command that is sent after an image was taken can't change "
            "it; yours are the other way round": 1 - wanted,
        }
        otherwise = (
            f"{case}: got {_integers(found)}. Which images count, and which commands "
            "are sent before the last of them?"
        )
        expect(found, wanted, otherwise, slips)


@check(array("one change of z", 3))
def together(answer: Callable, rng: np.random.Generator) -> None:
    """What two changes of a plan do beyond the sum of each alone, `[3]`.

    Given are a function z of a plan `[8, 2]`, the plan, and the two changes.
    """
    weights = rng.normal(size=(3, 16))
    bends = rng.uniform(0.5, 1.5, size=3)

    def z(plan: np.ndarray) -> np.ndarray:
        sums = weights @ np.asarray(plan).ravel()
        return sums + bends * sums**2

    u = rng.normal(size=(8, 2))
    a = np.zeros((8, 2))
    b = np.zeros((8, 2))
    a[2] = rng.uniform(0.5, 1.5, 2)
    b[7] = rng.uniform(0.5, 1.5, 2)
    alone = z(u + a) - z(u), z(u + b) - z(u)
    both = z(u + a + b) - z(u)
    truth = both - alone[0] - alone[1]
    slips = {
        "this is all that both do; take away what each does alone": both,
        "this is what the second does after the first; take away what it does "
        "alone": both - alone[0],
        "this is what the first does after the second; take away what it does "
        "alone": both - alone[1],
        "z(u) is taken away once too often or too seldom: each change is one from "
        "z(u)": z(u + a + b) - z(u + a) - z(u + b),
        "the sign is turned round": -truth,
    }
    otherwise = "change a alone, b alone, and both; then compare"
    expect(answer(z, u, a, b), truth, otherwise, slips)


@check(number("the root mean square in units of sigma"))
def farthest(answer: Callable, rng: np.random.Generator) -> None:
    """How far a plan moves in one solve at most, as a root mean square per number.

    Given are the iterations, the length of the longest step, the horizon, and how many
    numbers a command has. The truth is found by walking straight on.
    """
    for _ in range(3):
        # Straight on, one step after the other
        iterations = int(rng.integers(2, 9))
        longest = rng.uniform(0.5, 2.0)
        horizon = int(rng.integers(4, 17))
        commands = int(rng.integers(2, 4))
        way = rng.normal(size=(horizon, commands))
        moved = iterations * longest * way / np.linalg.norm(way)
        truth = np.sqrt((moved**2).mean())
        size = horizon * commands

        # What goes wrong easily
        slips = {
            "a step has the length γ over the whole plan, not in each number": (
                iterations * longest
            ),
            "a plan has horizon times commands numbers": (
                iterations * longest / np.sqrt(horizon)
            ),
            "the length of a step is the root of a sum of squares: its mean is taken "
            "under the root": iterations * longest / size,
            "each iteration makes a step": longest / np.sqrt(size),
        }
        otherwise = (
            f"{iterations} steps of length {longest:.2f}, all in one direction, move "
            f"{size} numbers"
        )
        found = answer(iterations, longest, horizon, commands)
        expect(found, truth, otherwise, slips)


@check(array("a plan, one command a row", None, None))
def moved_on(answer: Callable, rng: np.random.Generator) -> None:
    """The plan with which the next step begins, `[T, D_u]`.

    Given is a plan, a tensor `[T, D_u]`; its first command was sent, and its last one
    is to fill the gap.
    """
    length = int(rng.integers(5, 10))
    plan = torch.as_tensor(rng.normal(size=(length, 2)), dtype=torch.float32)
    found = answer(plan)
    assert len(found) == length, (
        f"a plan of {length} commands moves on to one of {length}, not {len(found)}: "
        "what is sent is gone, and the gap at the end is filled"
    )
    truth = torch.cat([plan[1:], plan[-1:]])
    slips = {
        "the first command is sent; the plan that comes begins with the second": plan,
        "the first command was sent and doesn't come again; the gap is filled with "
        "the last one": torch.roll(plan, -1, 0),
        "a plan moves on to the front: its first command leaves": (
            torch.cat([plan[:1], plan[:-1]])
        ),
    }
    otherwise = "all but the first command stay, in order, and the last comes twice"
    expect(found, truth, otherwise, slips)
