"""Tasks are done once, and again when what they stand on changes; a failure stops what needs it and nothing else."""

import os
from dataclasses import replace

import pytest
import torch

from clothlab import artifacts, tasks
from clothlab.experiments._record import trained
from clothlab.tasks import (
    COMPUTED,
    FAILED,
    KEPT,
    LEFT_OUT,
    Outcome,
    Task,
    do,
    expected,
    in_order,
    kind,
    makespan,
    measured,
    summary,
    urgency,
)


def put(name, text):
    (artifacts.data_folder() / name).write_text(text)


def join(out, *names):
    put(out, "+".join((artifacts.data_folder() / name).read_text() for name in names))


def say(*_):
    raise ValueError("the first line\nand more")


def nothing(*_):
    pass


def surroundings(out):
    put(out, f"{torch.get_num_threads()} {os.environ['CLOTHLAB_DATA']}")


A = Task("a-1", put, ("a.txt", "A"), (), ("a.txt",))
B = Task("b", put, ("b.txt", "B"), (), ("b.txt",))
BOTH = Task("both", join, ("both.txt", "a.txt", "b.txt"), ("a-1", "b"), ("both.txt",))


def do_all(store, *todo, run="now"):
    """States by name."""
    found = {}
    for task in in_order(todo):
        found[task.name] = do(task, store, run, *[found[name] for name in task.after])
    return found


def states(found):
    return [each.state for each in found.values()]


def test_what_was_done_is_taken_from_the_store(tmp_path):
    assert states(do_all(tmp_path, A, B, BOTH)) == 3 * [COMPUTED]
    assert (tmp_path / "data" / "both.txt").read_text() == "A+B"
    again = do_all(tmp_path, A, B, BOTH, run="later")
    assert states(again) == 3 * [KEPT]
    assert [each.size for each in again.values()] == [1, 1, 3]
    # A worker that died after it was done: whoever asks again in the same run hears that this run computed it.
    assert states(do_all(tmp_path, A, B, BOTH, run="now")) == 3 * [COMPUTED]


def test_other_arguments_make_it_anew_and_what_is_made_from_it(tmp_path):
    do_all(tmp_path, A, B, BOTH)
    other = replace(A, arguments=("a.txt", "changed"))
    assert states(do_all(tmp_path, other, B, BOTH, run="later")) == [COMPUTED, KEPT, COMPUTED]
    assert (tmp_path / "data" / "both.txt").read_text() == "changed+B"


def test_what_comes_out_the_same_leaves_the_rest_as_it_is(tmp_path):
    do_all(tmp_path, A, B, BOTH)
    (tmp_path / "results" / "a-1.json").unlink()
    assert states(do_all(tmp_path, A, B, BOTH, run="later")) == [COMPUTED, KEPT, KEPT]


@pytest.mark.parametrize("harm", ["data/a.txt", "results/a-1.json"])
@pytest.mark.parametrize("how", ["gone", "altered"])
def test_what_is_gone_or_altered_is_made_again(tmp_path, harm, how):
    do_all(tmp_path, A)
    if how == "gone":
        (tmp_path / harm).unlink()
    else:
        (tmp_path / harm).write_text("half of so")
    assert states(do_all(tmp_path, A, run="later")) == [COMPUTED]
    assert (tmp_path / "data" / "a.txt").read_text() == "A"


@pytest.mark.parametrize("what", ["clothlab", "torch", "mujoco"])
def test_another_version_makes_it_anew(tmp_path, monkeypatch, what):
    do_all(tmp_path, A)
    others = tasks.versions() | {what: "9.9"}
    monkeypatch.setattr(tasks, "versions", lambda: others)
    assert states(do_all(tmp_path, A, run="later")) == [COMPUTED]


def test_files_of_an_earlier_making_are_gone(tmp_path):
    many = Task("many", put, ("part-1.txt", "one"), (), ("part-*.txt",))
    do_all(tmp_path, many)
    do_all(tmp_path, replace(many, arguments=("part-2.txt", "two")))
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["part-2.txt"]


def test_a_failure_leaves_out_what_needs_it_and_nothing_else(tmp_path):
    bad = Task("b", say, (), (), ("b.txt",))
    last = Task("last", join, ("last.txt", "both.txt"), ("both",), ("last.txt",))
    found = do_all(tmp_path, A, bad, BOTH, last)
    assert states(found) == [COMPUTED, FAILED, LEFT_OUT, LEFT_OUT]
    assert summary(found.values()).splitlines() == [
        "1 computed, 0 taken from the store, 1 failed, 2 left out",
        "  failed: b: ValueError: the first line",
        "  left out: both: needs b",
        "  left out: last: needs both",
    ]
    assert states(do_all(tmp_path, A, B, BOTH, last, run="later")) == [KEPT, COMPUTED, COMPUTED, COMPUTED]


