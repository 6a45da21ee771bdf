"""From nothing to tables: a graph in which everything takes part, and the same tables whoever computes or dies."""

import json
import os
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import psutil
import pytest
from test_cluster import PATIENCE, scheduler_and_workers, states, until

from clothlab import artifacts, cluster, experiments, reproduce
from clothlab._validation import choose
from clothlab.datasets import RECORDINGS
from clothlab.experiments._record import converter
from clothlab.experiments.estimation import ESTIMATED
from clothlab.reproduce import MOST_SEEDS, Plan, graph, small_plan
from clothlab.tasks import COMPUTED, FAILED, do, in_order
from clothlab.training_configs import seen_by

PLANS = {"small": small_plan(2), "full": Plan(), "slow": Plan(slow=True), "many": Plan(seeds=MOST_SEEDS)}


@pytest.mark.parametrize("name", PLANS)
def test_a_graph_can_be_done_and_no_two_tasks_write_the_same(name):
    tasks = in_order(graph(PLANS[name]))
    files = [file for task in tasks for file in task.files]
    assert len(set(files)) == len(files)
    assert tasks[-1].name == "tables"


@pytest.mark.parametrize("name", ["small", "slow"])
def test_what_a_task_depends_on_can_be_written_down(name):
    for task in graph(PLANS[name]):
        assert json.dumps(converter.unstructure(task.arguments), allow_nan=False)


def test_all_usual_experiments_take_part_with_both_amounts_and_slow_ones_only_when_asked():
    made = {name: {file for task in graph(PLANS[name]) for file in task.files} for name in PLANS}
    usual = experiments.EXPERIMENTS.keys() - experiments.SLOW
    for name in ("small", "full"):
        records = {f"results/{each}{ending}.json" for each in usual for ending in ("", experiments.PAPER)}
        assert {file for file in made[name] if file.startswith("results/")} == records | {"results/table.json"}
    assert {f"results/{each}.json" for each in experiments.SLOW} <= made["slow"]


def test_only_trainings_and_what_is_done_with_them_grow_with_the_seeds():
    few, many = ({task.kind: 0 for task in graph(Plan())} for _ in range(2))
    for counts, seeds in ((few, 5), (many, 10)):
        for task in graph(Plan(seeds=seeds)):
            counts[task.kind] += 1
    grown = {kind for kind in few if many[kind] != few[kind]}
    assert all(many[kind] == 10 and few[kind] == 5 for kind in grown)
    assert {kind.split("-")[0] for kind in grown} == {
        *("model", "self_organisation", "estimation", "control", "integrated", "stiffness")
    }


def test_a_full_plan_has_the_full_sizes_and_learns_from_all_recordings():
    tasks = {task.name: task for task in graph(Plan())}
    assert tasks["control-paper-3"].arguments[2] == experiments.control.Settings(weights="torque-paper", models=(3,))
    assert tasks["merge-control-paper"].arguments[2] == experiments.control.Settings(weights="torque-paper")
    trials = [f"record-train-more-{k}" for k in range(RECORDINGS["train-more"].repeats)]
    assert set(tasks["autoencoder-torque"].after) == {"record-train-0", *trials}
    assert sum(len(task.arguments[0]) for task in tasks.values() if task.name.startswith("record-train-more")) == 342


def test_commands_of_the_estimation_are_never_those_that_were_recorded():
    settings = experiments.estimation.Settings()
    last = settings.first_seed + 100 * (MOST_SEEDS - 1) + 20 * (settings.repeats - 1) + len(ESTIMATED)
    assert last < RECORDINGS["train-more"].first_seed
    assert len(ESTIMATED) <= 20


def test_recordings_and_targets_of_a_store_are_those_of_the_repository(tmp_path):
    task = next(task for task in graph(Plan()) if task.name == "record-muscle-evaluation-0")
    (todo,) = task.arguments
    (path, recording, *how) = todo[1]
    short = replace(task, arguments=(((path, replace(recording, steps=5), *how),),))
    assert do(short, tmp_path, "now").state == COMPUTED
    (mine,) = artifacts.load_trials("muscle-evaluation", data=tmp_path / "data")
    stored = next(each for each in artifacts.load_trials("muscle-evaluation") if each.seed == mine.seed)
    assert np.array_equal(mine.images, stored.images[:5])
    drawn = next(task for task in graph(Plan(slow=True)) if task.name == "targets-drawn")
    assert do(drawn, tmp_path, "now").state == COMPUTED
    assert len(artifacts.load_targets("drawn", data=tmp_path / "data")) == len(artifacts.load_targets("drawn"))


