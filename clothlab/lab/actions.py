"""What the panel does for each message of the browser."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import choose
from clothlab.lab.targets import uploaded_mask
from clothlab.simulation.arm import Arm
from clothlab.simulation.vision import HEIGHT, WIDTH

if TYPE_CHECKING:
    from clothlab.lab.panel import LivePanel


def stick_command(arm: Arm, places: Sequence[float]) -> np.ndarray:
    """Command `[D_u]` where sticks and trigger stand in its range, 0 to 1; a place without a command is left out."""
    lower, upper = arm.command_lower, arm.command_upper
    return lower + np.clip(places[: len(lower)], 0, 1) * (upper - lower)


class PanelActions:
    """What a person can do in a panel; each action says in the panel's message what it did, if it can't be seen."""

    def __init__(self, panel: "LivePanel", say: Callable[[str], None]):
        self._panel, self._session, self._say = panel, panel.session, say

    def named(self) -> dict[str, Callable[..., object]]:
        """The actions by the names that the browser has for them."""
        panel, session = self._panel, self._session
        return {
            "start": panel.start,
            "pause": panel.pause,
            "step": panel.step,
            "reset": panel.reset,
            "set arm": panel.set_arm,
            "set driver": session.set_driver,
            "explore": lambda on: setattr(session, "exploring", bool(on)),
            "set cloth": panel.set_cloth,
            "set material": session.set_material,
            "set tension": panel.set_tension,
            "set p": lambda at: session.set_p(panel.views.plane.p(at)),
            "estimate": lambda on: setattr(session, "estimating", bool(on)),
            "set hand": self._take_over,
            "greet gamepad": self._greet_gamepad,
            "move sticks": lambda places: self._take_over(stick_command(session.arm, places)),
            "draw": lambda content: panel.aim(np.frombuffer(content, np.uint8).reshape(HEIGHT, WIDTH), show=False),
            "clear": lambda: self._say("draw a target; until then the robot keeps the one that it has"),
            "pick": lambda name: panel.aim(choose("image", name, session.gallery)),
            "take": lambda: panel.aim(session.observation["image"]),
            "upload": lambda size, content=b"": panel.aim(uploaded_mask(content, size)),
            "record": self._record,
            "stop": self._stop,
            "save": self._save,
            "discard": self._discard,
        }

    def _take_over(self, u: ArrayLike) -> None:
        """A person who moves a slider or a stick drives from then on."""
        self._session.set_hand(u)
        self._session.set_driver("manual")

    def _greet_gamepad(self, enough: bool) -> None:
        if not enough:
            raise ValueError("a gamepad needs two sticks and a trigger")
        trigger = ", right trigger: stiffness" if self._session.arm.has_stiffness else ""
        self._say(f"gamepad: left stick: shoulder, right stick: elbow{trigger}")

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
