"""The paper's controller where the model is right: what it foresees comes."""

import numpy as np
import pytest
import toy

from clothlab.method.control import Controller, Solution
from clothlab.method.iterative import nearest_plans

LEARNED = toy.learned()


def test_what_is_foreseen_of_the_end_of_a_period_is_what_comes():
    """z there, and its distance to a target that no command reaches."""
    cloth = "damp0.05-mass0.10"
    aim = np.array([0.3, -0.9, 0.7])
    policy = LEARNED.controller(toy.image_of(aim), cloth)
    assert policy.foreseen is None
    assert policy.predicted_distance is None

    z = np.zeros(3)
    for _ in range(2):
        for _ in range(8):
            observation = {"image": toy.image_of(z), "robot": np.zeros(4)}
            command = policy(observation)
            foreseen, distance = policy.foreseen, policy.predicted_distance
            z = np.append((1 + toy.bias_of(cloth)) * command, 0.0)
        assert policy.controller.period_ended
        assert foreseen == pytest.approx(z, abs=1e-5)
        assert distance == pytest.approx(np.linalg.norm(z - aim), abs=2e-3)
        assert distance == pytest.approx(0.7, abs=0.01)  # as near as commands lead


def test_the_first_plan_repeats_the_middle_between_the_limits_or_home():
    """A search that goes on with what it is given sends it."""

    class Nothing:
        name = "nothing"

        def begin(self, home, settings, learned=None):
            return None

        def __call__(self, problem, learned):
            return Solution(problem.plan, None)

    for home, first in ((None, [0.5, -2.0]), ([0.25, -1.0], [0.25, -1.0])):
        controller = Controller(
            LEARNED.model,
            lambda states, commands, t: states[:, 0, 0],
            np.zeros(2),
            [0.0, -3.0],
            [1.0, -1.0],
            home=home,
            search=Nothing(),
        )
        for _ in range(3):
            assert controller.act(np.zeros(7)) == pytest.approx(first)


def test_plans_are_looked_for_only_where_a_recording_holds_one():
    run = LEARNED.to_run(toy.random_trial("torque", "damp0.05-mass0.10", 15, 0))
    with pytest.raises(ValueError, match="plans of 8 steps need recorded runs"):
        nearest_plans([run], np.zeros(3))
