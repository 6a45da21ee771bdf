"""Policies that need no model: random commands, the scripted operator, replay."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_number
from clothlab.method.rollout import Policy
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.vision import Observation


class ReplayPolicy(Policy):
    """Sends recorded commands `[T, D_u]` again, whatever it sees."""

    name = "replay"

    def __init__(self, commands: ArrayLike):
        self.commands = check_array("commands", commands, ("T", "D_u"))
        self.reset()

    def reset(self, seed: int = 0) -> None:
        self._left = iter(self.commands)

    def __call__(self, observation: Observation) -> np.ndarray:
        u = next(self._left, None)
        if u is None:
            raise ValueError(
                f"only {len(self.commands)} commands were recorded: ask for no more "
                "steps than that"
            )
        return u


class RandomPolicy(Policy):
    """Uniform random commands, each held for 1 to `longest_hold` steps.

    So there are slow and fast motions, as in the paper's Random.
    """

    name = "random"

    def __init__(self, arm: Arm | str, *, longest_hold: int = 4):
        self.arm = get_arm(arm)
        self.longest_hold = check_number("longest_hold", longest_hold, int, at_least=1)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self._steps_left = 0

    def __call__(self, observation: Observation) -> np.ndarray:
        if self._steps_left == 0:
            self._u = self._rng.uniform(self.arm.command_lower, self.arm.command_upper)
            self._steps_left = int(self._rng.integers(1, self.longest_hold + 1))
        self._steps_left -= 1
        return self._u.copy()


class OperatorPolicy(Policy):
    """A scripted stand-in for the paper's human at a GUI.

    It lifts the cloth slowly and throws it down fast, which spreads it. Every swing
    draws its own height, depth, speeds and pauses. Stiffness commands are random, as in
    the paper.
    """

    name = "operator"

    def __init__(self, arm: Arm | str):
        self.arm = get_arm(arm)
        self._random = RandomPolicy(arm)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self._random.reset(seed)
        self._theta = self.arm.home_command[self.arm.angle_command]
        self._plan: Iterator[np.ndarray] = iter(())

    def __call__(self, observation: Observation) -> np.ndarray:
        theta = next(self._plan, None)
        if theta is None:
            self._plan = iter(self._swing())
            theta = next(self._plan)
        self._theta = theta
        u = self._random(observation)
        u[self.arm.angle_command] = theta
        return u

    def _swing(self) -> Sequence[np.ndarray]:
        """One swing: θ_ref `[2]` [rad] of each of its steps.

        Up in 3 to 6 steps, a pause of 0 to 2, down in 1 or 2, a pause of 1 to 3.
        """
        rng = self._rng
        lower = np.array(self.arm.lower)
        span = np.array(self.arm.upper) - lower

        # Where it turns: an angle is smaller, the higher the arm is.
        high = lower + rng.uniform(0.0, 0.35, len(lower)) * span
        low = lower + rng.uniform(0.65, 1.0, len(lower)) * span

        # The way there, without where it begins
        up = np.linspace(self._theta, high, rng.integers(3, 7) + 1)[1:]
        down = np.linspace(high, low, rng.integers(1, 3) + 1)[1:]
        rest_above = [high] * rng.integers(0, 3)
        rest_below = [low] * rng.integers(1, 4)
        return [*up, *rest_above, *down, *rest_below]
