"""How the notebooks are opened: by `make lab`, in a development container, and what the
workflows may do.
"""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
import tomllib
import urllib.error
import urllib.request

import pytest
import yaml
from make_locks import OLDEST, PYTHONS

from course.repository import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.fixture
def lab_command():
    """What `make lab` runs to start JupyterLab, as words."""
    if not shutil.which("make"):
        pytest.skip("no make")
    printed = subprocess.run(
        ["make", "-n", "lab"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    (line,) = [line for line in printed.splitlines() if "jupyter lab" in line]
    return line.split()


@pytest.mark.slow
def test_make_lab_serves_the_pictures_of_the_notebooks_and_opens_the_first_one(
    lab_command, tmp_path
):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    options = ["--no-browser", f"--port={port}", "--ServerApp.token=t", "--allow-root"]
    command = [sys.executable, "-m", "jupyter", *lab_command[1:], *options]
    environment = os.environ | {
        "JUPYTER_RUNTIME_DIR": str(tmp_path),
        "JUPYTER_CONFIG_DIR": str(tmp_path),
    }
    log = tmp_path / "lab.log"
    with log.open("w") as file:
        server = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=file, stderr=file
        )
    try:
        picture = f"http://localhost:{port}/files/docs/control.gif?token=t"
        for _ in range(120):
            try:
                answer = urllib.request.urlopen(picture, timeout=10)
                break
            except urllib.error.HTTPError as error:  # it answers, and has no such file
                pytest.fail(f"{error}: {picture}")
            except OSError:
                time.sleep(0.5)
        else:
            pytest.fail(log.read_text())
        assert answer.read() == (ROOT / "docs" / "control.gif").read_bytes()
        start = urllib.request.urlopen(
            f"http://localhost:{port}/?token=t", timeout=10
        ).url
        assert "/lab/tree/notebooks/00_start_here.ipynb" in start
    finally:
        server.terminate()
        server.wait(timeout=20)


def test_the_development_container_is_the_container():
    folder = ROOT / ".devcontainer"
    settings = json.loads((folder / "devcontainer.json").read_text())
    recipe = (folder / settings["build"]["dockerfile"]).resolve()
    assert recipe == ROOT / "Dockerfile"
    assert (folder / settings["build"]["context"]).resolve() == ROOT
    assert f"ARG NB_USER={settings['remoteUser']}\n" in recipe.read_text()
    # The image holds a copy of the package; the one that is edited has to come first.
    assert settings["remoteEnv"]["PYTHONPATH"] == "${containerWorkspaceFolder}"
    assert all(
        (ROOT / name).exists()
        for name in settings["customizations"]["codespaces"]["openFiles"]
    )


@pytest.fixture(params=WORKFLOWS, ids=lambda path: path.stem)
def workflow(request):
    return yaml.safe_load(request.param.read_text())


def steps(workflow):
    return [step for job in workflow["jobs"].values() for step in job["steps"]]


def test_a_workflow_pins_its_actions_and_bounds_its_time_and_rights(workflow):
    assert workflow["permissions"] == {"contents": "read"}, (
        "more only where a job needs it"
    )
    for step in steps(workflow):
        assert re.fullmatch(
            r"[\w./-]+@[0-9a-f]{40}", step.get("uses", "a@" + "0" * 40)
        ), step
    for name, job in workflow["jobs"].items():
        assert job["timeout-minutes"] <= 90
        assert name == "publish" or job.get("permissions", {}) == {}


def test_only_the_job_that_publishes_may_publish():
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "site.yml").read_text())[
        "jobs"
    ]
    assert jobs["publish"]["permissions"] == {"pages": "write", "id-token": "write"}
    assert jobs["publish"]["needs"] == "build"


def test_quick_tests_run_on_every_machine_that_the_readme_names():
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text())[
        "jobs"
    ]
    matrix = jobs["quick"]["strategy"]["matrix"]
    assert {each.split("-")[0] for each in matrix["os"]} == {
        "ubuntu",
        "macos",
        "windows",
    }
    assert set(matrix["python"]) == {".".join(each.split(".")[:2]) for each in PYTHONS}
    words = "\n".join(step.get("run", "") for step in jobs["quick"]["steps"])
    check = (ROOT / "Makefile").read_text().split("\ncheck: ")[1].split("\n\n")[0]
    for part in re.findall(r"\$\(BIN\)/([^\n;&]+)", check):
        assert part.strip() in words, (
            "the quick tests are `make check`, spelled out where there is no make"
        )


def test_make_runs_programs_that_are_there():
    makefile = (ROOT / "Makefile").read_text()
    programs = re.findall(r"\$\(BIN\)/python ([\w/]+\.py)", makefile)
    assert programs
    assert [each for each in programs if not (ROOT / each).exists()] == []


def test_ci_is_what_the_readme_says_and_nothing_else():
    lines = [
        line
        for line in (ROOT / ".ci" / "run").read_text().splitlines()
        if not line.startswith("#")
    ]
    command = "make --keep-going test pages"
    assert lines == ["set -euo pipefail", 'cd "$(dirname "$0")/.."', f"exec {command}"]
    assert f"`{command}`" in (ROOT / "README.md").read_text()


def test_the_readme_names_the_oldest_python_and_the_commands_of_every_system():
    readme = (ROOT / "README.md").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    oldest = project["requires-python"].removeprefix(">=")
    assert OLDEST.startswith(oldest)
    assert f"{oldest} to {list(PYTHONS)[-1].rsplit('.', 1)[0]}" in readme
    for line in (
        r"py -m venv .venv",
        r".venv\Scripts\python -m pip install -r environment.txt",
    ):
        assert f"\n{line}\n" in readme
    assert r".venv\Scripts\python -m clothlab doctor" in readme
    assert "Intel processor and Windows on ARM are not served" in readme


@pytest.mark.parametrize("absent", ["resource", "fcntl", "pwd", "grp", "termios"])
def test_nothing_that_windows_lacks_is_imported_before_it_is_needed(absent):
    files = [
        path
        for folder in ("clothlab", "examples", "tests")
        for path in (ROOT / folder).rglob("*.py")
    ]
    pattern = re.compile(rf"^(import|from) {absent}\b", re.MULTILINE)
    assert [path for path in files if pattern.search(path.read_text("utf-8"))] == []
