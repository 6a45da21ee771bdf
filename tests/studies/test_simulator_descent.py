"""Descent by measured slopes: right where the slope is known, and it ends in time."""

import numpy as np
import pytest
import torch

from clothlab.method.control import Limits
from studies import simulator_descent
from studies.simulator_descent import descend, measured_slope

SCALE = torch.tensor([0.5, 2.0])
LIMITS = Limits(torch.tensor([-3.0, -3.0]), torch.tensor([3.0, 3.0]), SCALE)
GOAL = torch.tensor([[1.0, -1.0], [0.5, 2.0], [-2.0, 0.0]])


def bowl(plans):
    return (plans - GOAL).square().sum((1, 2))


@pytest.mark.parametrize("nudge", [0.05, 0.5])
def test_the_slope_of_a_bowl_is_exact_with_any_nudge(nudge):
    plan = torch.arange(6.0).reshape(3, 2) / 6
    expected = 2 * (plan - GOAL) * SCALE  # by the chain rule, in units of the scale
    found = measured_slope(bowl, plan, nudge, SCALE)
    assert torch.allclose(found, expected, atol=1e-4)


def test_a_descent_arrives_never_rises_and_stays_within_the_limits():
    plan, losses = descend(bowl, torch.zeros(3, 2), LIMITS, 100)
    assert len(losses) == 101
    assert np.all(np.diff(losses) <= 0)
    assert losses[-1] < 1e-3 < losses[0]
    assert torch.allclose(plan, GOAL, atol=0.05)
    narrow = LIMITS._replace(upper=torch.tensor([0.25, 3.0]))
    plan, _ = descend(bowl, torch.zeros(3, 2), narrow, 100)
    assert plan[:, 0].max() == 0.25


def test_where_no_nudge_changes_the_loss_the_descent_ends_and_asks_no_more():
    asked = []

    def flat(plans):
        asked.append(len(plans))
        return torch.ones(len(plans))

    plan, losses = descend(flat, torch.zeros(3, 2), LIMITS, 50)
    assert torch.equal(plan, torch.zeros(3, 2))
    assert np.array_equal(losses, np.ones(51))
    sizes = len(simulator_descent.NUDGES)
    assert len(asked) == 1 + 3 * sizes  # up, down, and steps; each size once


def test_a_larger_nudge_sees_what_a_small_one_can_not():
    def pixels(plans):  # a loss that changes in steps, as images do
        return bowl(plans).floor()

    start = torch.zeros(3, 2)
    assert not measured_slope(pixels, start, 0.01, SCALE).any()
    _, losses = descend(pixels, start, LIMITS, 100)
    assert losses[-1] < losses[0] / 2


@pytest.mark.slow
def test_both_descents_begin_with_the_same_plan_and_end_lower():
    row = simulator_descent._run_both(
        "random", "target-1", "damp0.07-mass0.15", draws=1, iterations=2
    )
    assert row["after"] == [0, 1, 2]
    for world in ("simulator", "model"):
        assert row[world].shape == (1, 3)
        assert row[world][0, 2] < row[world][0, 0]
    assert row["model_thrown"].shape == (1,)
