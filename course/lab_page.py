"""The live lab on a page of the web site, without Python behind it.

A browser refuses modules and data that lie beside a page in a folder. So all that
belongs to the page is plain scripts, and a file is packed into one.
"""

import base64
import gzip
import json
import lzma
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from string import Template
from typing import Any

from clothlab import _store
from clothlab._files import write_bytes
from clothlab._validation import HEIGHT, WIDTH
from clothlab.lab import LivePanel, LiveSession
from clothlab.lab._playback import RECORDING, _packed
from clothlab.lab._views import REACHABLE, Views
from clothlab.simulation import vision
from clothlab.simulation._lattice import point_names
from clothlab.simulation._mjcf import build_spec, portable_mjcf
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from course.lab_constants import method_files
from course.npm import packages
from course.repository import ROOT, throw_page

SOURCES = ROOT / "docs" / "book" / "lab"
# Who can drive there: a controller for each kind of start
DRIVERS = ["control", "control: last", "control: earlier"]
DRIVERS += ["iterative", "manual", "random", "operator"]
_EXPORT = "export default { render };"
# What the page itself does, and what its worker does
_PAGE = ["files", "traits", "recorded_run", "geometry", "scene_picture", "views"]
_PAGE += ["live_lab", "robot", "page"]
_WORKER = ["files", "geometry", "physics", "stage", "camera", "drivers", "session"]
_WORKER += ["networks", "controller", "estimator", "aim"]
_WORKER += ["iterative", "worker"]
# How a script begins that holds packed files
_PACKED = "globalThis.clothlabFiles ??= {};\n"
# The page as one file to take along
ONE_FILE = "throw_a_cloth.html"
_RUNTIME = "ort-wasm-simd-threaded"
# Whose work is on the page, and where its licence lies in its Python package; those on
# npm have none.
_LICENCES = {
    "mujoco": ("LICENSE", "LICENSES_THIRD_PARTY.md"),
    "onnxruntime": ("LICENSE", "ThirdPartyNotices.txt"),
}


def write_lab(folder: Path) -> None:
    """Write the scripts of the page into a folder."""
    panel = str(LivePanel._esm).replace(_EXPORT, "")
    script = "\n".join([panel, sources(*_PAGE)])
    write_bytes(folder / "lab.js", f"(() => {{\n{script}}})();\n".encode())
    recording = (_store.data_folder() / RECORDING).read_bytes()
    write_packed(folder / "run.js", {"run.json": lzma.decompress(recording)})
    write_bytes(folder / "licences.txt", licences().encode())


def licences() -> str:
    """Under which conditions others' work is on the page."""
    texts = []
    for package, names in _LICENCES.items():
        found = {file.name: file for file in metadata.files(package) or ()}
        texts += [f"{package}\n\n{found[name].read_text()}" for name in names]
    return "\n\n".join(texts)


def write_robot(folder: Path, arm: str = "torque") -> None:
    """Write what a robot in the page is made of.

    What its worker does, MuJoCo, what runs networks, the method for an arm, and what
    the page shows of it. A FileNotFoundError where `make npm` is missing.
    """
    mujoco = packages()["@mujoco/mujoco"].folder
    runtime = packages()["onnxruntime-web"].folder / "dist"
    if not (mujoco.is_dir() and runtime.is_dir()):
        raise FileNotFoundError("no files of npm are there: run `make npm`")

    # A page in a folder may start a plain script as its worker, and no module.
    module = (mujoco / "mujoco.js").read_text("utf-8")
    script = module.replace("export default loadMujoco;", "")
    script = script.replace("import.meta.url", "self.location.href")
    networks = (runtime / "ort.wasm.min.js").read_text("utf-8")
    worker = "\n".join([script, networks, sources(*_WORKER)])

    # Each part in a script of its own
    wasm = (mujoco / "mujoco.wasm").read_bytes()
    runs = {
        f"onnxruntime.{kind}": (runtime / f"{_RUNTIME}.{kind}").read_bytes()
        for kind in ("mjs", "wasm")
    }
    session = LiveSession(arm)
    session.close()
    made = method_files(session.equipment)
    method = {f"{arm}/{name}": file for name, file in made.items()}
    about = json.dumps(lab_data(session), default=_packed)
    parts = {
        "worker": {"worker.js": worker.encode()},
        "mujoco": {"mujoco.wasm": wasm},
        "onnxruntime": runs,
        arm: method,
        "lab-data": {"lab.json": about.encode()},
    }
    for name, files in parts.items():
        write_packed(folder / f"{name}.js", files)


