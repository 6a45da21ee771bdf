"""Checks of notebook 09."""

from collections.abc import Callable

import numpy as np

from clothlab.arm import get_arm
from clothlab.checks._check import array, check, number, policy

__all__ = ["averaged", "half_time", "shaken"]


@check(number("a time in seconds, or None", none=True))
def half_time(answer: Callable) -> None:
    """A straight way from a distance of 4 to 0 in steps of 1."""
    way = np.array([[4.0, 0], [3, 0], [2, 0], [1, 0], [0, 0]])
    found = answer(way, np.zeros(2))
    assert found is not None, "half_time returned None on a path that reaches its goal"
    assert not np.isclose(found, 3), "3 is the number of steps: a step is 0.2 s"
    assert not np.isclose(found, 0.4), "after two steps the distance is exactly half, not below"
    assert np.isclose(found, 0.6), f"the path is below half after 3 steps, 0.6 s; got {found}"
    assert answer(way[:3], np.zeros(2)) is None, "a path that never gets below half must give None"


@check(array("the mean over time", 2))
def averaged(answer: Callable) -> None:
    """A ramp, whose averages are known."""
    ramp = np.arange(10.0)[:, None] * [1, -2]
    found = answer(ramp, 4)
    assert np.allclose(found, [7.5, -15]), f"the last four of 0 … 9 have the mean 7.5, got {found[0]}"
    assert np.allclose(answer(ramp, 50), ramp.mean(axis=0)), "with fewer than n estimates, take them all"


@check(policy(2))
def shaken(answer: Callable) -> None:
    """Spread, mean and range of the noise on constant commands."""
    arm, quiet = get_arm("torque"), np.array([0.1, -0.8])
    policy = answer(lambda observation: quiet, arm, 0.1, np.random.default_rng(1))
    sent = np.array([policy(None) for _ in range(2000)])
    assert sent.std(axis=0).min() > 1e-9, "the commands are not disturbed at all, or always in the same way"
    assert np.allclose(sent.std(axis=0), 0.1, rtol=0.1), f"the noise has {sent.std(axis=0).round(3)} rad, not 0.1 rad"
    assert np.allclose(sent.mean(axis=0), quiet, atol=0.02), "the noise must have the mean 0"
    edge = answer(lambda observation: arm.command_upper, arm, 1.0, np.random.default_rng(1))
    assert all((edge(None) <= arm.command_upper).all() for _ in range(50)), "a command left its range: use numpy.clip"
