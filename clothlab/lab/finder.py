"""Who finds p in a live run, and says how sure that is."""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab.artifacts import Trained
from clothlab.estimation import NewtonEstimator
from clothlab.uncertainty import Calibration, Doubt, calibrate

DOUBT_EVERY = 5  # steps; a look costs about as much as an update


@cache
def calibration(weights: str, known: str) -> Calibration:
    """What recorded trials that these weights were not trained on say about them.

    Raises:
        KeyError: weights or trials that are missing; the message lists the choices.
    """
    learned = artifacts.load(weights)
    runs = [learned.sequences(trial) for trial in artifacts.load_trials(known)]
    return calibrate(learned.model, learned.biases, runs)


class Finder:
    """Follows p by Gauss-Newton, which is right sooner than momentum is; now and then it doubts.

    Args:
        trained: the model and what it was trained with.
        calibration: what is known about its faults.
        p: where to start `[D_p]`.

    Raises:
        ValueError: p of another size or not finite.

    Attributes:
        doubt: how sure the estimate is, and how familiar the material; None before enough was seen.
    """

    def __init__(self, trained: Trained, calibration: Calibration, p: ArrayLike):
        self._trained, self._calibration, self._p = trained, calibration, p
        self._estimator = NewtonEstimator(trained.model, p)
        self._count = 0
        self.doubt: Doubt | None = None

    def update(self, s: ArrayLike, u: ArrayLike, *, at_rest: bool) -> np.ndarray:
        """Take in one step.

        Args:
            s: state seen before the command `[D_s]`.
            u: the command `[D_u]`.
            at_rest: whether the cloth hung still before it; of the first step alone this counts.

        Returns:
            The new estimate `[D_p]`.

        Raises:
            ValueError: as `Estimator.update`.
        """
        if not self._count:
            self._estimator = NewtonEstimator(self._trained.model, self._p, from_rest=at_rest)
        p = self._estimator.update(s, u)
        self._count += 1
        if self._count % DOUBT_EVERY == 0:
            self.doubt = self._calibration.doubt(self._estimator)
        return p
