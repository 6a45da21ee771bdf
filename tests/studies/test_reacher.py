"""The study of notebook 16: the Reacher with a payload and friction."""

from dataclasses import replace

import pytest

from studies import another_robot
from studies.another_robot import MATERIALS


@pytest.mark.slow
@pytest.mark.parametrize("kind", another_robot.KINDS)
def test_the_study_runs_small(kind):
    few = replace(another_robot.TRAINING, epochs=1)
    learned = another_robot.train(kind, 0, 120, few)
    methods = [name for name, kind_ in another_robot.METHODS.items() if kind_ == kind]
    for method in methods:
        distances = another_robot.control(learned, method, MATERIALS[0], False, 0)
        assert distances.shape == (10,)
        assert (distances < 0.42).all()
    if kind == "p":
        found = another_robot.identify(learned, MATERIALS[0], 5000, steps=20)
        assert found["trained"]
        assert {"right", "found_payload", "found_friction"} <= found.keys()
