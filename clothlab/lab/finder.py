"""Who finds p in a live run, and says how sure that is."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab.learning.calibration import Calibration, Doubt, calibrate
from clothlab.learning.estimation import NewtonEstimator
from clothlab.learning.trained import Trained

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


class Later:
    """A value that a thread of its own computes, once, when it is first asked for: no control step waits for it.

    Args:
        compute: what takes its time.
    """

    def __init__(self, compute: Callable[[], Calibration]):
        self._compute = compute
        self._future: Future[Calibration] | None = None

    def __call__(self) -> Calibration | None:
        """The value, or None as long as it is being computed; what went wrong there is raised here."""
        if self._future is None:
            worker = ThreadPoolExecutor(1, "calibration")
            self._future = worker.submit(self._compute)
            worker.shutdown(wait=False)
        return self._future.result() if self._future.done() else None


@cache
def calibration_later(weights: str, known: str) -> Later:
    """`calibration`, when somebody asks for it.

    Raises:
        KeyError: trials that are missing; the message lists the choices.
    """
    artifacts.load_trials(known)
    return Later(lambda: calibration(weights, known))


class Finder:
    """Follows p by Gauss-Newton, which is right sooner than momentum is; now and then it doubts.

    Args:
        trained: the model and what it was trained with.
        calibration: answers what is known about its faults, or None as long as that is being found out.
        p: where to start `[D_p]`.

    Raises:
        ValueError: p of another size or not finite.

    Attributes:
        doubt: how sure the estimate is, and how familiar the material; None before enough was seen
            and the calibration is there.
    """

    def __init__(self, trained: Trained, calibration: Callable[[], Calibration | None], p: ArrayLike):
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
        calibration = self._calibration()
        if calibration is not None and self._count % DOUBT_EVERY == 0:
            self.doubt = calibration.doubt(self._estimator)
        return p
