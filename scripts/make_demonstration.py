"""Record the run that the live lab plays back where a machine can't keep up: the
demonstration of docs/course/demo.md.

A panel does what its buttons do, without a browser and without waiting for the time to
pass.
"""

import numpy as np
from tqdm import trange

from clothlab import data
from clothlab.lab import LivePanel
from clothlab.lab._playback import RECORDING, SessionRecording
from clothlab.lab._views import MATERIAL
from clothlab.masks import HEIGHT, WIDTH
from clothlab.simulation.env import CONTROL_PERIOD

L = np.zeros((HEIGHT, WIDTH), bool)  # a letter, which no cloth looks like
L[20:80, 30:42] = L[68:80, 30:80] = True
# An action, by the name that the browser has for it, and its arguments
Press = tuple[str, dict]


def scenes(panel: LivePanel) -> list[tuple[float, str, list[Press]]]:
    """How long [s], what to say meanwhile, and what is pressed before."""
    cloth = panel.state["cloth"]
    dots = [dot["at"] for dot in panel.about["map"]["dots"]]
    far = max(dots, key=lambda at: np.linalg.norm(np.subtract(at, panel.frame["at"])))
    heavy = {"damping": cloth["material"][0], "mass": MATERIAL["C_mass [kg]"][1]}
    last = [("pick", {"name": "target-2"}), ("set driver", {"driver": "iterative"})]
    return [
        (
            4,
            "a robot holds a cloth; how should it move?",
            [("set driver", {"driver": "manual"})],
        ),
        (12, "random commands", [("set driver", {"driver": "random"})]),
        (
            18,
            "predictive control descends the gradient on the commands",
            [("set driver", {"driver": "control"})],
        ),
        (12, "the p of another material", [("set p", {"at": far})]),
        (16, "p is estimated online", [("estimate", {"on": True})]),
        (16, "another cloth in the hand", [("set material", heavy)]),
        (
            5,
            "a target that no cloth looks like",
            [("set cloth", {"cloth": cloth["name"]}), ("draw", {"content": L})],
        ),
        (27, "iterative learning control learns from achieved distances", last),
    ]


def press(panel: LivePanel, do: str, arguments: dict) -> None:
    """As a browser does, which sends pixels beside the message."""
    content = (
        [arguments.pop("content").astype(np.uint8).tobytes()]
        if "content" in arguments
        else []
    )
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
        for _ in trange(round(seconds / CONTROL_PERIOD), desc=caption, unit="step"):
            panel.step()
            reel.take(caption)
    panel.check()
    panel.close()
    path = data.data_folder() / RECORDING
    reel.save(path)
    data.write_checksums()
    print(
        f"{path}: {len(reel.shots) * CONTROL_PERIOD:.0f} s in {path.stat().st_size / 1e6:.1f} MB"
    )


if __name__ == "__main__":
    main()
