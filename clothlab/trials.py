"""Recorded runs, the one loop that records them, and the policies that need no model.

A policy is called with an observation and returns the command. Random commands, the scripted operator, a person's
sliders and the controller are all policies; a wrapper is a policy around another. `rollout` runs any of them.
"""

import io
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from clothlab._files import read_arrays, read_json, reading, write_bytes
from clothlab._validation import Checked, check_array, check_number
from clothlab.policies import Policy, as_policy
from clothlab.simulation.arm import Arm, check_command, get_arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv, Observation
from clothlab.simulation.vision import check_masks

FORMAT = 1  # of trial files
LONGEST = 18_000  # steps of a file: an hour, which fits into what a reader takes
LARGEST_SAG = 0.12  # [rad] of an arm that hangs still, below its command


@dataclass(frozen=True, eq=False)
class Trial(Checked):
    """One run with one cloth: the paper's D_k = {(s_1, u_1), …, (s_T, u_T)}, with the image in place of z.

    Attributes:
        images: cloth masks `[T, H, W]`, bool; `images[t]` is seen just before `commands[t]` is sent.
        robot: robot states `[T, D_r]`, float64, in the arm's units.
        commands: commands `[T, D_u]`, float64, in the arm's units.
        cloth: the cloth in the hand.
        arm: name of the arm.
        policy: what chose the commands, in a word.
        seed: seed of the run.
    """

    images: np.ndarray
    robot: np.ndarray
    commands: np.ndarray
    cloth: Cloth
    arm: str
    policy: str
    seed: int

    def __post_init__(self) -> None:
        """Refuse arrays that do not belong together, and what is no cloth, no name or no seed."""
        images = check_masks(self.images)
        if images.ndim != 3:
            raise ValueError(f"images are [T, H, W], got the shape {list(images.shape)}")
        object.__setattr__(self, "images", images)
        arm = get_arm(self.arm)
        for name, width in (("robot", len(arm.state_names)), ("commands", len(arm.command_names))):
            array = check_array(f"{name} of the {self.arm} arm", getattr(self, name), ("T", width))
            if len(array) != len(images):
                raise ValueError(f"{name} must have one row for each of the {len(images)} images, got {len(array)}")
            object.__setattr__(self, name, array)
        super().__post_init__()

    def __len__(self) -> int:
        """Return the number of control steps T."""
        return len(self.images)

    @property
    def time(self) -> np.ndarray:
        """Time of each step, `[T]` [s]."""
        return np.arange(len(self)) * CONTROL_PERIOD

    def __getitem__(self, steps: slice) -> "Trial":
        """Return a stretch of the trial, `trial[:100]`."""
        if not isinstance(steps, slice):
            raise TypeError(f"a trial is cut with a slice, such as trial[:100], not with {steps!r}")
        return replace(self, **{name: getattr(self, name)[steps] for name in ("images", "robot", "commands")})


def sensed_by(trial: Trial, arm: Arm | str) -> Trial:
    """The same run as an arm with other sensors would have recorded it: "torque" as "torque-feeling".

    Nothing is simulated: what the other one senses must follow from what was recorded.

    Args:
        trial: a run that started from the arm's home.
        arm: the other arm or its name; that of the trial returns the trial as it is.

    Raises:
        KeyError: unknown arm.
        ValueError: it does not follow, or the run started elsewhere.
    """
    arm, recorded = get_arm(arm), get_arm(trial.arm)
    if arm.name == recorded.name:
        return trial
    held = np.vstack([recorded.home_command, trial.commands[:-1]])
    robot = arm.sensed_instead(trial.arm, trial.robot, held)
    sag = trial.robot[0, recorded.sensed_angles] - recorded.home
    if (np.abs(sag) > LARGEST_SAG).any():
        raise ValueError("this run did not start from the arm's home: which command was held before it is not recorded")
    return replace(trial, arm=arm.name, robot=robot)


def rollout(
    env: ClothEnv,
    policy: Policy | Callable[[Observation], ArrayLike],
    steps: int,
    *,
    seed: int = 0,
    random_start: bool = False,
    name: str | None = None,
    watch: Callable[[], None] | None = None,
    samples: int = 5,
    progress: bool = False,
) -> Trial:
    """Let a policy move the cloth and record what happens. Policy and environment are reset first.

    Args:
        env: the scene.
        policy: chooses the command from each observation; a plain function will do.
        steps: how many control steps to run.
        seed: of the policy's random numbers and of the environment's start; stored in the trial, it says which trial
            it is.
        random_start: start from a random posture instead of the arm's home.
        name: what to call the policy in the trial; by default its own name.
        watch: called while each step goes by, as `ClothEnv.advance` has it.
        samples: how often a step; 5 make a video of 25 pictures a second.
        progress: show a progress bar.

    Returns:
        The recorded run, of `steps` steps.

    Raises:
        ValueError: no steps, or a command that the arm refuses.
        SimulationError: the physics diverged.
    """
    check_number("steps", steps, int, at_least=1)
    policy = as_policy(policy)
    policy.reset(seed)
    observation, _ = env.reset(seed=seed, options={"random_start": random_start})
    rows = []
    for _ in tqdm(range(steps), desc=env.cloth.label, disable=not progress, unit="step"):
        # Copies: a policy may go on changing what it was given and what it gave.
        image, robot = observation["image"].astype(bool), observation["robot"].copy()
        u = check_command(env.arm, policy(observation))
        rows.append((image, robot, u))
        env.advance(u, watch, samples)
        observation = env.observe()
    images, robot, commands = (np.array(column) for column in zip(*rows, strict=True))
    return Trial(images, robot, commands, env.cloth, env.arm.name, name or policy.name, seed)


