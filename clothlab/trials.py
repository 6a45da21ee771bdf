"""Recorded runs, the one loop that records them, and the policies that need no model.

A policy is a callable `policy(observation) -> u` `[D_u]`. Random commands, the scripted operator, a person's sliders
and the controller are all policies, and `rollout` runs any of them.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np
from tqdm.auto import tqdm

from clothlab._files import atomic_write
from clothlab.arm import Arm, check_command
from clothlab.cloth import Cloth
from clothlab.env import CONTROL_PERIOD, ClothEnv
from clothlab.vision import HEIGHT, WIDTH

__all__ = [
    "Motion",
    "OperatorPolicy",
    "Policy",
    "RandomPolicy",
    "Trial",
    "load_trial",
    "replay",
    "rollout",
    "save_trial",
]

Policy = Callable[[dict[str, np.ndarray]], np.ndarray]


@dataclass(frozen=True, eq=False)
class Trial:
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
        """Refuse arrays that do not belong together."""
        steps = len(self.images)
        if self.images.shape != (steps, HEIGHT, WIDTH) or self.images.dtype != bool:
            raise ValueError(
                f"images are [T, {HEIGHT}, {WIDTH}] of bool, got {self.images.shape} of {self.images.dtype}"
            )
        for name in ("robot", "commands"):
            array = getattr(self, name)
            if array.ndim != 2 or len(array) != steps:
                raise ValueError(f"{name} must have one row for each of the {steps} images, got {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} must be finite")

    def __len__(self) -> int:
        """Return the number of control steps T."""
        return len(self.images)

    @property
    def time(self) -> np.ndarray:
        """Time of each step, `[T]` [s]."""
        return np.arange(len(self)) * CONTROL_PERIOD


def rollout(
    env: ClothEnv,
    policy: Policy,
    steps: int,
    *,
    seed: int = 0,
    random_start: bool = False,
    name: str | None = None,
    progress: bool = False,
) -> Trial:
    """Let a policy move the cloth and record what happens.

    Args:
        env: the scene.
        policy: chooses the command from each observation.
        steps: how many control steps to run.
        seed: of the environment's start; stored in the trial.
        random_start: start from a random posture instead of the arm's home.
        name: what to call the policy in the trial; by default its class or function name.
        progress: show a progress bar.

    Returns:
        The recorded run, of `steps` steps.
    """
    observation, _ = env.reset(seed=seed, options={"random_start": random_start})
    images, robot, commands = [], [], []
    for _ in tqdm(range(steps), desc=f"{env.cloth.name}", disable=not progress, unit="step"):
        u = np.asarray(policy(observation), dtype=np.float64)
        images.append(observation["image"].astype(bool))
        robot.append(observation["robot"])
        commands.append(u)
        observation, *_ = env.step(u)
    name = name or getattr(policy, "__name__", type(policy).__name__)
    return Trial(np.array(images), np.array(robot), np.array(commands), env.cloth, env.arm.name, name, seed)


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


def replay(trial: Trial, *, arm: Arm | None = None, interval: float = 0.004) -> Motion:
    """Send the commands of a trial again and watch the arm closely.

    Args:
        trial: a run that started from the arm's home.
        arm: another arm to send them to; by default the trial's own.
        interval: between samples [s].

    Raises:
        ValueError: the arm does not do again what the trial recorded, as after a random start.
    """
    env = ClothEnv(arm or trial.arm, trial.cloth)
    env.reset(seed=trial.seed)
    steps = max(1, round(interval / env.scene.time_step))
    samples = []
    for u, recorded in zip(trial.commands, trial.robot, strict=True):
        if arm is None and not np.allclose(env.arm.state(env.data), recorded, atol=1e-6):
            raise ValueError("the replay leaves the recorded run: it started elsewhere, or with another arm")
        env.arm.command(env.data, check_command(env.arm, u))
        for _ in range(round(CONTROL_PERIOD / env.scene.time_step / steps)):
            mujoco.mj_step(env.model, env.data, steps)
            samples.append((env.data.time, *env.arm.angles(env.data), *env.data.site("hand").xpos))
        mujoco.mj_forward(env.model, env.data)  # as the recording did, before it looked
    env.close()
    time, theta, hand = np.split(np.array(samples), [1, 3], axis=1)
    return Motion(time[:, 0], theta, hand)


class RandomPolicy:
    """Uniform random commands, each held for a random number of steps (the paper's Random)."""

    def __init__(self, arm: Arm, *, seed: int, longest_hold: int = 4):
        """Prepare.

        Args:
            arm: gives the range of the commands.
            seed: of this policy's own random numbers.
            longest_hold: a command is held for 1 to this many steps, so that slow and fast motions both occur.
        """
        self.arm, self.longest_hold = arm, longest_hold
        self._rng = np.random.default_rng(seed)
        self._steps_left = 0

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the command `[D_u]`."""
        if self._steps_left == 0:
            self._u = self._rng.uniform(self.arm.command_lower, self.arm.command_upper)
            self._steps_left = self._rng.integers(1, self.longest_hold + 1)
        self._steps_left -= 1
        return self._u.copy()


class OperatorPolicy:
    """A scripted stand-in for the paper's human at a GUI: lifts the cloth slowly, throws it down fast to spread it.

    Every swing draws its own height, depth, speeds and pauses, so that no two are alike. What the arm takes beside
    joint angles (stiffness) is random, as in the paper.
    """

    def __init__(self, arm: Arm, *, seed: int):
        """Prepare.

        Args:
            arm: gives the range of the commands.
            seed: of this policy's own random numbers.
        """
        self.arm = arm
        self._rng = np.random.default_rng(seed)
        self._random = RandomPolicy(arm, seed=seed)
        self._theta = arm.home_command[: len(arm.lower)]
        self._plan: list[np.ndarray] = []

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the command `[D_u]`."""
        if not self._plan:
            self._plan = self._swing()
        self._theta = self._plan.pop(0)
        u = self._random(observation)
        u[: len(self._theta)] = self._theta
        return u

    def _swing(self) -> list[np.ndarray]:
        """One swing: up in 3 to 6 steps, a pause of 0 to 2, down in 1 or 2, a pause of 1 to 3."""
        rng, lower, upper = self._rng, np.array(self.arm.lower), np.array(self.arm.upper)
        high = lower + rng.uniform(0.0, 0.35, len(lower)) * (upper - lower)
        low = lower + rng.uniform(0.65, 1.0, len(lower)) * (upper - lower)
        up = np.linspace(self._theta, high, rng.integers(3, 7) + 1)[1:]
        down = np.linspace(high, low, rng.integers(1, 3) + 1)[1:]
        return [*up, *[high] * rng.integers(0, 3), *down, *[low] * rng.integers(1, 4)]


def save_trial(trial: Trial, path: str | Path) -> None:
    """Write a trial as `.npz`, images as packed bits. An interrupted write leaves an existing file as it was."""
    about = {"cloth": asdict(trial.cloth), "arm": trial.arm, "policy": trial.policy, "seed": trial.seed}
    with atomic_write(path) as temporary:
        np.savez_compressed(
            temporary,
            images=np.packbits(trial.images, axis=-1),
            robot=trial.robot,
            commands=trial.commands,
            about=np.array(json.dumps(about)),
        )


def load_trial(path: str | Path) -> Trial:
    """Read a trial.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is damaged or is no trial.
    """
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            about["cloth"] = Cloth(**about["cloth"])
            images = np.unpackbits(file["images"], axis=-1).astype(bool)
            return Trial(images, file["robot"], file["commands"], **about)
    except FileNotFoundError:
        raise
    except Exception as error:  # zip, numpy and json each have their own for a damaged file
        raise ValueError(f"{path} is damaged or is no trial: {error}") from error
