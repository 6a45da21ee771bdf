"""Makes the page: its files are packed into plain scripts.

A browser refuses modules and data that lie beside a page in a folder. So all that
belongs to the page is plain scripts, and a file is packed into one.
"""

import base64
import gzip
import tomllib
from collections.abc import Mapping
from contextlib import closing
from importlib import metadata
from pathlib import Path
from string import Template

import joblib

from clothlab._files import write_bytes
from clothlab.lab import LivePanel, LiveSession
from web import ROOT
from web.constants import as_json, method_constants, panel_constants
from web.method import graphs
from web.npm import fetch, packages

SOURCES = Path(__file__).with_name("page")
# The page as one file to take along
ONE_FILE = "throw_a_cloth.html"
ARMS = ("torque", "muscle")
_EXPORT = "export default { render };"
# What the page itself does, and what its worker does
_PAGE = ["files", "traits", "geometry", "scene_picture", "ellipse", "views"]
_PAGE += ["live_lab", "robot", "page"]
_WORKER = ["files", "geometry", "physics", "arm", "stage", "camera", "drivers"]
_WORKER += ["session", "networks", "controller", "estimator"]
_WORKER += ["iterative", "worker"]
# How a script begins that holds packed files
_PACKED = "globalThis.clothlabFiles ??= {};\n"
_RUNTIME = "ort-wasm-simd-threaded"
# Whose work is on the page, and where its licence lies in its Python package; those on
# npm have none.
_LICENCES = {
    "mujoco": ("LICENSE", "LICENSES_THIRD_PARTY.md"),
    "onnxruntime": ("LICENSE", "ThirdPartyNotices.txt"),
}


def build(folder: Path) -> None:
    """Write the page into a folder: its scripts, and once more as one file."""
    scripts = {"lab.js": page_script()}
    for name, files in parts().items():
        scripts[f"{name}.js"] = packed(files)
    for name, text in scripts.items():
        write_bytes(folder / name, text.encode())

    # In one file, a part waits in an element that bears its name, whose kind no browser
    # runs
    waiting = [
        f'<script type="text/plain" id="{name}">{text}</script>'
        for name, text in scripts.items()
        if name != "lab.js"
    ]
    one_file = "\n".join([*waiting, f"<script>{scripts['lab.js']}</script>"])
    licences = base64.b64encode(_licences().encode()).decode()
    at = f"data:text/plain;base64,{licences}"
    write_bytes(folder / ONE_FILE, html(one_file, at).encode())
    along = (
        "<p>For a room without a network: "
        f'<a href="{ONE_FILE}" download>this page as one file</a>, which runs from '
        "wherever it lies.</p>"
    )
    write_bytes(folder / "licences.txt", _licences().encode())
    index = html('<script defer src="lab.js"></script>', "licences.txt", along)
    write_bytes(folder / "index.html", index.encode())


def html(scripts: str, licences: str, along: str = "") -> str:
    """The page itself, with where licences are, and a word on how to take it along."""
    template = Template((SOURCES / "index.html").read_text("utf-8"))
    return template.substitute(
        scripts=scripts, along=along, licences=licences, series=_series()
    )


def _series() -> str:
    """The series in words, with a link to it where it is published."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    address = project["urls"]["Repository"]
    words = "a series of notebooks"
    return f'<a href="{address}">{words}</a>' if address else words


def page_script() -> str:
    """The panel of the live lab, and what the page makes of it."""
    panel = str(LivePanel._esm).replace(_EXPORT, "")
    return f"(() => {{\n{panel}\n{_sources(*_PAGE)}}})();\n"


def parts() -> dict[str, dict[str, bytes]]:
    """What a robot in the page is made of, by part: files by their names.

    What its worker does, MuJoCo, what runs networks, and each arm, with the method for
    it and what the page shows of it.
    """
    for package in packages().values():
        fetch(package)
    mujoco = packages()["@mujoco/mujoco"].folder
    runtime = packages()["onnxruntime-web"].folder / "dist"

    # A page in a folder may start a plain script as its worker, and no module.
    module = (mujoco / "mujoco.js").read_text("utf-8")
    script = module.replace("export default loadMujoco;", "")
    script = script.replace("import.meta.url", "self.location.href")
    networks = (runtime / "ort.wasm.min.js").read_text("utf-8")
    worker = "\n".join([script, networks, _sources(*_WORKER)])

    found = {
        "worker": {"worker.js": worker.encode()},
        "mujoco": {"mujoco.wasm": (mujoco / "mujoco.wasm").read_bytes()},
        "onnxruntime": {
            f"onnxruntime.{kind}": (runtime / f"{_RUNTIME}.{kind}").read_bytes()
            for kind in ("mjs", "wasm")
        },
    }
    print("the method of both arms becomes graphs: a minute", flush=True)
    each_arm = joblib.Parallel(n_jobs=len(ARMS))(
        joblib.delayed(arm_files)(arm) for arm in ARMS
    )
    for arm, files in zip(ARMS, each_arm, strict=True):
        found[arm] = {f"{arm}/{name}": content for name, content in files.items()}
    return found


def arm_files(arm: str) -> dict[str, bytes]:
    """All of an arm that the page loads when a visitor chooses it, by name."""
    with closing(LiveSession(arm)) as session:
        constants = as_json(method_constants(session))
        about = as_json(panel_constants(session))
        return graphs(session.trained) | {"constants": constants, "lab.json": about}


def packed(files: Mapping[str, bytes]) -> str:
    """A script that holds files by their names, which `files.js` unpacks."""
    lines = [_PACKED]
    for name, content in files.items():
        text = base64.b64encode(gzip.compress(content, mtime=0)).decode()
        lines.append(f'clothlabFiles["{name}"] = "{text}";\n')
    return "".join(lines)


def _sources(*names: str) -> str:
    """The page's own JavaScript, of these files."""
    return "\n".join((SOURCES / f"{name}.js").read_text("utf-8") for name in names)


def _licences() -> str:
    """Under which conditions others' work is on the page."""
    texts = []
    for package, names in _LICENCES.items():
        found = {file.name: file for file in metadata.files(package) or ()}
        texts += [f"{package}\n\n{found[name].read_text('utf-8')}" for name in names]
    return "\n\n".join(texts)
