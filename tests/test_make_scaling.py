"""The tables of docs/scaling.md: sums of what was measured, and a plan that follows from them."""

import json

import make_scaling
import pytest

from clothlab import artifacts
from clothlab.reproduce import graph, small_plan


@pytest.fixture
def store(tmp_path):
    """A run in which every task took two seconds on a core, three in all, and wrote ten bytes into each file."""
    for task in graph(small_plan(2)):
        answer = {"seconds": 3.0, "cpu_seconds": 2.0}
        artifacts.save_results({"answer": answer}, task.name, data=(tmp_path / "results").parent)
        for name in task.files:
            path = tmp_path / "data" / name.replace("*", "x")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b"0123456789")
    return tmp_path


def cells(text, first):
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {first} |")]
    return [each.strip() for each in line.strip("|").split("|")][1:]


def test_costs_are_sums_over_the_tasks_of_a_kind(store):
    text, count = make_scaling.costs(small_plan(2), store), len(graph(small_plan(2)))
    assert text.startswith("Size `small`, 2 seeds, 20")
    assert cells(text, "model-torque-paper") == ["2", "2.0", "4", "6", "0.00"]
    assert cells(text, "**all**")[:4] == [str(count), "", str(2 * count), str(3 * count)]
    one = len(graph(small_plan(1)))
    assert cells(text, "1 seed")[:2] == [str(one), f"{2 * one / 60:.1f}"]
    assert int(cells(text, "1 seed, `--paper-only`")[0]) < one


def test_a_run_that_is_not_finished_has_no_costs(store):
    (store / "results" / "tables.json").unlink()
    with pytest.raises(ValueError, match=r"1 tasks were never done in .*, such as tables: `make reproduce` first"):
        make_scaling.costs(small_plan(2), store)


def test_the_plan_adds_up(store):
    text, tasks = make_scaling.on_paper(small_plan(2), store, seeds=20), graph(small_plan(20))
    merges = sum(task.name.startswith("merge-") for task in tasks)
    work = 2 * (len(tasks) + 9 * merges)  # ten times as many seeds: merging takes ten times as long
    assert f"2 seeds: {len(tasks)} tasks, {work / 3600:.1f} core-hours" in text
    assert cells(text, "1") == [f"{work / 3600:.2f}", "100 %"]
    assert float(cells(text, "1024")[0]) == pytest.approx(2 * (5 + 10 + 1) / 3600, abs=0.006)  # the longest chain


def test_the_page_has_a_place_for_each_table():
    text = make_scaling.PAGE.read_text()
    for name in ("costs", "scaling", "plan"):
        assert f"<!-- {name} -->\nhere\n<!-- /{name} -->" in make_scaling.between(text, name, "here")
    with pytest.raises(ValueError, match="no place for 'nothing'"):
        make_scaling.between(text, "nothing", "here")


def test_a_task_s_answer_says_what_the_tables_need(tmp_path):
    from test_tasks import A, do_all

    do_all(tmp_path, A)
    answer = json.loads((tmp_path / "results" / "a-1.json").read_text())["answer"]
    assert set(answer) == {"run", "seconds", "cpu_seconds", "machine"}
    assert make_scaling.sizes([A], tmp_path) == {"a-1": 1}
