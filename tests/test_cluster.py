"""Tasks on real workers of Dask's: killed ones, unfit ones, failing tasks, and clients that are interrupted."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from test_tasks import BOTH, A, B, put, say, states

import clothlab
from clothlab import artifacts
from clothlab.tasks import COMPUTED, FAILED, KEPT, LEFT_OUT, Task

distributed = pytest.importorskip("distributed")
from clothlab import cluster  # noqa: E402

ROOT = Path(clothlab.__file__).parents[1]
TESTS = Path(__file__).parent
PATIENCE = 180  # [s], on a busy machine


def held(out):
    """Say who works on it, and go on when told."""
    folder = artifacts.data_folder().parent.parent
    (folder / f"started-{os.getpid()}").touch()
    until(lambda: (folder / "go").exists())
    put(out, "held")


def deadly():
    """What takes its worker with it."""
    os.kill(os.getpid(), signal.SIGKILL)


HELD = Task("held", held, ("held.txt",), ("both",), ("held.txt",))
AFTER = Task("after", put, ("after.txt", "C"), ("held",), ("after.txt",))


def until(there, seconds=PATIENCE):
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def client():
    """One worker in this process."""
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False}
    with distributed.Client(**options, dashboard_address="127.0.0.1:0", set_as_default=False) as client:
        yield client


@contextmanager
def scheduler_and_workers(folder, *workers):
    """The real commands: the address of `dask scheduler`, and what starts one more `dask worker`, `(folder, path)`."""
    file, started = folder / "scheduler.json", []

    def start(command, where, path):
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(each) for each in path] + sys.path)}
        command = [sys.executable, "-m", "dask", *command]
        with (folder / f"log-{len(started)}").open("w") as log:
            started.append(subprocess.Popen(command, cwd=where, env=environment, stdout=log, stderr=log))

    try:
        start(["scheduler", "--scheduler-file", str(file), "--no-dashboard", "--port", "0"], folder, [])
        until(file.exists)
        options = ["--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard", "--memory-limit", "0"]
        join = lambda where, path: start(["worker", *options, "--local-directory", str(folder)], where, path)  # noqa: E731
        for worker in workers:
            join(*worker)
        yield re.search(r'"address": "(.*?)"', file.read_text())[1], join
    finally:
        for process in started:
            for each in [*psutil.Process(process.pid).children(recursive=True), process]:
                each.kill()
            process.wait()


def test_a_graph_is_done_and_then_taken_from_the_store(client, tmp_path):
    store = tmp_path / "store"
    found = cluster.run([BOTH, B, A], store, client)
    assert states(found) == 3 * [COMPUTED]
    assert (store / "data" / "both.txt").read_text() == "A+B"
    assert states(cluster.run([A, B, BOTH], store, client)) == 3 * [KEPT]


def test_a_failure_leaves_the_others_alone(client, tmp_path):
    bad = Task("b", say, (), (), ("b.txt",))
    found = cluster.run([A, bad, BOTH], tmp_path / "store", client)
    assert {name: each.state for name, each in found.items()} == {"a-1": COMPUTED, "b": FAILED, "both": LEFT_OUT}
    assert found["b"].why == "ValueError: the first line"
    assert states(cluster.run([A, B, BOTH], tmp_path / "store", client)) == [KEPT, COMPUTED, COMPUTED]


def test_progress_says_how_long_the_rest_will_take(client, tmp_path, capsys):
    cluster.run([A, B, BOTH], tmp_path / "store", client, progress=True)
    shown = capsys.readouterr().err
    assert "3 of 3 tasks" in shown
    assert "about 0 s left; last both" in shown


def test_a_folder_with_other_things_is_no_store(client, tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(ValueError, match="is no store of results and not empty: name another folder"):
        cluster.run([A], tmp_path, client)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_trials_of_another_plan_are_not_learned_from(client, tmp_path):
    stray = cluster.open_store(tmp_path / "store") / "data" / "trials" / "train" / "07_felt.npz"
    stray.parent.mkdir(parents=True)
    stray.touch()
    with pytest.raises(ValueError, match=r"1 trials in the store are of another plan, such as .*07_felt\.npz: delete"):
        cluster.run([A], tmp_path / "store", client)
    cluster.run(
        [Task("t", put, ("trials/train/07_felt.npz", ""), (), ("trials/train/07_*.npz",))], tmp_path / "store", client
    )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"torch": "0.1"}, r"it runs torch [\d.+a-z]+ instead of 0\.1: install the same there"),
        ({"clothlab": "another"}, r"it runs clothlab [0-9a-f]{16} instead of another"),
    ],
)
def test_workers_of_other_versions_are_refused(client, tmp_path, monkeypatch, wrong, message):
    ours = cluster.versions() | wrong
    monkeypatch.setattr(cluster.Check, "__init__", lambda self, *_: vars(self).update(wanted=ours))
    monkeypatch.setattr(cluster.Check, "stored", lambda self: [])
    with pytest.raises(cluster.Unfit, match=message):
        cluster.run([A], tmp_path / "store", client)
    assert not (tmp_path / "store" / "data").exists()


def test_what_is_wrong_with_a_worker_is_said(tmp_path):
    store, ours = cluster.open_store(tmp_path / "store"), cluster.versions()
    token = (store / cluster.TOKEN).read_text()
    assert cluster.Check(store, token, ours).faults(1) == []
    assert "it has 2 threads: start it with --nthreads 1" in cluster.Check(store, token, ours).faults(2)[0]
    (other,) = cluster.Check(store, "of another folder", ours).faults(1)
    assert "it has another folder at" in other
    (nowhere,) = cluster.Check(tmp_path / "nowhere", token, ours).faults(1)
    assert nowhere.endswith("(No such file or directory): the folder must be shared by all machines")


def test_a_worker_that_lost_the_store_gives_its_task_back_and_leaves(tmp_path, monkeypatch):
    left = []
    loop = SimpleNamespace(add_callback=lambda close, nanny, reason: left.append((close, nanny, reason)))
    worker = SimpleNamespace(address="here", loop=loop, close="close", state=SimpleNamespace(nthreads=1))
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    store = cluster.open_store(tmp_path / "store")
    check = cluster.Check(store, (store / cluster.TOKEN).read_text(), cluster.versions())
    assert cluster._do(check, A, store, "now").state == COMPUTED
    (store / cluster.TOKEN).unlink()
    with pytest.raises(distributed.Reschedule):
        cluster._do(check, B, store, "now")
    assert not (store / "data" / "b.txt").exists()
    assert [(close, nanny, reason[:30]) for close, nanny, reason in left] == [
        ("close", True, "here: it cannot read the store")
    ]


def test_a_scheduler_that_is_not_there_is_missed(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with pytest.raises(
        cluster.Unfit, match=r"no scheduler answers at tcp://127\.0\.0\.1:9: start one with `dask scheduler`"
    ):
        cluster.connect("tcp://127.0.0.1:9").__enter__()


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_of_a_task_costs_only_that_task(tmp_path):
    store, killed = tmp_path / "store", []

    def kill_the_first():
        until(lambda: list(tmp_path.glob("started-*")))
        (first,) = tmp_path.glob("started-*")
        killed.append(int(first.name.removeprefix("started-")))
        os.kill(killed[0], signal.SIGKILL)
        (tmp_path / "go").touch()

    threading.Thread(target=kill_the_first).start()
    with cluster.local(2) as client:
        found = cluster.run([A, B, BOTH, HELD, AFTER], store, client)
    assert states(found) == 5 * [COMPUTED]
    assert killed
    assert len(list(tmp_path.glob("started-*"))) == 2
    assert (store / "data" / "after.txt").read_text() == "C"


@pytest.mark.slow
def test_a_task_that_kills_every_worker_fails_and_the_others_go_on(tmp_path):
    bad = Task("bad", deadly, (), (), ("bad.txt",))
    with cluster.local(1) as client:
        found = cluster.run([bad, replace(AFTER, after=("bad",)), A, B, BOTH], tmp_path / "store", client)
    assert (found["bad"].state, found["after"].state, found["both"].state) == (FAILED, LEFT_OUT, COMPUTED)
    assert found["bad"].why == "RuntimeError: 4 workers died of it, one after another"
    assert not list((tmp_path / "store" / "running").iterdir())
    assert found["after"].why == "needs bad"


@pytest.mark.slow
def test_two_runs_at_once_take_ports_of_their_own_that_only_this_machine_reaches():
    before = {each.laddr for each in psutil.Process().net_connections() if each.status == psutil.CONN_LISTEN}
    with cluster.local(1), cluster.local(1):
        found = {each.laddr for each in psutil.Process().net_connections() if each.status == psutil.CONN_LISTEN}
    assert {address.ip for address in found - before} == {"127.0.0.1"}


CLIENT = """
import signal, sys
from test_cluster import *
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background inherits that it is ignored
    with cluster.local(2) as client:
        cluster.run([A, B, BOTH, HELD, AFTER], sys.argv[1], client)
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_run_that_was_interrupted_goes_on_where_it_stopped(client, tmp_path, how):
    store = tmp_path / "store"
    (tmp_path / "client.py").write_text(CLIENT)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])}
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "client.py"), str(store)],
        env=environment,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    until(lambda: list(tmp_path.glob("started-*")))
    children = psutil.Process(process.pid).children(recursive=True)
    if how == signal.SIGINT:
        os.killpg(process.pid, how)  # Ctrl-C goes to all processes of a terminal
    else:
        process.send_signal(how)
    process.wait(PATIENCE)
    gone, alive = psutil.wait_procs(children, PATIENCE)
    assert gone
    assert not alive  # nobody works on for a client that is not there
    (tmp_path / "go").touch()
    found = cluster.run([A, B, BOTH, HELD, AFTER], store, client)
    assert states(found) == [KEPT, KEPT, KEPT, COMPUTED, COMPUTED]


