"""A beat that counts what is late, and ranges that warn once; no test waits."""

import warnings

import numpy as np
import pytest

from clothlab.method.data import Run
from clothlab.method.deploy import Beat, Ranges, RangeWatch


class Clock:
    """A clock that goes on only when somebody works or sleeps."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        assert seconds > 0
        self.now += seconds


@pytest.fixture
def clock():
    return Clock()


def begins(clock, work, period=0.05):
    """When cycles begin that work so long each, and how many were missed before."""
    beat = Beat(period, clock=clock, sleep=clock.sleep)
    times = []
    missed = []
    for seconds in work:
        missed.append(beat.wait())
        times.append(clock.now - 100.0)
        clock.now += seconds
    return beat, np.array(times), missed


def test_cycles_begin_on_the_beat_whatever_they_take(clock):
    beat, times, missed = begins(clock, [0.01, 0.049, 0.0, 0.03, 0.01])
    assert times == pytest.approx(0.05 * np.arange(5))
    assert missed == [0] * 5
    assert (beat.late, beat.missed) == (0, 0)
    assert beat.due == pytest.approx(0.2)


def test_a_short_delay_is_caught_up(clock):
    beat, times, missed = begins(clock, [0.06, 0.01, 0.01])
    assert times == pytest.approx([0.0, 0.06, 0.10])
    assert missed == [0, 0, 0]
    assert (beat.late, beat.missed) == (1, 0)


def test_a_long_delay_misses_cycles_and_leaves_the_others_on_the_beat(clock):
    beat, times, missed = begins(clock, [0.01, 0.19, 0.01, 0.01])
    assert times == pytest.approx([0.0, 0.05, 0.25, 0.30])
    assert missed == [0, 0, 3, 0]
    assert (beat.late, beat.missed) == (1, 3)


def test_delays_do_not_add_up(clock):
    rng = np.random.default_rng(0)
    work = rng.uniform(0, 0.09, 2000)
    beat, times, missed = begins(clock, work)
    cycles = np.arange(len(times)) + np.cumsum(missed)
    assert np.abs(times - 0.05 * cycles).max() <= 0.025 + 1e-9
    assert beat.late > 100
    assert beat.missed == sum(missed)


def runs():
    return [
        Run([[0, 5], [1, 5]], [[-1], [0]], "a"),
        Run([[-2, 5], [0, 6]], [[1], [0]], "b"),
    ]


def test_ranges_are_those_of_all_runs():
    ranges = Ranges.of(runs())
    assert ranges.s.tolist() == [[-2, 5], [1, 6]]
    assert ranges.u.tolist() == [[-1], [1]]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Ranges.of([]), "no runs"),
        (lambda: Ranges([[1], [0]], [[0], [1]]), "range of s has a lowest value above"),
        (lambda: Ranges([[0], [1]], [0, 1]), r"range of u is \[2, D_u\]"),
        (
            lambda: RangeWatch(Ranges.of(runs()), ["one"]),
            "2 states need as many names, or none, got 1: one",
        ),
        (lambda: RangeWatch(Ranges.of(runs()), margin=-1), "margin must be at least 0"),
        (lambda: Beat(0), "period must be above 0"),
    ],
)
def test_what_makes_no_sense_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()


def test_each_sensor_is_warned_of_once_by_its_name_and_range():
    watch = RangeWatch(Ranges.of(runs()), ["angle [rad]", "speed [rad/s]"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert watch([1.2, 5.5]).tolist() == [False, False]  # within the margin
    with pytest.warns(match=r"angle \[rad\] is 1.4, and was between -2 and 1 in"):
        assert watch([1.4, 5.5]).tolist() == [True, False]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert watch([9.0, 5.5]).tolist() == [True, False]
    with pytest.warns(match=r"speed \[rad/s\] is 4"):
        assert watch([0.0, 4.0]).tolist() == [False, True]


def test_sensors_without_names_are_counted():
    with pytest.warns(match=r"^state 1 \(counted from 0\) is 7,"):
        RangeWatch(Ranges.of(runs()), margin=0)([0, 7])


def test_a_number_that_never_changed_is_told_and_stops_nobody():
    watch = RangeWatch(Ranges([[0, 3], [1, 3]], [[0], [1]]), ("x [m]", "load [kg]"))
    with pytest.warns(match=r"load \[kg\] is 3, and was always 3 in training"):
        assert not watch([0.5, 3.0001]).any()
    assert not watch([0.5, 4.0]).any()  # no second warning, which would be an error
    with pytest.warns(match=r"x \[m\] says nothing \(NaN\)"):
        assert watch([np.nan, 3]).tolist() == [True, False]
