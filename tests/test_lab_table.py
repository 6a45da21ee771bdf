"""Setting the table behind a button: what is shown of a task, and that it can be stopped at any time."""

import asyncio
import json
import threading
import time

import numpy as np
import pytest

from clothlab.lab import table
from clothlab.lab.table import _SPREADERS, TableSection, _conclusion, _verdict
from clothlab.table_scene import task
from clothlab.table_scene.table_env import ClothPose, Placement, TableEnv
from clothlab.table_scene.task import PHASES, Outcome

SLOW = "lay it slowly"
POSE, STANDS = ClothPose(1.0, 0.97, -2.0, np.zeros(3)), Placement(1.25, 0.011, True)
GOOD = Outcome("", "", True, None, POSE, STANDS, 0.003, 330)
MISSED = Outcome("look", "it is turned", True, None, ClothPose(1.0, 1.0, 40.0, np.zeros(3)), None, None, 200)


def threads():
    return [thread for thread in threading.enumerate() if thread.name == "setting the table"]


class Fake:
    """A task without a robot: so many control periods a phase."""

    def __init__(self, outcome=GOOD, periods=3, error=None):
        self.outcome, self.periods, self.error, self.steps = outcome, periods, error, 0

    def __call__(self, method, seed, watch, progress):
        progress("")
        for phase in PHASES:
            progress(phase)
            for _ in range(self.periods):
                self.steps += 1
                watch(lambda: np.full((6, 8, 3), self.steps, np.uint8))
            if self.error is not None:
                raise self.error
            if phase == self.outcome.failed:
                break
        return self.outcome


class Page:
    """What a browser sees: it draws each frame at once, unless it is gone."""

    def __init__(self, gone=False):
        self.frames, self.errors, self.gone = [], [], gone
        self.section = TableSection(self.show, self.errors)

    def show(self, news):
        json.dumps({key: value for key, value in news.items() if key != "picture"})
        self.frames.append(news)
        if not self.gone and len(self.frames) > 1:
            self.section.drawn = news["number"]

    def last(self, key):
        return self.frames[-1][key]

    def marks(self):
        return [mark for _, mark in self.last("phases")]

    async def until(self, condition, seconds=10.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, self.frames[-1]
            await asyncio.sleep(0.01)

    async def finish(self):
        await self.until(lambda: not self.last("running"))


@pytest.fixture
def visit(monkeypatch):
    """Calls an async function with a page, whose section runs a fake task, in an event loop."""

    def visit(act, fake=None, **about):
        async def main():
            page = Page(**about)
            if fake is not None:
                monkeypatch.setattr(table, "_play", fake)
            try:
                await act(page)
            finally:
                page.section.close()
            return page

        page = asyncio.run(main())
        assert not threads()
        return page

    return visit


def test_phases_go_by_and_the_verdict_comes_last(visit):
    async def act(page):
        assert (page.last("running"), page.last("choices")) == (False, list(_SPREADERS))
        page.section.start(SLOW, seed=7)
        assert page.last("running")
        assert page.last("message")["text"].startswith("task 7;")
        await page.finish()

    page = visit(act, Fake())
    for news in page.frames:
        marks = [mark for _, mark in news["phases"]]
        assert marks.count("running") <= 1
        assert marks == sorted(marks, key=["done", "running", "waiting"].index)
    ran = [name for news in page.frames for name, mark in news["phases"] if mark == "running"]
    assert list(dict.fromkeys(ran)) == list(PHASES)
    assert page.marks() == ["done"] * len(PHASES)
    assert page.last("message")["text"] == _conclusion(GOOD)
    assert page.last("verdict") == _verdict(GOOD)
    assert page.last("picture")[:2] == b"\xff\xd8"
    assert [news["number"] for news in page.frames] == list(range(1, len(page.frames) + 1))


async def run_through(page):
    page.section.start(SLOW)
    await page.finish()


@pytest.mark.parametrize(
    ("error", "kind", "faults"), [(ValueError("no such cloth"), "mistake", 0), (ZeroDivisionError("oh"), "fault", 1)]
)
def test_an_error_is_a_message_in_the_phase_where_it_happened(visit, error, kind, faults):
    page = visit(run_through, Fake(error=error))
    assert page.marks() == ["failed"] + ["waiting"] * 6
    assert page.last("message")["kind"] == kind
    assert str(error) in page.last("message")["text"]
    assert len(page.errors) == faults


def test_a_stop_ends_the_task_within_a_control_period_and_another_may_begin(visit):
    fake = Fake(periods=1000)

    async def act(page):
        section = page.section
        section.start(SLOW)
        with pytest.raises(ValueError, match="already: stop it first"):
            section.start(SLOW)
        await page.until(lambda: fake.steps > 5)
        section.stop()
        after = fake.steps
        assert page.last("message")["text"] == "stopped"
        await page.finish()
        assert fake.steps <= after + 1
        assert page.marks() == ["stopped"] + ["waiting"] * 6
        section.stop()  # twice is once
        section.start(SLOW)
        await page.until(lambda: page.marks()[0] == "running")
        with pytest.raises(KeyError, match="unknown way to spread the cloth 'iron it'; choose from throw it, lay it"):
            section.start("iron it")

    visit(act, fake)


def test_a_page_that_is_gone_stops_the_robot(visit, monkeypatch):
    monkeypatch.setattr(table, "_PATIENCE", 3)

    async def act(page):
        page.section.start(SLOW)
        await page.until(lambda: not page.section.running)
        await asyncio.sleep(0.2)

    page = visit(act, Fake(), gone=True)
    assert "does not answer" in page.last("message")["text"]


def test_the_outcome_is_said_in_words():
    cloth, _ = _verdict(GOOD)
    assert cloth == {"text": "cloth spread: 100% of it flat on the table, 97% of its area, turned by 2°", "good": True}
    assert [line["good"] for line in _verdict(MISSED)] == [False]
    fallen = Outcome("", "", True, None, POSE, Placement(80.0, 0.5, False), 0.003, 330)
    assert "not placed: not on the table, tilted by 80.0°" in _verdict(fallen)[1]["text"]
    assert _conclusion(GOOD) == "the table is set, after 66 s of the robot's time"
    assert _conclusion(MISSED) == "“look” failed after 40 s of the robot's time: it is turned"
    assert "it is not" in _conclusion(fallen)


def test_what_throwing_needs_is_loaded_before_the_robot_moves(monkeypatch):
    done = []
    monkeypatch.setattr(table, "_load", lambda name: done.append(name))
    for name in ("successful_throws", "spread_target", "run_task"):
        monkeypatch.setattr(task, name, lambda *_, name=name, **__: done.append(name))
    table._play("throw it", 0, None, lambda phase: done.append("progress"))
    assert done == ["table-0", "successful_throws", "spread_target", "progress", "run_task"]


def test_a_robot_that_moves_is_seen_and_stopped_and_leaves_no_opengl(visit, monkeypatch):
    scenes = []
    monkeypatch.setattr(task, "TableEnv", lambda *arguments: scenes.append(TableEnv(*arguments)) or scenes[-1])

    async def act(page):
        page.section.start(SLOW, seed=1)
        await page.until(lambda: len({news["picture"] for news in page.frames}) > 4, 30)
        assert page.last("phases")[0] == ("fetch cloth", "running")
        assert len(scenes[0]._renderers) == 2
        page.section.close()

    page = visit(act)
    assert (page.errors, scenes[0]._renderers, len(scenes)) == ([], {}, 1)
    empty = table.encoded(np.zeros((288, 384, 3), np.uint8), ".jpg")
    assert len(page.last("picture")) > 3 * len(empty)
