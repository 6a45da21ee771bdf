"""The live lab on a page of the web site, without Python behind it.

A browser refuses modules and data that lie beside a page in a folder. So all that
belongs to the page is plain scripts, and a file is packed into one.
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
from course.lab_constants import method_files
from course.npm import packages
from course.repository import ROOT

SOURCES = ROOT / "docs" / "book" / "lab"
_EXPORT = "export default { render };"


def write_lab(folder: Path) -> None:
    """Write the scripts of the page into a folder."""
    panel = str(LivePanel._esm).replace(_EXPORT, "")
    script = "\n".join([panel, sources("files", "recorded_run", "page")])
    write_bytes(folder / "lab.js", f"(() => {{\n{script}}})();\n".encode())
    recording = (_store.data_folder() / RECORDING).read_bytes()
    write_packed(folder / "run.js", "run.json", lzma.decompress(recording))


def write_robot(folder: Path) -> None:
    """Write what a robot in the page is made of: MuJoCo, and what the worker does."""
    library = packages()["@mujoco/mujoco"].folder
    module = (library / "mujoco.js").read_text("utf-8")
    # A page in a folder may start a plain script as its worker, and no module.
    script = module.replace("export default loadMujoco;", "")
    script = script.replace("import.meta.url", "self.location.href")
    worker = "\n".join([script, sources("physics", "camera", "worker")])
    write_packed(folder / "worker.js", "worker.js", worker.encode())
    wasm = (library / "mujoco.wasm").read_bytes()
    write_packed(folder / "mujoco.js", "mujoco.wasm", wasm)


def write_runtime(folder: Path) -> None:
    """Write what runs the graphs of an arm: onnxruntime."""
    library = packages()["onnxruntime-web"].folder / "dist"
    names = ("ort.wasm.min.js", "ort-wasm-simd-threaded.mjs")
    for name in (*names, "ort-wasm-simd-threaded.wasm"):
        write_packed(folder / f"{name}.js", name, (library / name).read_bytes())


def write_method(folder: Path, arm: str) -> None:
    """Write the method for an arm: files by names such as `torque/encode`."""
    files = method_files(arm).items()
    packed_files = [packed(f"{arm}/{name}", content) for name, content in files]
    write_bytes(folder / f"{arm}.js", b"".join(packed_files))


def sources(*names: str) -> str:
    """The page's own JavaScript, of these files."""
    return "\n".join((SOURCES / f"{name}.js").read_text("utf-8") for name in names)


def write_packed(path: Path, name: str, content: bytes) -> None:
    """Write a script that holds a file by this name, which `files.js` unpacks."""
    write_bytes(path, packed(name, content))


def packed(name: str, content: bytes) -> bytes:
    """A line of a script that holds a file by this name."""
    text = base64.b64encode(gzip.compress(content, mtime=0)).decode()
    return f'(globalThis.clothlabFiles ??= {{}})["{name}"] = "{text}";\n'.encode()


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
