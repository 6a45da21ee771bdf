"""The doctor: what it says of a machine, also where something is missing."""

import ctypes.util
import os
import subprocess
import sys

import pytest

from clothlab import data


def doctor(**environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-m", "clothlab", "doctor"],
        env=os.environ | environment,
        capture_output=True,
    )


@pytest.fixture
def folder(tmp_path, square, monkeypatch):
    """A folder `data/` with one file, under a name that few code pages have."""
    folder = tmp_path / "Ōta" / "data"
    (folder / "results").mkdir(parents=True)
    (folder / "results" / "a.csv").write_text("iou\n0.8\n")
    data.write_checksums(folder)
    monkeypatch.setenv("CLOTHLAB_DATA", str(folder))
    monkeypatch.setenv("CLOTHLAB_DATA_URL", "https://example.com/data")
    return folder


@pytest.mark.slow
def test_all_is_well_also_where_the_output_is_not_utf_8(folder):
    done = doctor(PYTHONUTF8="0", PYTHONIOENCODING="cp1252")
    assert (done.returncode, done.stderr) == (0, b"")
    words = done.stdout.decode("cp1252").split()
    assert words[-3:] == ["all", "is", "well"]
    for package in ("clothlab", "torch", "mujoco"):
        assert package in words


@pytest.mark.slow
@pytest.mark.skipif(
    ctypes.util.find_library("OSMesa") is not None or sys.platform != "linux",
    reason="OSMesa is there, or nothing that draws with it",
)
def test_a_back_end_that_is_not_installed_is_named_and_the_rest_is_checked(folder):
    (folder / "results" / "a.csv").unlink()
    done = doctor(MUJOCO_GL="osmesa")
    assert (done.returncode, done.stderr) == (1, b"")
    advice = done.stdout.decode(errors="replace").splitlines()[-2:]
    assert advice == [
        "  - MUJOCO_GL=osmesa is set, and does not draw here: unset it and restart "
        "Python, and clothlab chooses what draws",
        "  - data/results/a.csv is missing: download it from "
        "https://example.com/data/results/a.csv",
    ]


@pytest.mark.parametrize("git", [True, False])
def test_what_is_missing_has_a_remedy_that_works_there(folder, git, monkeypatch):
    if git:
        (folder.parent / ".git").mkdir()
    (folder / "results" / "a.csv").unlink()
    (fault,) = data.faults()
    assert ("git checkout data/results/a.csv" in fault) == git
    assert ("download it from https://example.com/data/" in fault) != git


@pytest.mark.slow
def test_a_folder_that_is_not_there_is_said(folder, tmp_path):
    done = doctor(CLOTHLAB_DATA=str(tmp_path / "nowhere"))
    assert done.returncode == 1
    assert b"no data in" in done.stdout
