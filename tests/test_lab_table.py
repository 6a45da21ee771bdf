"""Setting the table behind a button: what is shown of an episode, and that it can be stopped at any time."""

import asyncio
import json
import threading
import time

import numpy as np
import pytest

from clothlab.experiments import table_setting
from clothlab.lab import table
from clothlab.lab.messages import Messages
from clothlab.lab.table import SIZE, SPREADERS, TableRun, TableSection, conclusion, verdict
from clothlab.table_scene.table_env import Placement, Spread, TableEnv
from clothlab.table_scene.task import PHASES, Outcome

SLOW_HAND = "lay it slowly"
BLACK = np.zeros((6, 8, 3), np.uint8)
LIES, STANDS = Spread(1.0, 0.97, -2.0, np.zeros(3)), Placement(1.25, 0.011, True)
GOOD = Outcome("", "", True, None, LIES, STANDS, 0.003, 330)
MISSED = Outcome("look", "it is turned", True, None, Spread(1.0, 1.0, 40.0, np.zeros(3)), None, None, 200)


def threads():
    return [thread for thread in threading.enumerate() if thread.name == "setting the table"]


def until(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


class Fake:
    """An episode without a robot: so many control periods a phase."""

    def __init__(self, outcome=GOOD, periods=3, error=None):
        self.outcome, self.periods, self.error, self.steps, self.begun = outcome, periods, error, 0, []

    def __call__(self, watch, progress):
        progress("")
        for phase in PHASES:
            progress(phase)
            self.begun.append(phase)
            for _ in range(self.periods):
                self.steps += 1
                watch(lambda: np.full_like(BLACK, self.steps))
            if self.error is not None:
                raise self.error
            if phase == self.outcome.failed:
                break
        return self.outcome


@pytest.fixture(autouse=True)
def no_thread_is_left():
    yield
    until(lambda: not threads())


@pytest.fixture
def begin():
    """Begins a run of a fake episode, and ends it when the test is over."""
    runs = []

    def begin(fake):
        runs.append(TableRun(fake, Messages()))
        return runs[-1]

    yield begin
    for run in runs:
        run.stop(wait=True)


def watched(run):
    """Takes each picture, and notes how far the run is."""
    shown = []
    while run.alive:
        if run.take() is not None or not shown:
            shown.append(run.marks())
        time.sleep(0.001)
    return [*shown, run.marks()]


def test_each_phase_is_waiting_then_running_then_done(begin):
    shown = watched(begin(Fake()))
    for k in range(len(PHASES)):
        each = [marks[k] for marks in shown]
        assert [mark for n, mark in enumerate(each) if n == 0 or mark != each[n - 1]][-2:] == ["running", "done"]
    for marks in shown[:-1]:
        assert marks.count("running") <= 1
        assert marks == sorted(marks, key=["done", "running", "waiting"].index)
    assert shown[-1] == ["done"] * len(PHASES)


def test_an_episode_waits_until_its_pictures_are_taken(begin):
    fake = Fake()
    run = begin(fake)
    until(lambda: fake.steps == 2)  # one that waits to be taken, and the next
    time.sleep(0.05)
    assert fake.steps == 2
    assert np.all(run.take() == 1)
    until(lambda: fake.steps == 3)


def test_who_is_stopped_within_a_phase_moves_for_one_period_at_most(begin):
    fake = Fake(periods=1000)
    run = begin(fake)
    until(lambda: run.take() is not None and fake.steps > 5)
    run.stop()
    after = fake.steps
    until(lambda: not run.alive)
    assert fake.steps <= after + 1
    assert run.marks() == ["stopped"] + ["waiting"] * 6
    assert (run.outcome, run.messages.errors) == (None, [])
    run.stop(wait=True)  # twice is once


def test_who_waits_for_a_picture_to_be_taken_can_be_stopped(begin):
    fake = Fake()
    run = begin(fake)
    until(lambda: fake.steps == 2)
    run.stop(wait=True)
    assert not run.alive
    assert fake.steps == 2


def test_a_stop_while_it_gets_ready_is_heard(begin):
    ready = threading.Event()

    def play(watch, progress):
        ready.wait(5)
        progress("")
        return GOOD

    run = begin(play)
    assert run.marks() == ["waiting"] * len(PHASES)
    run.stop()
    ready.set()
    until(lambda: not run.alive)
    assert run.outcome is None


def test_the_phase_that_failed_is_marked_and_those_after_it_wait(begin):
    fake = Fake(MISSED)
    assert watched(begin(fake))[-1] == ["done", "done", "done", "failed", "waiting", "waiting", "waiting"]
    assert fake.begun[-1] == "look"


@pytest.mark.parametrize(
    ("error", "kind", "faults"), [(ValueError("no such cloth"), "mistake", 0), (ZeroDivisionError("oh"), "fault", 1)]
)
def test_an_error_is_a_message_in_the_phase_where_it_happened(begin, error, kind, faults):
    run = begin(Fake(error=error))
    assert watched(run)[-1][0] == "failed"
    assert run.messages.shown["kind"] == kind
    assert str(error) in run.messages.shown["text"]
    assert "Traceback" not in run.messages.shown["text"]
    assert len(run.messages.errors) == faults


def test_what_became_of_cloth_and_basket_is_said_in_words():
    assert verdict(GOOD) == [
        {
            "text": "cloth spread: 100% of its points flat on the table, area 97% of the flat cloth's, turned by 2°",
            "good": True,
        },
        {"text": "basket placed: tilted by 1.2°, 1.1 cm off the cloth's centre, cloth dragged by 0.3 cm", "good": True},
    ]
    assert [line["good"] for line in verdict(MISSED)] == [False]
    assert "not spread" in verdict(MISSED)[0]["text"]
    fallen = Outcome("", "", True, None, LIES, Placement(80.0, 0.5, False), 0.003, 330)
    assert "not placed: not on the table, tilted by 80.0°" in verdict(fallen)[1]["text"]
    assert verdict(Outcome("fetch cloth", "no cloth in view", False, None, None, None, None, 9)) == []
    assert conclusion(GOOD) == "the table is set, after 66 s of the robot's time"
    assert conclusion(MISSED) == "“look” failed after 40 s of the robot's time: it is turned"
    assert "but it is not" in conclusion(fallen)


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

    def last(self, what):
        return self.frames[-1][what]

    async def until(self, condition, seconds=10.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, self.frames[-1]
            await asyncio.sleep(0.01)


@pytest.fixture
def visit(monkeypatch):
    """Calls an async function with a page, whose section plays a fake episode, in an event loop."""

    def visit(act, fake=None, **about):
        async def main():
            page = Page(**about)
            if fake is not None:
                monkeypatch.setattr(table, "play", lambda how, seed, watch, progress: fake(watch, progress))
            try:
                await act(page)
            finally:
                page.section.close()
            return page

        return asyncio.run(main())

    return visit


def test_phases_go_by_and_the_verdict_comes_last(visit):
    async def act(page):
        assert (page.last("running"), page.last("choices")) == (False, list(SPREADERS))
        page.section.start(SLOW_HAND, seed=7)
        assert page.last("running")
        assert page.last("message")["text"].startswith("episode 7;")
        await page.until(lambda: not page.last("running"))

    page = visit(act, Fake())
    ran = [name for news in page.frames for name, mark in news["phases"] if mark == "running"]
    assert list(dict.fromkeys(ran)) == list(PHASES)
    assert {mark for _, mark in page.last("phases")} == {"done"}
    assert page.last("message")["text"] == conclusion(GOOD)
    assert page.last("verdict") == verdict(GOOD)
    assert page.last("picture")[:2] == b"\xff\xd8"
    assert [news["number"] for news in page.frames] == list(range(1, len(page.frames) + 1))


def test_a_second_start_is_refused_until_the_first_episode_is_over(visit):
    async def act(page):
        section = page.section
        section.start(SLOW_HAND)
        with pytest.raises(ValueError, match="already: stop it first"):
            section.start(SLOW_HAND)
        assert len(threads()) == 1
        section.stop()
        assert page.last("message")["text"] == "stopped"
        await page.until(lambda: not page.last("running"))
        assert page.last("phases")[0][1] == "stopped"
        section.stop()  # twice is once
        section.start(SLOW_HAND)
        await page.until(lambda: page.last("phases")[0][1] == "running")
        with pytest.raises(KeyError, match="unknown way to spread the cloth 'iron it'; choose from throw it, lay it"):
            section.start("iron it")

    visit(act, Fake(periods=1000))


def test_closed_while_it_runs_it_leaves_no_thread(visit):
    async def act(page):
        page.section.start(SLOW_HAND)
        await page.until(lambda: len(page.frames) > 5)
        page.section.close()
        assert not threads()
        page.section.close()  # twice is once

    visit(act, Fake(periods=1000))


def test_a_page_that_is_gone_stops_the_robot(visit, monkeypatch):
    monkeypatch.setattr(table, "PATIENCE", 3)

    async def act(page):
        page.section.start(SLOW_HAND)
        await page.until(lambda: not page.section.running)
        await asyncio.sleep(0.2)

    page = visit(act, Fake(), gone=True)
    assert "does not answer" in page.last("message")["text"]
    assert not page.last("running")


def test_a_busy_kernel_is_not_a_page_that_is_gone(visit, monkeypatch):
    monkeypatch.setattr(table, "PATIENCE", 3)

    async def act(page):
        page.section.start(SLOW_HAND)
        await page.until(lambda: len(page.frames) > 3)
        page.gone = True
        await page.until(lambda: page.section._unseen > 0)
        time.sleep(0.5)  # a cell that computes; the answer is heard afterwards
        page.gone, page.section.drawn = False, page.last("number")
        await page.until(lambda: page.section._unseen == 0)
        assert page.section.running

    visit(act, Fake(periods=1000))


def test_a_fault_of_ours_is_kept_and_ends_the_episode(visit, monkeypatch):
    async def act(page):
        page.section.start(SLOW_HAND)
        monkeypatch.setattr(table, "encoded", lambda *_: 1 / 0)
        await page.until(lambda: not page.last("running"))
        assert not threads()
        assert page.last("message")["kind"] == "fault"

    assert "ZeroDivisionError" in visit(act, Fake()).errors[0]


def test_without_an_event_loop_nothing_begins():
    page = Page()
    with pytest.raises(RuntimeError, match="no running event loop"):
        page.section.start(SLOW_HAND)
    assert not threads()


def test_without_weights_the_robot_says_so_and_lays_the_cloth_slowly(visit, monkeypatch):
    def missing(name):
        raise KeyError(f"unknown dpmpb weights {name!r}; choose from torque-0")

    monkeypatch.setattr(table_setting, "trained", missing)
    monkeypatch.setattr(table_setting, "play", lambda *_, **__: GOOD)

    async def act(page):
        page.section.start("throw it")
        await page.until(lambda: not page.last("running"))
        assert page.last("message")["kind"] == "mistake"
        assert "needs the weights table-0, which are not there: run `make train`" in page.last("message")["text"]
        page.section.start(SLOW_HAND)
        await page.until(lambda: page.last("verdict"))

    assert visit(act).errors == []


def test_what_throwing_needs_is_loaded_before_the_robot_moves(monkeypatch):
    done = []
    for name in ("trained", "good_throws", "target"):
        monkeypatch.setattr(table_setting, name, lambda *_, name=name: done.append(name))
    monkeypatch.setattr(table_setting, "play", lambda *_, **__: done.append("play"))
    table.play("throw it", 0, None, lambda phase: done.append("told" + phase))
    assert done == ["trained", "told", "good_throws", "told", "target", "told", "play"]


def test_a_robot_that_moves_is_seen_and_stopped_and_leaves_no_opengl(visit, monkeypatch):
    scenes = []
    monkeypatch.setattr(table_setting, "TableEnv", lambda *arguments: scenes.append(TableEnv(*arguments)) or scenes[-1])

    async def act(page):
        page.section.start(SLOW_HAND, seed=1)
        await page.until(lambda: len({news["picture"] for news in page.frames}) > 4, 30)
        assert page.last("phases")[0] == ("fetch cloth", "running")
        assert len(scenes[0]._renderers) == 2
        page.section.close()

    page = visit(act)
    assert (page.errors, scenes[0]._renderers, len(scenes)) == ([], {}, 1)
    picture = table.encoded(np.zeros((*SIZE, 3), np.uint8), ".jpg")
    assert len(page.last("picture")) > 3 * len(picture)
