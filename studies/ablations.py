"""Models with less or more knowledge of the material: one without p, and one that is
given C_damp and C_mass.
"""

from dataclasses import replace

import numpy as np

from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.training import train_dpmpb
from clothlab.simulation.cloth import get_cloth
from studies._grid import shared
from studies._runs import config_of, recorded_runs, trained

KINDS = ("none", "known")


@shared
def train(kind: str, arm: str, seed: int) -> ClothCheckpoint:
    """A model with D_p = 0 ("none"), or whose p is log C_damp and log C_mass of each
    cloth, standardised ("known").

    ClothCheckpoint on all recordings of an arm, in the usual way.
    """
    learned, known = trained(f"{arm}-{seed}"), None
    settings = config_of(learned).model
    if kind == "none":
        settings = replace(settings, bias_size=0)
    else:
        cloths = [get_cloth(name) for name in learned.biases]
        logs = np.log([(cloth.damping, cloth.mass) for cloth in cloths])
        known = dict(
            zip(learned.biases, (logs - logs.mean(0)) / logs.std(0), strict=True)
        )
    runs = recorded_runs(learned)
    model, biases, trace = train_dpmpb(
        runs, settings, known=known, seed=seed, progress=False
    )
    return replace(learned, model=model, biases=biases, losses=trace.losses)
