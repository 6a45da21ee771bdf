"""A policy moves a robot, and what happened is recorded: the one loop."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import trange

from clothlab._validation import check_array, check_kind, check_number, check_seed
from clothlab.masks import Observation
from clothlab.method.data import Run


class Policy:
    """Chooses commands: `policy(observation)` returns the command `[D_u]`.

    A policy may ignore target and bias.
    """

    name = "policy"  # in recorded trials

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, before a new one.

        `seed` is that of the policy's own random numbers.
        """

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from now on."""

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from now on."""

    def __call__(self, observation: Observation) -> np.ndarray:
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
    observe: Callable[[Any], ArrayLike] | None = None,
    step: float | None = None,
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
        ValueError: A command is not one of this robot; it was not sent. Or an argument
            makes no sense, before the first step.
    """
    _check_robot(env)
    _check_policy(policy)
    check_number("steps", steps, int, at_least=1)
    check_seed(seed)
    name = _name(policy)

    if material is None:
        # The environment keeps the record.
        with _own_recording(env, observe)(watch, samples) as make_record:
            ended = _move(env, policy, steps, seed, options, progress)
        record = make_record(name, seed)
    else:
        # It is kept at the policy: what it sees and what it sends.
        check_kind("material", material, str)
        if watch is not None:
            raise ValueError(
                "only an environment's own record can be watched: leave out material"
            )
        noting = _Noting(policy, observe, getattr(env, "action_space", None))
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
    reset = getattr(policy, "reset", None)  # a plain function has none
    if callable(reset):
        reset(seed)
    observation, _ = env.reset(seed=seed, options=options)
    for done in trange(1, steps + 1, disable=not progress, unit="step"):
        u = np.asarray(policy(observation))
        observation, _, terminated, truncated, _ = env.step(u)
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


class _Noting(Policy):
    """A policy of states, which notes what it saw and what it sent."""

    def __init__(
        self,
        policy: Callable[[Any], ArrayLike],
        observe: Callable[[Any], ArrayLike] | None,
        space: Any,
    ):
        self.policy = policy
        self.name = _name(policy)
        self.observe = observe or np.asarray
        self.states: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []

        # What the robot takes, where it is known
        self._shape = getattr(space, "shape", None) or ("D_u",)
        self._low = getattr(space, "low", -np.inf)
        self._high = getattr(space, "high", np.inf)
        self._warned = False

    def reset(self, seed: int = 0) -> None:
        reset = getattr(self.policy, "reset", None)
        if callable(reset):
            reset(seed)

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
        if outside.any() and not self._warned:
            self._warned = True
            k = int(np.flatnonzero(outside)[0])
            warnings.warn(
                f"command {k} (counted from 0) of {self.name} is {u[k]:g}, beyond the "
                "limits of this environment, which may do something else: what is "
                "recorded is what was sent. Clip it in the policy",
                stacklevel=4,
            )


def _name(policy: Any) -> str:
    """That of a policy, or of a plain function."""
    unnamed = getattr(policy, "__name__", type(policy).__name__)
    return policy.name if isinstance(policy, Policy) else unnamed


def _check_robot(env: Any) -> None:
    """A ValueError for what is no environment of one robot with real commands."""
    methods = (getattr(env, name, None) for name in ("reset", "step"))
    if isinstance(env, type) or not all(map(callable, methods)):
        raise ValueError(
            "env is a Gymnasium environment, such as ClothEnv(arm, cloth), "
            f"got {type(env).__name__} {env!s:.80}"
        )
    space = getattr(env, "action_space", None)
    if hasattr(space, "n") or hasattr(space, "nvec"):
        raise ValueError(
            f"this environment has discrete actions, {space}: the model needs commands "
            "that are real numbers, which can follow a gradient. Look for a version of "
            "it with continuous actions (a Box)"
        )


def _check_policy(policy: Any) -> None:
    """A TypeError for what can't be called, or would first have to be made."""
    if not callable(policy) or isinstance(policy, type):
        raise TypeError(
            "a policy is called with an observation and returns a command, got "
            f"{policy!r}"
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
