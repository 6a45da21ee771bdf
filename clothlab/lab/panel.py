"""The live panel: one widget, whose JavaScript draws what `views` says and sends back what a person does."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from clothlab._validation import choose
from clothlab.alt_text import AltText
from clothlab.lab import views
from clothlab.lab.clock import Clock, LoopCallbacks
from clothlab.lab.drivers import stick_command
from clothlab.lab.messages import Messages
from clothlab.lab.playback import Playback
from clothlab.lab.session import LiveSession, StepInfo
from clothlab.lab.table import TableSection
from clothlab.lab.targets import uploaded_mask
from clothlab.lab.widget import Widget
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.vision import HEIGHT, WIDTH

ELLIPSE_EVERY = 5  # steps; matplotlib takes a third of a step for it
PATIENCE = 25  # steps without a sign from the browser, after which the page is taken to be closed


class LivePanel(Widget, anywidget.AnyWidget):
    """Everything under one panel, in real time; an earlier panel of this kernel is closed.

    Args:
        session: what is steered; by default a new session with the torque arm.

    Attributes:
        session: what is steered.
        errors: tracebacks of faults in callbacks, which a notebook's last cell raises with `check`.
        steps: how many steps were made since the panel was built.
        drawn: number of the last frame that the browser drew.
        history: the last steps.
        about: names, ranges and sizes, for the browser, as are those below.
        state: where every control stands, and the message.
        target: the target and what the network makes of it.
        frame: pictures, traces and p. None is sent until the browser has drawn the last one, so that a slow
            browser skips frames and never queues them.
        ellipse: PNG.
        table: what there is to see of a task of setting the table, which is no part of the session.
    """

    _esm = views.javascript("text", "traces", "target", "map", "gamepad", "table", "style", "panel")
    about = traitlets.Dict().tag(sync=True)
    state = traitlets.Dict().tag(sync=True)
    target = traitlets.Dict().tag(sync=True)
    frame = traitlets.Dict().tag(sync=True)
    ellipse = traitlets.Bytes().tag(sync=True)
    table = traitlets.Dict().tag(sync=True)

    _active: ClassVar["LivePanel | None"] = None

    def __init__(self, session: LiveSession | None = None):
        self._clock, self._callbacks = Clock(self._tick, CONTROL_PERIOD), LoopCallbacks()
        self.session = session or LiveSession()
        if LivePanel._active is not None:
            LivePanel._active.close()
        LivePanel._active = self
        self._messages = Messages()
        self.errors = self._messages.errors
        self.history: deque[StepInfo] = deque(maxlen=views.HISTORY)
        self.steps = self._unseen = self.drawn = 0  # _unseen: steps since the last frame was sent
        self._broken = False  # whether time stands still since a step failed
        self._answered = ""  # the last message that was acted on
        super().__init__()
        self._playback = Playback(self)
        self._setting = TableSection(lambda news: setattr(self, "table", news), self.errors)
        self.on_msg(self._hear)
        self._meet_arm()

    @property
    def running(self) -> bool:
        """Whether time goes by."""
        return self._clock.running

    @property
    def late(self) -> int:
        """How many steps began more than half a period late."""
        return self._clock.late

    @property
    def status(self) -> str:
        """How it goes, in a word: `running`, `paused`, `late`, or `fault` after a fault or a step that failed."""
        if self._broken or self._messages.shown["kind"] == "fault":
            return "fault"
        return "paused" if not self.running else "late" if self._clock.lately else "running"

    def start(self) -> None:
        """Let time go by, 5 steps a second."""
        self._broken = False
        self._clock.start()
        self._show(force=True)  # a page that was reloaded has not drawn the last one

    def pause(self) -> None:
        """Stop time."""
        self._clock.pause()
        self._show(force=True)

    def step(self) -> None:
        """Make a single step."""
        self._broken = False
        self._advance(solve=True)
        self._show(force=True)

    def reset(self) -> None:
        """Let the cloth hang still again."""
        self.session.reset()
        self._broken = False
        self.history.clear()
        self._show(force=True)

    def close(self) -> None:
        """Leave nothing behind: no task, no thread, no widget, no OpenGL context."""
        self._clock.pause()
        self._playback.close()
        self._setting.close()
        if LivePanel._active is self:
            LivePanel._active = None
        self.session.close()
        super().close()

    def still(self) -> tuple[bytes, AltText]:
        """The last frame that was sent, and the target."""
        return views.still(self.frame, self.target)

    def _tick(self, behind: float) -> bool:
        """A step in time; False pauses, after an error or when nobody looks."""
        guarded = self._messages.guarded
        going = guarded(lambda: self._advance(solve=behind < CONTROL_PERIOD)) and guarded(self._show)
        self._broken = not going
        if going and self._unseen > PATIENCE:
            self._messages.say("paused: the page does not answer")
            going = False
        if not going:
            self._clock.pause()
            self._refresh()
        return going

    def _advance(self, solve: bool) -> None:
        self.history.append(self.session.step(solve=solve))
        self.steps += 1
        self._unseen += 1

    def _show(self, force: bool = False) -> None:
        """Send how things stand, and a frame unless the browser has not drawn the last one yet."""
        self._refresh()
        number = self.frame.get("number", 0)
        if self.drawn == number or force:
            self._unseen = 0
            self.frame = views.frame(self.session, self._plane, list(self.history)) | {"number": number + 1}
            if self.steps % ELLIPSE_EVERY == 0 or force:
                self._draw_ellipse()

    def _draw_ellipse(self) -> None:
        self.ellipse = views.ellipse(self.session, self.history[-1].command if self.history else self.session.hand)

    def _refresh(self) -> None:
        more = {
            "running": self.running,
            "status": self.status,
            "message": self._messages.shown,
            "answered": self._answered,
        }
        self.state = views.state(self.session) | more

    def show_all(self) -> None:
        """Send everything anew, and a frame."""
        with self.hold_sync():  # the browser gets names and values together
            self.about = views.fixtures(self.session, self._plane)
            self._aim(self.session.target)
            self._show(force=True)

    def _meet_arm(self) -> None:
        self.history.clear()
        self._plane = views.plane(self.session)
        self.show_all()

    def _hear(self, _: object, content: dict[str, Any], buffers: Sequence[bytes]) -> None:
        """Take a message of the browser, perhaps in another thread: it then waits for the end of a step."""
        if content.get("do") == "drawn":
            self.drawn = content["frame"]
        elif content.get("do") == "table drawn":
            self._setting.drawn = content["frame"]
        else:
            self._callbacks.take(self._act, content, buffers)

    def _act(self, content: dict[str, Any], buffers: Sequence[bytes]) -> None:
        """Do what a person asked for, and answer how things stand then, even where nothing changed."""
        arguments = {key: value for key, value in content.items() if key not in ("do", "id")}
        if buffers:
            arguments["content"] = bytes(buffers[0])
        self._messages.say("")
        self._playback.stop()  # whatever a person does is meant for the robot that is here
        self._messages.guarded(lambda: choose("action", content.get("do", ""), self._actions())(**arguments))
        self._answered = content.get("id", "")
        self._messages.guarded(lambda: self._refresh() if self.running else self._show(force=True))

    def _actions(self) -> dict[str, Callable[..., object]]:
        """What the browser may ask for, by name."""
        session = self.session
        return {
            "start": self.start,
            "pause": self.pause,
            "step": self.step,
            "reset": self.reset,
            "set arm": self._set_arm,
            "set driver": session.set_driver,
            "explore": lambda on: setattr(session, "exploring", bool(on)),
            "set cloth": session.set_cloth,
            "set material": session.set_material,
            "set tension": self._set_tension,
            "set p": lambda at: session.set_p(self._plane.p(at)),
            "estimate": lambda on: setattr(session, "estimating", bool(on)),
            "set hand": self._take_over,
            "greet gamepad": lambda enough: self._messages.say(views.gamepad(session, enough)),
            "move sticks": self._move_sticks,
            "draw": lambda content: self._aim(np.frombuffer(content, np.uint8).reshape(HEIGHT, WIDTH), show=False),
            "clear": lambda: self._messages.say("draw a target; until then the robot keeps the one that it has"),
            "pick": lambda name: self._aim(choose("image", name, session.gallery)),
            "take": lambda: self._aim(session.observation["image"]),
            "upload": lambda size, content=b"": self._aim(uploaded_mask(content, size)),
            "record": self._record,
            "stop": self._stop,
            "save": self._save,
            "discard": self._discard,
            "play": self._playback.start,
            "live": lambda: None,
            "set the table": self._setting.start,
            "stop the task": self._setting.stop,
        }

    def _set_arm(self, name: str) -> None:
        self.session.set_arm(name)
        self._meet_arm()

    def _set_tension(self, f_const: float | None) -> None:
        self.session.set_tension(f_const)
        self._draw_ellipse()

    def _aim(self, mask: np.ndarray, show: bool = True) -> None:
        """Aim at an image `[H, W]`; `show` puts it on the canvas, where a drawn one is already."""
        self.session.set_target(mask)
        self.target = views.target(self.session) | {"version": self.target.get("version", 0) + show}

    def _take_over(self, u: ArrayLike) -> None:
        """Drive by hand: whoever moves a slider takes over."""
        self.session.set_hand(u)
        self.session.set_driver("manual")

    def _move_sticks(self, places: Sequence[float]) -> None:
        """Command where sticks and trigger stand in their range, 0 to 1."""
        self._take_over(stick_command(self.session.arm, places))

    def _record(self) -> None:
        self.session.record()
        self.history.clear()
        self._messages.say("recording, from the hanging cloth")

    def _stop(self) -> None:
        self.session.recorder.stop()
        self._messages.say("stopped: give it a name and save it, or discard it")

    def _save(self, name: str) -> None:
        self._messages.say(f"saved as {self.session.recorder.save(name).name}")

    def _discard(self) -> None:
        self.session.recorder.discard()
        self._messages.say("discarded")
