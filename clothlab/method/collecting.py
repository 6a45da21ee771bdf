"""Runs of a robot whose episodes end, or of several robots side by side."""

import copy
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from clothlab._validation import check_each, check_number, check_seed
from clothlab.method._episodes import (
    NotingPolicy,
    check_actions,
    check_environment,
    command_space,
    is_vector,
    step_through,
)
from clothlab.method._inputs import SHORTEST, long_enough
from clothlab.method._wrapping import as_policy
from clothlab.method.data import Run
from clothlab.method.policy import Policy

# How a run can end, as a warning counts it.
_TERMINATED = "with the task (terminated)"
_TRUNCATED = "at a time limit (truncated)"
_STOPPED = "with the recording"


def collect_runs(
    env: Any,
    policy: Policy | Callable[[Any], ArrayLike],
    steps: int,
    *,
    material: str | Sequence[str],
    shortest: int = SHORTEST,
    seed: int = 0,
    options: dict[str, Any] | None = None,
    observe: Callable[[Any], ArrayLike] | None = None,
    step: float | None = None,
    progress: bool = True,
) -> list[Run]:
    """Record so many steps, over as many episodes as that takes, each a run.

    When an episode ends, whether its task was over or a time limit cut it off, the next
    begins with the next seed. Wherever wrappers change commands on the way, those
    recorded are the policy's.

    Several robots side by side, of `gymnasium.vector`, each have a copy of the policy
    with a seed of its own. What an environment shows after it has reset itself is the
    beginning of the next run, in each of Gymnasium's modes; only in the mode `DISABLED`
    the seeds of later episodes are known, too.

    Args:
        env: A Gymnasium environment, bare or in wrappers, or one of several robots.
        policy: Returns the command `[D_u]` for an observation, or for the state that
            `observe` makes of it. If it has a `reset(seed)`, each episode begins so.
        steps: How many commands are sent, in all episodes together. Several robots
            finish the step in which that number is reached.
        material: Name of what stays the same in all these episodes, such as "heavy"; of
            several robots one name for all, or one for each.
        shortest: Runs of fewer steps are left out, and a warning counts them. The
            training needs one step more than its `sequence_length`.
        seed: Of the first episode.
        options: Those of each `reset`.
        observe: Makes the state `[D_s]` of an observation of one robot.
        step: What a control step takes [s], for runs that are to know it.
        progress: Whether a bar shows how far it is.

    Returns:
        The runs, in the order in which their episodes ended.

    Raises:
        ValueError: An argument makes no sense, actions are discrete, or no run is long
            enough.
    """
    check_environment(env)
    check_actions(env)
    check_number("steps", steps, int, at_least=1)
    check_number("shortest", shortest, int, at_least=1)
    check_seed(seed)
    policy = as_policy(policy)
    materials = _materials(env, material)

    # One robot after the other, or side by side
    collect = _side_by_side if is_vector(env) else _one_after_another
    name = policy.name
    with tqdm(total=steps, desc=name, disable=not progress, unit="step") as bar:
        episodes = collect(env, policy, observe, steps, seed, options, bar)

    runs = [each.noted.run(materials[each.robot], step) for each in episodes]
    return long_enough(runs, shortest, [each.ending for each in episodes])


@dataclass
class _Episode:
    """What was noted of one robot, and how it ended."""

    noted: NotingPolicy
    robot: int  # counted from 0
    ending: str = _STOPPED


def _one_after_another(
    env: Any,
    policy: Policy,
    observe: Callable[[Any], ArrayLike] | None,
    steps: int,
    seed: int,
    options: dict[str, Any] | None,
    bar: Any,
) -> list[_Episode]:
    """Episodes of one robot, `steps` in all."""
    episodes = []
    left = steps
    while left > 0:
        episode = _Episode(NotingPolicy(policy, observe, command_space(env)), robot=0)
        episodes.append(episode)
        ending = step_through(env, episode.noted, left, seed, options, bar)
        if ending is not None:
            episode.ending = _TERMINATED if ending.terminated else _TRUNCATED
        left -= len(episode.noted.states)
        seed += 1
    return episodes


