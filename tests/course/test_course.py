"""The teaching pack's pages say what is so, and the server's configuration does what it
says.
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from unittest.mock import MagicMock

import grade
import nbformat
import numpy as np
import pytest
import torch
from repository import number_of

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
COURSE = ROOT / "docs" / "course"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PROBLEMS = sorted((COURSE / "problems").glob("[a-z]*.md"))
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

from clothlab import mine
mine.note("target-1", hoped=20.0)
"""


def test_the_demonstration_names_only_what_the_panel_has():
    teaching = (COURSE / "README.md").read_text("utf-8")
    demonstration = teaching.split("## A demonstration in ten minutes\n")[1]
    demonstration = demonstration.split("\n## ")[0]
    said = set(re.findall(r"\*\*([^*]+)\*\*", demonstration))
    assert len(said) > 10
    files = [
        path
        for kind in ("*.py", "*.js")
        for path in (ROOT / "clothlab" / "lab").rglob(kind)
    ]
    shown = "".join(path.read_text() for path in files)
    assert {
        words for words in said if words.replace("driven by", "").strip() not in shown
    } == set()


@pytest.mark.parametrize("page", PROBLEMS, ids=lambda page: page.stem)
def test_a_weekly_problem_gives_ten_points(page):
    rows = re.findall(r"^\| (\d+) \| ", page.read_text("utf-8"), re.MULTILINE)
    assert sum(map(int, rows)) == 10


def test_the_site_and_the_teachers_page_lead_to_every_problem():
    toctree = (ROOT / "docs" / "book" / "index.md").read_text("utf-8")
    teaching = (COURSE / "README.md").read_text("utf-8")
    for page in PROBLEMS:
        assert f"docs/course/problems/{page.stem}" in toctree
        assert f"(problems/{page.name})" in teaching


def rows(section):
    """Cells of the tables in a section of the teacher's page, without their heads."""
    teaching = (COURSE / "README.md").read_text("utf-8")
    text = teaching.split(f"## {section}\n")[1].split("\n## ")[0]
    return [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in text.splitlines()
        if re.match(r"\| [\[\d]", line)
    ]


def test_the_teachers_page_says_what_the_notebooks_say_and_adds_up():
    points = tomllib.loads(grade.POINTS.read_text())
    minutes, names = {}, set()
    for path, (link, time, exercises) in zip(
        NOTEBOOKS, rows("The notebooks"), strict=True
    ):
        notebook = nbformat.read(path, as_version=4)
        assert f"({'../../notebooks/' + path.name})" in link
        first = notebook.cells[0].source
        assert f"**Working time**: about {time} minutes" in first
        weights = {name: points.get(name, 1) for name in grade.exercises(notebook)}
        names |= set(weights)
        asked = [
            f"`{name}`" + f" ({most})" * (most != 1) for name, most in weights.items()
        ]
        assert exercises.split(" · ") == (asked or ["–"])
        minutes[number_of(path)] = int(time)
    series = [number for number in minutes if not number.startswith("A")]
    planned = []
    for title, numbers, hours, *_ in rows("Seven weeks"):
        summed = sum(minutes[number] for number in numbers.split(", "))
        assert float(hours) == pytest.approx(summed / 60, abs=0.06), title
        planned += numbers.split(", ")
    assert planned == series
    assert set(points) <= names


def code_of(question):
    """Code of a question of `before.md`, and what its folded answer says."""
    asked, answer = question.split("<details><summary>Answer</summary>")
    code = [re.findall(r"```python\n(.*?)```", part, re.S) for part in (asked, answer)]
    return *map("".join, code), " ".join(answer.split())


@pytest.mark.slow
def test_the_questions_before_the_series_are_numbered_and_their_answers_are_right(
    capsys,
):
    """Code of the questions prints what the answers say."""
    text = (COURSE / "before.md").read_text()
    parts = re.split(r"^\*\*(\d+)\.\*\*", text, flags=re.MULTILINE)
    numbers = [int(each) for each in parts[1::2]]
    assert numbers == list(range(1, 16))
    assert parts[0].startswith("# Before you begin: fifteen questions")
    questions = dict(zip(numbers, parts[2::2], strict=True))
    assert all(each.count("</details>") == 1 for each in questions.values())

    # What is printed
    tools = {"np": np, "torch": torch}
    for number in (3, 5):
        asked, _, answer = code_of(questions[number])
        exec(asked, dict(tools))
        assert f"`{capsys.readouterr().out.strip()}`" in answer

    # The loop, without its line and with it
    asked, _, answer = code_of(questions[6])
    ends = []
    for missing in ("", "    sgd.zero_grad()\n"):
        torch.manual_seed(0)
        named = dict(tools)
        exec(asked.replace("    loss =", f"{missing}    loss ="), named)
        model = named["model"]
        ends.append([model.weight.item(), model.bias.item()])
    assert ends[0] != pytest.approx([3, 1], abs=0.1)
    assert ends[1] == pytest.approx([3, 1], abs=1e-3)
    assert "the weight is 3 and the bias 1" in answer

    # The step of p alone
    _, step, _ = code_of(questions[7])
    named = tools | {"h": lambda x, p: x * p, "x": torch.ones(2), "y": torch.ones(2)}
    exec(step, named)
    assert named["p"].tolist() == pytest.approx([0.1, 0.1])


def test_the_jacobians_of_the_questions_before_the_series_are_right():
    def f(x):
        return torch.stack([x[0] * x[1], x[0] + x[1] ** 2])

    found = torch.autograd.functional.jacobian(f, torch.tensor([2.0, 3.0]))
    assert found.tolist() == [[3, 2], [1, 6]]
    assert r"3 & 2 \\ 1 & 6" in (COURSE / "before.md").read_text()


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
    assert (tmp_path / "mine" / "log.json").is_file()
    assert {path: path.stat().st_mtime_ns for path in data.rglob("*")} == before


def test_jupyterlab_looks_for_no_news_wherever_it_is_started_for_a_class():
    lab = MagicMock()
    text = (ROOT / "jupyter_lab_config.py").read_text("utf-8")
    exec(text, {"get_config": lambda: lab})
    assert lab.LabApp.news_url is None
    assert lab.LabApp.check_for_updates_class == "jupyterlab.NeverCheckForUpdate"
    for starts in ("Makefile", "Dockerfile", "docs/course/jupyterhub_config.py"):
        assert "jupyter_lab_config.py" in (ROOT / starts).read_text("utf-8"), starts


def test_a_container_holds_nothing_that_somebody_made_in_the_clone():
    """Students would else find a teacher's models in `mine/`, and take them up."""
    left_out = {
        name: {
            line.removeprefix("**/").rstrip("/")
            for line in (ROOT / name).read_text("utf-8").splitlines()
        }
        for name in (".gitignore", ".dockerignore")
    }
    assert left_out[".gitignore"] - left_out[".dockerignore"] == set()
