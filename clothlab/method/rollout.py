"""The one loop: a policy moves a robot, and what happened is recorded."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from clothlab._validation import check_array, check_kind, check_number, check_seed
from clothlab.method._wrapping import as_policy
from clothlab.method.data import Run
from clothlab.method.policy import Policy


class EpisodeEnded(ValueError):
    """An episode was over too early: `run` is the record of the steps so far."""

    def __init__(self, message: str, run: Any):
        super().__init__(message)
        self.run = run


def rollout(
    env: Any,
    policy: Policy | Callable[[Any], ArrayLike],
    steps: int,
    *,
    seed: int = 0,
    options: dict[str, Any] | None = None,
    material: str | None = None,
    observe: Callable[[Any], ArrayLike] | None = None,
    watch: Callable[[], None] | None = None,
    samples: int = 5,
    progress: bool = False,
) -> Any:
    """Let a policy move a robot for some control steps, and record what happens.

    Policy and environment are reset first. What the record is depends on `material`:

    * Without it, the environment makes a record of its own: `ClothEnv` makes a `Trial`,
      of what it saw and of the commands that reached the arm, whatever wrappers change
      on the way.
    * With it, any robot's run is a `Run`: states and commands as the policy saw and
      sent them.

    Args:
        env: A Gymnasium environment, bare or in wrappers.
        policy: Returns the command `[D_u]` for an observation, or for the state that
            `observe` makes of it. If it has a `reset(seed)`, that is called first.
        steps: The number T of control steps.
        seed: Of the random numbers of policy and environment.
        options: Those of the environment's `reset`: `{"random_start": True}` lets a
            `ClothEnv` begin in another posture than the arm's home.
        material: Name of what stays the same within the run and differs between runs,
            such as "heavy". Runs of one name share one p.
        observe: Makes the state `[D_s]` of an observation, for a `Run`; without it,
            the observation is the state.
        watch: Called `samples` times in each step, evenly, to film what happens
            between observations. For environments with a record of their own.
        samples: How often; with 5, a film has 25 pictures a second.
        progress: Whether a bar shows how far it is.

    Returns:
        The environment's own record, or a `Run` of T steps.

    Raises:
        EpisodeEnded: The episode was over before the last step. The error says why,
            and keeps the record of the steps so far as its `run`.
        ValueError: A command is not one of this robot; it was not sent. Or an argument
            makes no sense, before the first step.
    """
    _check_environment(env)
    check_number("steps", steps, int, at_least=1)
    check_seed(seed)
    policy = as_policy(policy)

    if material is None:
        # The environment keeps the record.
        with _own_recording(env, observe)(watch, samples) as make_record:
            ended = _step_through(env, policy, steps, seed, options, progress)
        record = make_record(policy.name, seed)
    else:
        # It is kept at the policy: what it sees and what it sends.
        check_kind("material", material, str)
        if watch is not None:
            raise ValueError(
                "only an environment's own record can be watched: leave out material"
            )
        noting = _NotingPolicy(policy, observe or np.asarray)
        ended = _step_through(env, noting, steps, seed, options, progress)
        record = Run(np.stack(noting.states), np.stack(noting.commands), material)

    if ended:
        raise EpisodeEnded(ended, record)
    return record


def _step_through(
    env: Any,
    policy: Policy,
    steps: int,
    seed: int,
    options: dict[str, Any] | None,
    progress: bool,
) -> str:
    """Reset both and make the steps; why the episode ended too early, if it did."""
    policy.reset(seed)
    observation, _ = env.reset(seed=seed, options=options)
    bar = tqdm(range(steps), desc=policy.name, disable=not progress, unit="step")
    for step in bar:
        u = policy(observation)
        observation, _, terminated, truncated, _ = env.step(u)
        if (terminated or truncated) and step + 1 < steps:
            return _why_it_ended(terminated, step + 1, steps)
    return ""


class _NotingPolicy(Policy):
    """A policy of states, which notes what it saw and what it sent."""

    def __init__(self, policy: Policy, observe: Callable[[Any], ArrayLike]):
        self.policy: Any = policy  # here, its observation is a state
        self.name = policy.name
        self.observe = observe
        self.states: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []

    def reset(self, seed: int = 0) -> None:
        self.policy.reset(seed)

    def __call__(self, observation: Any) -> np.ndarray:
        s = np.array(self.observe(observation), ndmin=1)
        check_array("the state that `observe` makes", s, ("D_s",))
        # A copy: the policy may change what it is given.
        self.states.append(s.copy())

        u = np.array(self.policy(s), ndmin=1)
        check_array(f"the command of {self.name}", u, ("D_u",))
        self.commands.append(u.copy())
        return u


def _check_environment(env: Any) -> None:
    methods = (getattr(env, name, None) for name in ("reset", "step"))
    if isinstance(env, type) or not all(map(callable, methods)):
        raise ValueError(
            "env is a Gymnasium environment, such as ClothEnv(arm, cloth), "
            f"got {type(env).__name__} {env!s:.80}"
        )


def _own_recording(env: Any, observe: Callable | None) -> Callable:
    """How the environment records itself; a ValueError if it can't, or shouldn't."""
    recording = getattr(getattr(env, "unwrapped", env), "recording", None)
    if recording is None:
        raise ValueError(
            "this environment makes no record of its own: name the material, such as "
            'rollout(..., material="heavy"), and get a Run'
        )
    if observe is not None:
        raise ValueError("observe makes states of a Run: name its material, too")
    return recording


def _why_it_ended(terminated: bool, done: int, steps: int) -> str:
    """Advice for an episode that was over after `done` of `steps` steps."""
    where = f"after {done} of {steps} steps; they are kept as `run` of this error"
    if terminated:
        return (
            f"the robot's task was over {where}. Use gentler commands, or record "
            "several short runs"
        )
    return (
        f"the time limit of the environment was reached {where}: "
        "raise its `max_episode_steps`"
    )
