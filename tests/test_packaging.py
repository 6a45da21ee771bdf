"""A wheel works outside the clone: what it holds, what it imports, and where it finds
data.
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the unpacked wheel, far from the clone."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "--target",
        "wheel",
        "--directory",
        str(folder),
    ]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


def run(installed, tmp_path, code, data=""):
    """Run a line of Python with the unpacked wheel."""
    environment = os.environ | {
        "PYTHONPATH": str(installed),
        "CLOTHLAB_DATA": str(data),
    }
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )


def test_it_holds_all_that_it_needs_and_nothing_else(installed):
    held, ours = (
        {
            path.relative_to(root).as_posix()
            for path in (root / "clothlab").rglob("*")
            if path.is_file()
        }
        for root in (installed, ROOT)
    )
    assert (
        held
        == {name for name in ours if "__pycache__" not in name}
        > {"clothlab/py.typed"}
    )


def test_its_modules_come_when_they_are_asked_for(installed, tmp_path):
    code = "import clothlab, sys; print('mujoco' in sys.modules); from clothlab.lab import _clock; print(_clock.__file__)"
    done = run(installed, tmp_path, code)
    assert done.stdout.split() == [
        "False",
        str(installed / "clothlab" / "lab" / "clock.py"),
    ], done.stderr


def test_it_finds_the_data_whose_folder_is_named_or_says_how_to_get_them(
    installed, tmp_path
):
    code = "from clothlab import artifacts; print(artifacts.load_target('target-1').sum() > 100)"
    assert run(installed, tmp_path, code, ROOT / "data").stdout.strip() == "True"
    failed = run(installed, tmp_path, code).stderr
    assert "FileNotFoundError: no data in" in failed
    assert "set CLOTHLAB_DATA to that folder" in failed


def test_the_doctor_runs_without_the_clone(installed, tmp_path):
    code = "import sys; sys.argv = ['clothlab', 'doctor']; from clothlab.__main__ import main; sys.exit(main())"
    done = run(installed, tmp_path, code)
    assert done.returncode == 1
    assert "no data in" in done.stdout
