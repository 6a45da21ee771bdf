"""The paper's controller where the model is right: what it predicts comes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import toy

from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run
from clothlab.method.iterative import IterativeLearningSettings, nearest_plans

LEARNED = toy.learned()


def test_what_is_predicted_of_the_end_of_a_period_is_what_comes():
    """z there, and its distance to a target that no command reaches."""
    cloth = "damp0.05-mass0.10"
    aim = np.array([0.3, -0.9, 0.7])
    policy = LEARNED.controller(toy.image_of(aim), cloth)
    assert policy.predicted_z is None
    assert policy.predicted_distance is None

    z = np.zeros(3)
    for _ in range(2):
        for _ in range(8):
            observation = {"image": toy.image_of(z), "robot": np.zeros(4)}
            command = policy(observation)
            predicted, distance = policy.predicted_z, policy.predicted_distance
            z = np.append((1 + toy.bias_of(cloth)) * command, 0.0)
        assert policy.controller.period_ended
        assert predicted == pytest.approx(z, abs=1e-5)
        assert distance == pytest.approx(np.linalg.norm(z - aim), abs=2e-3)
        assert distance == pytest.approx(0.7, abs=0.01)  # as near as commands lead


def test_the_first_plan_repeats_the_middle_between_the_limits_or_home():
    """A search that goes on with what it is given sends it."""

    class Still(Controller):
        def search(self, s, plan, solve=True):
            return plan

    for home, first in ((None, [0.5, -2.0]), ([0.25, -1.0], [0.25, -1.0])):
        controller = Still(
            LEARNED.model,
            lambda states, commands, t: states[:, 0, 0],
            np.zeros(2),
            [0.0, -3.0],
            [1.0, -1.0],
            home=home,
        )
        for _ in range(3):
            assert controller.act(np.zeros(7)) == pytest.approx(first)


def test_plans_are_looked_for_only_where_a_recording_holds_one():
    run = LEARNED.to_run(toy.random_trial("torque", "damp0.05-mass0.10", 15, 0))
    with pytest.raises(ValueError, match="plans of 8 steps need recorded runs"):
        nearest_plans([run], np.zeros(3))


class Counting(Controller):
    """Its n-th plan has n tenths in each step."""

    def search(self, s, plan, solve=True):
        assert solve
        self.ends.append(float(plan[-1, 0]))
        return torch.full_like(plan, self.t / 10)


@pytest.mark.parametrize(
    ("warm_start", "added"),
    [("last", [0.9, 0.0, 0.1, 0.2, 0.3]), ("earlier", [0.9, 0.0, 0.1, 0.0, 0.1])],
)
def test_at_its_end_a_plan_goes_on_with_its_last_command_or_that_of_a_period_ago(
    warm_start, added
):
    settings = ControlSettings(horizon=4, period=3, warm_start=warm_start)
    controller = Counting(
        LEARNED.model,
        lambda states, commands, t: states[:, 0, 0],
        np.zeros(2),
        [0.0, 0.0],
        [1.0, 1.0],
        settings,
        home=[0.9, 0.9],
    )
    controller.ends = []
    for _ in range(5):
        controller.act(np.zeros(7))
    assert controller.ends == pytest.approx(added)


def test_recorded_plans_may_overlap_by_half_and_no_more():
    s, u = np.full((40, 7), 9.0), np.arange(40.0)[:, None].repeat(2, 1)
    for step, distance in ((20, 0.0), (16, 0.1), (17, 0.05), (24, 0.2), (23, 0.15)):
        s[step, :3] = distance
    found = nearest_plans([Run(s, u, "a")], np.zeros(3), horizon=8, count=3)
    assert found.u[:, 0, 0].tolist() == [12, 8, 16]


def test_recorded_plans_are_sent_within_the_limits():
    arm = replace(LEARNED.arm, lower=(-0.2, -0.8))
    recorded = [LEARNED.to_run(toy.random_trial("torque", "damp0.05-mass0.10", 80, 0))]
    settings = IterativeLearningSettings(trust=0, iterations=0)
    target = toy.image_of([-0.5, -1.4, 0.0])
    policy = LEARNED.iterative_controller(
        target, np.zeros(2), recorded, settings, arm=arm
    )
    observation = {"image": toy.image_of(np.zeros(3)), "robot": np.zeros(4)}
    sent = np.array([policy(observation) for _ in range(8)])
    assert (sent >= np.float32(arm.lower)).all()
    assert (sent == np.float32(arm.lower)).any()


def test_a_command_that_is_fixed_has_no_part_in_the_descent():
    controller = LEARNED.controller(
        toy.image_of(np.zeros(3)),
        np.zeros(2),
        arm=replace(LEARNED.arm, lower=(-0.8, -0.4), upper=(1.0, -0.4)),
    ).controller
    unit = float(LEARNED.model.u_std[0])
    assert controller.limits.scale.tolist() == [unit, 0.0]