@pytest.mark.parametrize(("deaths", "state"), [(3, COMPUTED), (4, FAILED)])
def test_a_task_of_which_many_processes_died_is_given_up_in_that_run(tmp_path, deaths, state):
    (tmp_path / "running").mkdir()
    (tmp_path / "running" / "a-1").write_text(9 * "an earlier run\n" + deaths * "now\n")
    found = do_all(tmp_path, A)["a-1"]
    assert found.state == state
    assert found.why == ("" if state == COMPUTED else "RuntimeError: 4 workers died of it, one after another")
    assert not list((tmp_path / "running").iterdir())
    assert do(A, tmp_path, "later").state == {COMPUTED: KEPT, FAILED: COMPUTED}[state]


def test_who_writes_nothing_has_failed(tmp_path):
    found = do_all(tmp_path, Task("idle", nothing, (), (), ("idle.txt",)))
    assert found["idle"] == Outcome("idle", FAILED, why="RuntimeError: idle did not write data/idle.txt")
    assert states(do_all(tmp_path, Task("idle", nothing, (), (), ("idle.txt",)))) == [FAILED]  # nothing looks done


def test_arguments_that_cannot_be_written_down_are_a_failure(tmp_path):
    found = do_all(tmp_path, replace(A, arguments=("a.txt", object())))
    assert "not JSON serializable" in found["a-1"].why


def test_a_task_has_one_thread_and_the_store_s_data_and_gives_both_back(tmp_path, monkeypatch):
    monkeypatch.setenv("CLOTHLAB_DATA", "before")
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    do_all(tmp_path, Task("s", surroundings, ("s.txt",), (), ("s.txt",)))
    assert (tmp_path / "data" / "s.txt").read_text() == f"1 {tmp_path / 'data'}"
    assert (torch.get_num_threads(), os.environ["CLOTHLAB_DATA"]) == (2, "before")
    torch.set_num_threads(threads)


def test_weights_of_another_folder_are_forgotten(tmp_path, monkeypatch):
    monkeypatch.setattr(artifacts, "load", lambda name: os.environ.get("CLOTHLAB_DATA"))
    before = trained("torque-0")
    do_all(tmp_path, Task("w", lambda: put("w.txt", str(trained("torque-0"))), (), (), ("w.txt",)))
    assert (tmp_path / "data" / "w.txt").read_text() == str(tmp_path / "data")
    assert trained("torque-0") == before
    trained.cache_clear()


@pytest.mark.parametrize(
    ("todo", "message"),
    [
        ([A, A], "two tasks are called 'a-1'"),
        ([BOTH, A], "'both' is made from 'b', which is no task"),
        ([replace(A, after=("b",)), replace(B, after=("a-1",))], "in a circle: "),
        ([replace(A, name="../a")], "the name of a task has letters"),
    ],
)
def test_tasks_that_do_not_belong_together_are_refused(todo, message):
    with pytest.raises(ValueError, match=message):
        in_order(todo)


def test_the_order_is_one_in_which_they_can_be_done():
    assert [task.name for task in in_order([BOTH, B, A])][-1] == "both"


def test_kinds_cost_the_same():
    assert [kind(name) for name in ("model-torque-paper-12", "tables", "control-3")] == [
        "model-torque-paper",
        "tables",
        "control",
    ]
    todo = [A, replace(A, name="a-2"), B]
    assert expected(todo, {"a-1": 4.0, "a-9": 2.0}) == {"a-1": 4.0, "a-2": 3.0, "b": 3.0}
    assert expected(todo, {}) == {"a-1": 0, "a-2": 0, "b": 0}


def test_the_time_of_a_graph_on_some_workers():
    seconds = {"a-1": 3.0, "b": 5.0, "both": 2.0}
    urgent = urgency([A, B, BOTH], seconds)
    assert urgent == {"a-1": 5.0, "b": 7.0, "both": 2.0}
    assert [makespan([A, B, BOTH], seconds, workers, urgent) for workers in (1, 2, 9)] == [10.0, 7.0, 7.0]
    assert makespan([BOTH], seconds, 1, urgent) == 2.0  # what it is made from is there
    assert makespan([], seconds, 1, urgent) == 0.0
    four = [replace(A, name=f"a-{k}") for k in range(4)]
    equal = dict.fromkeys([task.name for task in four], 1.0)
    assert [makespan(four, equal, workers, equal) for workers in (1, 2, 3, 4)] == [4.0, 2.0, 2.0, 1.0]


def test_what_tasks_took_is_known_of_those_that_were_done(tmp_path):
    assert measured(tmp_path / "nowhere", ["a-1"]) == {}
    do_all(tmp_path, A)
    (tmp_path / "results" / "b.json").write_text("{")
    found = measured(tmp_path, ["a-1", "b", "both"])
    assert list(found) == ["a-1"]
    assert 0 <= found["a-1"]["seconds"] < 5