def edit(folder):
    """Another version of the package."""
    shutil.copytree(ROOT / "clothlab", folder / "clothlab")
    with (folder / "clothlab" / "cloth.py").open("a") as file:
        file.write("# edited\n")


@pytest.mark.slow
def test_workers_that_see_another_folder_or_run_other_code_are_refused(tmp_path, monkeypatch):
    for name in ("here", "there", "old"):
        (tmp_path / name).mkdir()
    edit(tmp_path / "old")
    monkeypatch.chdir(tmp_path / "here")
    store = Path("/proc/self/cwd/store")  # the same path, for each process another folder
    workers = [(tmp_path / "here", []), (tmp_path / "there", []), (tmp_path / "here", [tmp_path / "old"])]
    with scheduler_and_workers(tmp_path, *workers) as (address, _), cluster.connect(address) as client:
        client.wait_for_workers(3, timeout=PATIENCE)
        with pytest.raises(cluster.Unfit) as refused:
            cluster.run([A], store, client)
        assert sorted(re.sub(r"^tcp://[^ ]*: |[0-9a-f]{16}", "", line) for line in str(refused.value).splitlines()) == [
            "it cannot read the store /proc/self/cwd/store (No such file or directory): "
            "the folder must be shared by all machines",
            "it runs clothlab  instead of : install the same there, and start it again",
        ]
        assert not (tmp_path / "here" / "store" / "data").exists()


@pytest.mark.slow
def test_a_worker_that_joins_later_and_is_unfit_does_nothing(tmp_path):
    edit(tmp_path / "old")
    store = cluster.open_store(tmp_path / "store")
    with (
        scheduler_and_workers(tmp_path, (tmp_path, [])) as (address, join),
        cluster.connect(address) as client,
        cluster.checked(client, store) as check,
    ):
        assert cluster._faults(check, 1) == []
        join(tmp_path, [tmp_path / "old"])
        until(lambda: re.search(r"Stopping worker.* it runs clothlab \w+ instead of", (tmp_path / "log-2").read_text()))
        until(lambda: len(client.nthreads()) == 1)
