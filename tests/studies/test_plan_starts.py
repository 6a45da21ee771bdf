"""Starts of plans: how they are drawn."""

import numpy as np
import pytest
import torch
from shared import shaken

from clothlab.method.control import ControlSettings
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import get_arm
from studies import plan_starts
from studies.plan_starts import PERIOD


def test_single_commands_of_still_and_of_random_plans_are_drawn_alike():
    arm = get_arm("torque")
    still = plan_starts.drawn_starts("still 4000", arm, 0)
    moving = plan_starts.drawn_starts("random 4000", arm, 0)
    assert still.shape == moving.shape == (4000, PERIOD, 2)
    assert np.ptp(still, axis=1).max() == 0
    assert np.ptp(moving, axis=1).min() > 0
    for moment in (np.mean, np.std):
        assert moment(still[:, 3], axis=0) == pytest.approx(
            moment(moving[:, 3], axis=0), abs=0.03
        )


def _controller(kind, plans):
    """A controller that wants small commands, and whose search hardly moves a plan."""
    return kind(
        shaken(DPMPB(2, 1)),
        lambda states, commands, t: commands.square().sum(dim=(1, 2)),
        np.zeros(2),
        [-1.0],
        [1.0],
        ControlSettings(smallest_step=1e-9, largest_step=1e-8),
        plans=plans,
        home=[1.0],
    )


@pytest.fixture
def plans():
    return np.random.default_rng(0).uniform(-1, 1, (20, PERIOD, 1)).astype("f4")


def test_a_chosen_plan_is_sent_as_it_is(plans):
    controller = _controller(plan_starts.ChoosingController, plans)
    sent = [controller.act(np.zeros(2)) for _ in range(PERIOD)]
    smallest = np.square(plans).sum(axis=(1, 2)).argmin()
    np.testing.assert_allclose(sent, plans[smallest], atol=1e-6)


def test_a_blind_start_is_any_of_the_plans_and_searched_on(plans):
    controller = _controller(plan_starts.BlindController, plans)
    s = torch.zeros(2)
    found = [controller.search(s, controller.plan).numpy() for _ in range(40)]
    gaps = np.abs(np.array(found)[:, None] - plans).max(axis=(2, 3))  # [40, 20]
    assert gaps.min(axis=1).max() < 1e-5
    assert len({*gaps.argmin(axis=1)}) > 10
    assert len(controller.trace) == 40
