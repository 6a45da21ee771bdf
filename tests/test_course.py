"""The teaching pack's pages say what is so, and the server's configuration does what it says."""

import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
COURSE = ROOT / "docs" / "course"
RECORD = """
from clothlab import artifacts
from clothlab.lab import LiveSession
session = LiveSession()
session.record()
for _ in range(6):
    session.step()
print(session.recorder.save("first"))
session.close()
print(len(artifacts.load_trials("mine")[0]))
"""


class Config(SimpleNamespace):
    """Takes whatever is set, as JupyterHub's does."""

    def __getattr__(self, name):
        setattr(self, name, Config())
        return getattr(self, name)


@pytest.fixture
def hub(monkeypatch):
    """The configuration of the server, of this clone."""
    monkeypatch.setenv("CLOTHLAB", str(ROOT))
    config = Config()
    exec((COURSE / "jupyterhub_config.py").read_text(), {"get_config": lambda: config})
    return config


def test_ten_questions_each_with_a_folded_answer():
    text = (COURSE / "before.md").read_text()
    assert re.findall(r"^\*\*(\d+)\.\*\*", text, re.MULTILINE) == [str(k) for k in range(1, 11)]
    assert text.count("<details><summary>Answer</summary>") == text.count("</details>") == 10


def test_the_demonstration_names_only_what_the_panel_has():
    said = set(re.findall(r"\*\*([^*]+)\*\*", (COURSE / "demo.md").read_text()))
    shown = "".join(
        path.read_text() for path in (ROOT / "clothlab" / "lab").rglob("*") if path.suffix in (".py", ".js")
    )
    for words in said:
        assert words.replace("driven by", "").strip() in shown, words


def test_the_configuration_sets_limits_and_folders(hub):
    assert hub.Spawner.cpu_limit >= 1
    assert hub.Spawner.mem_limit == "2G"
    assert Path(hub.Spawner.environment["CLOTHLAB_DATA"]) == ROOT / "data"


@pytest.mark.slow
def test_a_student_of_the_server_records_at_home_and_leaves_the_data_alone(hub, tmp_path):
    data = Path(os.environ.get("CLOTHLAB_DATA") or hub.Spawner.environment["CLOTHLAB_DATA"])
    before = {path: path.stat().st_mtime_ns for path in data.rglob("*")}
    environment = hub.Spawner.environment | {"HOME": str(tmp_path), "PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)}
    environment |= {"CLOTHLAB_DATA": str(data)}
    command = [sys.executable, "-c", RECORD]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path, check=True).stdout
    path, steps = said.split()
    assert Path(path) == tmp_path / "recordings" / "first.npz"
    assert int(steps) == 6
    assert {path: path.stat().st_mtime_ns for path in data.rglob("*")} == before
