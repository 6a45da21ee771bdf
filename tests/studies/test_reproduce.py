"""From nothing to tables: worlds of seeds of their own, and what was interrupted goes
on.
"""

import os
import signal
import subprocess
import sys
import time

import joblib
import pandas as pd
import pytest
import reproduce
from reproduce import Plan

from studies import headline
from studies._parallel import KEPT, side_by_side

PATIENCE = 300  # [s], on a busy machine


def test_a_plan_has_what_its_trainings_need():
    full, papers = Plan(), Plan(seeds=2, paper_only=True)
    assert [config.name for config in full.configs()] == [
        "torque",
        "torque-paper",
        "muscle",
        "muscle-paper",
    ]
    assert [each.name for each in papers.datasets()] == [
        "train",
        "muscle-train",
        "evaluation",
        "muscle-evaluation",
    ]
    assert {name for config in full.configs() for name in config.recordings} < {
        each.name for each in full.datasets()
    }
    cases = papers.cases("joint_estimation_control-paper")
    assert cases == [{"model": model, "weights": "torque-paper"} for model in range(2)]
    assert all(name.endswith("-paper") for name in papers.tables())
    assert {*papers.tables()} < {*full.tables()}


def test_worlds_share_no_seed_and_the_first_is_the_stored_one():
    plans = [Plan(world=k) for k in range(10)]
    assert plans[0].datasets() == Plan().datasets()
    assert {config.first_seed for config in plans[0].configs()} == {0}
    seeds = []
    for plan in plans:
        for dataset in plan.datasets():
            seeds += [run["seed"] for run in dataset.runs().values()]
    assert len(set(seeds)) == len(seeds)
    assert len({plan.configs()[0].first_seed for plan in plans}) == 10


def test_tables_of_worlds_stand_side_by_side(tmp_path):
    folders = [tmp_path / name for name in "ab"]
    home = tmp_path / "home"
    for folder in (*folders, home):
        folder.mkdir()
    for k, folder in enumerate(folders):
        table = pd.DataFrame({"model": [0, 0], "error": [k, [1.0, 2.0]]})
        reproduce.studies.save(table, "both", data=folder)
    reproduce.studies.save(table, "one", data=folders[0])
    reproduce.save_side_by_side(dict(enumerate(folders)), home)
    assert [path.name for path in (home / "results").iterdir()] == ["worlds-both.csv"]
    both = reproduce.studies.load("worlds-both", data=home)
    assert list(both.columns) == ["world", "model", "error"]
    assert list(both["world"]) == [0, 0, 1, 1]


def test_more_worlds_are_added_to_those_that_are_there(tmp_path):
    for k in range(3):
        (tmp_path / str(k)).mkdir()
        table = pd.DataFrame({"error": [float(k)]})
        reproduce.studies.save(table, "both", data=tmp_path / str(k))
    home = tmp_path / "home"
    home.mkdir()
    reproduce.save_side_by_side({k: tmp_path / str(k) for k in (0, 2)}, home)
    reproduce.studies.save(pd.DataFrame({"error": [7.0]}), "both", data=tmp_path / "2")
    reproduce.save_side_by_side({k: tmp_path / str(k) for k in (1, 2)}, home)
    both = reproduce.studies.load("worlds-both", data=home)
    assert both.to_dict("list") == {"world": [0, 1, 2], "error": [0.0, 1.0, 7.0]}


@pytest.mark.parametrize(
    ("words", "called", "names"),
    [
        (["record"], "record_again", []),
        (["record", "train", "evaluation"], "record_again", ["train", "evaluation"]),
        (["train", "torque", "--workers", "3"], "train_again", ["torque"]),
        (["results", "control"], "run_again", ["control"]),
    ],
)
def test_each_command_is_a_program_of_its_own(words, called, names, monkeypatch):
    calls = []

    def noted(name):
        def call(names, **options):
            calls.append((name, names, options["workers"]))

        return call

    for name in ("record_again", "train_again", "run_again"):
        monkeypatch.setattr(reproduce, name, noted(name))
    monkeypatch.setattr("sys.argv", ["reproduce.py", *words])
    assert reproduce.main() == 0
    workers = 3 if "--workers" in words else os.cpu_count()
    assert calls == [(called, names, workers)]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([], "COMMAND"),
        (["record", "--scheduler=x"], "unrecognized arguments: --scheduler=x"),
        (["everything", "control"], "unrecognized arguments: control"),
    ],
)
def test_what_a_command_does_not_know_is_refused(words, reason, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["reproduce.py", *words])
    with pytest.raises(SystemExit) as ended:
        reproduce.main()
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err


def test_weights_that_are_there_are_not_trained_again(monkeypatch):
    calls = []

    def noted(function, cases, *_, **__):
        calls.extend(cases)
        return []

    monkeypatch.setattr(reproduce, "side_by_side", noted)
    monkeypatch.setattr(reproduce.data, "write_checksums", lambda: None)
    config = reproduce.TRAINING_CONFIGS["torque-paper"]
    reproduce.train([config], range(5), anew=False)
    assert calls == []


