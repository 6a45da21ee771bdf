"""The live panel: one widget, in which a person steers a session.

Its JavaScript draws what `Views` says, and sends back what the person does.
"""

import traceback
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from clothlab._validation import HEIGHT, WIDTH, choose
from clothlab.lab.session import LiveSession, StepInfo
from clothlab.lab.views import HISTORY, Views, still_picture
from clothlab.lab.widget import Clock, LoopCallbacks, Widget, javascript
from clothlab.simulation.arm import Arm
from clothlab.simulation.env import CONTROL_PERIOD, SimulationError
from clothlab.simulation.vision import mask_from_file

# What a person can do wrong; the rest is our fault
KNOWN_ERRORS = (ValueError, KeyError, OSError, SimulationError)
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
        if not isinstance(session, LiveSession | None):
            kind = type(session).__name__
            raise ValueError(f"session is a LiveSession, got {kind} {session!r:.80}")

        # One session at a time
        self.session = session or LiveSession()
        if LivePanel._active is not None:
            LivePanel._active.close()
        LivePanel._active = self

        # How far it is, and what went wrong
        self.history: deque[StepInfo] = deque(maxlen=HISTORY)
        self.steps = 0  # since the panel was built
        self.drawn = 0  # number of the last frame that the browser drew
        self.errors: list[str] = []
        self._sent = 0  # steps when the last frame was sent
        self._answered = ""  # the last message that was acted on
        self._say("")

        # Time, and what a person does
        self._clock = Clock(self._tick, CONTROL_PERIOD)
        self._callbacks = LoopCallbacks()
        super().__init__()
        self.on_msg(self._receive)
        self._show_arm()

    @property
    def running(self) -> bool:
        """Whether time goes by."""
        return self._clock.running

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
        if not hasattr(self, "_clock"):  # it was refused before it was one
            return
        self._clock.pause()
        if LivePanel._active is self:
            LivePanel._active = None
        self.session.close()
        super().close()

    def still(self) -> tuple[bytes, str]:
        """The last frame that was sent, and the target."""
        return still_picture(self.frame, self.target)

    def _tick(self, behind: float) -> bool:
        """A step in time, which comes so late [s].

        False pauses, after an error or when the page does not answer.
        """
        solve = behind < CONTROL_PERIOD
        went_well = self._guarded(lambda: self._advance(solve=solve))
        went_well = went_well and self._guarded(self._show)
        if went_well and self.steps - self._sent <= _PATIENCE:
            return True

        if went_well:
            self._say("paused: the page does not answer")
        self._clock.pause()
        self._refresh()
        return False

    def _advance(self, *, solve: bool) -> None:
        self.history.append(self.session.step(solve=solve))
        self.steps += 1

    # What the browser is sent

    def _show_arm(self) -> None:
        """Send all anew, as another arm has it."""
        self.history.clear()
        self.views = Views(self.session)
        with self.hold_sync():  # the browser gets names and values together
            self.about = self.views.about()
            self._show_target()
            self._show(force=True)

    def _show_target(self, *, on_canvas: bool = True) -> None:
        """Send the target; a drawn one is on the canvas already."""
        version = self.target.get("version", 0) + on_canvas
        self.target = self.views.target() | {"version": version}

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
        status = "late" if self._clock.late else "running"
        self.state = self.views.state() | {
            "running": self.running,
            "status": status if self.running else "paused",
            "message": self._message,
            "answered": self._answered,
        }

    def _say(self, text: str, kind: str = "info") -> None:
        """Show this message from now on; the kind is `info`, `mistake` or `fault`."""
        self._message = {"text": text, "kind": kind}

    def _guarded(self, act: Callable[[], object]) -> bool:
        """Call `act`, and answer whether it went well; an error becomes a message."""
        try:
            act()
        except KNOWN_ERRORS as error:
            # A KeyError would put its text into quotation marks
            words = error.args[0] if isinstance(error, KeyError) else error
            self._say(f"⚠ {words}", "mistake")
        except Exception as error:
            self.errors.append(traceback.format_exc())
            words = traceback.format_exception_only(error)[-1].strip()
            self._say(f"✗ a fault in the panel: {words}", "fault")
        else:
            return True
        return False

    # What a person does

    def _receive(self, _: object, content: Any, buffers: Sequence[bytes]) -> None:
        """Handle a message of the browser.

        It may come in another thread, and then waits for the end of a step.
        """
        arguments = dict(content)
        do = arguments.pop("do")
        if buffers:
            arguments["content"] = bytes(buffers[0])
        if do == "drawn":
            self.drawn = arguments["frame"]
        else:
            self._callbacks.call(self._act, do, arguments)

    def _act(self, do: str, arguments: dict[str, Any]) -> None:
        """Do what a person asked for, and answer how things stand then.

        The answer comes even where nothing changed.
        """
        self._answered = arguments.pop("id")
        self._say("")
        self._guarded(lambda: self._actions()[do](**arguments))
        show = self._refresh if self.running else partial(self._show, force=True)
        self._guarded(show)

    def _actions(self) -> dict[str, Callable[..., object]]:
        """What a person can do, by the page's names for it and for its arguments.

        Each says in the panel's message what it did, if it can't be seen.
        """
        session = self.session
        return {
            # Time
            "start": self.start,
            "pause": self.pause,
            "step": self.step,
            "reset": self.reset,
            # The cloth in the hand, and what is known of it
            "set cloth": session.set_cloth,
            "set material": session.set_material,
            "set p": lambda at: session.set_p(self.views.plane.p(at)),
            "estimate": lambda on: setattr(session, "estimating", on),
            # The arm, and who moves it
            "set arm": self._set_arm,
            "set driver": session.set_driver,
            "explore": lambda on: setattr(session, "exploring", on),
            "set tension": self._set_tension,
            "set hand": self._take_over,
            "greet gamepad": self._greet_gamepad,
            "move sticks": lambda places: self._take_over(
                stick_command(session.arm, places)
            ),
            # The target; the content of a file is its bytes
            "draw": self._draw,
            "clear": lambda: self._say(
                "draw a target; until then the robot keeps the one that it has"
            ),
            "pick": lambda name: self._aim(choose("image", name, session.gallery)),
            "take": lambda: self._aim(session.observation["image"]),
            "upload": lambda content: self._aim(mask_from_file(content)),
            # The recording
            "record": self._record,
            "stop": self._stop,
            "save": lambda name: self._say(
                f"saved as {session.recorder.save(name).name}"
            ),
            "discard": self._discard,
        }

    def _aim(self, mask: np.ndarray) -> None:
        """Aim at an image `[H, W]`."""
        self.session.set_target(mask)
        self._show_target()

    def _draw(self, content: bytes) -> None:
        """Aim at what was drawn: a byte for each pixel, 0 or 1, row by row."""
        self.session.set_target(np.frombuffer(content, np.uint8).reshape(HEIGHT, WIDTH))
        self._show_target(on_canvas=False)

    def _set_arm(self, name: str) -> None:
        """Change the arm, with its own cloth, target and p."""
        self.session.set_arm(name)
        self._show_arm()

    def _set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command [N], or leave it free with None."""
        self.session.set_tension(f_const)
        self._draw_ellipse()

    def _take_over(self, u: ArrayLike) -> None:
        """A person who moves a slider or a stick drives from then on."""
        self.session.set_hand(u)
        self.session.set_driver("manual")

    def _greet_gamepad(self, enough: bool) -> None:
        if not enough:
            raise ValueError("a gamepad needs two sticks and a trigger")
        uses = "left stick: shoulder, right stick: elbow"
        if self.session.arm.has_stiffness:
            uses += ", right trigger: stiffness"
        self._say(f"gamepad: {uses}")

    def _record(self) -> None:
        self.session.record()
        self.history.clear()
        self._say("recording, from the hanging cloth")

    def _stop(self) -> None:
        self.session.recorder.stop()
        self._say("stopped: give it a name and save it, or discard it")

    def _discard(self) -> None:
        self.session.recorder.discard()
        self._say("discarded")


def stick_command(arm: Arm, places: Sequence[float]) -> np.ndarray:
    """Command `[D_u]` where sticks and trigger stand in its range, 0 to 1.

    A place without a command is left out.
    """
    lower = arm.command_lower
    upper = arm.command_upper
    return lower + np.clip(places[: len(lower)], 0, 1) * (upper - lower)
