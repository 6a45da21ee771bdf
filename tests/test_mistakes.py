"""Mistakes that people make: each is answered at the door, in a sentence that says what
belongs there.
"""

import numpy as np
import pytest
import torch

from clothlab import analysis, plots
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, estimate_bias
from clothlab.method.iterative import IterativeController
from clothlab.method.model import DPMPB
from clothlab.simulation.cloth import Cloth, cloth_name, foam
from clothlab.simulation.scene import Scene
from clothlab.simulation.vision import iou
from clothlab.trials import recorded_plans

MODEL = DPMPB(7, 2).eval()
RUN = Run(np.zeros((40, 7)), np.zeros((40, 2)), "a")
MASK = np.zeros((96, 128), bool)
MASK[30:50, 40:70] = True


MISTAKES = {
    "a mask needs a gradient": (
        lambda: iou(torch.zeros(96, 128, requires_grad=True), MASK),
        "cloth images are .*, got Tensor",
    ),
    "one image for a grid of them": (
        lambda: plots.image_grid(MASK),
        r"a list of \[h, w\].*, \[image\]",
    ),
    "a trial for a run": (
        lambda: estimate_bias(MODEL, "trial"),
        "a run is a Run, got a str: `learned.to_run",
    ),
    "trials for runs": (
        lambda: IterativeController(
            MODEL, (0, 0, 0), (0, 0), (0, 0), (1, 1), ["trial"]
        ),
        "a run is a Run, got a str",
    ),
    "words for recordings": (
        lambda: recorded_plans(["heavy"]),
        "each of recordings is a Trial or a Run, got str",
    ),
    "a network of another kind": (
        lambda: Controller(torch.nn.Linear(2, 2), len, (0, 0), (0, 0), (1, 1)),
        "model is a DPMPB, got Linear",
    ),
    "an autoencoder for a model": (
        lambda: BiasEstimator(Autoencoder()),
        "model is a DPMPB, got Autoencoder: .*`learned.model`",
    ),
    "a cloth of no mass": (
        lambda: Cloth("mine", mass=0),
        "Cloth.mass must be at least 0.001, got 0",
    ),
    "a cloth of one row": (
        lambda: Cloth("mine", rows=1),
        "Cloth.rows must be at least 2, got 1",
    ),
    "a mass that is none": (
        lambda: cloth_name(0.05, np.nan),
        "C_mass is a finite number, got nan",
    ),
    "a foam that is none": (
        lambda: foam("medium", 2),
        "unknown foam 'medium'; choose from soft, hard",
    ),
    "a time step of nothing": (
        lambda: Scene(time_step=0),
        "Scene.time_step must be above 0",
    ),
    "step sizes that fall": (
        lambda: ControlSettings(smallest_step=2),
        "from smallest_step to largest_step, got 2 to 1.0",
    ),
    "an interval of nothing": (
        lambda: analysis.crossed_interval(np.zeros((0, 5))),
        r"values is .*, got the shape \[0, 5\]",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_answered_with_what_belongs_there(name):
    act, sentence = MISTAKES[name]
    with pytest.raises((ValueError, KeyError), match=sentence) as answered:
        act()
    assert "\n" not in str(answered.value)
