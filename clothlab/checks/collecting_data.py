"""Checks of notebook 03."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, expect, policy
from clothlab.simulation.arm import get_arm

_STATES, _COMMANDS = array("the states", None, 4), array("the commands between them", None, 2)


@check(policy(2))
def wave(answer: Callable) -> None:
    """Two periods of eight steps, then two of twelve of another policy."""
    arm = get_arm("torque")
    for period, one in [(period, answer(arm, period)) for period in (8, 12)]:
        u = np.array([one({}) for _ in range(2 * period)])
        _expect_wave(u, period, arm.command_lower, arm.command_upper)


def _expect_wave(u: np.ndarray, period: int, lower: np.ndarray, upper: np.ndarray) -> None:
    """Two periods of commands `[2 period, 2]` between the limits `[2]`."""
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    message = f"the first command is the middle of the range, {middle}, not {u[0]}"
    if period == 12 and np.isclose(u, middle).all(axis=1).any():
        message += ": each policy counts its own steps"
    expect(u[0], middle, message)
    message = "first of all, the angles of the command grow (which lowers the arm: they are positive downwards)"
    assert (u[1] > u[0]).all(), message + ("; yours become smaller" if (u[1] < u[0]).all() else ", both of them")
    again = f"with period={period}, the wave starts again after {period} calls"
    expect(u[period:], u[:period], again)
    assert not np.allclose(u[: period // 2], u[period // 2 : period]), again + ", yours sooner"
    expect(u.max(axis=0), upper, f"the wave reaches {upper}, not {u.max(axis=0).round(3)}")
    expect(u.min(axis=0), lower, f"the wave reaches {lower}, not {u.min(axis=0).round(3)}")
    phase = 2 * np.pi * np.arange(2 * period)[:, None] / period
    expect(u, middle + half * np.sin(phase), "limits and period are right, but between them it is not a sine")


class _Noting:
    """A policy that notes when it is asked, and whose commands tell what it was asked."""

    def __init__(self, number: int, asked: list[int]):
        self.number, self.asked = number, asked

    def __call__(self, observation: float) -> np.ndarray:
        self.asked.append(self.number)
        return np.array([10.0 * self.number + observation, self.number])
