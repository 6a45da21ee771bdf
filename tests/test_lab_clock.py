"""Time in the kernel's event loop."""

import asyncio
import time
from threading import get_ident

import pytest

from clothlab.lab.clock import RECENT, Clock, Turns


def test_ticks_keep_the_period_and_lost_time_is_not_made_up_for():
    async def main():
        ticks = []
        clock = Clock(lambda behind: ticks.append(behind) or True, 0.05)
        clock.start()
        clock.start()  # twice is once
        await asyncio.sleep(0.52)
        clock.pause()
        assert not clock.running
        number = len(ticks)
        await asyncio.sleep(0.2)
        assert len(ticks) == number
        return number, clock.late

    number, late = asyncio.run(main())
    assert 6 <= number <= 11
    assert late <= 2


def test_who_was_late_is_so_for_a_few_ticks():
    async def main():
        said = []

        def tick(behind):
            said.append(clock.lately)
            if len(said) == 2:
                time.sleep(0.09)  # the next one comes late
            return len(said) < 3 + RECENT

        clock = Clock(tick, 0.05)
        clock.start()
        await asyncio.sleep(0.05 * (5 + RECENT))
        return said

    said = asyncio.run(main())
    assert said[:2] == [False, False]
    assert all(said[2 : 2 + RECENT])
    assert not said[-1]


def test_a_tick_that_says_no_is_the_last():
    async def main():
        clock = Clock(lambda behind: False, 0.01)
        clock.start()
        await asyncio.sleep(0.05)
        return clock.running

    assert not asyncio.run(main())


def test_without_an_event_loop_time_cannot_go_by():
    with pytest.raises(RuntimeError, match="no running event loop"):
        Clock(lambda behind: True, 0.1).start()


def test_callbacks_of_other_threads_wait_for_their_turn():
    async def main():
        turns, threads = Turns(), []
        turns.take(lambda: threads.append(get_ident()))
        assert len(threads) == 1  # at once
        await asyncio.to_thread(turns.take, lambda: threads.append(get_ident()))
        await asyncio.sleep(0.05)
        return threads

    assert asyncio.run(main()) == [get_ident()] * 2


def test_outside_a_notebook_callbacks_act_at_once():
    done = []
    Turns().take(done.append, 1)
    assert done == [1]
