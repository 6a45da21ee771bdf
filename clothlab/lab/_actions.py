"""What the panel does for each message of the browser, and what it may hold."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import (
    HEIGHT,
    WIDTH,
    check_array,
    check_flag,
    check_number,
    choose,
)
from clothlab.lab._targets import uploaded_mask
from clothlab.simulation.arm import Arm

if TYPE_CHECKING:
    from clothlab.lab._panel import LivePanel


_LONGEST_IDENTITY = 64  # letters
_MOST_NUMBERS = 10  # in a list; commands have three


def stick_command(arm: Arm, places: Sequence[float] | np.ndarray) -> np.ndarray:
    """Command `[D_u]` where sticks and trigger stand in its range, 0 to 1.

    A place without a command is left out.
    """
    lower = arm.command_lower
    upper = arm.command_upper
    places = check_array("places of the sticks", places[: len(lower)], lower.shape)
    return lower + np.clip(places, 0, 1) * (upper - lower)


class Message(NamedTuple):
    """What a browser asks for.

    Anybody can send anything from a page, so that all of it is checked.
    """

    do: str  # the action
    identity: str  # of this message, by which its answer is known
    # Of the action, as JSON has them; `content` is a file's bytes
    arguments: dict[str, Any]

    @classmethod
    def read(cls, content: Any, buffers: Sequence[bytes]) -> "Message":
        """What a message says; `do` is empty where it names no action."""
        named = content if isinstance(content, Mapping) else {}
        arguments = dict(named)
        do = arguments.pop("do", None)
        identity = arguments.pop("id", None)
        if buffers:
            arguments["content"] = bytes(buffers[0])
        if not isinstance(do, str):
            do = ""
        if not isinstance(identity, str) or len(identity) > _LONGEST_IDENTITY:
            identity = ""
        return cls(do, identity, arguments)


def _text(what: str, value: Any) -> str:
    """A name or other short text."""
    if not isinstance(value, str):
        raise ValueError(f"{what} is a text, got {value!r:.40}")
    return value


def _numbers(what: str, value: Any) -> np.ndarray:
    """A short list of finite numbers `[N]`."""
    if not isinstance(value, list) or len(value) > _MOST_NUMBERS:
        raise ValueError(f"{what} is a short list of numbers, got {value!r:.40}")
    return check_array(what, value, ("N",))


def _count(what: str, value: Any) -> int:
    """A whole number."""
    return check_number(what, value, int)


def _force(what: str, value: Any) -> float | None:
    """A force [N], or None where it is free."""
    return None if value is None else check_number(what, value)


def _image(what: str, value: Any) -> np.ndarray:
    """An image `[H, W]` of 0 and 1, from its pixels row by row."""
    if not isinstance(value, bytes) or len(value) != HEIGHT * WIDTH:
        got = len(value) if isinstance(value, bytes) else f"{value!r:.40}"
        raise ValueError(
            f"{what} has {HEIGHT * WIDTH} bytes, one for each pixel, got {got}"
        )
    return np.frombuffer(value, np.uint8).reshape(HEIGHT, WIDTH)


def _file(what: str, value: Any) -> bytes:
    """What is in a file."""
    if not isinstance(value, bytes):
        raise ValueError(f"{what} is what is in a file, got {value!r:.40}")
    return value


class Action(NamedTuple):
    """What to call, and how each of its arguments is read."""

    call: Callable[..., object]
    reads: Mapping[str, Callable[[str, Any], Any]] = {}
    optional: frozenset[str] = frozenset()

    def __call__(self, arguments: Mapping[str, Any]) -> None:
        """Call it with the arguments of a message.

        A ValueError says what is missing, too much or of a wrong kind.
        """
        needed = self.reads.keys() - self.optional
        if not needed <= arguments.keys() <= self.reads.keys():
            takes = ", ".join(self.reads) or "nothing"
            got = ", ".join(map(repr, arguments)) or "nothing"
            raise ValueError(f"this action takes {takes}, got {got}")
        read = {
            name: self.reads[name](name, value) for name, value in arguments.items()
        }
        self.call(**read)


class PanelActions:
    """What a person can do in a panel.

    Each action says in the panel's message what it did, if it can't be seen.
    """

    def __init__(self, panel: "LivePanel", say: Callable[[str], None]):
        self._panel = panel
        self._session = panel.session
        self._say = say

    def act(self, message: Message) -> None:
        """Do what a message asks for; an error says what is wrong with it."""
        action = choose("action", message.do, self.named())
        action(message.arguments)

    def named(self) -> dict[str, Action]:
        """The actions by the names that the browser has for them."""
        return (
            self._of_time()
            | self._of_cloth()
            | self._of_commands()
            | self._of_target()
            | self._of_recording()
        )

    def _of_time(self) -> dict[str, Action]:
        panel = self._panel
        return {
            "start": Action(panel.start),
            "pause": Action(panel.pause),
            "step": Action(panel.step),
            "reset": Action(panel.reset),
        }

    def _of_cloth(self) -> dict[str, Action]:
        """The cloth in the hand, and what is known of it."""
        material = {"damping": check_number, "mass": check_number}
        return {
            "set cloth": Action(self._panel.set_cloth, {"cloth": _text}),
            "set material": Action(self._session.set_material, material),
            "set p": Action(self._set_p, {"at": _numbers}),
            "estimate": Action(self._estimate, {"on": check_flag}),
        }

    def _of_commands(self) -> dict[str, Action]:
        """The arm, and who moves it."""
        panel = self._panel
        return {
            "set arm": Action(panel.set_arm, {"name": _text}),
            "set driver": Action(self._session.set_driver, {"driver": _text}),
            "explore": Action(self._explore, {"on": check_flag}),
            "set tension": Action(panel.set_tension, {"f_const": _force}),
            "set hand": Action(self._take_over, {"u": _numbers}),
            "greet gamepad": Action(self._greet_gamepad, {"enough": check_flag}),
            "move sticks": Action(self._move_sticks, {"places": _numbers}),
        }

    def _of_target(self) -> dict[str, Action]:
        upload = {"size": _count, "content": _file}
        return {
            "draw": Action(self._draw, {"content": _image}),
            "clear": Action(self._clear),
            "pick": Action(self._pick, {"name": _text}),
            "take": Action(self._take),
            "upload": Action(self._upload, upload, frozenset({"content"})),
        }

    def _of_recording(self) -> dict[str, Action]:
        return {
            "record": Action(self._record),
            "stop": Action(self._stop),
            "save": Action(self._save, {"name": _text}),
            "discard": Action(self._discard),
        }

    def _estimate(self, on: bool) -> None:
        self._session.estimating = on

    def _explore(self, on: bool) -> None:
        self._session.exploring = on

    def _draw(self, content: np.ndarray) -> None:
        self._panel.aim(content, show=False)

    def _clear(self) -> None:
        self._say("draw a target; until then the robot keeps the one that it has")

    def _pick(self, name: str) -> None:
        self._panel.aim(choose("image", name, self._session.gallery))

    def _take(self) -> None:
        """Aim at what the camera sees now."""
        self._panel.aim(self._session.observation["image"])

    def _set_p(self, at: np.ndarray) -> None:
        """Use the p of a place on the map `[2]`."""
        place = check_array("a place on the map", at, (2,))
        self._session.set_p(self._panel.views.plane.p(place))

    def _move_sticks(self, places: np.ndarray) -> None:
        self._take_over(stick_command(self._session.arm, places))

    def _upload(self, size: int, content: bytes = b"") -> None:
        self._panel.aim(uploaded_mask(content, size))

    def _take_over(self, u: ArrayLike) -> None:
        """A person who moves a slider or a stick drives from then on."""
        self._session.set_hand(u)
        self._session.set_driver("manual")

    def _greet_gamepad(self, enough: bool) -> None:
        if not enough:
            raise ValueError("a gamepad needs two sticks and a trigger")
        uses = "left stick: shoulder, right stick: elbow"
        if self._session.arm.has_stiffness:
            uses += ", right trigger: stiffness"
        self._say(f"gamepad: {uses}")

    def _record(self) -> None:
        self._session.record()
        self._panel.history.clear()
        self._say("recording, from the hanging cloth")

    def _stop(self) -> None:
        self._session.recorder.stop()
        self._say("stopped: give it a name and save it, or discard it")

    def _save(self, name: str) -> None:
        self._say(f"saved as {self._session.recorder.save(name).name}")

    def _discard(self) -> None:
        self._session.recorder.discard()
        self._say("discarded")
