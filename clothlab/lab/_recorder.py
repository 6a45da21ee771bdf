"""Recordings of a live session.

A recording is a list of steps. It is written to its file every five seconds and when it
stops, so that little is lost with a kernel.
"""

import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clothlab._validation import check_name
from clothlab.simulation.vision import Observation
from clothlab.trials import Trial, save_trial

_EVERY = 25  # control steps between two writes, five seconds


class _Row(NamedTuple):
    """A step of a trial."""

    image: np.ndarray  # [H, W], bool
    robot: np.ndarray  # [D_r]
    command: np.ndarray  # [D_u]


class Recorder:
    """Keeps one recording at a time.

    It runs, or it is stopped and waits for its name, or there is none. Until it is
    saved, its file is `unfinished-TIME.npz`, a trial like any other.
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self.running = False
        self._file: Path | None = None
        self._rows: list[_Row] = []
        self._about: dict[str, Any] = {}  # of the trial: cloth, arm, seed
        self._policies: dict[str, None] = {}  # that drove, in order

    @property
    def waiting(self) -> bool:
        """Whether a stopped recording waits to be saved or discarded."""
        return self._file is not None and not self.running

    def refuse_while_running(self, what: str) -> None:
        """Raise if a recording runs, of which this can't change."""
        if self.running:
            raise ValueError(
                f"{what} cannot change during a recording: save or discard it first"
            )

    def start(self) -> None:
        """Begin a recording."""
        if self._file is not None:
            raise ValueError(
                "there is a recording already: save it under a name, or discard it"
            )
        self._file = self.folder / f"unfinished-{time.time_ns()}.npz"
        self.running = True

    def add(self, observation: Observation, u: np.ndarray, about: dict) -> None:
        """Take in a step; `about` is the trial's cloth, arm, policy and seed."""
        image = observation["image"].astype(bool)
        self._rows.append(_Row(image, observation["robot"], u))
        self._about = about
        self._policies[about["policy"]] = None
        if len(self._rows) % _EVERY == 0:
            self._write()

    def stop(self) -> None:
        """Stop; what was recorded waits to be saved or discarded."""
        self.running = False
        self._write()

    def save(self, name: str) -> Path:
        """Stop, and give the recording its name.

        After a bad or existing name, a running recording goes on.
        """
        path = self.folder / f"{check_name('recording', name)}.npz"
        if path.exists():
            raise ValueError(f"a recording named {name!r} exists: choose another name")
        if self._file is None or not self._rows:
            raise ValueError("nothing was recorded")
        self.stop()
        self._file.replace(path)
        self._forget()
        return path

    def discard(self) -> None:
        """Stop, and forget the recording that runs or waits."""
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        self._forget()

    def close(self) -> None:
        """Write what there is and let go of it: its file stays."""
        self.stop()
        self._forget()

    def _forget(self) -> None:
        self.running = False
        self._file = None
        self._rows = []
        self._about = {}
        self._policies = {}

    def _write(self) -> None:
        """Write the whole recording, if there is anything in it."""
        if self._file is None or not self._rows:
            return
        about = self._about | {"policy": ", ".join(self._policies)}
        trial = Trial(
            images=np.array([row.image for row in self._rows]),
            robot=np.array([row.robot for row in self._rows]),
            commands=np.array([row.command for row in self._rows]),
            **about,
        )
        self.folder.mkdir(parents=True, exist_ok=True)
        save_trial(trial, self._file)