def test_what_was_seen_is_read_as_it_was(tmp_path, monkeypatch, trial):
    recipe = small_plan().recipes["torque"]
    (tmp_path / "weights").mkdir()
    eyes = "weights/autoencoder-torque.safetensors"
    (tmp_path / eyes).write_bytes((artifacts.data_folder() / eyes).read_bytes())
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    monkeypatch.setattr(artifacts, "load_trials", lambda name: [trial])
    reproduce.see("torque", recipe)
    found = []
    monkeypatch.setattr(reproduce, "train_model", lambda name, runs, seed, recipe: found.extend(runs))
    reproduce.train_seen("torque", 0, recipe)
    for run, seen in zip(found, seen_by("torque", recipe), strict=True):
        assert np.array_equal(run.s, seen.s)
        assert np.array_equal(run.u, seen.u)
        assert run.material == seen.material
    (tmp_path / "seen" / "torque.npz").write_bytes(b"half")
    with pytest.raises(ValueError, match="holds no encoded recordings"):
        reproduce.train_seen("torque", 0, recipe)


def test_pieces_of_what_takes_hours_are_kept_beside_the_data(tmp_path, monkeypatch):
    folders = []
    monkeypatch.setattr(experiments.feeling, "run", lambda settings=None, *, folder="build": folders.append(folder))
    monkeypatch.setattr(experiments.any_target, "run", lambda settings=None: folders.append(None))
    monkeypatch.setattr(experiments, "save", lambda name, record: (artifacts.data_folder() / "results").mkdir())
    for name in ("feeling", "any_target"):
        task = next(task for task in graph(Plan(slow=True)) if task.name == name)
        assert task.after[-1].startswith("merge-stiffness")  # everything else
        assert do(task, tmp_path / name, "now").why.endswith(f"did not write data/results/{name}.json")
    assert folders == [tmp_path / "feeling" / "pieces" / "feeling", None]


@pytest.mark.parametrize(
    ("given", "status", "message"),
    [
        (["--small", "--with-slow"], 2, "--small has no slow experiments"),
        (["--workers", "1", "--scheduler", "tcp://here"], 2, "not allowed with"),
        (["--with-slow", "--paper-only"], 2, "--paper-only leaves out what the slow experiments stand on"),
        (["--with-slow", "--seeds", "3"], 2, "--with-slow needs 5 seeds at least"),
        (["--seeds", "0"], 2, "--seeds must be at least 1"),
        (["--seeds", "901"], 2, "--seeds must be at most 900"),
        (["--store", "."], 2, "is no store of results and not empty"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_starts(given, status, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(reproduce.main(given))  # as argparse does it itself
    assert ended.value.code == status
    shown = capsys.readouterr()
    assert message in shown.out + shown.err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def read(store):
    """All files that a run made, without what says when and where."""
    return {
        path.relative_to(store): path.read_bytes() for path in sorted((store / "data").rglob("*")) if path.is_file()
    }


@pytest.mark.slow
def test_the_tables_are_the_same_to_the_byte_with_a_killed_worker(tmp_path, capsys):
    here, all_tasks = tmp_path / "here", len(graph(small_plan(1)))
    command = ["--small", "--seeds", "1", "--store", str(here), "--workers", "1"]
    on_papers = len(graph(replace(small_plan(1), amounts=(experiments.PAPER,)))) - 1  # the tables are made anew
    for options, computed, taken in (
        (["--paper-only"], on_papers + 1, 0),
        ([], all_tasks - on_papers, on_papers),
        ([], 0, all_tasks),
    ):
        assert reproduce.main([*command, *options]) == 0
        assert capsys.readouterr().out.startswith(f"{computed} computed, {taken} taken from the store, 0 failed")
        tables = (here / "data" / "tables.md").read_text()
        assert tables.count("mean IoU") == 1

    there, killed = tmp_path / "there", []

    def kill_one_in_the_middle():
        until(lambda: (there / "results" / "model-torque-0.json").exists())
        time.sleep(1)  # whatever it does now takes longer
        running = {each: " ".join(each.info["cmdline"] or []) for each in psutil.process_iter(["cmdline"])}
        workers = [each for each, command in running.items() if str(tmp_path) in command]
        busy = [each for worker in workers for each in worker.children() if "spawn_main" in running.get(each, "")]
        killed.append(busy[0].pid)
        os.kill(busy[0].pid, signal.SIGKILL)

    with scheduler_and_workers(tmp_path, (tmp_path, []), (tmp_path, [])) as (address, _):
        threading.Thread(target=kill_one_in_the_middle).start()
        with cluster.connect(address) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
            found = cluster.run(graph(small_plan(1)), there, client)
    assert killed
    assert set(states(found)) == {COMPUTED}
    assert read(there) == read(here)


@pytest.mark.slow
def test_a_failing_experiment_is_named_and_the_status_says_so(tmp_path, capsys, monkeypatch):
    tasks = graph(small_plan(1))
    few = [task for task in tasks if task.name in ("record-evaluation-0", "targets")]
    lost = replace(few[1], name="lost", function=choose, arguments=("fish", "carp", {}), files=("fish",))
    monkeypatch.setattr(reproduce, "graph", lambda plan: [*few, lost])
    assert reproduce.main(["--small", "--store", str(tmp_path / "store"), "--workers", "1"]) == 1
    shown = capsys.readouterr().out
    assert f"  {FAILED}: lost: KeyError: \"unknown fish 'carp'; choose from (none)\"" in shown
    assert "2 computed, 0 taken from the store, 1 failed, 0 left out" in shown
    assert "the same command tries again what failed" in shown
