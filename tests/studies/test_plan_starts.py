"""Starts of plans: how they are drawn."""

import numpy as np
import pytest

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
