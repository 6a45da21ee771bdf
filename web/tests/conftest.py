"""The page that `python -m web build` made, a Chromium without a network, and Node.js."""

import base64
import gzip
import json
import re
import shutil
import subprocess
from pathlib import Path

import playwright
import pytest

from web import PAGE
from web.build import ARMS, SOURCES
from web.npm import packages

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
LOADING = 120_000  # [ms] that a robot may take, also on a machine that has much to do


@pytest.fixture(scope="session")
def folder():
    """The folder of the page."""
    assert (PAGE / "index.html").exists(), "run `python -m web build` first"
    return PAGE


@pytest.fixture(scope="session")
def browser_type_launch_args(browser_type_launch_args):
    """The system's Chromium; without one, Playwright takes its own."""
    options = browser_type_launch_args | {"args": ["--no-sandbox"]}
    for name in CHROMIUM:
        if path := shutil.which(name):
            return options | {"executable_path": path}
    return options


@pytest.fixture(scope="session")
def browser_context_args(browser_context_args):
    size = {"width": 1280, "height": 900}
    return browser_context_args | {"viewport": size, "offline": True}


@pytest.fixture
def visit(page):
    """Open a file in the browser; what it asked for beside files, and what it
    complained of, ends the test.
    """
    complaints = []

    def hear_request(asked):
        if not asked.url.startswith(("file:", "data:", "blob:")):
            complaints.append(asked.url)

    def hear_message(said):
        if said.type in ("error", "warning"):
            complaints.append(said.text)

    page.on("request", hear_request)
    page.on("console", hear_message)
    page.on("pageerror", lambda error: complaints.append(str(error)))

    def visit(file):
        page.goto(file.as_uri())
        return page

    yield visit
    assert complaints == []


def unpacked(script):
    """The files that a script of the page holds, by name."""
    pairs = re.findall(r'^clothlabFiles\["(.*)"\] = "(.*)";$', script.read_text(), re.M)
    return {name: gzip.decompress(base64.b64decode(text)) for name, text in pairs}


@pytest.fixture(scope="session")
def method_folders(folder, tmp_path_factory):
    """Of each arm, a folder with its graphs and the constants beside them."""
    folders = {}
    for arm in ARMS:
        folders[arm] = tmp_path_factory.mktemp(arm)
        for name, content in unpacked(folder / f"{arm}.js").items():
            if not name.endswith("lab.json"):
                (folders[arm] / name.split("/")[-1]).write_bytes(content)
    return folders


@pytest.fixture(scope="session")
def node(tmp_path_factory, method_folders):
    """Run a script beside this file in the Node.js that Playwright brings along, with
    MuJoCo, the page's sources and what it is given as JSON; what it prints as JSON.
    """
    mujoco = packages()["@mujoco/mujoco"].folder / "mujoco.js"
    runtime = packages()["onnxruntime-web"].folder / "dist"
    program = next((Path(playwright.__file__).parent / "driver").glob("node*"))
    file = tmp_path_factory.mktemp("node") / "given.json"

    def run(script, arm, content):
        where = {"folder": str(method_folders[arm]), "runtime": str(runtime)}
        file.write_text(json.dumps(where | content))
        command = [program, Path(__file__).with_name(script), mujoco, SOURCES, file]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run
