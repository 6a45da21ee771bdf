"""Checks of notebook 03."""

from collections.abc import Callable

import numpy as np

from clothlab.arm import get_arm
from clothlab.checks._check import array, arrays, check, policy
from clothlab.cloth import get_cloth
from clothlab.trials import Trial
from clothlab.vision import HEIGHT, WIDTH

__all__ = ["take_turns", "transitions", "wave"]


_STATES, _COMMANDS = array("states", None, 4), array("the commands", None, 2)


@check(arrays("three arrays: before, commands, after", _STATES, _COMMANDS, _STATES))
def transitions(answer: Callable) -> None:
    """A made-up trial of six steps, no two of whose numbers are equal."""
    images, robot = np.zeros((6, HEIGHT, WIDTH), bool), np.arange(24.0).reshape(6, 4)
    trial = Trial(images, robot, 100 + np.arange(12.0).reshape(6, 2), get_cloth("soft-1"), "torque", "made up", seed=0)
    found = answer(trial)
    lengths = [len(array) for array in found]
    expected = len(trial) - 1
    assert lengths == [expected] * 3, f"{expected} steps have an after, your arrays have {lengths} rows"
    before, commands, after = found
    assert np.array_equal(before, trial.robot[:-1]), "the last state has no after, so it is not a before"
    assert np.array_equal(after, trial.robot[1:]), "after is one step later than before"
    assert np.array_equal(commands, trial.commands[:-1]), "commands[t] acts between states t and t + 1"


@check(policy(2))
def wave(answer: Callable) -> None:
    """Two periods of eight steps."""
    arm = get_arm("torque")
    policy = answer(arm, 8)
    u = np.array([policy({}) for _ in range(16)])
    middle = (arm.command_lower + arm.command_upper) / 2
    assert np.allclose(u[0], middle), f"the first command is the middle of the range, {middle}, not {u[0]}"
    assert (u[1] > u[0]).all(), "the wave rises first"
    assert np.allclose(u[:8], u[8:]), "after `period` calls the wave starts again"
    assert np.allclose(u.max(axis=0), arm.command_upper), f"the wave reaches {arm.command_upper}, not {u.max(axis=0)}"
    assert np.allclose(u.min(axis=0), arm.command_lower), f"the wave reaches {arm.command_lower}, not {u.min(axis=0)}"


@check(policy(2))
def take_turns(answer: Callable) -> None:
    """Two policies that note when they are asked, and whose commands tell what they were asked."""
    asked = []
    policies = [lambda observation, k=k: asked.append(k) or np.full(2, 10.0 * k + observation) for k in (0, 1)]
    policy = answer(*policies, every=3)
    commands = [policy(float(t)) for t in range(8)]
    turns = [0, 0, 0, 1, 1, 1, 0, 0]
    assert asked == turns, f"with every=3, eight steps ask {turns}, yours asked {asked}"
    expected = [10.0 * k + t for t, k in enumerate(turns)]
    assert np.allclose([u[0] for u in commands], expected), "pass the observation on and return the policy's command"