def test_an_unknown_name_lists_the_choices(monkeypatch):
    monkeypatch.setattr("sys.argv", ["reproduce.py", "train", "torqe"])
    choices = "unknown 'torqe'; choose from torque-paper, "
    with pytest.raises(SystemExit, match=choices):
        reproduce.main()


@pytest.mark.slow
def test_results_are_made_of_the_stored_tables():
    text = reproduce.results()
    answers, _, tables = text.partition("**P of the cloths**")
    assert answers.count("\n    ") == len(headline.QUESTIONS)
    assert tables.count("\n| --- |") == 7


def test_the_paper_is_one_world_with_the_tables_of_the_seven_rows(
    monkeypatch, tmp_path, capsys
):
    asked = []
    monkeypatch.setattr(reproduce, "reproduce", lambda plan, **_: asked.append(plan))
    monkeypatch.setattr(reproduce.report, "of_one", lambda: "seven answers")
    monkeypatch.setenv("CLOTHLAB_DATA", "")  # is set anew, as is KEPT
    monkeypatch.setenv(KEPT, "")
    words = ["reproduce.py", "paper", "--folder", str(tmp_path), "--world", "4"]
    monkeypatch.setattr("sys.argv", words)
    assert reproduce.main() == 0
    (plan,) = asked
    assert (plan.world, plan.seeds, plan.endings) == (4, 1, ("-paper",))
    assert plan.tables() == [f"{name}-paper" for name in headline.TABLES]
    assert "seven answers" in capsys.readouterr().out


# Sizes in which everything takes part and nothing is learned, and an experiment of three
# rows that says when it computes one
TINY = """
import sys, time
from dataclasses import replace
from functools import partial
from pathlib import Path
import reproduce, studies
from clothlab.method.autoencoder import AutoencoderTraining
from reproduce import Plan
from studies import Experiment
from studies._grid import grid

def noted(number, folder):
    with (Path(folder) / "done.txt").open("a") as file:
        file.write(str(number))
    time.sleep(2)
    return {"found": number}

folder = Path(sys.argv[sys.argv.index("--folder") + 1])
cases = partial(grid, number=range(3), folder=str(folder))
studies.EXPERIMENTS["noted"] = Experiment("noted", noted, cases)
Plan.tables = lambda self: ["trained_p-paper", "noted"]
for name, each in reproduce.DATASETS.items():
    reproduce.DATASETS[name] = replace(each, steps=24, policies=("operator",))
for name, each in reproduce.TRAINING_CONFIGS.items():
    few = {"epochs": 2, "sequence_length": 8}
    reproduce.TRAINING_CONFIGS[name] = replace(
        each, autoencoder=AutoencoderTraining(epochs=1), model=replace(each.model, **few)
    )
short = {"steps": 40, "seeds": (3000,), "foams": ("soft-1",)}
reproduce.find_targets = partial(reproduce.find_targets, **short)
reproduce.results = lambda: "no results"
reproduce.report.of_one = lambda: "no answers"
sys.exit(reproduce.main())
"""


@pytest.mark.slow
def test_what_was_killed_and_what_was_interrupted_goes_on_where_it_stopped(tmp_path):
    words = ["everything", "--paper-only", "--seeds", "1", "--workers", "1"]
    command = [sys.executable, "-c", TINY, *words, "--folder", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    data, done = tmp_path / "data", tmp_path / "done.txt"

    def started_until(there):
        process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        end = time.monotonic() + PATIENCE
        while not there():
            assert process.poll() is None
            assert time.monotonic() < end, "waited in vain"
            time.sleep(0.05)
        return process

    # In the trainings
    autoencoder = data / "weights" / "autoencoder-torque-paper.safetensors"
    process = started_until(autoencoder.exists)
    process.kill()
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in data.rglob("*.npz")}
    before[autoencoder] = autoencoder.stat().st_mtime_ns
    assert len(before) > 20

    # In a study
    process = started_until(lambda: done.exists() and done.read_text() == "01")
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 130

    # Nothing is done again but the row that was interrupted
    subprocess.run(command, env=environment, check=True, timeout=PATIENCE)
    assert done.read_text() == "0112"
    assert before == {path: path.stat().st_mtime_ns for path in before}
    tables = {path.stem for path in (data / "results").iterdir()}
    assert tables == {"trained_p-paper", "noted"}
    assert (tmp_path / "results.md").read_text() == "no results"


def folders_of_a_worker(name):
    return f"{name} {os.environ[KEPT]}"


@pytest.mark.slow
def test_the_workers_of_a_scheduler_do_all_calls_and_know_the_folders(
    monkeypatch, tmp_path
):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path / "data"))
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as c:
        monkeypatch.setenv(KEPT, str(tmp_path))
        with reproduce.workers_of(c.scheduler_address):
            assert joblib.parallel.get_active_backend()[0].__class__.__name__ == (
                "DaskDistributedBackend"
            )
            calls = [{"name": name} for name in "ab"]
            found = side_by_side(folders_of_a_worker, calls, "folders", workers=-1)
            assert list(found) == [f"a {tmp_path}", f"b {tmp_path}"]
