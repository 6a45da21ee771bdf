"""The loop's decisions by a clock that goes on only when somebody sleeps."""

import time
import warnings
from dataclasses import replace
from pathlib import Path

import loop_at_20_hz as example
import numpy as np
import pytest
import torch
from loop_at_20_hz import STEP, Loop, SimulatedClock, Swing

from clothlab.method.deploy import Beat, Ranges, RangeWatch

PAGE = Path(example.__file__).parents[1] / "docs" / "your_own_robot.md"


@pytest.fixture(scope="module")
def learned():
    """Hardly trained: what is tested is what the loop decides."""
    torch.set_num_threads(1)
    short = replace(example.TRAINING, epochs=1, stride=20)
    return example.learn(short, steps=200)


class Slow(Swing):
    """A swing that in some cycles takes long to read, or to send to [s]."""

    def __init__(self, clock, reading=None, sending=None):
        super().__init__(1.0, clock)
        self.clock = clock
        self.reading = reading or {}
        self.sending = sending or {}
        self.sent = []

    def read(self):
        self.clock.sleep(self.reading.get(len(self.sent), 0.0))
        return super().read()

    def send(self, u):
        super().send(u)
        self.clock.sleep(self.sending.get(len(self.sent), 0.01))
        self.sent.append(u.copy())


def looped(learned, cycles, alarm=None, **delays):
    clock = SimulatedClock()
    robot = Slow(clock, **delays)
    said = []
    beat = Beat(STEP, clock=clock, sleep=clock.sleep)
    wide = Ranges([[-99, -99], [99, 99]], learned.ranges.u)
    anywhere = replace(learned, ranges=wide)
    loop = Loop(robot, anywhere, beat, say=said.append, clock=clock, alarm=alarm)
    windows = []
    for _ in range(cycles):
        loop.cycle()
        window = loop.estimator.window
        windows.append(0 if window is None else len(window.s))
    return loop, said, windows


def test_in_time_every_cycle_solves_and_p_moves_when_there_is_enough(learned):
    loop, said, windows = looped(learned, 30)
    assert loop.controller.solves == 30
    assert said == ["p moves"]
    # Ten steps of warm-up, five predictions to judge.
    assert windows == [0] * 15 + list(range(16, 31))
    assert (loop.report.late, loop.report.missed) == (0, 0)
    assert not np.array_equal(loop.report.biases[-1], [0])


def test_after_a_late_cycle_the_plan_goes_on_without_a_solve(learned):
    loop, _, windows = looped(learned, 30, sending={20: 0.06})
    assert (loop.report.late, loop.report.missed) == (1, 0)
    assert loop.controller.solves == 29
    assert windows[-1] == 30  # nothing is forgotten


@pytest.mark.slow
def test_after_missed_cycles_the_window_is_forgotten_and_p_stays(learned):
    loop, said, windows = looped(learned, 42, sending={20: 0.19})
    assert (loop.report.late, loop.report.missed) == (1, 3)
    assert windows[20] == 21
    assert windows[21:36] == [0] * 15
    assert windows[36] == 16
    p = np.array(loop.report.biases)
    assert (p[21:36] == p[20]).all()
    assert p[20] != 0
    assert said == [
        "p moves",
        "a gap: p stays, and its window begins anew",
        "too few steps to move p",
        "p moves",
    ]


def test_a_sensor_that_answers_late_is_a_gap_too(learned):
    loop, _, windows = looped(learned, 24, reading={20: 0.19})
    # Before the late answer, and after it, since the next one comes soon.
    assert loop.report.gaps == 2
    assert windows[20:] == [0, 0, 0, 0]


def test_out_of_range_the_robot_is_sent_to_rest_and_the_sensor_named(learned):
    narrow = replace(learned.ranges, s=np.array([[-0.2, -50], [0.2, 50]]))
    clock = SimulatedClock()
    robot = Slow(clock)
    robot.state = np.array([0.9, 0.0])
    beat = Beat(STEP, clock=clock, sleep=clock.sleep)
    loop = Loop(robot, replace(learned, ranges=narrow), beat, say=[].append)
    with pytest.warns(match=r"angle \[rad\] is 0\.\d+, and was between -0\.2 and 0\.2"):
        loop.cycle()
    assert robot.sent == [[0.0]]
    assert loop.report.rests == 1
    for _ in range(30):
        loop.cycle()  # no second warning, which would be an error here
    assert loop.report.rests < 31  # the swing has come down
    assert np.any(robot.sent)


def test_out_of_range_and_where_a_sensor_says_nothing_p_stays(learned):
    clock = SimulatedClock()
    robot = Slow(clock)
    beat = Beat(STEP, clock=clock, sleep=clock.sleep)
    ranges = replace(learned.ranges, s=np.array([[-9, -9], [9, 9]]))
    loop = Loop(robot, replace(learned, ranges=ranges), beat, say=[].append)
    for _ in range(25):
        loop.cycle()
    before = loop.estimator.p
    assert before != 0

    # The swing itself goes on; its speed is seen far too high, then not at all.
    read = robot.read
    for wrong, message in ((99.0, "was between -9 and 9"), (np.nan, "says nothing")):
        robot.read = lambda wrong=wrong: (np.array([0.0, wrong]), read()[1])
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            for _ in range(3):
                loop.cycle()
        assert loop.estimator.p == before
        assert loop.estimator.window is None
        loop.watch = RangeWatch(ranges, learned.state_names)  # warns anew
        assert message in str(told[0].message)
        assert len(told) == 1
    assert loop.report.rests == 6
    robot.read = read
    loop.cycle()
    assert loop.report.rests == 6


@pytest.mark.slow
def test_the_alarm_is_asked_once_a_second_and_told_once(learned):
    asked = []

    def alarm(fit, p):
        asked.append((len(fit.errors), p.shape))
        return True

    loop, said, _ = looped(learned, 62, alarm=alarm)
    # With the 21st, 41st and 61st cycle: a window without its ten steps of warm-up.
    assert asked == [(10, (1,)), (30, (1,)), (50, (1,))]
    assert loop.report.alarms == 3
    assert said == ["p moves", "this is predicted worse than all that was trained on"]


@pytest.mark.slow
def test_it_keeps_20_hz_by_a_real_clock(learned):
    loop = Loop(Swing(1.0, time.monotonic), learned, Beat(STEP), say=[].append)
    begin = time.monotonic()
    for _ in range(41):
        loop.cycle()
    took = time.monotonic() - begin
    # On a busy machine cycles are missed, and the beat stays.
    cycles = 40 + loop.report.missed
    assert cycles * STEP <= took <= (cycles + 3) * STEP + 0.5


@pytest.mark.slow
def test_rates_are_a_table():
    rows = example.rates(repeats=3).splitlines()
    assert len(rows) == 2 + 3 * 3
    assert len({row.count("|") for row in rows}) == 1


def test_a_table_takes_the_place_of_the_one_before(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"a\n{example.BEGIN}\nold\n{example.END}\nb\n")
    for table in ("new", "newer"):
        example.put_into(page, table)
        expected = f"a\n{example.BEGIN}\n\n{table}\n\n{example.END}\nb\n"
        assert page.read_text() == expected
    assert example.BEGIN in PAGE.read_text("utf-8")


def test_a_page_without_marks_is_left_as_it_is_and_the_marks_are_named(tmp_path):
    page = tmp_path / "page.md"
    for text in ("a\n", f"a\n{example.BEGIN}\nb\n"):
        page.write_text(text)
        with pytest.raises(
            ValueError, match=r"page.md has no place for .*end of rates"
        ):
            example.put_into(page, "new")
        assert page.read_text() == text
