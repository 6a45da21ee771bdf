"""Models with less or more knowledge of the material: one without p, and one that is given C_damp and C_mass."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clothlab.experiments._grid import shared
from clothlab.experiments._runs import recorded_runs, trained
from clothlab.learning.dpmpb import Sequences, train_dpmpb
from clothlab.learning.trained import Trained
from clothlab.simulation.cloth import get_cloth
from clothlab.training_configs import config_of


def without_p(learned: Trained, runs: Sequence[Sequences], seed: int) -> Trained:
    """A model trained on the same recordings in the same way, with D_p = 0."""
    settings = replace(config_of(learned).model, bias_size=0)
    model, biases, trace = train_dpmpb(runs, settings, seed=seed, progress=False)
    return replace(learned, model=model, biases=biases, losses=trace.losses)


def with_constants(learned: Trained, runs: Sequence[Sequences], seed: int) -> Trained:
    """A model trained likewise whose p is log C_damp and log C_mass of each cloth, standardised; not for foams."""
    cloths = [get_cloth(name) for name in learned.biases]
    logs = np.log([(cloth.damping, cloth.mass) for cloth in cloths])
    known = dict(zip(learned.biases, (logs - logs.mean(0)) / logs.std(0), strict=True))
    model, biases, trace = train_dpmpb(runs, config_of(learned).model, known=known, seed=seed, progress=False)
    return replace(learned, model=model, biases=biases, losses=trace.losses)


MODELS = {"none": without_p, "known": with_constants}


@shared
def train(kind: str, arm: str, seed: int) -> Trained:
    """One of `MODELS`, on all recordings of an arm."""
    learned = trained(f"{arm}-{seed}")
    return MODELS[kind](learned, recorded_runs(learned), seed)
