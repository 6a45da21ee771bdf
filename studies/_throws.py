"""Tasks on which rivals compete: a cloth that no training saw, and a target.

All rivals get the same: the recordings, 40 s of random commands with the cloth, the
same throws, and the outcome of each.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.data import Run
from clothlab.method.policy import Policy


@dataclass(frozen=True, eq=False)
class Task:
    """What a rival may know before its first throw."""

    learned: ClothCheckpoint  # autoencoder, model, and trained p of recorded cloths
    target: np.ndarray  # mask [H, W]
    runs: list[Run]  # recordings from which the model learned
    excited: Run  # random commands with the cloth in the hand
    seed: int  # of whatever a rival draws


# What makes a policy for a task
Rival = Callable[[Task], Policy]
