"""Setting the table in the live lab: an episode in a thread of its own, and what is shown of it. No widgets here.

The live session's steps take turns with all else that the kernel does. An episode cannot: its phases are loops, and a
look at the table takes longer than a step may. Its scene and the OpenGL contexts are made, used and closed in its
thread; others see its pictures alone.
"""

import contextlib
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np

from clothlab._validation import choose
from clothlab.experiments import table_setting
from clothlab.experiments.table_setting import DYNAMIC, METHODS, Settings
from clothlab.lab.clock import Clock
from clothlab.lab.messages import Messages
from clothlab.lab.views import encoded
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.table_scene.servoing import Mover, lay_slowly
from clothlab.table_scene.table_env import TableEnv
from clothlab.table_scene.task import PHASES, Outcome, Spreader

SIZE = (288, 384)  # [pixel] height and width of the picture; the robot's looks have another, and other renderers
PERIOD = 0.05  # [s] after which the panel asks for a picture again
PATIENCE = 100  # such periods without a sign from the browser, after which the page is taken to be closed
SEEDS = 1_000_000  # as many episodes are drawn from
PARTING = 10.0  # [s] to wait at most for the end of a thread that was told to stop

Draw = Callable[[], np.ndarray]  # a picture [h, w, 3], uint8
Play = Callable[[Callable[[Draw], None], Callable[[str], None]], Outcome]  # an episode, that tells watch and progress


class Stopped(Exception):
    """Somebody stopped the robot."""


def aside(env: TableEnv) -> np.ndarray:
    """The scene as somebody sees it who stands aside, `SIZE`, without shadows, which take two thirds of the time."""
    eye = mujoco.MjvCamera()
    eye.lookat[:], eye.distance, eye.azimuth, eye.elevation = (-0.45, 0.0, 0.55), 3.5, 125.0, -22.0
    renderer = env.renderer(*SIZE)
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
    renderer.update_scene(env.data, eye)
    return renderer.render()


def _throw(settings: Settings, check: Callable[[], None]) -> Spreader:
    """Who throws the cloth. What that needs is loaded now, piece by piece, so that the robot need not wait for it."""
    name = f"{settings.weights}-{settings.models[0]}"
    try:
        learned = table_setting.trained(name)
    except KeyError as error:
        raise KeyError(
            f"to throw the cloth, the robot needs the weights {name}, which are not there: run `make train`, or let "
            "it lay the cloth slowly"
        ) from error
    check()
    table_setting.good_throws(name)
    check()
    table_setting.target(settings.foam, settings.ahead)

    def spread(mover: Mover) -> None:
        METHODS[DYNAMIC](settings, learned, mover)

    return spread


def _lay(settings: Settings, check: Callable[[], None]) -> Spreader:
    return lay_slowly


SPREADERS: dict[str, Callable[[Settings, Callable[[], None]], Spreader]] = {"throw it": _throw, "lay it slowly": _lay}


def play(how: str, seed: int, watch: Callable[[Draw], None], progress: Callable[[str], None]) -> Outcome:
    """An episode of `experiments.table_setting` that can be stopped while it gets ready, too.

    Args:
        how: the cloth is spread, one of `SPREADERS`.
        seed: where rack and basket stand.
        watch: told after each control period how to draw the scene. What it or `progress` raises ends the episode.
        progress: told the name of each phase as it begins; an empty one while it gets ready.

    Raises:
        KeyError: weights or recordings that are missing; the message says what to do.
    """
    settings = Settings()
    spreader = SPREADERS[how](settings, partial(progress, ""))
    progress("")
    return table_setting.play(settings, spreader, seed, watch=lambda env: watch(partial(aside, env)), progress=progress)


