"""What the method asks of an arm; those of `clothlab.simulation.arm` have it."""

from typing import Protocol

import numpy as np


class Layout(Protocol):
    """Where things lie in the state s = (z, robot state)."""

    @property
    def size(self) -> int:
        """D_s."""

    @property
    def z(self) -> slice:
        """The latent image."""

    @property
    def tensions(self) -> slice:
        """The muscle tensions [N]; empty for an arm without muscles."""


class ControlledArm(Protocol):
    """An arm whose commands a policy may send."""

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest command, `[D_u]`."""

    @property
    def command_upper(self) -> np.ndarray:
        """Largest command, `[D_u]`."""

    @property
    def home_command(self) -> np.ndarray:
        """The command that the first plan repeats, `[D_u]`."""

    def layout(self, latent_size: int) -> Layout:
        """Where things lie in s, for a z of so many numbers."""
