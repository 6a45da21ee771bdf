"""What iterative learning knows in the middle of a run."""

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from clothlab.method.model import Memory


@dataclass(frozen=True, eq=False)
class Attempt:
    """One period: a plan, where it started, and where it led."""

    s: Tensor  # state at its start [D_s]
    memory: Memory  # recurrent state there
    u: Tensor  # the plan [T, D_u]
    p: np.ndarray  # the bias in use [D_p]
    z: Tensor  # what was seen after each command so far [T, D_z]


@dataclass(frozen=True, eq=False)
class Experience:
    """What is known in the middle of a run. It is never changed, only replaced."""

    attempts: tuple[Attempt, ...] = ()  # of the periods that are over
    # Distance that was expected of each period's plan when it was chosen [s.d. of z].
    expected: tuple[float, ...] = ()
    under_way: Attempt | None = None  # the present period
    z_ref: Tensor | None = None  # at which its plan aims [D_z]

    def expected_for(self, z_ref: Tensor) -> float | None:
        """What is expected of the plan being sent; None if it aims at another target.

        Which is another target is judged by identity: each image has a z of its own.
        """
        if self.under_way is None or self.z_ref is not z_ref:
            return None
        return self.expected[-1]
