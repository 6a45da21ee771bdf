"""Recordings of a live session: a list of steps, and the trial that is saved of it."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clothlab._validation import check_name
from clothlab.data import recording_into
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.vision import Observation
from clothlab.trials import Trial, save_trial


class _Step(NamedTuple):
    """What was observed, and the command that was sent then."""

    image: np.ndarray  # [H, W], bool
    robot: np.ndarray  # [D_r]
    command: np.ndarray  # [D_u]
    driver: str


class Recorder:
    """Keeps one recording at a time, until it is saved or discarded.

    Args:
        folder: of the files of saved recordings.
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self.running = False
        self._about: dict[str, Any] = {}  # of the trial: cloth, arm and seed
        self._steps: list[_Step] = []

    @property
    def waiting(self) -> bool:
        """Whether a stopped recording waits to be saved or discarded."""
        return bool(self._steps) and not self.running

    def start(self, cloth: Cloth, arm: Arm, seed: int) -> None:
        """Begin a recording of this cloth in the hand of this arm."""
        if self.running or self.waiting:
            raise ValueError(
                "there is a recording already: save it under a name, or discard it"
            )
        self.running = True
        self._about = {"cloth": cloth, "arm": arm, "seed": seed}

    def add(self, observation: Observation, u: np.ndarray, driver: str) -> None:
        """Keep a step: what was observed, and the command `[D_u]` of this driver."""
        image = observation["image"].astype(bool)
        self._steps.append(_Step(image, observation["robot"], u, driver))

    def stop(self) -> None:
        """Stop; what was recorded waits to be saved or discarded."""
        self.running = False

    def save(self, name: str) -> Path:
        """Write the recording into a file of this name, and end it.

        After a bad name or an existing one, a ValueError says so and nothing changes.
        """
        path = self.folder / f"{check_name('recording', name)}.npz"
        if not self._steps:
            raise ValueError("nothing was recorded")

        # Every driver once, in order
        policy = ", ".join(dict.fromkeys(step.driver for step in self._steps))
        trial = Trial(
            images=np.array([step.image for step in self._steps]),
            robot=np.array([step.robot for step in self._steps]),
            commands=np.array([step.command for step in self._steps]),
            policy=policy,
            **self._about,
        )
        try:
            with recording_into(self.folder):
                save_trial(trial, path, new=True)
        except FileExistsError as error:
            words = f"a recording named {name!r} exists: choose another name"
            raise ValueError(words) from error
        self.discard()
        return path

    def discard(self) -> None:
        """Stop, and forget the recording."""
        self.running = False
        self._steps = []
