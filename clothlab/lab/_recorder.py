"""Recordings of a live session, on the disk every five seconds, so that hardly anything
is lost with a kernel.

While a recording runs, the news of the last five seconds go into a piece, a small file
of its own: to write all that was recorded so often would cost more the longer it gets,
and in the end make control steps late. When the recording stops, its file is written as
a whole, and the pieces go. If the kernel dies before, the pieces stay, and the next
recorder of this folder joins them.
"""

import os
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from clothlab._validation import check_name
from clothlab.masks import Observation
from clothlab.trials import Trial, load_trial, save_trial

_EVERY = 25  # control steps in a piece, five seconds
_LONGEST = 18_000  # steps of a recording, an hour
_COLUMNS = ("images", "robot", "commands")
_PIECES = (
    ".pieces"  # ending of a recording's folder of pieces, each named by its first step
)
# [s] without a new piece, after which nobody is taken to go on with a recording
_ABANDONED = 3600.0


class Recorder:
    """Keeps one recording at a time: it runs, or it is stopped and waits for its name,
    or there is none.

    Until it is saved, its file is `unfinished-TIME-PROCESS.npz`, a trial like any
    other.
    """

    def __init__(self, folder: Path | str):
        self.folder, self.running = Path(folder), False
        self._file: Path | None = None
        self._rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._about: dict[str, Any] = {}
        self._policies: dict[str, None] = {}
        self._written = 0  # steps that are in pieces
        join_pieces(self.folder)

    @property
    def waiting(self) -> bool:
        """Whether a stopped recording waits to be saved or discarded."""
        return self._file is not None and not self.running

    def start(self) -> None:
        """Begin a recording."""
        if self._file is not None:
            raise ValueError(
                "there is a recording already: save it under a name, or discard it"
            )
        file = self.folder / f"unfinished-{time.time_ns()}-{os.getpid()}.npz"
        self.folder.mkdir(parents=True, exist_ok=True)
        file.touch()  # an OSError now rather than when much is recorded
        file.unlink()
        self._file, self.running = file, True

    def add(self, observation: Observation, u: np.ndarray, about: dict) -> None:
        """Take in a step; `about` is the trial's cloth, arm, policy and seed.

        A full disk stops the recording.
        """
        self._rows.append((observation["image"].astype(bool), observation["robot"], u))
        self._policies = dict.fromkeys([*self._policies, about["policy"]])
        self._about = about
        if len(self._rows) % _EVERY == 0:
            self.running = False  # unless the disk takes it
            self._write_piece()
            if len(self._rows) >= _LONGEST:
                self._write()
                raise OSError(
                    f"a recording has {_LONGEST} steps at most, which are over: save it"
                )
            self.running = True

    def stop(self) -> None:
        """Stop; what was recorded waits to be saved or discarded."""
        self.running = False
        self._write()

    def save(self, name: str) -> Path:
        """Stop, and give the recording its name; after a bad or existing name, a
        running recording goes on.
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
            shutil.rmtree(self._pieces, ignore_errors=True)
        self._forget()

    def close(self) -> None:
        """Write what there is and let go of it: its file stays."""
        if self._file is not None:
            self.stop()
        self._forget()

    def _forget(self) -> None:
        self._file, self.running = None, False
        self._rows, self._about, self._policies = [], {}, {}
        self._written = 0

    @property
    def _pieces(self) -> Path:
        assert self._file is not None
        return self._file.with_suffix(_PIECES)

    def _trial(self, start: int = 0) -> Trial:
        """What was recorded from a step on."""
        images, robot, commands = (
            np.array(column) for column in zip(*self._rows[start:], strict=True)
        )
        about = self._about | {"policy": ", ".join(self._policies)}
        return Trial(images, robot, commands, **about)

    def _write_piece(self) -> None:
        save_trial(self._trial(self._written), _piece(self._pieces, self._written))
        self._written = len(self._rows)

    def _write(self) -> None:
        """Write the whole recording, after which no piece is needed."""
        if self._rows and self._file is not None:
            save_trial(self._trial(), self._file)
            shutil.rmtree(self._pieces, ignore_errors=True)


def _piece(folder: Path, start: int) -> Path:
    return folder / f"{start:06}.npz"


def join_pieces(folder: Path) -> list[Path]:
    """Make a trial of what a kernel that died had recorded, and return the files.

    A recording that another kernel goes on with is left alone. Should one be joined too
    early, nothing is lost either: its later pieces are joined to it another time, or
    its whole file takes its place when it stops.
    """
    joined = []
    for pieces in sorted(folder.glob(f"unfinished-*{_PIECES}")):
        if _abandoned(pieces):
            file = pieces.with_suffix(".npz")
            parts = [load_trial(file)] if file.exists() else []
            steps = sum(map(len, parts))
            while (path := _piece(pieces, steps)).exists():  # in order, up to a gap
                parts.append(load_trial(path))
                steps += len(parts[-1])
            if parts:
                save_trial(_joined(parts), file)
                joined.append(file)
            shutil.rmtree(pieces)
    return joined


def _abandoned(pieces: Path) -> bool:
    """Whether the process that wrote these pieces, the last part of their name, is
    gone.
    """
    process = int(pieces.stem.rsplit("-", 1)[1])
    if os.name == "posix":
        try:
            os.kill(process, 0)  # signal 0 only asks
        except ProcessLookupError:
            return True
        except PermissionError:
            pass  # another user's, so it is alive
    return time.time() - pieces.stat().st_mtime > _ABANDONED


def _joined(parts: list[Trial]) -> Trial:
    """One trial of several that follow each other; the last one knows all that had
    driven.
    """
    images, robot, commands = (
        np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS
    )
    return replace(parts[-1], images=images, robot=robot, commands=commands)
