"""The container: it asks for what a fresh Debian needs, and notebook 00 passes in it
where a container can be run.
"""

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
ASKED = "import urllib.request as u; print(u.urlopen('http://localhost:8888/api').read().decode())"


def test_the_recipe_agrees_with_the_project():
    recipe = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
    assert "libegl1 libopengl0 libgl1-mesa-dri" in recipe
    oldest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "requires-python"
    ].removeprefix(">=")
    version = re.search(r"^FROM python:([\d.]+)", recipe, re.MULTILINE)[1]
    assert [int(part) for part in version.split(".")] >= [
        int(part) for part in oldest.split(".")
    ]
    user, command = recipe[recipe.rindex("USER ") :].split("\n", 1)
    assert user == "USER ${NB_USER}"
    options = json.loads(re.search(r"CMD (\[[^]]*\])", command.replace("\n", ""))[1])
    opened = re.search(r"--LabApp.default_url=/lab/tree/(\S+)", options[-1])[1]
    assert (ROOT / opened).exists()
    assert options[-1] in (ROOT / "Makefile").read_text()


def test_what_it_copies_leaves_out_what_is_not_the_repositorys():
    left_out = set((ROOT / ".dockerignore").read_text().split())
    ignored = {
        line.strip("/")
        for line in (ROOT / ".gitignore").read_text().split()
        if line.startswith(("data/", "."))
    }
    assert ignored - {".ipynb_checkpoints"} | {".git", "build"} <= left_out


@pytest.fixture(scope="module")
def docker():
    """Runs a command of the container runtime that answers, for which the image is
    built.
    """
    for name in ("docker", "podman"):
        if (
            shutil.which(name)
            and not subprocess.run(
                [name, "info"], capture_output=True, timeout=60
            ).returncode
        ):
            subprocess.run(
                [name, "build", "--tag", IMAGE, str(ROOT)], check=True, timeout=1800
            )
            return lambda *words, **options: subprocess.run(
                [name, *words], check=True, text=True, **options
            )
    pytest.skip(
        "NO CONTAINER RUNTIME ANSWERS (docker, podman): the container was not built, and nothing ran in it"
    )


@pytest.mark.container
def test_notebook_00_passes_in_it_without_a_network(docker):
    solve = "python course/solutions.py solve --into /tmp/solved notebooks/00_start_here.ipynb"
    run = "jupyter nbconvert --execute --to=notebook --output-dir=/tmp /tmp/solved/00_start_here.ipynb"
    docker(
        "run",
        "--rm",
        "--network",
        "none",
        IMAGE,
        "sh",
        "-c",
        f"{solve} && {run}",
        timeout=900,
    )


@pytest.mark.container
def test_jupyterlab_answers_in_it(docker):
    name = docker(
        "run", "--rm", "--detach", "--network", "none", IMAGE, capture_output=True
    ).stdout.strip()
    try:
        time.sleep(30)
        assert "version" in json.loads(
            docker("exec", name, "python", "-c", ASKED, capture_output=True).stdout
        )
    finally:
        docker("kill", name, capture_output=True)
