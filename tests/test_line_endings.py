"""A clone by a Git that turns line endings into Windows' own is the same clone: data
keep their checksums.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
CHECKED = "from clothlab.__main__ import check_files; print(check_files())"


def git(*words, cwd=ROOT):
    """What a command of Git prints."""
    return subprocess.run(
        ["git", *words], cwd=cwd, check=True, capture_output=True, text=True
    ).stdout


def test_no_file_would_be_converted():
    # `text` or `eol` of a path say what a Windows checkout does to it: data untouched,
    # text with a line feed alone.
    names = git("ls-files").splitlines()
    data = [name for name in names if name.startswith("data/")]
    asked = git("check-attr", "text", "--", *data).splitlines()
    assert [line for line in asked if not line.endswith(": text: unset")] == []
    asked = git("check-attr", "eol", "--", *(set(names) - set(data))).splitlines()
    assert [line for line in asked if not line.endswith(": eol: lf")] == []
    binary = [name for name in names if name.endswith((".png", ".gif"))]
    asked = git("check-attr", "text", "--", *binary).splitlines()
    assert [line for line in asked if not line.endswith(": text: unset")] == []


@pytest.mark.slow
def test_the_data_of_a_clone_with_windows_line_endings_keep_their_checksums(tmp_path):
    git(
        "clone",
        "--quiet",
        "--depth=1",
        "--config=core.autocrlf=true",
        ROOT.as_uri(),
        str(tmp_path / "clone"),
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "clone")}
    environment.pop("CLOTHLAB_DATA", None)
    command = [sys.executable, "-c", CHECKED]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert str(tmp_path / "clone" / "data") in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"
    shell = tmp_path / "clone" / ".ci" / "run"
    assert b"\r" not in shell.read_bytes()
