"""Starts of plans: what fills a gap, and what is noted of a search."""

import numpy as np
import pytest
import torch

from clothlab.method.control import ControlSettings
from clothlab.simulation._arm_data import get_arm
from studies import plan_starts
from studies.plan_starts import PERIOD, NotingSearch, earlier_by


@pytest.mark.parametrize("steps", [-1, 0, 1, 2])
def test_a_command_comes_so_many_steps_earlier_in_the_next_period(steps):
    rng = np.random.default_rng(0)
    sent = [torch.full((2,), float(t)) for t in range(3 * PERIOD)]
    plan = torch.zeros(PERIOD, 2)
    added = int(earlier_by(steps)(plan, sent, rng)[0])
    lies_at = len(sent) + PERIOD - 1
    assert (added - lies_at) % PERIOD == steps % PERIOD


def test_until_a_period_was_sent_the_last_command_fills_the_gap():
    plan = torch.arange(16.0).reshape(8, 2)
    sent = [torch.zeros(2)] * (PERIOD - 1)
    rng = np.random.default_rng(0)
    assert torch.equal(earlier_by(1)(plan, sent, rng), plan[-1])


def test_the_packages_warm_start_comes_one_step_earlier(cloth_policy_commands):
    by_settings = cloth_policy_commands(
        NotingSearch(), ControlSettings(warm_start="earlier")
    )
    by_search = cloth_policy_commands(NotingSearch(earlier_by(1)), ControlSettings())
    assert np.array_equal(by_settings, by_search)


@pytest.fixture
def cloth_policy_commands():
    """Commands of a controller in a world that is known, with a search."""
    import toy

    from clothlab.method.cloth_task import ControlPolicy

    learned = toy.learned()
    states = np.random.default_rng(1).normal(size=(20, 7))

    def commands(search, settings):
        target = toy.image_of([0.4, -0.8, 0.0])
        p = learned.biases["damp0.03-mass0.10"]
        policy = ControlPolicy(
            learned.model,
            learned.autoencoder,
            learned.arm,
            target,
            p,
            settings,
            search=search,
        )
        return np.array([policy.controller.act(s) for s in states])

    return commands


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
