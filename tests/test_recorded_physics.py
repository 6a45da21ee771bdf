"""What was recorded comes again: all results stand on the constants of these worlds."""

from functools import cache

import numpy as np
import pytest

from clothlab import data
from clothlab.simulation.arm import ARMS
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import iou

STEPS = 8
recorded = cache(data.load_trials)


@pytest.mark.parametrize(
    ("trials", "cloth"),
    [
        ("train", "damp0.03-mass0.05"),
        ("train", "damp0.07-mass0.15"),
        ("muscle-train", "soft-1"),
        ("muscle-train", "hard-3"),
    ],
)
def test_an_arm_and_a_cloth_of_that_name_move_as_they_did(trials, cloth):
    trial = next(each for each in recorded(trials) if each.cloth.name == cloth)[:STEPS]
    env = ClothEnv(ARMS[trial.arm.name], get_cloth(cloth))
    env.start(seed=trial.seed)
    robot, images = [], []
    for u in trial.commands:
        robot.append(env.arm.state(env.data))
        images.append(env.observe()["image"])
        env.advance(u)
    env.close()
    assert np.array(robot) == pytest.approx(trial.robot, abs=1e-5)
    assert iou(np.array(images), trial.images).min() > 0.98
