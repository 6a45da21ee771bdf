"""A recorded run of the simulation, and how an environment records itself."""

import base64
import html
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from clothlab._validation import check_array, check_masks, check_number
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.scene import CONTROL_PERIOD
from clothlab.simulation.vision import Observation

# Of the film strip in a notebook: images, and the grey between them
_SHOWN = 10
_GREY = 128


@dataclass(frozen=True, eq=False, repr=False)
class Trial:
    """One run with one cloth: the paper's D_k = {(s_1, u_1), …, (s_T, u_T)}.

    It holds the image in place of z: `to_run` encodes it, with any autoencoder.
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
        # Images: as bool, at least one
        images = check_masks(self.images)
        if images.ndim != 3 or not len(images):
            raise ValueError(
                "images are [T, H, W] of at least one step, "
                f"got the shape {list(images.shape)}"
            )
        object.__setattr__(self, "images", images)

        # The arm, which says how wide the rows of the others are
        arm = get_arm(self.arm)
        object.__setattr__(self, "arm", arm)
        self._check_rows("robot", len(arm.state_names))
        self._check_rows("commands", len(arm.command_names))
        seed = check_number("seed", self.seed, int, at_least=0)
        object.__setattr__(self, "seed", seed)

    def _check_rows(self, name: str, width: int) -> None:
        """Make an array float64 with one row of this width for each image."""
        what = f"{name} of the {self.arm.name} arm"
        array = check_array(what, getattr(self, name), ("T", width))
        if len(array) != len(self.images):
            raise ValueError(
                f"{name} must have one row for each of the {len(self.images)} images, "
                f"got {len(array)}"
            )
        object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        """Return one line: cloth, policy, length, arm, and what came of it."""
        outcome = f", {self.outcome}" if self.outcome else ""
        return (
            f"Trial of {self.cloth.name} by {self.policy}: {len(self)} steps of "
            f"{CONTROL_PERIOD} s, {self.arm.name} arm{outcome}"
        )

    def _repr_html_(self) -> str:
        """For a notebook: that line, and images from the first to the last step."""
        steps = np.linspace(0, len(self) - 1, min(len(self), _SHOWN)).round()
        half = self.images[steps.astype(int), ::2, ::2] * np.uint8(255)
        framed = [np.pad(each, 1, constant_values=_GREY) for each in half]
        _, png = cv2.imencode(".png", np.hstack(framed))
        data = base64.b64encode(png.tobytes()).decode()
        words = html.escape(repr(self))
        return f'{words}<br><img src="data:image/png;base64,{data}" alt="{words}">'

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
            images=self.images[steps],
            robot=self.robot[steps],
            commands=self.commands[steps],
        )


@dataclass
class Recording:
    """What an environment keeps of each step while it is recorded."""

    watch: Callable[[], None] | None = None  # called in each step, to film it
    samples: int = 1  # how often
    images: list[np.ndarray] = field(default_factory=list)
    robot: list[np.ndarray] = field(default_factory=list)
    commands: list[np.ndarray] = field(default_factory=list)

    def keep(self, observation: Observation, u: np.ndarray) -> None:
        """Keep what was seen, and the command `[D_u]` that was then sent."""
        self.images.append(observation["image"])
        self.robot.append(observation["robot"])
        self.commands.append(u)

    def trial(self, cloth: Cloth, arm: Arm, policy: str, seed: int) -> Trial:
        """The steps so far as a trial."""
        images = np.array(self.images)
        robot = np.array(self.robot)
        commands = np.array(self.commands)
        return Trial(images, robot, commands, cloth, arm, policy, seed)
