"""What does p arrange if C_damp is the damping of the springs?

The paper has its damping "between those point masses", and doesn't say how. Each
reading is recorded, and a model is trained on it, in the same way. What varies is the
reading and the training.
"""

from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from clothlab import data
from clothlab.analysis import spread
from clothlab.method.data import Run
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.policies import OperatorPolicy, RandomPolicy
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout, to_run
from studies._grid import Experiment, over, shared
from studies._runs import loss_of_run
from studies.estimation import MaterialReadout

DRAG = "drag of the points"  # that of this project
DAMPER = "damper of the springs"  # and no drag at all
BOTH = "damper of the springs, with drag"  # the same drag for all cloths
READINGS = (DRAG, DAMPER, BOTH)
_KEPT_DRAG = 0.05  # [N s/m] in the third reading
_FIRST_SEED = 400_000  # no other set of trials has these seeds
_HELD_OUT = 900_000  # added for the runs that no training sees
# As many updates as for the paper's amount of recordings, with four times as much
_TRAINING = ModelTraining(epochs=60)


def cloth_of(reading: str, name: str) -> Cloth:
    """One of the paper's nine cloths, whose C_damp is read in one of three ways."""
    cloth = CLOTHS[name]
    if reading == DRAG:
        return cloth
    drag = 0.0 if reading == DAMPER else _KEPT_DRAG
    return replace(cloth, damping=drag, spring_damping=cloth.damping)


@shared
def _record(reading: str, repeats: int, steps: int, first_seed: int) -> list[Run]:
    """Runs with all nine cloths, random and operator's, as the autoencoder sees them.

    The autoencoder is the stored one, which learned from cloths with drag.
    """
    autoencoder, _ = data.load_autoencoder("torque")
    runs: list[Run] = []
    seed = first_seed
    for name in CLOTHS:
        with closing(ClothEnv("torque", cloth_of(reading, name))) as env:
            for policy in (RandomPolicy, OperatorPolicy) * repeats:
                trial = rollout(env, policy(env.arm), steps, seed=seed)
                runs.append(to_run(autoencoder, trial))
                seed += 1
    return runs


def _run_one(
    reading: str, model: int, repeats: int = 4, steps: int = 250, epochs: int = 60
) -> dict[str, Any]:
    """Train W and p on one reading, and ask what p knows of the cloths.

    Args:
        reading: of C_damp, one of `READINGS`.
        model: seed of the training.
        repeats: times the paper's amount of recordings.
        steps: control steps of each recording.
        epochs: of the training.
    """
    runs = _record(reading, repeats, steps, _FIRST_SEED)
    settings = replace(_TRAINING, epochs=epochs)
    learned, biases, curve = train_dpmpb(runs, settings, seed=model, progress=False)
    readout = MaterialReadout.fit(biases, CLOTHS)

    # How well each p predicts other runs of each cloth
    p = torch.as_tensor(np.stack([biases[name] for name in CLOTHS]))
    losses = []
    for run in _record(reading, 1, steps, _FIRST_SEED + _HELD_OUT):
        losses.append(loss_of_run(learned, run, p))
    return {
        "p": p.numpy().round(4),  # in the order of CLOTHS [9, D_p]
        "spread": spread(biases),
        "r2": readout.r2,  # of log C_damp and log C_mass, one cloth left out
        "loss": float(curve[-1]),  # of the last epoch [s.d.²]
        # Of two runs with each cloth, by each p [18, 9] [s.d.²]
        "held_out": np.round(losses, 5),
    }


def named(held_out: np.ndarray) -> np.ndarray:
    """How often the p that predicts a run best is of a cloth with its own constants.

    From losses `[18, 9]`, two runs for each of the nine cloths, come the shares for
    C_damp and C_mass, `[2]`; one run of three is chance.
    """
    best = np.asarray(held_out).argmin(axis=1)
    own = np.repeat(np.arange(len(CLOTHS)), 2)
    damping = best // 3 == own // 3
    mass = best % 3 == own % 3
    return np.array([damping.mean(), mass.mean()])


EXPERIMENTS = (
    Experiment("other_reading", _run_one, over(reading=READINGS, model=range(1))),
)
