"""What a rule of estimation is: given a window and p, how does p move?"""

from typing import Any, NamedTuple, Protocol

import numpy as np
from torch import Tensor

from clothlab.method.model import DPMPB

LARGEST_LOSS = 1e38  # nearly the largest number in single precision


class Window(NamedTuple):
    """The last steps that were observed."""

    s: Tensor  # states [T, D_s]
    u: Tensor  # commands [T, D_u]
    warmup: int  # first steps, which only fill the memory


class Moved(NamedTuple):
    """What a rule makes of p."""

    p: np.ndarray  # the new estimate [D_p]
    loss: float  # of the old one
    carried: Any = None  # what the rule wants to be given in the next step


class Rule(Protocol):
    """How an estimate moves when a step has been observed."""

    window: int  # steps that it looks back

    def warmup(self, count: int) -> int | None:
        """How many first of so many steps only fill the memory.

        None where there is nothing to judge yet.
        """

    def move(self, model: DPMPB, window: Window, p: np.ndarray, carried: Any) -> Moved:
        """p `[D_p]` after one step; `carried` is None in the first."""
