"""What belongs together after a training: arm, autoencoder, model, and p of each
material.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import ControlPolicy
from clothlab.method.control import ControlSettings, GradientSearch, Search
from clothlab.method.data import Run
from clothlab.method.iterative import IterativeLearningSettings, IterativeSearch
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import Arm, StateLayout
from clothlab.trials import Trial, to_run


@dataclass(frozen=True, eq=False)
class Trained:
    """An arm, the autoencoder of what its camera sees, a model, and p of each material."""

    name: str  # of the weights, such as torque-0
    arm: Arm
    autoencoder: Autoencoder
    model: DPMPB  # trained on the z of this autoencoder
    biases: dict[str, np.ndarray]  # trained p of each material, {name: [D_p]}
    # Mean squared error of each epoch of the model's training, [epochs]
    losses: np.ndarray
    autoencoder_name: str

    @property
    def layout(self) -> StateLayout:
        """Where things lie in the state `s`."""
        return self.arm.layout(self.autoencoder.latent_size)

    def to_run(self, trial: Trial) -> Run:
        """States and commands of a recorded trial, as the model sees them."""
        return to_run(self.autoencoder, trial)

    def controller(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        settings: ControlSettings | None = None,
        plans: ArrayLike | None = None,
        *,
        arm: Arm | None = None,
    ) -> ControlPolicy:
        """The paper's controller with this model.

        Args:
            target: mask `[H, W]`.
            p: parametric bias `[D_p]`, or the name of a trained material.
            settings: the constants of the control.
            plans: recorded ones from which a period may start, `[N, horizon, D_u]`.
            arm: one with other limits, such as `arm.with_stiffness(10)`.
        """
        search = GradientSearch(plans)
        return self._policy(target, p, settings, search, arm)

    def iterative_controller(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        runs: Sequence[Run],
        settings: IterativeLearningSettings | None = None,
        *,
        arm: Arm | None = None,
    ) -> ControlPolicy:
        """Iterative learning control with this model.

        Args:
            target: mask `[H, W]`.
            p: parametric bias `[D_p]`, or the name of a trained material.
            runs: recordings to begin with, as `to_run` gives them.
            settings: how much is tried, and how far an outcome teaches.
            arm: one with other limits, such as `arm.with_stiffness(10)`.
        """
        search = IterativeSearch(runs, settings, biases=self.biases)
        return self._policy(target, p, None, search, arm)

    def _policy(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        settings: ControlSettings | None,
        search: Search,
        arm: Arm | None,
    ) -> ControlPolicy:
        bias = choose("material", p, self.biases) if isinstance(p, str) else p
        return ControlPolicy(
            self.model,
            self.autoencoder,
            arm or self.arm,
            target,
            bias,
            settings,
            search=search,
        )
