"""The one loop: a policy moves a robot, and what happened is recorded."""

from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from clothlab._validation import check_kind, check_number, check_seed
from clothlab.method._episodes import (
    Ending,
    NotingPolicy,
    check_actions,
    check_environment,
    command_space,
    is_vector,
    step_through,
)
from clothlab.method._wrapping import as_policy
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
    _check_one_robot(env)
    check_number("steps", steps, int, at_least=1)
    check_seed(seed)
    policy = as_policy(policy)

    if material is None:
        # The environment keeps the record.
        with _own_recording(env, observe)(watch, samples) as make_record:
            ending = _go(env, policy, steps, seed, options, progress)
        record = make_record(policy.name, seed)
    else:
        # It is kept at the policy: what it sees and what it sends.
        check_kind("material", material, str)
        if watch is not None:
            raise ValueError(
                "only an environment's own record can be watched: leave out material"
            )
        check_actions(env)
        noting = NotingPolicy(policy, observe, command_space(env))
        ending = _go(env, noting, steps, seed, options, progress)
        record = noting.run(material, step)

    if ending is not None:
        raise EpisodeEnded(_why_it_ended(ending, steps), record)
    return record


def _check_one_robot(env: Any) -> None:
    check_environment(env)
    if is_vector(env):
        raise ValueError(
            "rollout moves one robot: `collect_runs` takes an environment of several"
        )


def _go(
    env: Any,
    policy: Policy,
    steps: int,
    seed: int,
    options: dict[str, Any] | None,
    progress: bool,
) -> Ending | None:
    """The episode with a bar of progress."""
    name = policy.name
    with tqdm(total=steps, desc=name, disable=not progress, unit="step") as bar:
        return step_through(env, policy, steps, seed, options, bar)


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


def _why_it_ended(ending: Ending, steps: int) -> str:
    """Advice for an episode that was over before its last step."""
    where = f"after {ending.done} of {steps} steps"
    where += "; they are kept as `run` of this error"
    if ending.terminated:
        return (
            f"the robot's task was over {where}. Use gentler commands, or record "
            "several short runs with `collect_runs`"
        )
    return (
        f"the time limit of the environment was reached {where}: "
        "raise its `max_episode_steps`, or record several runs with `collect_runs`"
    )
