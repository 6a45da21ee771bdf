"""The live panel: one widget, in which a person steers a session.

Its JavaScript draws what `Views` says, and sends back what the person does.
"""

from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

import anywidget
import numpy as np
import traitlets

from clothlab.lab._actions import PanelActions
from clothlab.lab._clock import Clock, LoopCallbacks
from clothlab.lab._messages import Messages
from clothlab.lab._pictures import still
from clothlab.lab._session import LiveSession, StepInfo
from clothlab.lab._views import HISTORY, Views
from clothlab.lab._widget import Widget, javascript
from clothlab.simulation.env import CONTROL_PERIOD

_ELLIPSE_EVERY = 5  # steps; matplotlib takes a third of a step for it
# Steps without a drawn frame, after which the page is taken to be closed: on a server,
# its kernel would go on computing for nobody
_PATIENCE = 25


class LivePanel(Widget, anywidget.AnyWidget):
    """Everything under one panel, in real time.

    An earlier panel of this kernel is closed.

    Args:
        session: what is steered; by default a new session with the torque arm.
    """

    _esm = javascript("text", "traces", "target", "map", "gamepad", "style", "panel")
    about = traitlets.Dict().tag(sync=True)  # names, ranges and sizes
    # Where every control stands, and the message
    state = traitlets.Dict().tag(sync=True)
    target = traitlets.Dict().tag(sync=True)  # with what the autoencoder makes of it
    # Pictures, traces and p; the next one waits until this one is drawn
    frame = traitlets.Dict().tag(sync=True)
    ellipse = traitlets.Bytes().tag(sync=True)  # PNG

    _active: ClassVar["LivePanel | None"] = None

    def __init__(self, session: LiveSession | None = None):
        # One session at a time
        self.session = session or LiveSession()
        if LivePanel._active is not None:
            LivePanel._active.close()
        LivePanel._active = self

        # How far it is
        self.history: deque[StepInfo] = deque(maxlen=HISTORY)
        self.steps = 0  # since the panel was built
        self.drawn = 0  # number of the last frame that the browser drew
        self._sent = 0  # steps when the last frame was sent
        self._answered = ""  # the last message that was acted on

        # Time, words, and what a person can do
        self._clock = Clock(self._tick, CONTROL_PERIOD)
        self._callbacks = LoopCallbacks()
        self._messages = Messages()
        self.errors = self._messages.errors
        super().__init__()
        self._actions = PanelActions(self, self._messages.say)
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
    def _status(self) -> str:
        """The sign of the panel."""
        if not self.running:
            return "paused"
        return "late" if self._clock.lately else "running"

    def start(self) -> None:
        """Let time go by, 5 steps a second."""
        self._clock.start()
        self._show(force=True)  # a page that was reloaded has not drawn the last one

    def pause(self) -> None:
        """Stop time."""
        self._clock.pause()
        self._show(force=True)

    def step(self) -> None:
        """Make a single step."""
        self._advance(solve=True)
        self._show(force=True)

    def reset(self) -> None:
        """Let the cloth hang still again."""
        self.session.reset()
        self.history.clear()
        self._show(force=True)

    def close(self) -> None:
        """Leave nothing behind: no thread, no widget, no OpenGL context."""
        self._clock.pause()
        if LivePanel._active is self:
            LivePanel._active = None
        self.session.close()
        super().close()

    def still(self) -> tuple[bytes, str]:
        """The last frame that was sent, and the target."""
        return still(self.frame, self.target)

    def set_arm(self, name: str) -> None:
        """Change the arm, with its own cloth, target and p."""
        self.session.set_arm(name)
        self._meet_arm()

    def set_cloth(self, cloth: str) -> None:
        """Put another cloth into the hand."""
        self.session.set_cloth(cloth)

    def set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command [N], or leave it free with None."""
        self.session.set_tension(f_const)
        self._draw_ellipse()

    def aim(self, mask: np.ndarray, *, show: bool = True) -> None:
        """Aim at an image `[H, W]`.

        `show` puts it on the canvas, where a drawn one is already.
        """
        self.session.set_target(mask)
        version = self.target.get("version", 0) + show
        self.target = self.views.target() | {"version": version}

    def show_all(self) -> None:
        """Send everything anew, and a frame."""
        with self.hold_sync():  # the browser gets names and values together
            self.about = self.views.fixtures()
            self.aim(self.session.target)
            self._show(force=True)

    def _tick(self, behind: float) -> bool:
        """A step in time.

        False pauses, after an error or when the page does not answer.
        """
        solve = behind < CONTROL_PERIOD
        guarded = self._messages.guarded
        went_well = guarded(lambda: self._advance(solve=solve)) and guarded(self._show)
        if went_well and self.steps - self._sent <= _PATIENCE:
            return True

        if went_well:
            self._messages.say("paused: the page does not answer")
        self._clock.pause()
        self._refresh()
        return False

    def _advance(self, *, solve: bool) -> None:
        self.history.append(self.session.step(solve=solve))
        self.steps += 1

    def _show(self, *, force: bool = False) -> None:
        """Send how things stand, and a frame.

        No frame is sent while the browser has not drawn the last one yet, unless by
        force.
        """
        self._refresh()
        number = self.frame.get("number", 0)
        if self.drawn != number and not force:
            return
        self._sent = self.steps
        frame = self.views.frame(list(self.history))
        self.frame = frame | {"number": number + 1}
        if self.steps % _ELLIPSE_EVERY == 0 or force:
            self._draw_ellipse()

    def _draw_ellipse(self) -> None:
        u = self.history[-1].command if self.history else self.session.hand
        self.ellipse = self.views.ellipse(u)

    def _refresh(self) -> None:
        self.state = self.views.state() | {
            "running": self.running,
            "status": self._status,
            "message": self._messages.shown,
            "answered": self._answered,
        }

    def _meet_arm(self) -> None:
        self.history.clear()
        self.views = Views(self.session)
        self.show_all()

    def _hear(self, _: object, content: Any, buffers: Sequence[bytes]) -> None:
        """Take a message of the browser.

        It may come in another thread, and then waits for the end of a step.
        """
        arguments = dict(content)
        do = arguments.pop("do")
        if buffers:
            arguments["content"] = bytes(buffers[0])
        if do == "drawn":
            self.drawn = arguments["frame"]
        else:
            self._callbacks.take(self._act, do, arguments)

    def _act(self, do: str, arguments: dict[str, Any]) -> None:
        """Do what a person asked for, and answer how things stand then.

        The answer comes even where nothing changed.
        """
        self._answered = arguments.pop("id")
        self._messages.say("")
        self._messages.guarded(lambda: self._actions.named()[do](**arguments))
        show = self._refresh if self.running else partial(self._show, force=True)
        self._messages.guarded(show)
