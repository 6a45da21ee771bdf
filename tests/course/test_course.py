"""The teaching pack's pages say what is so, and the server's configuration does what it
says.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
COURSE = ROOT / "docs" / "course"
RECORD = """
from clothlab import data as stored
from clothlab.lab import LiveSession
session = LiveSession()
session.record()
for _ in range(6):
    session.step()
print(session.recorder.save("first"))
session.close()
print(len(stored.load_trials("mine")[0]))
"""


def test_the_demonstration_names_only_what_the_panel_has():
    said = set(re.findall(r"\*\*([^*]+)\*\*", (COURSE / "demo.md").read_text()))
    files = [
        path
        for kind in ("*.py", "*.js")
        for path in (ROOT / "clothlab" / "lab").rglob(kind)
    ]
    shown = "".join(path.read_text() for path in files)
    assert {
        words for words in said if words.replace("driven by", "").strip() not in shown
    } == set()


@pytest.mark.slow
def test_a_student_of_the_server_records_at_home_and_leaves_the_data_alone(
    monkeypatch, tmp_path
):
    monkeypatch.setenv("CLOTHLAB", str(ROOT))
    hub = MagicMock()
    exec((COURSE / "jupyterhub_config.py").read_text(), {"get_config": lambda: hub})
    data = ROOT / "data"
    assert Path(hub.Spawner.environment["CLOTHLAB_DATA"]) == data
    before = {path: path.stat().st_mtime_ns for path in data.rglob("*")}
    environment = hub.Spawner.environment | {
        "HOME": str(tmp_path),
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(ROOT),
    }
    command = [sys.executable, "-c", RECORD]
    said = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    ).stdout
    path, steps = said.split()
    assert Path(path) == tmp_path / "recordings" / "first.npz"
    assert int(steps) == 6
    assert {path: path.stat().st_mtime_ns for path in data.rglob("*")} == before