def write_one_file(path: Path, scripts: Path) -> None:
    """Write the page as one file to take along, from the folder of its scripts.

    A part waits there in an element with its name, whose kind no browser runs.
    """
    texts = {each.name: each.read_text("utf-8") for each in scripts.glob("*.js")}
    parts = [
        f'<script type="text/plain" id="{name}">{text}</script>'
        for name, text in texts.items()
        if text.startswith(_PACKED)
    ]
    licences = base64.b64encode((scripts / "licences.txt").read_bytes()).decode()
    template = Template((SOURCES / "one_file.html").read_text("utf-8"))
    text = template.substitute(
        policy=policy(),
        page=throw_page(),
        licences=licences,
        parts="\n".join(parts),
        lab=texts["lab.js"],
    )
    write_bytes(path, text.encode())


def policy() -> str:
    """What the page may ask for, as its header says."""
    header = (SOURCES.parent / "throw.md").read_text("utf-8")
    (found,) = re.findall(r'Policy": "(.*)"', header)
    return str(found)


def sources(*names: str) -> str:
    """The page's own JavaScript, of these files."""
    return "\n".join((SOURCES / f"{name}.js").read_text("utf-8") for name in names)


def write_packed(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a script that holds files by their names, which `files.js` unpacks."""
    lines = [_PACKED]
    for name, content in files.items():
        packed = base64.b64encode(gzip.compress(content, mtime=0)).decode()
        lines.append(f'clothlabFiles["{name}"] = "{packed}";\n')
    write_bytes(path, "".join(lines).encode())


def scene(arm: str, cloth: Cloth | str) -> dict[str, Any]:
    """What physics and camera need of an arm with a cloth that hangs still in its hand.

    Its MJCF, where it starts, the time steps of a control period, and how a picture
    becomes a mask.
    """
    env = ClothEnv(arm, cloth)
    spec = build_spec(env.arm, env.cloth, env.scene)
    camera = {
        "size": (HEIGHT, WIDTH),
        "redness": vision._REDNESS,
        "kernel": vision.KERNEL.tolist(),
    }
    return {
        "mjcf": portable_mjcf(spec),
        "start": _start(env),
        "substeps": env.scene.substeps,
        "camera": camera,
    }


def _start(env: ClothEnv) -> dict[str, list[float]]:
    names = ("qpos", "qvel", "act", "ctrl")
    return {name: getattr(env.data, name).tolist() for name in names}


def any_cloth_scene(arm: str, cloth: Cloth | str) -> dict[str, Any]:
    """The same for cloths of any C_damp and C_mass, whose places are open in the MJCF.

    The cloth is put below the hand, and hangs still after `settle` time steps.
    """
    placed = ClothEnv(arm, cloth, scene=Scene(settle_time=0))
    world = scene(arm, cloth)

    # Names in braces where numbers of the cloth stand
    root = ElementTree.fromstring(world["mjcf"])
    names = {name for row in point_names(placed.cloth) for name in row}
    points = [body for body in root.iter("body") if body.get("name") in names]
    for body in points:
        for joint in body.findall("joint"):
            joint.set("damping", "{damping}")
        for ball in body.findall("geom"):
            ball.set("mass", "{mass}")

    # And how it begins
    return world | {
        "mjcf": ElementTree.tostring(root, encoding="unicode"),
        "start": _start(placed),
        "settle": round(Scene.settle_time / Scene.time_step),
        "timeStep": Scene.time_step,
        "points": len(points),
    }


def lab_data(session: LiveSession) -> dict[str, Any]:
    """What a session in the page begins with, and what its panel shows of it."""
    arm = session.arm.name
    views = Views(session)

    # What a person chooses from
    drivers = {"arms": [arm], "drivers": DRIVERS, "only": False}
    keys = ("name", "label", "damping", "mass")
    cloths = [{key: getattr(cloth, key) for key in keys} for cloth in CLOTHS.values()]

    # The scene, and the map of p
    axes = views.plane._axes
    return {
        "about": views.fixtures() | drivers,
        "scene": any_cloth_scene(arm, session.equipment.setup.cloth),
        "cloths": cloths,
        "plane": {"mean": axes.mean_.tolist(), "axes": axes.components_.tolist()},
        "reachable": REACHABLE,
    }
