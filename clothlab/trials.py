"""Recorded runs, the one loop that records them, and their files."""

import io
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike
from tqdm.auto import tqdm

from clothlab._files import OtherKindError, load_arrays, reading, write_bytes
from clothlab._validation import (
    Checked,
    check_array,
    check_each,
    check_flag,
    check_kind,
    check_number,
    check_seed,
)
from clothlab.masks import Observation, check_masks
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.data import Run
from clothlab.method.policy import Policy, as_policy
from clothlab.simulation.arm import Arm, arm_data, arm_from_data, check_command, get_arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv

# Of trial files: with the name of an arm, with an arm of one's own, and with an outcome
_FORMATS = (1, 2, 3)
# With that the policy's name ended in older files when the cloth lay spread afterwards
_SPREAD = ", spread"
# Of the arrays in a file. Masks are packed eight to a byte: that many hold 87,000
# steps, nearly five hours.
_MOST_BYTES = 2**27


@dataclass(frozen=True, eq=False)
class Trial(Checked):
    """One run with one cloth: the paper's D_k = {(s_1, u_1), …, (s_T, u_T)}, with the
    image in place of z.
    """

    # Cloth masks [T, H, W], bool; images[t] is seen just before commands[t] is sent
    images: np.ndarray
    robot: np.ndarray  # robot states [T, D_r], float64, in the arm's units
    commands: np.ndarray  # commands [T, D_u], float64, in the arm's units
    cloth: Cloth
    arm: Arm  # or the name of one of `ARMS`
    policy: str  # name of what chose the commands
    seed: int
    outcome: str = ""  # what came of it, in a word, where that was judged

    def __post_init__(self) -> None:
        images = check_masks(self.images)
        if images.ndim != 3 or not len(images):
            raise ValueError(
                f"images are [T, H, W] of at least one step, got the shape {list(images.shape)}"
            )
        object.__setattr__(self, "images", images)
        arm = get_arm(self.arm)
        object.__setattr__(self, "arm", arm)
        for name, width in (
            ("robot", len(arm.state_names)),
            ("commands", len(arm.command_names)),
        ):
            array = check_array(
                f"{name} of the {arm.name} arm", getattr(self, name), ("T", width)
            )
            if len(array) != len(images):
                raise ValueError(
                    f"{name} must have one row for each of the {len(images)} images, got {len(array)}"
                )
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
            raise TypeError(
                f"a trial is cut with a slice, such as trial[:100], not with {steps!r}"
            )
        return replace(
            self,
            **{
                name: getattr(self, name)[steps]
                for name in ("images", "robot", "commands")
            },
        )


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
    """Let a policy move the cloth for `steps` control steps and record what happens;
    both are reset first.

    The policy may be a function that returns the command for an observation; in the
    trial it has its name, or `name`. The seed is that of its random numbers and of a
    `random_start` from a posture other than the arm's home. `watch` is called `samples`
    times in each step, as in `ClothEnv.advance`: 5 make 25 pictures a second.
    """
    check_kind("env", env, ClothEnv, ": ClothEnv(arm, cloth) makes one")
    check_number("steps", steps, int, at_least=1)
    check_seed(seed)
    check_flag("random_start", random_start)
    policy = as_policy(policy)
    policy.reset(seed)
    observation, _ = env.reset(seed=seed, options={"random_start": random_start})
    rows = []
    for _ in tqdm(
        range(steps), desc=env.cloth.label, disable=not progress, unit="step"
    ):
        # Copies: a policy may change the arrays that it was given, or those that it
        # returned.
        image, robot = observation["image"].astype(bool), observation["robot"].copy()
        u = check_command(env.arm, policy(observation))
        rows.append((image, robot, u))
        env.advance(u, watch, samples)
        observation = env.observe()
    images, robot, commands = (np.array(column) for column in zip(*rows, strict=True))
    return Trial(images, robot, commands, env.cloth, env.arm, name or policy.name, seed)


def recorded_plans(
    trials: Sequence[Trial], horizon: int = 8, count: int = 200, *, seed: int = 0
) -> np.ndarray:
    """Stretches of recorded commands, `[count, horizon, D_u]`, drawn at random."""
    check_number("count", count, int, at_least=1)
    trials = check_each("trials", trials, Trial)
    if not trials or min(map(len, trials)) < check_number(
        "horizon", horizon, int, at_least=1
    ):
        raise ValueError(
            f"plans of {horizon} steps need recorded trials that are at least as long"
        )
    windows = np.concatenate(
        [sliding_window_view(trial.commands, horizon, axis=0) for trial in trials]
    )
    chosen = np.random.default_rng(seed).choice(
        len(windows), count, replace=len(windows) < count
    )
    return windows[chosen].transpose(0, 2, 1)


def to_run(autoencoder: Autoencoder, trial: Trial) -> Run:
    """States and commands of a recorded trial, encoded with this autoencoder."""
    s = np.concatenate([encode(autoencoder, trial.images), trial.robot], axis=1)
    return Run(
        s.astype(np.float32), trial.commands.astype(np.float32), trial.cloth.name
    )


def save_trial(trial: Trial, path: str | Path) -> None:
    """Write a trial as `.npz`, images as packed bits.

    An interrupted write leaves an existing file as it was.
    """
    if Path(path).suffix != ".npz":
        raise ValueError(f"a trial's file ends in .npz, got {str(path)!r}")
    arm = arm_data(trial.arm)
    about = {
        "format": 1 if isinstance(arm, str) else 2,
        "cloth": asdict(trial.cloth),
        "arm": arm,
        "policy": trial.policy,
        "seed": trial.seed,
    }
    if trial.outcome:
        about |= {"format": 3, "outcome": trial.outcome}
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
    """Read a trial; a ValueError names the file if it is damaged, is no trial, is too
    large, or of a newer version.
    """
    with reading(path, "trial"):
        arrays = load_arrays(path, _MOST_BYTES)
        about = json.loads(str(arrays["about"]))
        file_format = about.pop("format")
        if file_format not in _FORMATS:
            raise OtherKindError(
                f"its format is {file_format}, this version reads "
                f"{_FORMATS[0]} to {_FORMATS[-1]}"
            )
        if file_format < 3 and about["policy"].endswith(_SPREAD):
            about["policy"] = about["policy"].removesuffix(_SPREAD)
            about["outcome"] = "spread"
        about["cloth"] = Cloth(**about["cloth"])
        about["arm"] = arm_from_data(about["arm"])
        images = np.unpackbits(arrays["images"], axis=-1).view(bool)
        return Trial(images, arrays["robot"], arrays["commands"], **about)
