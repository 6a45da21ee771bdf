"""Recordings of a live session, of which hardly anything is lost with a kernel.

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
from typing import Any, NamedTuple

import numpy as np

from clothlab._validation import check_name
from clothlab.masks import Observation
from clothlab.trials import Trial, load_trial, save_trial

_EVERY = 25  # control steps in a piece, five seconds
_LONGEST = 18_000  # steps of a recording, an hour
# Ending of a recording's folder of pieces, each named by its first step
_PIECES = ".pieces"
# [s] without a new piece, after which nobody is taken to go on with a recording
_ABANDONED = 3600.0


class _Row(NamedTuple):
    """A step of a trial."""

    image: np.ndarray  # [H, W], bool
    robot: np.ndarray  # [D_r]
    command: np.ndarray  # [D_u]


class Recorder:
    """Keeps one recording at a time.

    It runs, or it is stopped and waits for its name, or there is none. Until it is
    saved, its file is `unfinished-TIME-PROCESS.npz`, a trial like any other.
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self.running = False
        self._file: Path | None = None
        self._rows: list[_Row] = []
        self._written = 0  # steps that are in pieces
        self._about: dict[str, Any] = {}  # of the trial: cloth, arm, seed
        self._policies: dict[str, None] = {}  # that drove, in order
        join_pieces(self.folder)

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
        file = self.folder / f"unfinished-{time.time_ns()}-{os.getpid()}.npz"
        self.folder.mkdir(parents=True, exist_ok=True)
        file.touch()  # an OSError now rather than when much is recorded
        file.unlink()
        self._file = file
        self.running = True

    def add(self, observation: Observation, u: np.ndarray, about: dict) -> None:
        """Take in a step; `about` is the trial's cloth, arm, policy and seed.

        A full disk stops the recording.
        """
        image = observation["image"].astype(bool)
        self._rows.append(_Row(image, observation["robot"], u))
        self._about = about
        self._policies[about["policy"]] = None
        if len(self._rows) % _EVERY:
            return

        # It goes on only once the disk has taken it
        self.running = False
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
            shutil.rmtree(self._pieces, ignore_errors=True)
        self._forget()

    def close(self) -> None:
        """Write what there is and let go of it: its file stays."""
        if self._file is not None:
            self.stop()
        self._forget()

    def _forget(self) -> None:
        self.running = False
        self._file = None
        self._rows = []
        self._written = 0
        self._about = {}
        self._policies = {}

    @property
    def _pieces(self) -> Path:
        assert self._file is not None
        return self._file.with_suffix(_PIECES)

    def _trial(self, start: int = 0) -> Trial:
        """What was recorded from a step on."""
        rows = self._rows[start:]
        about = self._about | {"policy": ", ".join(self._policies)}
        return Trial(
            images=np.array([row.image for row in rows]),
            robot=np.array([row.robot for row in rows]),
            commands=np.array([row.command for row in rows]),
            **about,
        )

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
        if not _abandoned(pieces):
            continue
        file = pieces.with_suffix(".npz")
        parts = _parts(file, pieces)
        if parts:
            save_trial(_joined(parts), file)
            joined.append(file)
        shutil.rmtree(pieces)
    return joined


def _parts(file: Path, pieces: Path) -> list[Trial]:
    """What was joined before, and the pieces that follow it, in order, up to a gap."""
    parts = [load_trial(file)] if file.exists() else []
    steps = sum(map(len, parts))
    path = _piece(pieces, steps)
    while path.exists():
        parts.append(load_trial(path))
        steps += len(parts[-1])
        path = _piece(pieces, steps)
    return parts


def _abandoned(pieces: Path) -> bool:
    """Whether the process that wrote these pieces is gone.

    Its number is the last part of their name.
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
    """One trial of several that follow each other.

    The last one knows all that had driven.
    """
    return replace(
        parts[-1],
        images=np.concatenate([part.images for part in parts]),
        robot=np.concatenate([part.robot for part in parts]),
        commands=np.concatenate([part.commands for part in parts]),
    )
