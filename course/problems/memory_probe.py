"""What does the memory hold? A model solution, and its reference values.

Of the half page, measured on the 18 evaluation trials with `torque-0`, means over the
three numbers of z, the first twenty steps left out:

                          change of z    z two steps ago    z eight steps ago
    state and command            0.52               0.31                 0.06
    memory                       0.50               0.54                 0.09
    memory, LSTM untrained       0.37               0.65                 0.23

The trained memory knows more of the near past than state and command do, and an LSTM
with random weights knows still more: any recurrent network keeps an echo. Training has
not made it remember; it keeps what predicts. One training: an answer with other numbers
may be right.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler


def share_known(features: Sequence[np.ndarray], values: Sequence[np.ndarray]) -> float:
    """R² of values that a straight map reads off features, in runs it has not seen.

    Features `[T, D]` and values `[T]` come run by run.
    """
    x = np.concatenate(features)
    y = np.concatenate(values)
    run = np.repeat(np.arange(len(values)), [len(each) for each in values])

    # A ridge for features in standard deviations, its penalty chosen on runs left out
    ridge = make_pipeline(StandardScaler(), Ridge())
    penalties = {"ridge__alpha": 10.0 ** np.arange(-3, 5)}
    judged = {"cv": LeaveOneGroupOut(), "scoring": "neg_mean_squared_error"}
    chosen = GridSearchCV(ridge, penalties, **judged)

    # Each run is read off by what was fitted and chosen on all the others
    error = 0.0
    spread = 0.0
    for train, test in LeaveOneGroupOut().split(x, y, run):
        chosen.fit(x[train], y[train], groups=run[train])
        error += ((y[test] - chosen.predict(x[test])) ** 2).sum()
        spread += ((y[test] - y[train].mean()) ** 2).sum()
    return float(1 - error / spread)


def parts(
    answer: Callable, seed: int = 0
) -> Iterator[tuple[int, str, Callable[[], bool]]]:
    """Points, words and condition of each part."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float, **hidden: float) -> bool:
        found = [float(answer(*_hidden(rng, **hidden))) for _ in range(3)]
        return low < np.median(found) < high

    known = "features that know 80 %: between 0.7 and 0.9"
    yield 2, known, lambda: between(0.7, 0.9, known=0.8)
    drift = "features that know nothing, but drift as slowly as the values: below 0.1"
    yield 2, drift, lambda: between(-9, 0.1, known=0.0, memory=0.98)
    many = "almost as many features as steps: above 0.4"
    yield 1, many, lambda: between(0.4, 0.9, known=0.8, size=120, steps=25)


def _hidden(
    rng: np.random.Generator,
    known: float,
    memory: float = 0.5,
    size: int = 20,
    steps: int = 80,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Features and values of six runs, of which the features know a share.

    Args:
        rng: of the numbers.
        known: share of the values' variance that features tell.
        memory: correlation of a number with that of the step before.
        size: how many features.
        steps: of each run.
    """
    way = rng.normal(size=(12, size))
    features = []
    values = []
    for _ in range(6):
        hidden = _slow(rng, memory, (steps, 13))
        tells = hidden[:, 0] * np.sqrt(known) + hidden[:, 12] * np.sqrt(1 - known)
        values.append(tells)
        features.append(hidden[:, :12] @ way + 0.1 * rng.normal(size=(steps, size)))
    return features, values


def _slow(
    rng: np.random.Generator, memory: float, shape: tuple[int, int]
) -> np.ndarray:
    """Random numbers of variance one that resemble those of the step before."""
    series = [rng.normal(size=shape[1])]
    for _ in range(shape[0] - 1):
        fresh = rng.normal(size=shape[1])
        series.append(memory * series[-1] + np.sqrt(1 - memory**2) * fresh)
    return np.array(series)
