"""The paper's controller where the model is right: what it foresees comes."""

import numpy as np
import pytest
import toy

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
