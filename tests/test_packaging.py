"""A wheel works outside the clone: what it holds, what it imports, and where it finds data."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="session")
def installed(tmp_path_factory):
    """A folder with the unpacked wheel, far from the clone."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.fixture
def run(installed, tmp_path):
    """Run a line of Python with the unpacked wheel."""

    def run(code, **environment):
        path = {"PYTHONPATH": str(installed), "CLOTHLAB_DATA": "", **environment}
        command = [sys.executable, "-c", code]
        return subprocess.run(command, cwd=tmp_path, env=os.environ | path, capture_output=True, text=True)

    return run


def test_it_holds_all_that_it_needs_and_nothing_else(installed):
    held = {path.relative_to(installed).as_posix() for path in installed.rglob("*") if path.is_file()}
    ours = {path.relative_to(ROOT).as_posix() for path in (ROOT / "clothlab").rglob("*") if path.is_file()}
    ours = {name for name in ours if "__pycache__" not in name}
    assert {name for name in held if ".dist-info/" not in name} == ours
    assert "clothlab/py.typed" in held


def test_its_modules_come_when_they_are_asked_for(run, installed):
    done = run(
        "import clothlab, sys; print('mujoco' in sys.modules); from clothlab.simulation import env; print(env.__file__)"
    )
    assert done.stdout.split() == ["False", str(installed / "clothlab" / "simulation" / "env.py")], done.stderr


def test_without_data_it_says_how_to_get_them(run):
    done = run("from clothlab import artifacts; artifacts.load_target('target-1')")
    assert "FileNotFoundError: no data in" in done.stderr
    assert "set CLOTHLAB_DATA to that folder" in done.stderr


def test_it_finds_the_data_that_it_is_told_of(run):
    code = "from clothlab import artifacts; print(artifacts.load_target('target-1').sum() > 100)"
    assert run(code, CLOTHLAB_DATA=str(ROOT / "data")).stdout.strip() == "True"


def test_the_doctor_runs_without_the_clone(run):
    done = run("import sys; sys.argv = ['clothlab', 'doctor']; from clothlab.__main__ import main; sys.exit(main())")
    assert done.returncode == 1
    assert "no data in" in done.stdout