class TableRun:
    """An episode that runs in a thread of its own, not faster than its pictures are taken.

    Args:
        play: the episode: told whom to tell of each control period, and of each phase.
        messages: where an error becomes a message.

    Attributes:
        messages: that place.
        phase: the last one begun, one of `PHASES`; empty while the episode gets ready.
        outcome: what became of it; None before its end, and where it was stopped or failed to run.
        stopping: whether it was told to stop.
    """

    def __init__(self, play: Play, messages: Messages):
        self._play, self.messages = play, messages
        self.phase, self.stopping = "", False
        self.outcome: Outcome | None = None
        self._picture: np.ndarray | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="setting the table", daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it still runs; one that was told to stop does, until the end of its control period."""
        return self._thread.is_alive()

    def take(self) -> np.ndarray | None:
        """The picture of the last control period `[h, w, 3]`, once; then the episode goes on to the next."""
        with self._changed:
            picture, self._picture = self._picture, None
            self._changed.notify_all()
        return picture

    def stop(self, *, wait: bool = False) -> None:
        """Let the robot move no farther than to the end of the control period.

        Args:
            wait: until thread and OpenGL contexts are gone.
        """
        with self._changed:
            self.stopping = True
            self._changed.notify_all()
        if wait:
            self._thread.join(PARTING)

    def marks(self) -> list[str]:
        """How far it got: for each of `PHASES` "done", "running", "failed", "stopped" or "waiting"."""
        reached = PHASES.index(self.phase) if self.phase else -1
        marks = ["done"] * max(0, reached) + ["waiting"] * (len(PHASES) - max(0, reached))
        if self.phase:
            marks[reached] = self._mark()
        return marks

    def _mark(self) -> str:
        """That of the phase begun last."""
        if self.outcome is not None:
            return "failed" if self.outcome.failed else "done"
        if self.stopping:
            return "stopped"
        return "running" if self.alive else "failed"

    def _work(self) -> None:
        self.messages.guarded(self._until_stopped)

    def _until_stopped(self) -> None:
        with contextlib.suppress(Stopped):
            self.outcome = self._play(self._watch, self._progress)

    def _watch(self, draw: Draw) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self.stopping or self._picture is None)
        self._check()
        picture = draw()
        self._check()
        self._picture = picture

    def _progress(self, phase: str) -> None:
        self._check()
        self.phase = phase

    def _check(self) -> None:
        if self.stopping:
            raise Stopped


def verdict(outcome: Outcome) -> list[dict[str, Any]]:
    """How cloth and basket really lie and stand, in words: `[{text, good}]`."""
    lines, lies, stands = [], outcome.spread, outcome.placement
    if lies is not None:
        word = "spread" if lies.success else "not spread"
        text = f"cloth {word}: {lies.flat:.0%} of its points flat on the table, area {lies.area:.0%} of the flat "
        lines.append({"text": text + f"cloth's, turned by {abs(lies.angle):.0f}°", "good": lies.success})
    if stands is not None:
        word, dragged = "placed" if outcome.placed else "not placed", 100 * (outcome.dragged or 0.0)
        text = f"basket {word}: {'' if stands.on_table else 'not on the table, '}tilted by {stands.tilt:.1f}°, "
        text += f"{100 * stands.off_centre:.1f} cm off the cloth's centre, cloth dragged by {dragged:.1f} cm"
        lines.append({"text": text, "good": outcome.placed})
    return lines


def conclusion(outcome: Outcome) -> str:
    """What became of an episode, in a sentence."""
    took = f"after {outcome.steps * CONTROL_PERIOD:.0f} s of the robot's time"
    if outcome.failed:
        return f"“{outcome.failed}” failed {took}: {outcome.cause}"
    if outcome.success:
        return f"the table is set, {took}"
    return f"the robot thinks that the table is set, {took}, but it is not"


class TableSection:
    """The part of the panel that sets the table: one episode at a time.

    Args:
        show: told what the browser is to show: plain data, and the picture's bytes.
        errors: where tracebacks of faults are kept.

    Attributes:
        drawn: number of the last frame that the browser has drawn.
    """

    def __init__(self, show: Callable[[dict[str, Any]], None], errors: list[str]):
        self._tell, self._messages = show, Messages(errors)
        self._clock = Clock(self._tick, PERIOD)
        self._run: TableRun | None = None
        self._picture, self._news = b"", dict[str, Any]()
        self.drawn = self._number = self._unseen = 0  # _unseen: periods since a frame that the browser has not drawn
        self._show()

    @property
    def running(self) -> bool:
        """Whether an episode runs."""
        return self._run is not None and self._run.alive

    def start(self, how: str, seed: int | None = None) -> None:
        """Begin an episode.

        Args:
            how: the cloth is spread, one of `SPREADERS`.
            seed: where rack and basket stand; drawn by default.

        Raises:
            KeyError: unknown way to spread it; the message lists the choices.
            ValueError: one runs already.
            RuntimeError: no event loop runs, as in a plain script.
        """
        choose("way to spread the cloth", how, SPREADERS)
        if self.running:
            raise ValueError("the robot is setting the table already: stop it first")
        seed = int(np.random.default_rng().integers(SEEDS)) if seed is None else seed
        self._clock.start()
        self._messages.say(f"episode {seed}; the number says where rack and basket stand")
        self._picture, self._unseen = b"", 0
        self._run = TableRun(partial(play, how, seed), self._messages)
        self._show()

    def stop(self, why: str = "stopped") -> None:
        """Let the robot stop at the end of its control period; without an episode, nothing happens."""
        if self._run is not None and self.running and not self._run.stopping:
            self._messages.say(why)
            self._run.stop()
            self._show()

    def close(self) -> None:
        """Leave nothing behind: no task, no thread, no OpenGL context."""
        self._clock.pause()
        if self._run is not None:
            self._run.stop(wait=True)

    def _tick(self, behind: float) -> bool:
        """Show what is new, unless the browser has not drawn the last frame yet; False after the end."""
        going = self.running  # asked first, so that nothing comes after what is shown last
        self._unseen = 0 if self.drawn == self._number else self._unseen + 1
        if self._unseen > PATIENCE:
            self.stop("stopped: the page does not answer")
        if (not self._unseen or not going) and not self._messages.guarded(self._take):
            self.close()
            self._show()
            return False
        return going

    def _take(self) -> None:
        assert self._run is not None
        picture = self._run.take()
        if picture is not None:
            self._picture = encoded(picture, ".jpg")
        if self._run.outcome is not None:
            self._messages.say(conclusion(self._run.outcome))
        self._show()

    def _show(self) -> None:
        """Send a frame if something is new."""
        run = self._run
        news = {
            "choices": list(SPREADERS),
            "running": self.running,
            "phases": list(zip(PHASES, run.marks() if run else ["waiting"] * len(PHASES), strict=True)),
            "message": self._messages.shown,
            "verdict": verdict(run.outcome) if run and run.outcome else [],
            "picture": self._picture,
        }
        if news != self._news:
            self._news, self._number = news, self._number + 1
            self._tell(news | {"number": self._number})
