"""What a policy is."""

import numpy as np
from numpy.typing import ArrayLike

from clothlab.masks import Observation


class Policy:
    """Chooses commands: `policy(observation)` returns the command `[D_u]`.

    A policy may ignore target and bias.
    """

    name = "policy"  # in recorded trials

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, before a new one.

        `seed` is that of the policy's own random numbers.
        """

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from now on."""

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from now on."""

    def __call__(self, observation: Observation) -> np.ndarray:
        """Return the command `[D_u]`."""
        raise NotImplementedError
