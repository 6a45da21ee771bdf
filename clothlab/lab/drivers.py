"""The drivers of a live run, which choose its commands.

The controllers among them predict, and what they predict is kept with each command.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab.method.cloth_task import ControlPolicy
from clothlab.method.data import Run
from clothlab.method.rollout import Policy
from clothlab.policies import OperatorPolicy, RandomPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.vision import Observation
from clothlab.weights import ClothCheckpoint

DRIVERS = ("control", "iterative", "manual", "random", "operator")


class Choice(NamedTuple):
    """A command, and what its driver says about it."""

    command: np.ndarray  # [D_u], in the arm's units
    solved: bool  # whether a controller solved for it, or went on with its last plan
    # Distance that the controller predicts for the end of its period [s.d. of z]
    predicted: float | None
    period_ended: bool  # whether a period of the controller ends with it
    basis: str = ""  # what the plan of iterative learning rests on


class Period(NamedTuple):
    """A controller's period that has ended."""

    predicted: float  # distance that was predicted when it began [s.d. of z]
    achieved: float  # that of its last step [s.d. of z]


class Drivers:
    """The policies for one arm, which may have other limits than that of the weights.

    Args:
        trained: weights, with autoencoder and materials.
        arm: the arm that is driven.
        target: image to aim at `[H, W]`.
        p: parametric bias `[D_p]`.
        plans: starts of the control `[N, horizon, D_u]`.
        runs: recordings that iterative learning begins with.
    """

    def __init__(
        self,
        trained: ClothCheckpoint,
        arm: Arm,
        target: ArrayLike,
        p: ArrayLike,
        *,
        plans: ArrayLike,
        runs: Sequence[Run],
    ):
        # Those that predict, and all that choose by themselves
        self._arm = arm
        iterative = trained.iterative_controller(target, p, runs, arm=arm)
        self._learning = iterative.controller
        self._controllers: dict[str, ControlPolicy] = {
            "control": trained.controller(target, p, plans=plans, arm=arm),
            "iterative": iterative,
        }
        self._policies: dict[str, Policy] = {
            **self._controllers,
            "random": RandomPolicy(arm),
            "operator": OperatorPolicy(arm),
        }

        # Predicted distance of each step since the period began
        self._period: list[float] = []

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
        """Let the controllers begin a period.

        Phase, memory and plan are of their last turn; what was learned stays.
        """
        for policy in self._controllers.values():
            policy.controller.resume()
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
        """Ask a driver for a command.

        Args:
            driver: one of `DRIVERS`.
            observation: what the robot sees now.
            hand: command of the driver "manual" `[D_u]`.
            solve: whether a controller solves, or goes on with its last plan.
            exploring: whether iterative learning tries new plans.
        """
        # A person, or what doesn't predict
        if driver not in self._controllers:
            if driver == "manual":
                arm = self._arm
                u = np.clip(hand, arm.command_lower, arm.command_upper)
            else:
                u = self._policies[driver](observation)
            return Choice(u, solved=False, predicted=None, period_ended=False)

        # A controller, and what it says of its command
        policy = self._controllers[driver]
        controller = policy.controller
        self._learning.exploring = exploring
        solves = len(controller.trace)
        u = policy(observation, solve=solve)
        return Choice(
            command=u,
            solved=len(controller.trace) > solves,
            predicted=policy.predicted_distance,
            period_ended=controller.period_ended,
            basis=self._learning.basis if controller is self._learning else "",
        )

    def close_period(self, choice: Choice, distance: float) -> Period | None:
        """Take in the distance seen after a choice [s.d. of z].

        Answers at the end of a controller's period.
        """
        if choice.predicted is not None:
            self._period.append(choice.predicted)
        if not choice.period_ended or not self._period:
            return None

        predicted = self._period[0]
        self._period = []
        return Period(float(predicted), float(distance))
