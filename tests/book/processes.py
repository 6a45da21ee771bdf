"""The processes of the browser that this one started: their memory, and a brake."""

import os
import signal
import time
from contextlib import contextmanager, suppress

import psutil
from sampling import sampling

# [s], in which a braked process runs and stands still once: its threads need some of it
# to wake, so that shorter turns brake by more than they say.
TURN = 0.05
LOOKS = 0.5  # [s] between two looks for new processes


def browser():
    """All processes of the browser."""
    children = psutil.Process().children(recursive=True)
    return [each for each in children if "chrom" in each.name()]


def page_memory():
    """What the process of the largest page takes [MB].

    Of what several share, such as the browser's program, a part.
    """
    pages = [each for each in browser() if "--type=renderer" in each.cmdline()]
    return max(each.memory_full_info().pss for each in pages) / 1e6


@contextmanager
def slower(times):
    """Let the browser run a share of the time only, again and again.

    Its own throttling leaves workers alone.
    """
    found = []
    looked = -LOOKS

    def tell(what):
        for each in found:
            with suppress(ProcessLookupError):
                os.kill(each.pid, what)

    def turn():
        nonlocal found, looked
        if time.monotonic() - looked >= LOOKS:
            found = browser()
            looked = time.monotonic()
        tell(signal.SIGSTOP)
        time.sleep(TURN * (1 - 1 / times))
        tell(signal.SIGCONT)

    with sampling(turn, TURN / times):
        yield
