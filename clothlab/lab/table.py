"""Setting the table in the live lab: a task in a thread of its own, and what is shown of it. No widgets here.

A look at the table takes longer than a step of the live session may. The scene and its OpenGL contexts are made, used
and closed in the thread of the task.
"""

import contextlib
import threading
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import mujoco
import numpy as np

from clothlab import artifacts
from clothlab._validation import choose
from clothlab.lab.clock import Clock
from clothlab.lab.messages import Messages
from clothlab.lab.views import encoded
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.table_scene import task
from clothlab.table_scene.servoing import lay_slowly
from clothlab.table_scene.table_env import TableEnv
from clothlab.table_scene.task import PHASES, Outcome, Spreader

_SIZE = (288, 384)  # [pixel] height and width of the picture
_PATIENCE = 100  # periods without a sign from the browser, after which the page is taken to be closed
_PERIOD = 0.05  # [s] after which the panel asks for a picture again

_Draw = Callable[[], np.ndarray]  # makes a picture [h, w, 3], uint8


class _Stopped(Exception):
    """A person stopped the robot."""


def _draw(env: TableEnv) -> np.ndarray:
    """The whole scene, without shadows, which take two thirds of the time."""
    env.renderer(*_SIZE).scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
    return env.camera_picture(*_SIZE, view="room")


_load = cache(artifacts.load)


def _thrower() -> Spreader:
    """Loads what a throw needs now, so that the robot need not wait for it."""
    learned = _load("table-0")
    task.successful_throws(learned)
    task.spread_target()
    return lambda driver: task.excite_and_throw(driver, learned)


_SPREADERS: dict[str, Callable[[], Spreader]] = {"throw it": _thrower, "lay it slowly": lambda: lay_slowly}


def _play(method: str, seed: int, watch: Callable[[_Draw], None], progress: Callable[[str], None]) -> Outcome:
    """Run a task: `watch` gets a function that draws the scene, `progress` each phase; what they raise ends it."""
    spreader = _SPREADERS[method]()
    progress("")
    return task.run_task(spreader, seed, watch=lambda env: watch(partial(_draw, env)), progress=progress)


def _verdict(outcome: Outcome) -> list[dict[str, Any]]:
    """How cloth and basket really lie and stand, in words: `[{text, good}]`."""
    lines, pose, stands = [], outcome.pose, outcome.placement
    if pose is not None:
        text = f"cloth {'' if pose.spread else 'not '}spread: {pose.flat:.0%} of it flat on the table, "
        text += f"{pose.area:.0%} of its area, turned by {abs(pose.angle):.0f}°"
        lines.append({"text": text, "good": pose.spread})
    if stands is not None:
        text = f"basket {'' if outcome.placed else 'not '}placed: {'' if stands.on_table else 'not on the table, '}"
        text += f"tilted by {stands.tilt:.1f}°, {100 * stands.off_centre:.1f} cm off the cloth's centre, "
        text += f"cloth dragged by {100 * (outcome.dragged or 0.0):.1f} cm"
        lines.append({"text": text, "good": outcome.placed})
    return lines


def _conclusion(outcome: Outcome) -> str:
    """What became of a task, in a sentence."""
    took = f"after {outcome.steps * CONTROL_PERIOD:.0f} s of the robot's time"
    if outcome.failed:
        return f"“{outcome.failed}” failed {took}: {outcome.cause}"
    return f"the table is set, {took}" if outcome.success else f"the robot takes the table for set, {took}; it is not"


