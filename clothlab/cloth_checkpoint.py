"""A checkpoint of a robot that handles cloth: its arm is one that can be simulated."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from clothlab._files import OtherKindError
from clothlab._validation import check_kind, choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.checkpoint import Checkpoint
from clothlab.method.cloth_task import ControlPolicy
from clothlab.method.control import ControlSettings, GradientSearch, Search
from clothlab.method.data import Run
from clothlab.method.iterative import IterativeLearningSettings, IterativeSearch
from clothlab.simulation._arm_data import arm_data, arm_from_data, get_arm
from clothlab.simulation._state_layout import StateLayout
from clothlab.simulation.arm import Arm
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.trials import Trial, to_run


@dataclass(frozen=True, eq=False, kw_only=True)
class ClothCheckpoint(Checkpoint):
    """A model, p of each cloth, the arm, and the autoencoder of what its camera sees.

    The arm says what the states and commands are.
    """

    arm: Arm  # or the name of one of `ARMS`
    autoencoder: Autoencoder
    step: float | None = CONTROL_PERIOD  # [s]

    def __post_init__(self) -> None:
        object.__setattr__(self, "arm", get_arm(self.arm))
        check_kind("autoencoder", self.autoencoder, Autoencoder)
        object.__setattr__(self, "state_names", self.layout.names)
        object.__setattr__(self, "command_names", self.arm.command_names)
        super().__post_init__()

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
            target: mask `[H, W]` to realise once a period.
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
            target: mask `[H, W]` to realise once a period.
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
        """A controller with one search or another."""
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

    def _arm_to_data(self) -> Any:
        return arm_data(self.arm)

    @classmethod
    def _arm_from_data(cls, data: Any) -> Arm:
        if data is None:
            raise OtherKindError("it has no arm; `Checkpoint.load` reads it")
        return arm_from_data(data)
