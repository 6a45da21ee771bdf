"""All that belongs together after a training: arm, autoencoder, model, and p of each material."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import choose
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import ControlPolicy, ControlSettings
from clothlab.learning.dpmpb import DPMPB, Sequences, to_sequences
from clothlab.learning.iterative import PracticePolicy, PracticeSettings
from clothlab.simulation.arm import Arm, StateLayout
from clothlab.trials import Trial


@dataclass(frozen=True, eq=False)
class Trained:
    """What belongs together: an arm, the autoencoder of what its camera sees, a model, and p of each material.

    Attributes:
        name: of the weights, such as `torque-0`.
        arm: the arm.
        autoencoder: image ↔ z.
        model: the DPMPB that was trained on its z.
        biases: trained p of each material, `{name: [D_p]}`.
        losses: mean squared error of each epoch of the model's training, `[epochs]`.
        sees_with: name of the autoencoder.
    """

    name: str
    arm: Arm
    autoencoder: Autoencoder
    model: DPMPB
    biases: dict[str, np.ndarray]
    losses: np.ndarray
    sees_with: str

    @property
    def layout(self) -> StateLayout:
        """Where things lie in the state `s`."""
        return self.arm.layout(self.autoencoder.latent_size)

    def sequences(self, trial: Trial) -> Sequences:
        """States and commands of a recorded trial of this arm, as the model sees them."""
        if trial.arm != self.arm.name:
            raise ValueError(f"this trial is of the {trial.arm} arm, these weights are of the {self.arm.name} arm")
        return to_sequences(self.autoencoder, trial)

    def controller(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        settings: ControlSettings | None = None,
        plans: ArrayLike | None = None,
        *,
        arm: Arm | None = None,
    ) -> ControlPolicy:
        """A controller with this model.

        Args:
            target: mask `[H, W]`.
            p: parametric bias `[D_p]`, or the name of a trained material.
            settings: the paper's constants.
            plans: starts, as `ControlPolicy` has them.
            arm: one with other limits, such as `arm.with_stiffness(10)`.
        """
        return ControlPolicy(self.model, self.autoencoder, arm or self.arm, target, self._bias(p), settings, plans)

    def practice(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        runs: Sequence[Sequences],
        settings: PracticeSettings | None = None,
        *,
        arm: Arm | None = None,
    ) -> PracticePolicy:
        """A controller with this model that learns from its outcomes.

        Args:
            target: mask `[H, W]`.
            p: parametric bias `[D_p]`, or the name of a trained material.
            runs: recordings to begin with, as `sequences` gives them.
            settings: how much is tried, and how far an outcome teaches.
            arm: one with other limits, such as `arm.with_stiffness(10)`.
        """
        return PracticePolicy(self.model, self.autoencoder, arm or self.arm, target, self._bias(p), runs, settings)

    def _bias(self, p: ArrayLike | str) -> ArrayLike:
        return choose("material", p, self.biases) if isinstance(p, str) else p