class TableSection:
    """The part of the panel that sets the table, one task at a time, not faster than its pictures are shown.

    `show` gets what the browser is to show, plain data and a picture; `drawn` is the last frame that it has drawn.
    """

    def __init__(self, show: Callable[[dict[str, Any]], None], errors: list[str]):
        self._send, self._messages = show, Messages(errors)
        self._clock = Clock(self._tick, _PERIOD)
        self._thread, self._changed = threading.Thread(), threading.Condition()
        self._phase, self._stopping = "", False
        self._outcome: Outcome | None = None
        self._drawing: np.ndarray | None = None  # the last period's picture; the thread waits until it is taken
        self._picture, self._news = b"", dict[str, Any]()
        self.drawn = self._number = self._unseen = 0  # _unseen: periods since a frame that the browser has not drawn
        self._show()

    @property
    def running(self) -> bool:
        """Whether a task runs."""
        return self._thread.is_alive()

    def start(self, method: str, seed: int | None = None) -> None:
        """Begin a task with one of the spreaders; the seed, by default drawn, says where rack and basket stand."""
        choose("way to spread the cloth", method, _SPREADERS)
        if self.running:
            raise ValueError("the robot is setting the table already: stop it first")
        seed = int(np.random.default_rng().integers(1_000_000)) if seed is None else seed
        self._clock.start()
        self._messages.say(f"task {seed}; the number says where rack and basket stand")
        self._phase, self._stopping, self._outcome, self._drawing = "", False, None, None
        self._picture, self._unseen = b"", 0
        self._thread = threading.Thread(target=self._work, args=(method, seed), name="setting the table", daemon=True)
        self._thread.start()
        self._show()

    def stop(self, reason: str = "stopped") -> None:
        """Let the robot stop at the end of its control period, if it runs."""
        if self.running and not self._stopping:
            self._messages.say(reason)
            self._halt()
            self._show()

    def close(self) -> None:
        """Leave nothing behind: no task, no thread, no OpenGL context."""
        self._clock.pause()
        self._halt()
        if self.running:
            self._thread.join(timeout=10)

    def _halt(self) -> None:
        with self._changed:
            self._stopping = True
            self._changed.notify_all()

    def _work(self, method: str, seed: int) -> None:
        def until_stopped() -> None:
            with contextlib.suppress(_Stopped):
                self._outcome = _play(method, seed, self._watch, self._progress)

        self._messages.guarded(until_stopped)

    def _watch(self, draw: _Draw) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._stopping or self._drawing is None)
        self._check()
        picture = draw()
        self._check()
        self._drawing = picture

    def _progress(self, phase: str) -> None:
        self._check()
        self._phase = phase

    def _check(self) -> None:
        if self._stopping:
            raise _Stopped

    def _tick(self, behind: float) -> bool:
        """Show what is new, unless the browser has not drawn the last frame yet; False after the end."""
        going = self.running  # asked first, so that nothing comes after what is shown last
        self._unseen = 0 if self.drawn == self._number else self._unseen + 1
        if self._unseen > _PATIENCE:
            self.stop("stopped: the page does not answer")
        if (not self._unseen or not going) and not self._messages.guarded(self._take):
            self.close()
            self._show()
            return False
        return going

    def _take(self) -> None:
        with self._changed:
            drawing, self._drawing = self._drawing, None
            self._changed.notify_all()
        if drawing is not None:
            self._picture = encoded(drawing, ".jpg")
        if self._outcome is not None:
            self._messages.say(_conclusion(self._outcome))
        self._show()

    def _show(self) -> None:
        """Send a frame if something is new."""
        marks = ["waiting"] * len(PHASES)
        if self._phase:
            reached = PHASES.index(self._phase)
            mark = "stopped" if self._stopping else "running" if self.running else "failed"
            if self._outcome is not None:
                mark = "failed" if self._outcome.failed else "done"
            marks[: reached + 1] = ["done"] * reached + [mark]
        news = {
            "choices": list(_SPREADERS),
            "running": self.running,
            "phases": list(zip(PHASES, marks, strict=True)),
            "message": self._messages.shown,
            "verdict": _verdict(self._outcome) if self._outcome else [],
            "picture": self._picture,
        }
        if news != self._news:
            self._news, self._number = news, self._number + 1
            self._send(news | {"number": self._number})
