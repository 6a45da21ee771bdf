"""One episode of one robot: the loop, and a note of what was seen and sent."""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array
from clothlab.method.data import Run
from clothlab.method.policy import Policy


class Ending(NamedTuple):
    """An episode that was over too early."""

    terminated: bool  # by the task itself; else a time limit cut it off
    done: int  # steps until then


def step_through(
    env: Any,
    policy: Policy,
    steps: int,
    seed: int,
    options: dict[str, Any] | None,
    bar: Any,
) -> Ending | None:
    """Reset both and make the steps; the ending, if there was one before the last.

    Args:
        env: a Gymnasium environment.
        policy: that moves it.
        steps: at most.
        seed: of both.
        options: of the environment's `reset`.
        bar: of progress.
    """
    policy.reset(seed)
    observation, _ = env.reset(seed=seed, options=options)
    for step in range(steps):
        u = policy(observation)
        observation, _, terminated, truncated, _ = env.step(u)
        bar.update()
        if (terminated or truncated) and step + 1 < steps:
            return Ending(bool(terminated), step + 1)
    return None


class NotingPolicy(Policy):
    """A policy of states, which notes what it saw and what it sent."""

    def __init__(
        self,
        policy: Policy,
        observe: Callable[[Any], ArrayLike] | None,
        space: Any = None,  # of the robot's commands, where it is known
    ):
        self.policy: Any = policy  # here, its observation is a state
        self._shape = getattr(space, "shape", None) or ("D_u",)
        self._low = getattr(space, "low", -np.inf)
        self._high = getattr(space, "high", np.inf)
        self.name = policy.name
        self.observe = observe or np.asarray
        self.states: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []
        self._told = False  # of commands beyond limits

    def reset(self, seed: int = 0) -> None:
        self.policy.reset(seed)

    def __call__(self, observation: Any) -> np.ndarray:
        s = np.array(self.observe(observation), ndmin=1)
        check_array("the state that `observe` makes", s, ("D_s",))
        # A copy: the policy may change what it is given.
        self.states.append(s.copy())

        u = np.array(self.policy(s), ndmin=1)
        check_array(f"the command of {self.name}", u, self._shape)
        self._look_at_limits(u)
        self.commands.append(u.copy())
        return u

    def _look_at_limits(self, u: np.ndarray) -> None:
        """Warn of a first command that the robot may not execute as it was sent."""
        slack = 1e-5 * np.maximum(np.abs(u), 1)
        outside = (u < self._low - slack) | (u > self._high + slack)
        if outside.any() and not self._told:
            self._told = True
            k = int(np.flatnonzero(outside)[0])
            warnings.warn(
                f"command {k} (counted from 0) of {self.name} is {u[k]:g}, beyond the "
                "limits of this environment, which may do something else: what is "
                "recorded is what was sent. Clip it in the policy",
                stacklevel=5,
            )

    def run(self, material: str, step: float | None) -> Run:
        """What was noted, as a run of this material."""
        return Run(np.stack(self.states), np.stack(self.commands), material, step=step)


def check_environment(env: Any) -> None:
    """A ValueError for what is no Gymnasium environment."""
    methods = (getattr(env, name, None) for name in ("reset", "step"))
    if isinstance(env, type) or not all(map(callable, methods)):
        raise ValueError(
            "env is a Gymnasium environment, such as ClothEnv(arm, cloth), "
            f"got {type(env).__name__} {env!s:.80}"
        )


def is_vector(env: Any) -> bool:
    """Whether an environment holds several robots, as those of `gymnasium.vector`."""
    return hasattr(env, "num_envs")


def command_space(env: Any) -> Any:
    """The space of one robot's commands; None where the environment has none."""
    name = "single_action_space" if is_vector(env) else "action_space"
    return getattr(env, name, None)


def check_actions(env: Any) -> None:
    """A ValueError for an environment whose actions are no vector of real numbers."""
    space = command_space(env)
    # Choices have a number of them, and composed actions the spaces of their parts.
    if hasattr(space, "n") or hasattr(space, "nvec"):
        raise ValueError(
            f"this environment has discrete actions, {space}: the model needs commands "
            "that are real numbers, which can follow a gradient. Look for a version of "
            "it with continuous actions (a Box)"
        )
    if hasattr(space, "spaces"):
        raise ValueError(
            f"this environment has actions of several parts, {space}: wrap it so that "
            "a command is one vector of real numbers (FlattenAction)"
        )
