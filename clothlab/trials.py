"""Recorded runs, the one loop that records them, and their files."""

import io
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from clothlab._files import reading, write_bytes
from clothlab._validation import Checked, check_array, check_number
from clothlab.policies import Policy, as_policy
from clothlab.simulation.arm import check_command, get_arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv, Observation
from clothlab.simulation.vision import check_masks

_FORMAT = 1  # of trial files


@dataclass(frozen=True, eq=False)
class Trial(Checked):
    """One run with one cloth: the paper's D_k = {(s_1, u_1), …, (s_T, u_T)}, with the image in place of z."""

    images: np.ndarray  # cloth masks [T, H, W], bool; images[t] is seen just before commands[t] is sent
    robot: np.ndarray  # robot states [T, D_r], float64, in the arm's units
    commands: np.ndarray  # commands [T, D_u], float64, in the arm's units
    cloth: Cloth
    arm: str  # name
    policy: str  # name of what chose the commands
    seed: int

    def __post_init__(self) -> None:
        images = check_masks(self.images)
        if images.ndim != 3 or not len(images):
            raise ValueError(f"images are [T, H, W] of at least one step, got the shape {list(images.shape)}")
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
        """Return a part of the trial, `trial[:100]`."""
        if not isinstance(steps, slice):
            raise TypeError(f"a trial is cut with a slice, such as trial[:100], not with {steps!r}")
        return replace(self, **{name: getattr(self, name)[steps] for name in ("images", "robot", "commands")})


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
    """Let a policy move the cloth for `steps` control steps and record what happens; both are reset first.

    The policy may be a function that returns the command for an observation; in the trial it has its name, or `name`.
    The seed is that of its random numbers and of a `random_start` from a posture other than the arm's home. `watch` is
    called `samples` times in each step, as in `ClothEnv.advance`: 5 make 25 pictures a second.
    """
    check_number("steps", steps, int, at_least=1)
    policy = as_policy(policy)
    policy.reset(seed)
    observation, _ = env.reset(seed=seed, options={"random_start": random_start})
    rows = []
    for _ in tqdm(range(steps), desc=env.cloth.label, disable=not progress, unit="step"):
        # Copies: a policy may change the arrays that it was given, or those that it returned.
        image, robot = observation["image"].astype(bool), observation["robot"].copy()
        u = check_command(env.arm, policy(observation))
        rows.append((image, robot, u))
        env.advance(u, watch, samples)
        observation = env.observe()
    images, robot, commands = (np.array(column) for column in zip(*rows, strict=True))
    return Trial(images, robot, commands, env.cloth, env.arm.name, name or policy.name, seed)


def save_trial(trial: Trial, path: str | Path) -> None:
    """Write a trial as `.npz`, images as packed bits. An interrupted write leaves an existing file as it was."""
    if Path(path).suffix != ".npz":
        raise ValueError(f"a trial's file ends in .npz, got {str(path)!r}")
    about = {"format": _FORMAT, "cloth": asdict(trial.cloth)}
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
    """Read a trial; a ValueError names the file if it is damaged, is no trial, or is of a newer version."""
    with reading(path, "trial"), np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False) as file:
        about = json.loads(str(file["about"]))
        if about.pop("format") != _FORMAT:
            raise ValueError(f"its format is not {_FORMAT}, this version's")
        about["cloth"] = Cloth(**about["cloth"])
        images = np.unpackbits(file["images"], axis=-1).view(bool)
        return Trial(images, file["robot"], file["commands"], **about)
