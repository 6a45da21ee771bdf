"""The live lab on a page of the web site, without Python behind it.

A browser refuses modules and data that lie beside a page in a folder. So the panel is
one plain script there, and the recorded run another.
"""

import base64
import gzip
import lzma
from pathlib import Path
from typing import Any

from clothlab import _store
from clothlab._files import write_bytes
from clothlab._validation import HEIGHT, WIDTH
from clothlab.lab import LivePanel
from clothlab.lab._playback import RECORDING
from clothlab.simulation import vision
from clothlab.simulation._mjcf import build_spec, portable_mjcf
from clothlab.simulation.env import ClothEnv
from course.repository import ROOT

SOURCES = ROOT / "docs" / "book" / "lab"
_EXPORT = "export default { render };"


def write_lab(folder: Path) -> None:
    """Write the scripts of the page into a folder."""
    write_bytes(folder / "lab.js", _script().encode())
    write_bytes(folder / "run.js", _run().encode())


def _script() -> str:
    """The panel, its model and the page as one script that leaves no names behind."""
    parts = [str(LivePanel._esm).replace(_EXPORT, "")]
    parts += [
        (SOURCES / f"{name}.js").read_text("utf-8") for name in ("recorded_run", "page")
    ]
    return "(() => {\n" + "\n".join(parts) + "})();\n"


def _run() -> str:
    """The recorded run as a script: its JSON by gzip, which browsers unpack."""
    recording = (_store.data_folder() / RECORDING).read_bytes()
    packed = gzip.compress(lzma.decompress(recording), mtime=0)
    return f'globalThis.clothlabRun = "{base64.b64encode(packed).decode()}";\n'


def scene(arm: str, cloth: str) -> dict[str, Any]:
    """What physics and camera need of an arm with a cloth that hangs still in its hand.

    Its MJCF, where it starts, the time steps of a control period, and how a picture
    becomes a mask.
    """
    env = ClothEnv(arm, cloth)
    spec = build_spec(env.arm, env.cloth, env.scene)
    names = ("qpos", "qvel", "act", "ctrl")
    start = {name: getattr(env.data, name).tolist() for name in names}
    camera = {
        "size": (HEIGHT, WIDTH),
        "redness": vision._REDNESS,
        "kernel": vision.KERNEL.tolist(),
    }
    return {
        "mjcf": portable_mjcf(spec),
        "start": start,
        "substeps": env.scene.substeps,
        "camera": camera,
    }
