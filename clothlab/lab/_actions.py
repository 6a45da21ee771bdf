"""What the panel does for each message of its page."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import HEIGHT, WIDTH, choose
from clothlab.lab._targets import uploaded_mask
from clothlab.simulation.arm import Arm

if TYPE_CHECKING:
    from clothlab.lab._panel import LivePanel


def stick_command(arm: Arm, places: Sequence[float]) -> np.ndarray:
    """Command `[D_u]` where sticks and trigger stand in its range, 0 to 1.

    A place without a command is left out.
    """
    lower = arm.command_lower
    upper = arm.command_upper
    return lower + np.clip(places[: len(lower)], 0, 1) * (upper - lower)


class PanelActions:
    """What a person can do in a panel.

    Each action says in the panel's message what it did, if it can't be seen.
    """

    def __init__(self, panel: "LivePanel", say: Callable[[str], None]):
        self._panel = panel
        self._session = panel.session
        self._say = say

    def named(self) -> dict[str, Callable[..., object]]:
        """The actions by the names that the page has for them.

        Their arguments have the page's names, too; `content` is a file's bytes.
        """
        panel = self._panel
        session = self._session
        return {
            # Time
            "start": panel.start,
            "pause": panel.pause,
            "step": panel.step,
            "reset": panel.reset,
            # The cloth in the hand, and what is known of it
            "set cloth": panel.set_cloth,
            "set material": session.set_material,
            "set p": self._set_p,
            "estimate": self._estimate,
            # The arm, and who moves it
            "set arm": panel.set_arm,
            "set driver": session.set_driver,
            "explore": self._explore,
            "set tension": panel.set_tension,
            "set hand": self._take_over,
            "greet gamepad": self._greet_gamepad,
            "move sticks": self._move_sticks,
            # The target
            "draw": self._draw,
            "clear": self._clear,
            "pick": self._pick,
            "take": self._take,
            "upload": self._upload,
            # The recording
            "record": self._record,
            "stop": self._stop,
            "save": self._save,
            "discard": self._discard,
        }

    def _estimate(self, on: bool) -> None:
        self._session.estimating = on

    def _explore(self, on: bool) -> None:
        self._session.exploring = on

    def _draw(self, content: bytes) -> None:
        """Aim at what was drawn: a byte for each pixel, 0 or 1, row by row."""
        mask = np.frombuffer(content, np.uint8).reshape(HEIGHT, WIDTH)
        self._panel.aim(mask, show=False)

    def _clear(self) -> None:
        self._say("draw a target; until then the robot keeps the one that it has")

    def _pick(self, name: str) -> None:
        self._panel.aim(choose("image", name, self._session.gallery))

    def _take(self) -> None:
        """Aim at what the camera sees now."""
        self._panel.aim(self._session.observation["image"])

    def _set_p(self, at: Sequence[float]) -> None:
        """Use the p of a place on the map `[2]`."""
        self._session.set_p(self._panel.views.plane.p(at))

    def _move_sticks(self, places: Sequence[float]) -> None:
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
