"""The live lab on a page of the web site, without Python behind it.

A browser refuses modules and data that lie beside a page in a folder. So all that
belongs to the page is plain scripts, and a file is packed into one.
"""

import base64
import gzip
import re
from collections.abc import Mapping
from contextlib import closing
from importlib import metadata
from pathlib import Path
from string import Template
from typing import Any

from clothlab._files import write_bytes
from clothlab.lab import LivePanel, LiveSession
from clothlab.lab._equipment import SETUPS
from clothlab.lab._traces import traces
from clothlab.lab._views import REACHABLE, Views
from clothlab.simulation.arm import JOINTS
from course.lab_constants import as_json, method_files
from course.lab_scene import any_cloth_scene, cloths
from course.npm import packages
from course.repository import ROOT, throw_page

SOURCES = ROOT / "docs" / "book" / "lab"
# Who can drive there: a controller for each kind of start
DRIVERS = ["control", "control: last", "control: earlier"]
DRIVERS += ["iterative", "manual", "random", "operator"]
_EXPORT = "export default { render };"
# What the page itself does, and what its worker does
_PAGE = ["files", "traits", "geometry", "scene_picture", "ellipse"]
_PAGE += ["views", "live_lab", "robot", "page"]
_WORKER = ["files", "geometry", "physics", "arm", "stage", "camera", "drivers"]
_WORKER += ["session", "networks", "controller", "estimator"]
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
    write_bytes(folder / "licences.txt", licences().encode())


def licences() -> str:
    """Under which conditions others' work is on the page."""
    texts = []
    for package, names in _LICENCES.items():
        found = {file.name: file for file in metadata.files(package) or ()}
        texts += [f"{package}\n\n{found[name].read_text()}" for name in names]
    return "\n\n".join(texts)


def write_robot(folder: Path) -> None:
    """Write what a robot in the page is made of.

    What its worker does, MuJoCo, what runs networks, and each arm, with the method for
    it and what the page shows of it. A FileNotFoundError where `make npm` is missing.
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
    parts = {
        "worker": {"worker.js": worker.encode()},
        "mujoco": {"mujoco.wasm": wasm},
        "onnxruntime": runs,
    }
    for arm in SETUPS:
        files = arm_files(arm)
        parts[arm] = {f"{arm}/{name}": file for name, file in files.items()}
    for name, files in parts.items():
        write_packed(folder / f"{name}.js", files)


def arm_files(arm: str) -> dict[str, bytes]:
    """All of an arm that the page loads when a visitor chooses it, by name."""
    with closing(LiveSession(arm)) as session:
        about = as_json(lab_data(session))
    return method_files(session.equipment) | {"lab.json": about}


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


def lab_data(session: LiveSession) -> dict[str, Any]:
    """What a session in the page begins with, and what its panel shows of it."""
    views = Views(session)
    arm = session.arm

    # What a person chooses from
    chosen = {"arm": arm.name, "drivers": DRIVERS}

    # The scene, and the map of p
    axes = views.plane._axes
    return {
        "about": views.fixtures() | chosen,
        "scene": any_cloth_scene(arm.name, session.equipment.setup.cloth),
        "cloths": cloths(arm),
        "plots": _plots(session),
        "plane": {"mean": axes.mean_.tolist(), "axes": axes.components_.tolist()},
        "usual_distance": session.equipment.usual_distance,
        "reachable": REACHABLE,
    }


def _plots(session: LiveSession) -> list[dict[str, Any]]:
    """What the plots of a run look like, and where a moment has the values of a line.

    They are those of a step by a controller, without what it was.
    """
    places: dict[str, list[str | int]] = {
        "distance": ["distance"],
        "predicted at each step": ["predicted"],
        "f_const": ["command", len(JOINTS)],
        "step": ["milliseconds"],
    }
    for j, joint in enumerate(JOINTS):
        places |= {joint: ["theta", j], f"{joint} ref": ["command", j]}
    plots = traces(session, [session.step()])
    for plot in plots:
        for line in plot["lines"]:
            del line["values"]
            line["place"] = places[line["name"]]
    return plots
