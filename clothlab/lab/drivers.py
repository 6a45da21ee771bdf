"""Who can choose the commands of a live run, and what came of what the controllers among them promised."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab.learning.dpmpb import Sequences
from clothlab.learning.trained import Trained
from clothlab.policies import OperatorPolicy, Policy, RandomPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.env import Observation

DRIVERS = ("control", "iterative", "manual", "random", "operator")


class Choice(NamedTuple):
    """A command, and what its driver says about it."""

    command: np.ndarray  # [D_u], in the arm's units
    solved: bool  # whether a controller solved for it, or went on with its last plan
    predicted: float | None  # distance that the controller promises for the end of its period [s.d. of z]
    period_ended: bool  # whether a period of the controller ends with it


class Period(NamedTuple):
    """A controller's period that is over."""

    predicted: float  # expected distance, as it was when the period began [s.d. of z]
    achieved: float  # what came of it [s.d. of z]: control aims at the last step of a period, practice at the best


ACHIEVED: dict[str, Callable[[Sequence[float]], float]] = {"control": lambda away: away[-1], "iterative": min}


class PredictionLog:
    """Keeps what the controller that drives promised, until its period is over and shows what came of it."""

    def __init__(self) -> None:
        self._predicted: float | None = None
        self._distances: list[float] = []

    def interrupt(self) -> None:
        """Forget the promise of a period under way: it was about another target."""
        self._predicted = None

    def add(self, driver: str, choice: Choice, distance: float) -> Period | None:
        """Take in a step and the distance seen after it [s.d. of z]; answers at the end of a period."""
        if driver not in ACHIEVED:
            return None
        if not self._distances:
            self._predicted = choice.predicted
        self._distances.append(distance)
        if not choice.period_ended:
            return None
        predicted, distances = self._predicted, self._distances
        self._predicted, self._distances = None, []
        return None if predicted is None else Period(predicted, ACHIEVED[driver](distances))


class ManualPolicy(Policy):
    """Sends what a person's sliders say, within the range of the arm."""

    name = "manual"

    def __init__(self, arm: Arm, u: np.ndarray):
        self.arm, self.u = arm, u

    def __call__(self, observation: Observation) -> np.ndarray:
        return np.clip(self.u, self.arm.command_lower, self.arm.command_upper)


def stick_command(arm: Arm, places: Sequence[float]) -> np.ndarray:
    """Command `[D_u]` where sticks and trigger stand in its range, 0 to 1; more places than commands are left out."""
    lower, upper = arm.command_lower, arm.command_upper
    return lower + np.clip(places[: len(lower)], 0, 1) * (upper - lower)


class Drivers:
    """The policies for one arm with one range of commands.

    Args:
        trained: model, autoencoder.
        arm: that of the weights, or one with other limits.
        target: mask `[H, W]`.
        p: parametric bias `[D_p]`.
        hand: the command `[D_u]` that the hand begins with.
        plans: starts of the control, `[N, horizon, D_u]`.
        runs: recordings that practice begins with.

    Attributes:
        account: of what the controller that drives promised.
    """

    def __init__(
        self,
        trained: Trained,
        arm: Arm,
        target: ArrayLike,
        p: ArrayLike,
        hand: np.ndarray,
        *,
        plans: ArrayLike,
        runs: Sequence[Sequences],
    ):
        self._iterative = trained.iterative_controller(target, p, runs, arm=arm)
        self._controllers = {
            "control": trained.controller(target, p, plans=plans, arm=arm),
            "iterative": self._iterative,
        }
        self._hand = ManualPolicy(arm, hand)
        others = {"manual": self._hand, "random": RandomPolicy(arm), "operator": OperatorPolicy(arm)}
        self._policies: dict[str, Policy] = self._controllers | others
        self.account = PredictionLog()

    def reset(self, seed: int) -> None:
        """Everybody forgets the last run, and what was learned in it."""
        for policy in self._policies.values():
            policy.reset(seed)
        self.account = PredictionLog()

    def set_target(self, mask: ArrayLike) -> None:
        """Everybody aims at another image `[H, W]`."""
        for policy in self._policies.values():
            policy.set_target(mask)
        self.account.interrupt()

    def set_bias(self, p: ArrayLike) -> None:
        """Everybody uses another parametric bias `[D_p]`."""
        for policy in self._policies.values():
            policy.set_bias(p)

    def set_hand(self, u: np.ndarray) -> None:
        """The hand sends this command `[D_u]`."""
        self._hand.u = u

    def resume(self) -> None:
        """Let the controllers begin a period: phase, memory and plan are of when they last drove. Practice stays."""
        self._controllers["control"].reset()
        self._iterative.resume()
        self.account = PredictionLog()

    def choose(self, driver: str, observation: Observation, *, solve: bool, exploring: bool) -> Choice:
        """Ask one of `DRIVERS` for a command.

        Args:
            driver: whom.
            observation: what the robot sees.
            solve: False lets a controller go on with its last plan, unless it has none yet.
            exploring: whether practice tries new plans.
        """
        if driver not in self._controllers:
            return Choice(self._policies[driver](observation), solved=False, predicted=None, period_ended=False)
        controller, self._iterative.exploring = self._controllers[driver], exploring
        before = len(controller.trace)
        u = (controller if solve else controller.step_without_solving)(observation)
        return Choice(u, len(controller.trace) > before, controller.predicted_distance, controller.period_ended)
