"""The drivers of a live run, which choose its commands, and what the controllers among
them predict.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab.masks import Observation
from clothlab.method.data import Run
from clothlab.method.policy import Policy
from clothlab.policies import OperatorPolicy, RandomPolicy
from clothlab.simulation.arm import Arm
from clothlab.trained import Trained

DRIVERS = ("control", "iterative", "manual", "random", "operator")


class Choice(NamedTuple):
    """A command, and what its driver says about it."""

    command: np.ndarray  # [D_u], in the arm's units
    solved: bool  # whether a controller solved for it, or went on with its last plan
    # Distance that the controller predicts for the end of its period [s.d. of z]
    predicted: float | None
    period_ended: bool  # whether a period of the controller ends with it
    basis: str = ""  # what the plan of iterative learning rests on
    foreseen: np.ndarray | None = (
        None  # z that the control predicts for the end of its period [D_z]
    )


class Period(NamedTuple):
    """A controller's period that is over."""

    predicted: float  # distance that was predicted when it began [s.d. of z]
    # Distance of its last step for control, of its best step for iterative learning
    # [s.d. of z]
    achieved: float


class Drivers:
    """The policies for one arm, which may have other limits than that of the weights.

    `plans` are starts of the control `[N, horizon, D_u]`, `runs` are recordings that
    iterative learning begins with.
    """

    def __init__(
        self,
        trained: Trained,
        arm: Arm,
        target: ArrayLike,
        p: ArrayLike,
        *,
        plans: ArrayLike,
        runs: Sequence[Run],
    ):
        self._iterative = trained.iterative_controller(target, p, runs, arm=arm)
        self._controllers = {
            "control": trained.controller(target, p, plans=plans, arm=arm),
            "iterative": self._iterative,
        }
        self._arm, others = (
            arm,
            {"random": RandomPolicy(arm), "operator": OperatorPolicy(arm)},
        )
        self._policies: dict[str, Policy] = self._controllers | others
        self._period: list[
            tuple[float, float]
        ] = []  # predicted and seen distance of each step since it began
        self.began: np.ndarray | None = (
            None  # `foreseen` when the period began, until the next one begins
        )

    def reset(self, seed: int) -> None:
        """Forget the last run, and what was learned in it."""
        for policy in self._policies.values():
            policy.reset(seed)
        self._period = []

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]`."""
        for policy in self._policies.values():
            policy.set_target(mask)
        self._period = []  # it was about another target

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]`."""
        for policy in self._policies.values():
            policy.set_bias(p)

    def resume(self) -> None:
        """Let the controllers begin a period: phase, memory and plan are of their last
        turn. What was learned stays.
        """
        self._controllers["control"].reset()
        self._iterative.resume()
        self._period = []

    def choose(
        self,
        driver: str,
        observation: Observation,
        *,
        hand: np.ndarray,
        solve: bool,
        exploring: bool,
    ) -> Choice:
        """Ask a driver for a command; `hand` is the manual one `[D_u]`; without
        `solve`, the last plan goes on.
        """
        if driver not in self._controllers:
            u = np.clip(hand, self._arm.command_lower, self._arm.command_upper)
            if driver != "manual":
                u = self._policies[driver](observation)
            return Choice(u, solved=False, predicted=None, period_ended=False)
        controller, self._iterative.exploring = self._controllers[driver], exploring
        before = controller.solves
        u = (controller if solve else controller.step_without_solving)(observation)
        basis, foreseen = (
            getattr(controller, "basis", ""),
            getattr(controller, "foreseen", None),
        )
        solved, predicted = controller.solves > before, controller.predicted_distance
        return Choice(u, solved, predicted, controller.period_ended, basis, foreseen)

    def close_period(
        self, driver: str, choice: Choice, distance: float
    ) -> Period | None:
        """Take in the distance seen after a choice [s.d. of z]; answers at the end of a
        controller's period.
        """
        if choice.predicted is not None:
            self.began = self.began if self._period else choice.foreseen
            self._period.append((choice.predicted, distance))
        if not choice.period_ended or not self._period:
            return None
        period, self._period = np.array(self._period), []
        achieved = period[:, 1].min() if driver == "iterative" else period[-1, 1]
        return Period(float(period[0, 0]), float(achieved))
