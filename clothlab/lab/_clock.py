"""Time in the kernel's event loop, and callbacks that wait for their turn in it."""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable

_RECENT = 5  # ticks
_PAUSE = 0.005  # [s] at least between two ticks, in which callbacks act


class LoopCallbacks:
    """Lets callbacks act in the thread that made this, between two steps.

    JupyterLab calls the handlers of widgets in a thread of their own, in the middle of
    whatever the kernel does.
    """

    def __init__(self) -> None:
        self._thread = threading.get_ident()
        self._loop: asyncio.AbstractEventLoop | None = None
        # Outside a notebook there is no loop, and no other thread calls us
        with contextlib.suppress(RuntimeError):
            self._loop = asyncio.get_running_loop()

    def take(self, act: Callable, *arguments: object) -> None:
        """Call `act` now, or from another thread as soon as the kernel is free."""
        if self._loop is None or threading.get_ident() == self._thread:
            act(*arguments)
        else:
            self._loop.call_soon_threadsafe(act, *arguments)


class Clock:
    """Calls `tick` once a `period` [s], in the event loop, until it answers False.

    `tick` is told how late it comes [s].
    """

    def __init__(self, tick: Callable[[float], bool], period: float):
        self._tick = tick
        self._period = period
        self._task: asyncio.Task | None = None
        self.late = 0  # ticks that came more than half a period late
        self._recent = deque[bool](maxlen=_RECENT)

    @property
    def lately(self) -> bool:
        """Whether one of the last few ticks came more than half a period late."""
        return any(self._recent)

    @property
    def running(self) -> bool:
        """Whether time goes by."""
        return self._task is not None and not self._task.done()

    def start(self) -> None:
        """Let time go by; twice is once."""
        if not self.running:
            self._recent.clear()
            self._task = asyncio.get_running_loop().create_task(self._run())

    def pause(self) -> None:
        """Stop time."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            # A tick, and how late it is
            behind = loop.time() - due
            late = behind > self._period / 2
            self._recent.append(late)
            self.late += late
            if not self._tick(behind):
                self._task = None
                return

            # Lost time is not made up for; callbacks act meanwhile
            due = max(due + self._period, loop.time() - 2 * self._period)
            await asyncio.sleep(max(_PAUSE, due - loop.time()))
