"""Recordings of a live session, written when they stop and once a minute, so that little is lost with a kernel."""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from clothlab._validation import check_name
from clothlab.simulation.env import Observation
from clothlab.trials import Trial, save_trial

_EVERY = 300  # control steps between two writes, one minute
_LONGEST = 18_000  # steps of a recording, an hour


class Recorder:
    """Keeps one recording at a time: it runs, or it is stopped and waits for its name, or there is none.

    Until it is saved, its file is `unfinished-TIME-PROCESS.npz`, a trial like any other.
    """

    def __init__(self, folder: Path | str):
        self.folder, self.running = Path(folder), False
        self._file: Path | None = None
        self._rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._about: dict[str, Any] = {}
        self._policies: dict[str, None] = {}

    @property
    def waiting(self) -> bool:
        """Whether a stopped recording waits to be saved or discarded."""
        return self._file is not None and not self.running

    def start(self) -> None:
        """Begin a recording."""
        if self._file is not None:
            raise ValueError("there is a recording already: save it under a name, or discard it")
        file = self.folder / f"unfinished-{time.time_ns()}-{os.getpid()}.npz"
        self.folder.mkdir(parents=True, exist_ok=True)
        file.touch()  # an OSError now rather than when much is recorded
        file.unlink()
        self._file, self.running = file, True

    def add(self, observation: Observation, u: np.ndarray, about: dict) -> None:
        """Take in a step; `about` is the trial's cloth, arm, policy and seed. A full disk stops the recording."""
        self._rows.append((observation["image"].astype(bool), observation["robot"], u))
        self._policies = dict.fromkeys([*self._policies, about["policy"]])
        self._about = about
        if len(self._rows) % _EVERY == 0:
            self.running = False  # unless the disk takes it
            self._write()
            if len(self._rows) >= _LONGEST:
                raise OSError(f"a recording has {_LONGEST} steps at most, which are over: save it")
            self.running = True

    def stop(self) -> None:
        """Stop; what was recorded waits to be saved or discarded."""
        self.running = False
        self._write()

    def save(self, name: str) -> Path:
        """Stop, and give the recording its name; after a bad or existing name, a running recording goes on."""
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
        if self._file is not None:
            self.stop()
        self._forget()

    def _forget(self) -> None:
        self._file, self.running = None, False
        self._rows, self._about, self._policies = [], {}, {}

    def _write(self) -> None:
        if self._rows and self._file is not None:
            images, robot, commands = (np.array(column) for column in zip(*self._rows, strict=True))
            about = self._about | {"policy": ", ".join(self._policies)}
            save_trial(Trial(images, robot, commands, **about), self._file)