@dataclass(frozen=True, eq=False)
class Motion:
    """What the arm did in a trial, finer than the trial's steps and beyond what its sensors say.

    Attributes:
        time: `[N]` [s].
        theta: joint angles `[N, 2]` [rad].
        hand: position of the hand in the world `[N, 3]` [m].
    """

    time: np.ndarray
    theta: np.ndarray
    hand: np.ndarray

    @property
    def hand_speed(self) -> np.ndarray:
        """Speed of the hand, `[N]` [m/s]."""
        return np.linalg.norm(np.gradient(self.hand, self.time, axis=0), axis=1)


class MotionWatch:
    """What to pass as `watch` to `rollout` or `ClothEnv.advance`, to know afterwards how the arm moved."""

    def __init__(self, env: ClothEnv):
        self._env = env
        self._rows: list[tuple[float, ...]] = []

    def __call__(self) -> None:
        data = self._env.data
        self._rows.append((data.time, *self._env.arm.angles(data), *data.site("hand").xpos))

    def motion(self) -> Motion:
        """All that was seen.

        Raises:
            ValueError: nothing was.
        """
        if not self._rows:
            raise ValueError("a motion needs commands: one at the least")
        time, theta, hand = np.split(np.array(self._rows), [1, 3], axis=1)
        return Motion(time[:, 0], theta, hand)


def watch_motion(env: ClothEnv, commands: Iterable[ArrayLike], *, interval: float = 0.004) -> Motion:
    """Send commands to a scene as it stands, and watch the arm closely.

    Args:
        env: the scene, which is moved.
        commands: `[T, D_u]`.
        interval: between samples [s]; it divides the control period of 0.2 s.

    Raises:
        ValueError: no commands, one that the arm refuses, or an interval that does not divide the control period.
    """
    samples = round(CONTROL_PERIOD / check_number("interval", interval, at_least=env.scene.time_step))
    if samples < 1 or env.scene.substeps % samples or abs(samples * interval - CONTROL_PERIOD) > 1e-9:
        raise ValueError(f"interval must be whole time steps and divide {CONTROL_PERIOD} s: 0.004, for one")
    watch = MotionWatch(env)
    try:
        commands = iter(commands)
    except TypeError:
        raise ValueError(f"commands are [T, D_u], got {commands!s:.80}") from None
    for u in commands:
        env.advance(u, watch, samples)
    return watch.motion()


def replay(trial: Trial, *, arm: Arm | None = None, interval: float = 0.004) -> Motion:
    """Send the commands of a trial again and watch the arm closely.

    Args:
        trial: a run that started from the arm's home.
        arm: another arm to send them to; by default the trial's own.
        interval: between samples [s]; it divides the control period of 0.2 s.

    Raises:
        ValueError: the arm does not do again what the trial recorded, as after a random start; or an interval that does
            not divide the control period.
    """
    env = ClothEnv(arm or trial.arm, trial.cloth)
    env.start(seed=trial.seed)

    def compared() -> Iterator[np.ndarray]:
        for u, recorded in zip(trial.commands, trial.robot, strict=True):
            if arm is None and not np.allclose(env.arm.state(env.data), recorded, atol=1e-6):
                raise ValueError("the replay leaves the recorded run: it started elsewhere, or with another arm")
            yield u

    return watch_motion(env, compared(), interval=interval)


def save_trial(trial: Trial, path: str | Path) -> None:
    """Write a trial as `.npz`, images as packed bits. An interrupted write leaves an existing file as it was.

    Raises:
        ValueError: a path that does not end in `.npz`, where no loader would look, or more than `LONGEST` steps, which
            none would read.
    """
    if Path(path).suffix != ".npz":
        raise ValueError(f"a trial's file ends in .npz, got {str(path)!r}")
    if len(trial) > LONGEST:
        raise ValueError(f"a trial's file has {LONGEST} steps at most, got {len(trial)}: save it in stretches")
    about = {"format": FORMAT, "cloth": asdict(trial.cloth)}
    about |= {name: getattr(trial, name) for name in ("arm", "policy", "seed")}
    content = io.BytesIO()
    np.savez_compressed(
        content,
        images=np.packbits(trial.images, axis=-1),
        robot=trial.robot,
        commands=trial.commands,
        about=np.array(json.dumps(about)),
    )
    write_bytes(path, content.getvalue())


def load_trial(path: str | Path) -> Trial:
    """Read a trial.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is damaged, is no trial, or was written by a newer version.
    """
    with reading(path, "trial"):
        file = read_arrays(path, ("images", "robot", "commands", "about"))
        about = read_json(str(file["about"]))
        if about.pop("format") != FORMAT:
            raise ValueError(f"its format is not {FORMAT}, this version's")
        about["cloth"] = Cloth(**about["cloth"])
        images = np.unpackbits(file["images"], axis=-1).view(bool)
        return Trial(images, file["robot"], file["commands"], **about)
