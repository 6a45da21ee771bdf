"""Recordings of a live session, kept on disk while they run, so that a kernel that dies loses no more than a second."""

import os
import re
import time
import weakref
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from clothlab._validation import check_name
from clothlab.simulation.env import Observation
from clothlab.trials import Trial, load_trial, save_trial

PLACE = re.compile(r"\d{1,20}-\d{1,9}(-\d{1,10}-\d{1,20})?")  # name of a folder in `unfinished`
PIECE = 5  # control steps, one second

_HELD: "weakref.WeakValueDictionary[Path, Recorder]" = weakref.WeakValueDictionary()  # by recorders of this process


class Recorder:
    """Keeps one recording at a time: it runs, or it is stopped and waits for its name, or there is none.

    Each has a folder of its own below `unfinished`, named after the time and the process, so that two kernels never
    mix their steps. What a dead kernel left is taken over and waits to be saved or discarded like one that was stopped.

    Args:
        folder: where finished recordings go.

    Attributes:
        folder: where finished recordings go.
        running: whether steps are taken in.
        remark: what the last `save` had to leave out; usually nothing.
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self._place: Path | None = None
        self.running, self.remark = False, ""
        self._rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []  # not on disk yet
        self._steps, self._about = 0, dict[str, Any]()  # on disk; of the rows that are not
        self.find()

    @property
    def waiting(self) -> bool:
        """Whether a stopped recording waits to be saved or discarded."""
        return self._place is not None and not self.running

    def start(self) -> None:
        """Begin anew.

        Raises:
            ValueError: a recording runs already.
            FileExistsError: another waits, or was found: `save` or `discard` it first.
            OSError: nothing can be written to the folder.
        """
        if self.running:
            raise ValueError("a recording runs already: save or discard it first")
        self.find()
        if self._place is not None:
            raise FileExistsError("there is an unfinished recording: save it under a name, or discard it")
        place = self.folder / "unfinished" / _place_name()
        try:
            place.mkdir(parents=True)
        except OSError as error:
            raise OSError(f"nothing can be written to {self.folder}: {error.strerror or error}") from error
        self._hold(place)
        self.running = True

    def add(self, observation: Observation, u: np.ndarray, about: dict) -> None:
        """Take in a step that happened; `about` is the trial's cloth, arm, policy and seed.

        Raises:
            OSError: the disk does not take it. The recording is then stopped, and holds all steps up to this one.
        """
        self._rows.append((observation["image"].astype(bool), observation["robot"], u))
        self._about = about | {"policy": _joined([self._about.get("policy", ""), about["policy"]])}
        if len(self._rows) == PIECE:
            self.running = False  # unless the disk takes it
            self._flush()
            self.running = True

    def stop(self) -> None:
        """Stop; what was recorded waits to be saved or discarded."""
        self.running = False
        self._flush()

    def save(self, name: str) -> Path:
        """Stop, and join the pieces into `NAME.npz`. A damaged or missing piece ends it; `remark` then says so.

        Raises:
            ValueError: a bad or existing name, or nothing was recorded. A running recording then goes on.
        """
        path, damage = self.folder / f"{check_name('recording', name)}.npz", ""
        if path.exists():
            raise ValueError(f"a recording named {name!r} exists: choose another name")
        if self._place is None or not (self._rows or any(self._place.glob("*.npz"))):
            raise ValueError("nothing was recorded")
        self.stop()
        parts: list[Trial] = []
        for piece in sorted(self._place.glob("*.npz")):
            length = sum(map(len, parts))
            try:
                part = load_trial(piece) if int(piece.stem) == length else None
            except ValueError:
                part = None
            if part is None:
                damage = f"only its first {length} steps: what follows is damaged"
                break
            parts.append(part)
        if not parts:
            raise ValueError("the first second of this recording is damaged: discard it")
        policy = _joined([part.policy for part in parts])
        arrays = {
            key: np.concatenate([getattr(part, key) for part in parts]) for key in ("images", "robot", "commands")
        }
        joined: dict[str, Any] = arrays | {"policy": policy}
        save_trial(replace(parts[0], **joined), path)
        self.discard()
        self.remark = damage
        return path

    def discard(self) -> None:
        """Stop, and forget the recording that runs or waits."""
        if self._place is not None and self._place.exists():
            for file in sorted(self._place.iterdir(), reverse=True):  # whatever is left can still be saved
                file.unlink()
            self._place.rmdir()
        self._hold(None)

    def close(self) -> None:
        """Put everything on disk and let go of it: another recorder may save it."""
        if self.running:
            self.stop()
        self._hold(None)

    def _hold(self, place: Path | None) -> None:
        """Go on with the pieces of this folder, or with none."""
        if self._place is not None:
            _HELD.pop(self._place, None)
        if place is not None:
            _HELD[place] = self
        self._place, self.running, self.remark = place, False, ""
        self._rows, self._steps, self._about = [], 0, {}

    def _flush(self) -> None:
        """Put what is not on disk yet there, under the number of its first step."""
        if self._rows and self._place is not None:
            images, robot, commands = (np.array(column) for column in zip(*self._rows, strict=True))
            save_trial(Trial(images, robot, commands, **self._about), self._place / f"{self._steps:08d}.npz")
            self._steps += len(self._rows)
            self._rows, self._about = [], {}

    def find(self) -> None:
        """Take over the oldest recording that a dead kernel or a closed session left, unless another waits here."""
        left: Iterable[Path] = (self.folder / "unfinished").glob("*-*") if self._place is None else ()
        for place in sorted(left):
            # Not through a link, which could lead to files of another kind: what is discarded is deleted.
            if PLACE.fullmatch(place.name) and not place.is_symlink() and _abandoned(place):
                mine = place.with_name(_place_name())
                try:
                    place.rename(mine)
                except OSError:  # another kernel was faster, or this one may not
                    continue
                self._hold(mine)
                if any(mine.glob("*.npz")):
                    return
                self.discard()  # its first second was not over


def _abandoned(place: Path) -> bool:
    """Whether nobody records there any more."""
    started, pid, *by_boot = map(int, place.name.split("-"))
    if pid == os.getpid():
        return place not in _HELD
    try:
        born = psutil.Process(pid).create_time()
    except psutil.NoSuchProcess:
        return True
    # Or a later process was given the same number. The clock on the wall may have been set since; how old a process and
    # a recording are now does not depend on it.
    if not by_boot:  # a recording of an earlier version
        return born > started / 1e9
    boot, clock = by_boot
    return boot != _boot() or time.time() - born < (time.monotonic_ns() - clock) / 1e9 - 1


def _place_name() -> str:
    """Of a recording that begins now: when, by whom, and when since which start of the machine."""
    return f"{time.time_ns()}-{os.getpid()}-{_boot()}-{time.monotonic_ns()}"


@cache
def _boot() -> int:
    """What tells this start of the machine from others; 0 where the system does not say."""
    path = Path("/proc/sys/kernel/random/boot_id")
    return int(path.read_text()[:8], 16) if path.exists() else 0


def _joined(policies: list[str]) -> str:
    """Names of policies, each once, in the order of their first appearance: `control, hand`."""
    names = [name for policy in policies for name in policy.split(", ") if name]
    return ", ".join(dict.fromkeys(names))
