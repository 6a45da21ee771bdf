"""Mistakes that people make: each is answered at the door, in a sentence that says what
belongs there.
"""

import numpy as np
import pytest
import torch

import studies
from clothlab import _store, analysis, plots
from clothlab.calibration import calibrate
from clothlab.masks import iou
from clothlab.method.autoencoder import Autoencoder, train_autoencoder
from clothlab.method.cloth_task import ControlPolicy, period_mask
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, prediction_loss
from clothlab.method.gauss_newton import NewtonEstimator, best_bias, estimate_bias
from clothlab.method.iterative import IterativeSearch, nearest_plans
from clothlab.method.model import DPMPB
from clothlab.simulation._arm_data import get_arm
from clothlab.simulation.cloth import cloth_name, foam
from clothlab.trials import recorded_plans
from studies import datasets

MODEL = DPMPB(7, 2).eval()
RUN = Run(np.zeros((40, 7)), np.zeros((40, 2)), "a")
MASK = np.zeros((96, 128), bool)
MASK[30:50, 40:70] = True
STATES, COMMANDS = torch.zeros(20, 7), torch.zeros(20, 2)


def swings(runs):
    search = IterativeSearch(runs)
    arm = get_arm("torque")
    return ControlPolicy(MODEL, Autoencoder().eval(), arm, MASK, (0, 0), search=search)


def controller(**wrong):
    return ControlPolicy(
        MODEL, Autoencoder().eval(), get_arm("torque"), MASK, (0, 0), **wrong
    )


MISTAKES = {
    "settings are a dict": [
        (
            lambda: controller(settings={}),
            r"settings is a ControlSettings, got dict .*ControlSettings\(name=value\)",
        ),
        (
            lambda: Controller(MODEL, len, (0, 0), (0, 0), (1, 1), {"horizon": 3}),
            "settings is a ControlSettings",
        ),
        (
            lambda: BiasEstimator(MODEL, settings={"rate": 1}),
            "settings is an EstimationSettings",
        ),
        (
            lambda: NewtonEstimator(MODEL, settings={"window": 1}),
            "settings is a NewtonSettings",
        ),
        (
            lambda: train_autoencoder(MASK[None], {"epochs": 1}),
            "settings is an AutoencoderTraining",
        ),
        (lambda: period_mask(1, {"period": 3}), "settings is a ControlSettings"),
    ],
    "a seed is no whole number": [
        (
            lambda: train_autoencoder([MASK] * 64, seed="3", progress=False),
            "seed is a whole number, got 3",
        ),
        (
            lambda: datasets.record_run(
                datasets.DATASETS["train"], "damp0.03-mass0.05", "operator", 0.5
            ),
            "seed is a",
        ),
    ],
    "a mask is no mask": [
        (
            lambda: iou(torch.zeros(96, 128, requires_grad=True), MASK),
            "cloth images are .*, got Tensor",
        ),
        (lambda: iou([[0, 1], [0]], MASK), "cloth images are .*, got list"),
        (lambda: plots.image_grid(MASK), r"a list of \[h, w\].*, \[image\]"),
    ],
    "a run is no run": [
        (
            lambda: estimate_bias(MODEL, "trial"),
            "run is a Run, got str trial: `learned.to_run",
        ),
        (lambda: best_bias(MODEL, [RUN], (0, 0)), "run is a Run, got list"),
        (lambda: calibrate(MODEL, {}, RUN), "runs are a list of Run, got Run"),
        (lambda: swings(["trial"]), "each of runs is a Run, got str trial"),
        (lambda: nearest_plans(RUN, [0, 0, 0]), "runs are a list of Run"),
        (lambda: recorded_plans([RUN]), "each of trials is a Trial, got Run"),
    ],
    "a model is no model": [
        (
            lambda: Controller(torch.nn.Linear(2, 2), len, (0, 0), (0, 0), (1, 1)),
            "model is a DPMPB, got Linear",
        ),
        (lambda: BiasEstimator(Autoencoder()), "model is a DPMPB, got Autoencoder"),
    ],
    "a name is no name": [
        (
            lambda: _store.save_results(b"x", "n1", None),
            r"results end in .*\.csv.*, got None",
        ),
        (lambda: cloth_name(0.05, np.nan), "C_mass is a finite number, got nan"),
        (lambda: foam("medium", 2), "unknown foam 'medium'; choose from soft, hard"),
        (lambda: foam("soft", 0), "sheets must be at least 1"),
        (
            lambda: datasets.record_run(
                datasets.DATASETS["train"], "damp0.03-mass0.05", "operater", 0
            ),
            "unknown policy 'operater'; choose from random, operator",
        ),
        (
            lambda: studies.EXPERIMENTS["control"].cases(modle=0),
            "control has no 'modle'; choose from .*model",
        ),
    ],
    "a number is out of range": [
        (
            lambda: nearest_plans([RUN], [np.nan] * 3),
            r"z_ref is \[D_z\] and finite, got nan",
        ),
        (
            lambda: nearest_plans([RUN], np.zeros(8)),
            "z_ref has 8 numbers, more than the 7 of a state",
        ),
        (lambda: period_mask(1.5, ControlSettings()), "t is a whole number, got 1.5"),
        (
            lambda: prediction_loss(MODEL, STATES, COMMANDS, torch.zeros(2), 10**6),
            "warmup must be at most 18",
        ),
    ],
    "there is nothing": [
        (
            lambda: analysis.late_median(analysis.best_per_period(np.ones(8))),
            "best are empty",
        ),
        (
            lambda: analysis.difference_interval(np.zeros((0, 5))),
            r"differences are empty.* shape \[0, 5\]",
        ),
        (
            lambda: analysis.difference_interval(np.zeros((5, 0))),
            "differences are empty",
        ),
        (lambda: analysis.rate_interval([]), "held are empty"),
    ],
}


@pytest.mark.parametrize(
    ("act", "sentence"),
    [
        pytest.param(*each, id=f"{kind} {k}")
        for kind, mistakes in MISTAKES.items()
        for k, each in enumerate(mistakes)
    ],
)
def test_a_mistake_is_answered_with_what_belongs_there(act, sentence):
    with pytest.raises((ValueError, KeyError), match=sentence) as told:
        act()
    assert "\n" not in str(told.value)
