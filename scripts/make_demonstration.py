"""`make demonstration`: record the run that the live lab plays back.

It plays it where a machine can't keep up; docs/course/demo.md follows its scenes. A
panel does what its buttons do, without a browser and without waiting for the time to
pass.
"""

from typing import NamedTuple

import numpy as np
from tqdm import trange

from clothlab import _store
from clothlab._validation import HEIGHT, WIDTH
from clothlab.lab import LivePanel
from clothlab.lab._playback import RECORDING, SessionRecording
from clothlab.lab._views import MATERIAL
from clothlab.simulation.env import CONTROL_PERIOD

L = np.zeros((HEIGHT, WIDTH), bool)  # a letter, which no cloth looks like
L[20:80, 30:42] = True
L[68:80, 30:80] = True


class Press(NamedTuple):
    """An action."""

    do: str  # the name that the browser has for it
    arguments: dict


class Scene(NamedTuple):
    """What is pressed, and what is to be seen then."""

    seconds: float
    caption: str
    presses: list[Press]


def scenes(panel: LivePanel) -> list[Scene]:
    """The scenes of the demonstration, in order."""

    def drive(driver: str) -> Press:
        return Press("set driver", {"driver": driver})

    # What the presses need of the panel: the farthest p, a heavy material, its cloth
    here = panel.frame["at"]
    dots = [dot["at"] for dot in panel.about["map"]["dots"]]
    far = max(dots, key=lambda at: np.linalg.norm(np.subtract(at, here)))
    cloth = panel.state["cloth"]
    heavy = {"damping": cloth["material"][0], "mass": MATERIAL["C_mass [kg]"][1]}
    back = Press("set cloth", {"cloth": cloth["name"]})
    draw = Press("draw", {"content": L})
    easy = Press("pick", {"name": "target-2"})

    # From a robot that waits to one that learns
    question = "a robot holds a cloth; how should it move?"
    descent = "predictive control descends the gradient on the commands"
    learning = "iterative learning control learns from achieved distances"
    return [
        Scene(4, question, [drive("manual")]),
        Scene(12, "random commands", [drive("random")]),
        Scene(18, descent, [drive("control")]),
        Scene(12, "the p of another material", [Press("set p", {"at": far})]),
        Scene(16, "p is estimated online", [Press("estimate", {"on": True})]),
        Scene(16, "another cloth in the hand", [Press("set material", heavy)]),
        Scene(5, "a target that no cloth looks like", [back, draw]),
        Scene(27, learning, [easy, drive("iterative")]),
    ]


def press(panel: LivePanel, do: str, arguments: dict) -> None:
    """As a browser does, which sends pixels beside the message."""
    content = []
    if "content" in arguments:
        content.append(arguments.pop("content").astype(np.uint8).tobytes())
    panel._handle_custom_msg({"do": do, "id": do, **arguments}, content)
    if panel.state["message"]["kind"] != "info":
        raise RuntimeError(f"{do}: {panel.state['message']['text']}")


def main() -> None:
    """Play the scenes one after the other."""
    panel = LivePanel()
    reel = SessionRecording(panel)
    for seconds, caption, presses in scenes(panel):
        for do, arguments in presses:
            press(panel, do, arguments)
        steps = round(seconds / CONTROL_PERIOD)
        for _ in trange(steps, desc=caption, unit="step"):
            panel.step()
            reel.take(caption)
    panel.check()
    panel.close()

    # Kept where the lab looks for it
    path = _store.data_folder() / RECORDING
    reel.save(path)
    _store.write_checksums()
    length = len(reel.shots) * CONTROL_PERIOD
    print(f"{path}: {length:.0f} s in {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