def _side_by_side(
    env: Any,
    policy: Policy,
    observe: Callable[[Any], ArrayLike] | None,
    steps: int,
    seed: int,
    options: dict[str, Any] | None,
    bar: Any,
) -> list[_Episode]:
    """Episodes of several robots, in the order in which they ended."""
    # All begin together.
    mode = _reset_mode(env, options)
    robots = _Robots(env, policy, observe, seed)
    first = list(range(seed, seed + env.num_envs))
    observations, _ = env.reset(seed=first, options=options)

    done = 0
    while done < steps:
        acting = int((~robots.resetting).sum())
        done += acting
        bar.update(acting)

        # Each robot acts, and some episodes are over.
        commands = robots.commands(observations)
        observations, _, terminated, truncated, _ = env.step(commands)
        over = terminated | truncated
        seeds = robots.end(over, terminated)

        # What they show now depends on who resets them, and when.
        robots.resetting = over if mode == _NEXT_STEP else np.zeros_like(over)
        if mode == _DISABLED and over.any():
            again = {**(options or {}), "reset_mask": over}
            observations, _ = env.reset(seed=seeds, options=again)
    return robots.ended + [each for each in robots.under_way if each.noted.states]


class _Robots:
    """Several robots, each in an episode of its own and with a policy of its own."""

    def __init__(
        self,
        env: Any,
        policy: Policy,
        observe: Callable[[Any], ArrayLike] | None,
        seed: int,
    ):
        count = env.num_envs
        self._space = command_space(env)
        self._policy = policy
        self._observe = observe
        self._seeds = itertools.count(seed)
        self._sent: list[Any] = [None] * count
        self.ended: list[_Episode] = []
        self.under_way = [self._begin(robot)[0] for robot in range(count)]
        # Whose next step is only a reset: whatever is sent then reaches nobody.
        self.resetting = np.zeros(count, bool)

    def _begin(self, robot: int) -> tuple[_Episode, int]:
        """Another episode, and its seed."""
        seed = next(self._seeds)
        policy = copy.deepcopy(self._policy)
        noted = NotingPolicy(policy, self._observe, self._space)
        noted.reset(seed)
        return _Episode(noted, robot), seed

    def commands(self, observations: Any) -> np.ndarray:
        """A command for each robot `[N, D_u]`, noted where a robot acts on it."""
        for episode in self.under_way:
            if not self.resetting[episode.robot]:
                seen = _of_one(observations, episode.robot)
                self._sent[episode.robot] = episode.noted(seen)
        return np.stack(self._sent)

    def end(self, over: np.ndarray, terminated: np.ndarray) -> list[int | None]:
        """Begin others where episodes are over `[N]`; their seeds, None elsewhere."""
        seeds: list[int | None] = [None] * len(over)
        for robot in np.flatnonzero(over):
            episode = self.under_way[robot]
            episode.ending = _TERMINATED if terminated[robot] else _TRUNCATED
            self.ended.append(episode)
            self.under_way[robot], seeds[robot] = self._begin(int(robot))
        return seeds


# How `gymnasium.vector.AutoresetMode` calls them
_NEXT_STEP = "NextStep"
_SAME_STEP = "SameStep"
_DISABLED = "Disabled"


def _reset_mode(env: Any, options: dict[str, Any] | None) -> str:
    """When robots of this environment are reset; a ValueError if it doesn't say so."""
    mode = (getattr(env, "metadata", None) or {}).get("autoreset_mode")
    mode = getattr(mode, "value", mode)
    if mode not in (_NEXT_STEP, _SAME_STEP, _DISABLED):
        raise ValueError(
            "this environment of several robots does not say when it resets one, so "
            "that runs could hold a jump: make it with Gymnasium 1.1 or later, "
            "SyncVectorEnv(..., autoreset_mode=AutoresetMode.DISABLED)"
        )
    if options and mode != _DISABLED:
        raise ValueError(
            "an environment that resets its robots itself does so without options: "
            "make it with autoreset_mode=AutoresetMode.DISABLED"
        )
    return mode


def _of_one(observations: Any, robot: int) -> Any:
    """What one robot observes, of what all do."""
    if isinstance(observations, dict):
        return {name: _of_one(part, robot) for name, part in observations.items()}
    if isinstance(observations, tuple):
        return tuple(_of_one(part, robot) for part in observations)
    return observations[robot]


def _materials(env: Any, material: str | Sequence[str]) -> list[str]:
    """The name of each robot's material."""
    count = env.num_envs if is_vector(env) else 1
    if isinstance(material, str):
        return [material] * count
    materials = check_each("the names of materials", material, str)
    if len(materials) != count:
        raise ValueError(
            f"material is one name for all, or one for each of {count} robots, got "
            f"{len(materials)}"
        )
    return materials
