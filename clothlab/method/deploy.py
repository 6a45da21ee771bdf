"""A beat and ranges: what a loop on a real robot needs beside its controller.

`examples/loop_at_20_hz.py` puts all of them together in one thread. Not in the paper.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_names, check_number
from clothlab.method._inputs import check_runs
from clothlab.method.data import Run


@dataclass(frozen=True, eq=False)
class Ranges:
    """Between which values states and commands lay in the training data.

    Nothing keeps a network from answering outside of them, and nothing there makes its
    answers right. A `Checkpoint` keeps them.
    """

    s: np.ndarray  # the lowest and the highest states [2, D_s]
    u: np.ndarray  # the lowest and the highest commands [2, D_u]

    def __post_init__(self) -> None:
        for name in ("s", "u"):
            what = f"the range of {name}"
            found = check_array(what, getattr(self, name), (2, f"D_{name}"))
            if not (found[0] <= found[1]).all():
                raise ValueError(f"{what} has a lowest value above its highest")
            object.__setattr__(self, name, found)

    @classmethod
    def of(cls, runs: Sequence[Run]) -> "Ranges":
        """Those of these runs, which are all of the same robot."""
        runs = check_runs(runs)
        if not runs:
            raise ValueError("no runs to take ranges from")
        return cls(_range([run.s for run in runs]), _range([run.u for run in runs]))


class RangeWatch:
    """Says once of each sensor that it has left what the model was trained on.

    A number that never changed in training is left out by the model, so that it counts
    as inside wherever it is; but that it has changed is said.

    Args:
        ranges: of the training data.
        names: of the numbers of s, for the warning, such as `Checkpoint.state_names`.
        margin: share of its range by which a number may lie outside, without a word.
    """

    def __init__(
        self, ranges: Ranges, names: Sequence[str] = (), *, margin: float = 0.1
    ):
        size = ranges.s.shape[1]
        check_names("states", names, size)
        counted = [f"state {k} (counted from 0)" for k in range(size)]
        self._names = list(names) or counted
        margin = check_number("margin", margin, at_least=0)
        self._ranges = ranges
        self._heard = ranges.s[0] < ranges.s[1]
        reach = margin * (ranges.s[1] - ranges.s[0])
        self._lowest = ranges.s[0] - reach
        self._highest = ranges.s[1] + reach
        self._told = np.zeros(size, bool)

    def __call__(self, s: ArrayLike) -> np.ndarray:
        """Which numbers of a state `[D_s]` are outside, `[D_s]` bool.

        The first time that one is, there is a warning with its name and its range. A
        sensor that says nothing (NaN) is outside.
        """
        s = np.asarray(s, np.float64)
        check_array("s", np.nan_to_num(s), self._told.shape)
        outside = ~((s >= self._lowest) & (s <= self._highest))
        for k in np.flatnonzero(outside & ~self._told):
            warnings.warn(self._sentence(int(k), s[k]), stacklevel=2)
        self._told |= outside
        return outside & (self._heard | np.isnan(s))

    def _sentence(self, k: int, value: float) -> str:
        """What is said of the k-th number of a state."""
        low, high = self._ranges.s[:, k]
        name = self._names[k]
        if np.isnan(value):
            return f"{name} says nothing (NaN): no plan can be made from such a state"
        if low == high:
            return (
                f"{name} is {value:.4g}, and was always {low:.4g} in training: the "
                "model leaves it out. If it matters, record it at other values"
            )
        return (
            f"{name} is {value:.4g}, and was between {low:.4g} and {high:.4g} in "
            "training: do not trust p and plans here. Go back there, or record such "
            "motions and train again"
        )


class Beat:
    """Cycles of one length, counted from one start, so that delays do not add up.

    A cycle that begins less than half its length late begins at once. After a longer
    delay, cycles are missed: the next one begins when it would have begun anyway.

    Args:
        period: of a cycle [s], the step of the model.
        clock: a time [s] that never goes back.
        sleep: waits so long [s].
    """

    def __init__(
        self,
        period: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.period = check_number("period", period, above=0)
        self._clock = clock
        self._sleep = sleep
        self._start: float | None = None
        self._count = 0  # cycles since the start, missed ones among them
        self.late = 0  # cycles whose work took longer than a period
        self.missed = 0  # cycles that did not take place

    def wait(self) -> int:
        """Wait until the next cycle begins; how many were missed before it."""
        now = self._clock()
        if self._start is None:
            self._start = now
            return 0

        # Is it late, and by how much?
        self._count += 1
        behind = now - self._start - self._count * self.period
        missed = 0
        if behind > 0:
            self.late += 1
            missed = int(behind / self.period + 0.5)
            self.missed += missed
            self._count += missed

        left = self._start + self._count * self.period - now
        if left > 0:
            self._sleep(left)
        return missed

    @property
    def due(self) -> float:
        """When the present cycle should have begun, from the first one on [s]."""
        return self._count * self.period


def _range(values: list[np.ndarray]) -> np.ndarray:
    lowest = np.min([each.min(axis=0) for each in values], axis=0)
    highest = np.max([each.max(axis=0) for each in values], axis=0)
    return np.stack([lowest, highest]).astype(np.float64)
