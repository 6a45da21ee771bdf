"""Estimation of p in a live run, with a report of how sure it is."""

from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from clothlab import data
from clothlab.calibration import Calibration, EstimateReport, calibrate
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.gauss_newton import NewtonEstimator, linearise

_REPORT_EVERY = 5  # steps; a report costs about as much as an update


@cache
def _calibration(weights: str, known: str) -> "Future[Calibration]":
    """Calibrate by recorded trials that the weights were not trained on.

    In a thread, so that no control step waits for it.
    """
    learned = data.load(weights)
    trials = data.load_trials(known)

    def compute() -> Calibration:
        runs = [learned.to_run(trial) for trial in trials]
        return calibrate(learned.model, learned.biases, runs)

    worker = ThreadPoolExecutor(1, "calibration")
    future = worker.submit(compute)
    worker.shutdown(wait=False)
    return future


class BiasTracker:
    """Follows p by Gauss-Newton, from `p` `[D_p]` on.

    `known` are trials that the model was not trained on, for calibration.
    """

    def __init__(self, trained: ClothCheckpoint, known: str, p: ArrayLike):
        self._trained = trained
        self._known = known
        self._p = p
        self._estimator = NewtonEstimator(trained.model, p)
        self._count = 0  # steps taken in
        # How sure the estimate is; None at first
        self.report: EstimateReport | None = None

    def update(self, s: ArrayLike, u: ArrayLike, *, at_rest: bool) -> np.ndarray:
        """Take in state `[D_s]` and command `[D_u]`; the new p `[D_p]`.

        `at_rest`: the cloth hung still before.
        """
        if not self._count:
            model = self._trained.model
            self._estimator = NewtonEstimator(model, self._p, from_rest=at_rest)
        p = self._estimator.update(s, u)
        self._count += 1

        calibration = _calibration(self._trained.name, self._known)
        if calibration.done() and self._count % _REPORT_EVERY == 0:
            fit = linearise(self._estimator)
            self.report = calibration.result().report(fit, p)
        return p
