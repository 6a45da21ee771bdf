"""The live lab on a machine that has too much to do: controls answer all the same, and nothing queues."""

import os
import subprocess
import sys

import numpy as np
import pytest
from browser_lab import answers, slider

pytestmark = pytest.mark.browser
MOST = 4  # steps of the panel between a control and the frame that shows its effect
BURST = 30  # presses in a row, as fast as they come


@pytest.fixture
def busy():
    """As many endless loops as there are cores."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


def test_controls_answer_and_nothing_queues_while_all_cores_are_busy(open_notebook, busy):
    notebook = open_notebook("14_live_lab.ipynb")
    notebook.start_panel()
    notebook.page.get_by_role("button", name="estimate p online").click()
    notebook.until("panel.session.estimating")
    waits = answers(notebook, 5)
    seconds, steps = np.moveaxis(waits, -1, 0)
    print(
        f"from a control to its effect, all cores busy: median {np.median(seconds):.1f} s, {np.median(steps):.0f} steps"
    )
    assert (np.median(steps, axis=1) <= MOST).all(), waits.tolist()

    hand = slider(notebook.page, "shoulder")
    for _ in range(BURST):
        hand.press("ArrowRight")
    asked = float(hand.input_value())
    begun = int(notebook.evaluate("panel.steps"))
    notebook.until(f"abs(panel.session.hand[0] - {asked}) < 0.05 or panel.steps > {begun} + {MOST}")
    assert notebook.evaluate(f"bool(abs(panel.session.hand[0] - {asked}) < 0.05)") == "True"
    assert int(notebook.evaluate("panel.frame['number'] - panel.drawn")) <= 1  # a frame waits for the one before
    notebook.evaluate("panel.check()")
