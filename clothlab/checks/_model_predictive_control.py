"""Checks of notebook 07."""

import numpy as np
import torch

from clothlab.checks.ask import Question, exercise
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings

_HORIZON = 12  # of the masks that are asked for


@exercise("a list of 0 and 1, one for each predicted step", _HORIZON)
def my_mask(rng: np.random.Generator) -> Question:
    """Which of the predicted steps t + 1, t + 2, … end a period: 0 and 1 `[T]`.

    Given are t and the settings, of which horizon and period count [control step].
    """
    t = int(rng.integers(40))
    period = int(rng.choice([3, 4, 5, 6, 7, 9]))
    settings = ControlSettings(horizon=_HORIZON, period=period)
    steps = t + 1 + np.arange(_HORIZON)
    slips = {
        "the first number is that of step t + 1, not of step t": steps % period == 1,
        "the first number is that of step t + 1, not of step t + 2": (
            (steps + 1) % period == 0
        ),
        "periods are counted from the beginning of the run, not from step t": (
            (steps - t) % period == 0
        ),
        "1 is where the image counts, at the end of a period; 0 everywhere else": (
            steps % period != 0
        ),
    }
    slips = {said: value.astype(float) for said, value in slips.items()}
    otherwise = (
        f"t = {t}, horizon {_HORIZON}, period {period}: 1 is where the step is a "
        f"multiple of {period}, and the first of them is step {t + 1}"
    )
    return Question((t, settings), period_mask(t, settings), slips, otherwise)


@exercise("plans, one for each of the step lengths", 4, 8, 2)
def step_down(rng: np.random.Generator) -> Question:
    """Plans `[K, T, D_u]` [rad], each a step of another length downhill (eq. 7).

    Given are a plan `[T, D_u]`, its slope `[T, D_u]` in units of sigma `[D_u]`, and the
    lengths `[K]`.
    """
    u, slope = rng.normal(size=(2, 8, 2))
    slope = slope * rng.uniform(2.0, 5.0)
    sigma = rng.uniform(0.3, 0.8, 2)
    gammas = rng.uniform(0.1, 1.0, 4)
    long = gammas[:, None, None]
    direction = slope / np.linalg.norm(slope)
    slips = {
        "this goes uphill": u + long * sigma * direction,
        "only the direction counts: divide the slope by its length": (
            u - long * sigma * slope
        ),
        "one length for the whole slope, not one for each command": (
            u - long * sigma * slope / np.linalg.norm(slope, axis=1, keepdims=True)
        ),
        "the step is γ long in units of sigma, and the plan is in rad": (
            u - long * direction
        ),
        "a step of 1 in units of sigma is sigma rad: multiply by it": (
            u - long * direction / sigma
        ),
    }
    given = tuple(
        torch.as_tensor(each, dtype=torch.float32) for each in (u, slope, sigma, gammas)
    )
    otherwise = "from u, go γ times sigma times the slope's direction, downhill"
    return Question(given, u - long * sigma * direction, slips, otherwise)


@exercise("a plan, one command a row and as many as before", 8, 2)
def moved_on(rng: np.random.Generator) -> Question:
    """The plan with which the next step begins, `[T, D_u]`.

    Given is a plan, a tensor `[T, D_u]`; its first command was sent, and its last one
    is to fill the gap.
    """
    plan = torch.as_tensor(rng.normal(size=(8, 2)), dtype=torch.float32)
    slips = {
        "the first command is sent; the plan that comes begins with the second": plan,
        "the first command was sent and doesn't come again; the gap is filled with "
        "the last one": torch.roll(plan, -1, 0),
        "a plan moves on to the front: its first command leaves": (
            torch.cat([plan[:1], plan[:-1]])
        ),
        "the gap is filled with the last command once more": (
            torch.cat([plan[1:], torch.zeros(1, 2)])
        ),
    }
    otherwise = "all but the first command stay, in order, and the last comes twice"
    return Question((plan,), torch.cat([plan[1:], plan[-1:]]), slips, otherwise)
