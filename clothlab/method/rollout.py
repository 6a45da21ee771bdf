"""A policy moves a robot, and what happened is recorded: the one loop."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import trange

from clothlab.method.data import Run
from clothlab.method.model import numbers


class Policy:
    """Chooses commands: `policy(observation)` returns the command `[D_u]`.

    A policy may ignore target and bias.
    """

    name = "policy"  # in recorded trials

    def reset(self, seed: int = 0) -> None:
        """Forget the last run; `seed` is that of the policy's own random numbers."""

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from now on."""

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from now on."""

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the command `[D_u]`."""
        raise NotImplementedError


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
    observe: Callable[[Any], ArrayLike] = np.asarray,
    step: float | None = None,
    watch: Callable[[], None] | None = None,
    samples: int = 5,
    progress: bool = False,
) -> Any:
    """Let a policy move a robot for some control steps, and record what happens.

    Policy and environment are reset first. What the record is depends on `material`:

    * Without it, the environment makes a record of its own: `ClothEnv` makes a `Trial`.
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
        observe: Makes the state `[D_s]` of an observation, for a `Run`.
        step: What a control step takes [s], for a `Run` that is to know it.
        watch: Called `samples` times in each step, evenly, to film what happens
            between observations. For environments with a record of their own.
        samples: How often; with 5, a film has 25 pictures a second.
        progress: Whether a bar shows how far it is.

    Returns:
        The environment's own record, or a `Run` of T steps.

    Raises:
        EpisodeEnded: The episode was over before the last step. The error says why,
            and keeps the record of the steps so far as its `run`.
        ValueError: The environment makes no record of its own, takes commands that are
            no real numbers, or has another interface than Gymnasium's.
    """
    if not hasattr(env, "step"):
        raise ValueError(
            "env is a Gymnasium environment, such as ClothEnv(arm, cloth), got "
            f"{type(env).__name__} {env!s:.80}"
        )
    if isinstance(policy, type) or not callable(policy):
        raise TypeError(
            "a policy is called with an observation and returns a command, got "
            f"{policy!r}"
        )
    name = getattr(policy, "name", getattr(policy, "__name__", type(policy).__name__))
    if material is None:
        # The environment keeps the record, whatever wrappers change on the way.
        recording = getattr(getattr(env, "unwrapped", env), "recording", None)
        if recording is None:
            raise ValueError(
                "this environment makes no record of its own: name the material, such "
                'as rollout(..., material="heavy"), and get a Run'
            )
        with recording(watch, samples) as make_record:
            ended = _move(env, policy, steps, seed, options, progress)
        record = make_record(name, seed)
    else:
        # It is kept at the policy: what it sees and what it sends.
        _check_actions(env)
        noting = _Noting(policy, observe, env)
        ended = _move(env, noting, steps, seed, options, progress)
        states = np.stack(noting.states)
        record = Run(states, np.stack(noting.commands), material, step=step)

    if ended:
        raise EpisodeEnded(ended, record)
    return record


def _move(
    env: Any,
    policy: Callable[[Any], ArrayLike],
    steps: int,
    seed: int,
    options: dict[str, Any] | None,
    progress: bool,
) -> str:
    """The loop: why the episode was over before its last step, or nothing."""
    if hasattr(policy, "reset"):  # a plain function has none
        policy.reset(seed)
    observation = _started(env, seed, options)
    for done in trange(1, steps + 1, disable=not progress, unit="step"):
        u = np.asarray(policy(observation))
        moved = env.step(u)
        if len(moved) != 5:
            raise ValueError(_other_interface(f"`step` returns {len(moved)} values"))
        observation, _, terminated, truncated, _ = moved
        if done == steps:
            break
        where = f"after {done} of {steps} steps; they are kept as `run` of this error"
        if terminated:
            return f"the robot's task was over {where}. Use gentler commands"
        if truncated:
            return (
                f"the time limit of the environment was reached {where}: raise its "
                "`max_episode_steps`"
            )
    return ""


def _started(env: Any, seed: int, options: dict[str, Any] | None) -> Any:
    """The first observation of an episode."""
    try:
        started = env.reset(seed=seed, options=options)
    except TypeError as error:
        if "unexpected keyword argument" not in str(error):
            raise
        raise ValueError(_other_interface(f"of `reset`, {error}")) from error
    if not (isinstance(started, tuple) and len(started) == 2):
        raise ValueError(_other_interface("`reset` returns no info"))
    return started[0]


def _other_interface(difference: str) -> str:
    return (
        f"this environment has not Gymnasium's interface ({difference}), perhaps that "
        "of the older gym: wrap it, so that reset(seed=..., options=...) returns "
        "(observation, info) and step(u) returns (observation, reward, terminated, "
        "truncated, info)"
    )


class _Noting:
    """A policy of states, which notes what it saw and what it sent."""

    def __init__(self, policy: Any, observe: Callable[[Any], ArrayLike], env: Any):
        self.policy = policy
        self.observe = observe
        self.space: Any = getattr(env, "action_space", None)
        self.states: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []
        self._warned = False

    def reset(self, seed: int = 0) -> None:
        if hasattr(self.policy, "reset"):
            self.policy.reset(seed)

    def __call__(self, observation: Any) -> np.ndarray:
        # Copies: the policy may change what it is given.
        s = np.array(self.observe(observation), ndmin=1)
        self.states.append(s.copy())
        u = np.array(self.policy(s), ndmin=1)
        numbers("the command of this policy", u, u.shape)
        self.commands.append(u.copy())
        self._look_at_limits(u)
        return u

    def _look_at_limits(self, u: np.ndarray) -> None:
        """Warn of a first command that the robot may not execute as it was sent."""
        if self._warned or not hasattr(self.space, "low"):
            return
        slack = 1e-5 * np.maximum(np.abs(u), 1)
        outside = (u < self.space.low - slack) | (u > self.space.high + slack)
        if outside.any():
            self._warned = True
            k = int(np.flatnonzero(outside)[0])
            warnings.warn(
                f"command {k} (counted from 0) is {u[k]:g}, beyond the limits of this "
                "environment, which may do something else: what is recorded is what "
                "was sent. Clip it in the policy",
                stacklevel=4,
            )


def _check_actions(env: Any) -> None:
    """Refuse an environment whose commands are no real numbers."""
    space = getattr(env, "action_space", None)
    if hasattr(space, "n") or hasattr(space, "nvec"):
        raise ValueError(
            f"this environment has discrete actions, {space}: the model needs commands "
            "that are real numbers, which can follow a gradient. Look for a version of "
            "it with continuous actions (a Box)"
        )
