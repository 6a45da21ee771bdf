"""A policy while p is estimated: which p it is given, and when."""

import numpy as np
import pytest
import toy

from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.estimation import NewtonEstimator
from clothlab.policies import RandomPolicy

RIGHT = toy.bias_of("damp0.03-mass0.15")


class Noting(RandomPolicy):
    """Random commands, and a note of each p that is given."""

    def __init__(self, arm):
        super().__init__(arm)
        self.given = []

    def set_bias(self, p):
        self.given.append(p)


def test_it_begins_with_the_estimator_s_p_and_gets_each_estimate_after_its_step():
    learned = toy.learned()
    inner = Noting(learned.arm)
    estimator = NewtonEstimator(learned.model, [0.3, -0.2])
    policy = EstimatingPolicy(inner, estimator, learned.autoencoder)
    assert inner.given == [pytest.approx([0.3, -0.2])]

    trial = toy.new_trial(policy, learned.arm, "damp0.03-mass0.15", 12, 0)
    assert inner.given[1] == pytest.approx([0.3, -0.2])  # at the reset
    assert np.array_equal(inner.given[2:], policy.trace)
    assert len(policy.trace) == len(trial) == 12
    assert policy.trace[-1] == pytest.approx(RIGHT, abs=0.01)

    policy.reset()
    assert inner.given[-1] == pytest.approx([0.3, -0.2])
    assert policy.trace == []
    assert estimator.p == pytest.approx([0.3, -0.2])
