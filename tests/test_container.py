"""The container: it asks for what a fresh Debian needs, and notebook 00 passes in it where a container can be run."""

import json
import re
import shutil
import subprocess
import time
import tomllib
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
IMAGE = "clothlab-test"
DRAWING = {"libegl1", "libgl1-mesa-dri"}
ASKED = "import urllib.request as u; print(u.urlopen('http://localhost:8888/api').read().decode())"


def recipe():
    return (ROOT / "Dockerfile").read_text().replace("\\\n", " ")


def test_it_installs_what_the_readme_says_a_fresh_debian_needs():
    asked = set(re.search(r"apt-get install ([^&]*)", recipe())[1].split())
    assert asked >= DRAWING
    for name in DRAWING:
        assert name in (ROOT / "README.md").read_text()
        assert name in (ROOT / ".ci" / "run").read_text()


def test_its_python_is_new_enough():
    oldest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"].removeprefix(">=")
    version = re.search(r"^FROM python:([\d.]+)", recipe(), re.MULTILINE)[1]
    assert [int(part) for part in version.split(".")] >= [int(part) for part in oldest.split(".")]


def test_it_does_not_run_as_root_and_opens_a_notebook_that_exists():
    last = recipe()[recipe().rindex("USER ") :]
    assert last.startswith("USER ${NB_USER}")
    assert (ROOT / json.loads(re.search(r"CMD (.*)", last)[1])[-1]).exists()


def test_what_it_copies_leaves_out_what_is_not_the_repositorys():
    left_out = set((ROOT / ".dockerignore").read_text().split())
    ignored = {line.strip("/") for line in (ROOT / ".gitignore").read_text().split() if line.startswith(("data/", "."))}
    assert ignored - {".ipynb_checkpoints"} <= left_out
    assert {".git", "build"} <= left_out


@pytest.fixture(scope="module")
def docker():
    """Runs a command of the container runtime that answers."""
    for name in ("docker", "podman"):
        if shutil.which(name) and not subprocess.run([name, "info"], capture_output=True, timeout=60).returncode:
            return lambda *words, **options: subprocess.run([name, *words], check=True, text=True, **options)
    pytest.skip("NO CONTAINER RUNTIME ANSWERS (docker, podman): the container was not built, and nothing ran in it")


@pytest.fixture(scope="module")
def image(docker):
    docker("build", "--tag", IMAGE, str(ROOT), timeout=1800)
    return IMAGE


@pytest.mark.container
def test_notebook_00_passes_in_it_without_a_network(docker, image):
    run = ["python", "-m", "pytest", "--nbmake", "--nbmake-timeout=300", "notebooks/00_start_here.ipynb"]
    docker("run", "--rm", "--network", "none", image, *run, timeout=900)


@pytest.mark.container
def test_jupyterlab_answers_in_it(docker, image):
    answer = "{}"
    name = docker("run", "--rm", "--detach", "--network", "none", image, capture_output=True).stdout.strip()
    try:
        for _ in range(60):
            try:
                answer = docker("exec", name, "python", "-c", ASKED, capture_output=True).stdout
            except subprocess.CalledProcessError:
                time.sleep(1)
            else:
                break
        assert "version" in json.loads(answer)
    finally:
        docker("kill", name, capture_output=True)
