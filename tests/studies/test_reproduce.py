"""From nothing to tables: the same files whoever computes, is interrupted or dies."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import psutil
import pytest
import reproduce
from reproduce import Plan

PATIENCE = 300  # [s], on a busy machine
EVERYTHING = [sys.executable, reproduce.__file__, "everything"]
SMALL = [*EVERYTHING, "--small", "--seeds", "1", "--paper-only"]


def test_a_plan_has_what_its_trainings_need_and_a_small_one_shortens_it():
    full, papers, small = Plan(), Plan(seeds=2, paper_only=True), Plan(small=True)
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
    assert [each.name for each in small.datasets()] == [
        each.name for each in full.datasets()
    ]
    assert all(each.steps == 24 and len(each.runs()) <= 18 for each in small.datasets())
    assert [(case["model"], case["steps"]) for case in small.cases("control")] == [
        (0, 16),
        (1, 16),
    ]


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
        (["train", "torqe"], "unknown 'torqe'; choose from torque-paper, "),
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


@pytest.mark.slow
def test_results_are_made_of_the_stored_tables():
    text = reproduce.results()
    # One under each heading but the first, under which the parts of the paper stand
    headings = re.findall("^###? ", text, re.MULTILINE)
    assert text.count("\n| --- |") == len(headings) - 1 > 0


def until(there: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not there():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


@contextmanager
def scheduler_and_two_workers(
    folder: Path,
) -> Iterator[tuple[str, list[psutil.Process]]]:
    """Address of a real `dask scheduler`, and two real `dask worker`s."""
    file, started = folder / "scheduler.json", []

    def start(*command: str) -> None:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        with (folder / f"log-{len(started)}").open("w") as log:
            command = (
                sys.executable,
                "-m",
                "dask",
                *command,
                "--scheduler-file",
                str(file),
                "--no-dashboard",
            )
            started.append(
                subprocess.Popen(
                    command, cwd=folder, env=environment, stdout=log, stderr=log
                )
            )

    try:
        start("scheduler", "--port", "0")
        until(file.exists)
        for _ in range(2):
            start(
                "worker",
                "--nthreads",
                "1",
                "--memory-limit",
                "0",
                "--local-directory",
                str(folder),
            )
        yield (
            re.search(r'"address": "(.*?)"', file.read_text())[1],
            [psutil.Process(each.pid) for each in started[1:]],
        )
    finally:
        for process in started:
            for each in [
                *psutil.Process(process.pid).children(recursive=True),
                process,
            ]:
                each.kill()
            process.wait()


def contents(folder: Path) -> dict[Path, bytes]:
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def kept(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("output.pkl")}


@pytest.mark.nightly
def test_all_files_are_the_same_after_an_interruption_and_with_a_killed_worker(
    tmp_path,
):
    here, there = tmp_path / "here", tmp_path / "there"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [*SMALL, "--workers", "1", "--folder", str(here)]
    first = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    until((here / "data" / "weights" / "autoencoder-torque-paper.safetensors").exists)
    first.kill()
    first.wait()
    before = kept(here)
    assert len(before) > 20
    subprocess.run(command, env=environment, check=True, timeout=PATIENCE)
    assert before.items() < kept(here).items()  # nothing was done again

    with scheduler_and_two_workers(tmp_path) as (address, workers):
        command = [*SMALL, "--scheduler", address, "--folder", str(there)]
        with subprocess.Popen(command, env=environment) as distributed:
            until(lambda: len(kept(there)) > 5)
            (worker,) = [
                each
                for each in workers[0].children()
                if "spawn_main" in " ".join(each.cmdline())
            ]
            worker.send_signal(signal.SIGKILL)
            assert distributed.wait(PATIENCE) == 0
        assert "signal 9" in (tmp_path / "log-1").read_text()
    assert contents(there / "data") == contents(here / "data")
    assert any(path.suffix == ".csv" for path in contents(there / "data"))
