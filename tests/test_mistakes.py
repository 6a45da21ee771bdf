"""Mistakes that people make: each is answered at the door, in a sentence that says what
belongs there.
"""

import numpy as np
import pytest
import torch

from clothlab import analysis, plots
from clothlab.lab import Control, LivePanel, PBMap
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, estimate_bias
from clothlab.method.iterative import IterativeController
from clothlab.method.model import DPMPB
from clothlab.simulation.cloth import Cloth, cloth_name, foam
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from clothlab.simulation.vision import iou
from clothlab.trials import recorded_plans

MODEL = DPMPB(7, 2).eval()
RUN = Run(np.zeros((40, 7)), np.zeros((40, 2)), "a")
MASK = np.zeros((96, 128), bool)
MASK[30:50, 40:70] = True


def control(loss, **change):
    Controller(MODEL, loss, (0, 0), (-1, -1), (1, 1), **change).act(np.zeros(7))


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
    "a mass of nothing": (
        lambda: cloth_name(0.05, 0.0),
        "C_mass must be above 0, got 0.0",
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
    "two sensors of one name": (
        lambda: Run(np.zeros((9, 2)), np.zeros((9, 1)), "a", state_names=("g", "g")),
        "states of a run need different names, got g, g",
    ),
    "no loss": (lambda: control(None), "loss is a function, .*, got NoneType"),
    "a loss of NumPy": (
        lambda: control(lambda s, u, t: s.detach().numpy().sum((1, 2))),
        r"a loss is \[B\], .* in a tensor of torch, got ndarray",
    ),
    "a loss without a gradient": (
        lambda: control(lambda s, u, t: s.detach().square().sum((1, 2))),
        "the loss has no gradient: .* without `detach`",
    ),
    "a home that is out of reach": (
        lambda: control(len, home=(5, 0)),
        r"home \[5. 0.\] is not between the limits \[-1. -1.\] and \[1. 1.\]",
    ),
    "settings of a scene in a dictionary": (
        lambda: ClothEnv("torque", scene={"time_step": 0.002}),
        r"scene is a Scene\(time_step=...\), got dict",
    ),
    "labels in a list": (
        lambda: PBMap({"a": np.zeros(2), "b": np.ones(2)}, [], p=(0, 0)),
        "labels are {name of a material: .*, got list",
    ),
    "a control of no parameter": (
        lambda: Control(lambda x=1: None, y=[1, 2]),
        "no parameter 'y'; it has x",
    ),
    "a control without a start": (
        lambda: Control(lambda x: None, x=[1, 2]),
        "parameter x needs a default",
    ),
    "a control that starts at no choice": (
        lambda: Control(lambda x=3: None, x=[1, 2]),
        r"the default of x, 3, is not among \[1, 2\]",
    ),
    "a slider that starts beyond its end": (
        lambda: Control(lambda x=3: None, x=(1, 2, 1)),
        r"the default of x, 3, is not among \(1, 2, 1\)",
    ),
    "an arm for a session": (
        lambda: LivePanel("torque"),
        "session is a LiveSession, got str 'torque'",
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
