"""Estimation of p in a live run, and whether its material is like any trained on."""

import numpy as np
from numpy.typing import ArrayLike

from clothlab.method.estimation import Linearisation, NewtonEstimator, NewtonSettings
from clothlab.weights import ClothCheckpoint

# How many times the loss of the training that of a run may be. With trained cloths it
# stays below 3.
_STRANGE = 5.0


class BiasTracker:
    """Follows p by Gauss-Newton, from `p` `[D_p]` on."""

    def __init__(self, trained: ClothCheckpoint, p: ArrayLike):
        self._model = trained.model
        self._usual = trained.losses[-1] if len(trained.losses) else np.inf
        self._p = p
        self._estimator: NewtonEstimator | None = None  # made in the first step
        self._seen: Linearisation | None = None  # how p predicts what was observed

    def update(self, s: ArrayLike, u: ArrayLike, *, at_rest: bool) -> np.ndarray:
        """Take in state `[D_s]` and command `[D_u]`; the new p `[D_p]`.

        `at_rest`: the cloth hung still before the first of them.
        """
        if self._estimator is None:
            settings = NewtonSettings(from_rest=at_rest)
            self._estimator = NewtonEstimator(self._model, self._p, settings)
        p = self._estimator.update(s, u)
        self._seen = self._estimator.linearisation()
        return p

    @property
    def covariance(self) -> np.ndarray | None:
        """How far the estimate scatters, `[D_p, D_p]`; None before it can be said."""
        if self._seen is None:
            return None
        try:
            return self._seen.covariance()
        except np.linalg.LinAlgError:
            return None

    @property
    def is_strange(self) -> bool:
        """Whether it is predicted much worse than what the model was trained on."""
        return self._seen is not None and self._seen.loss > _STRANGE * self._usual
