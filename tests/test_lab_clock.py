"""Time in the kernel's event loop, on a clock that jumps from one event to the next."""

import asyncio
from threading import get_ident

import pytest

from clothlab.lab.widget import _RECENT, Clock, LoopCallbacks


class JumpingLoop(asyncio.SelectorEventLoop):
    """Nothing waits: when there is nothing to do, it is at once as late as the next
    event is due.
    """

    now = 0.0

    def time(self):
        return self.now

    def _run_once(self):
        if not self._ready and self._scheduled:
            self.now = max(self.now, self._scheduled[0]._when)
        super()._run_once()


def ran(main):
    with asyncio.Runner(loop_factory=JumpingLoop) as runner:
        return runner.run(main())


def test_ticks_keep_the_period():
    async def main():
        ticks = []
        clock = Clock(lambda behind: ticks.append(behind) or True, 0.05)
        clock.start()
        clock.start()  # twice is once
        await asyncio.sleep(0.52)
        clock.pause()
        assert not clock.running
        await asyncio.sleep(0.2)
        return ticks, clock.late

    ticks, late = ran(main)
    assert ticks == pytest.approx([0] * 11, abs=1e-9)
    assert not late


def test_a_late_tick_is_remembered_for_a_few_ticks_and_lost_time_is_not_made_up_for():
    async def main():
        lately, loop = [], asyncio.get_running_loop()

        def tick(behind):
            lately.append(clock.late)
            if len(lately) == 2:
                loop.now += 1.0  # this tick took 20 periods
            return len(lately) < 5 + _RECENT

        clock = Clock(tick, 0.05)
        clock.start()
        await asyncio.sleep(3)
        return lately

    lately = ran(main)
    assert lately[:2] == [False, False]
    assert all(lately[2 : 2 + _RECENT])
    assert not lately[-1]


def test_callbacks_of_other_threads_wait_for_the_loop():
    async def main():
        callbacks, threads = LoopCallbacks(), []
        callbacks.call(lambda: threads.append(get_ident()))
        assert len(threads) == 1  # at once
        await asyncio.to_thread(callbacks.call, lambda: threads.append(get_ident()))
        await asyncio.sleep(0.05)
        return threads

    assert asyncio.run(main()) == [get_ident()] * 2
