"""The live lab on a machine that has too much to do: controls answer all the same, and nothing queues."""

import os
import subprocess
import sys
from ast import literal_eval

import numpy as np
import pytest
from browser_lab import slider

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


def steps_until_shown(notebook, presses):
    """Steps of the panel from each press of a key on a slider to the frame that shows its effect."""
    notebook.evaluate(
        "None",
        "shown = []\n"
        "def _note(_, content, __):\n"
        "    if content['do'] == 'drawn' and panel.history:\n"
        "        shown.append((panel.steps, float(panel.history[-1].command[0])))\n"
        "panel.on_msg(_note)",
    )
    hand, waits = slider(notebook.page, "shoulder"), []
    hand.press("ArrowLeft")  # takes over: the command now is the slider's
    for _ in range(presses):
        notebook.page.wait_for_timeout(700)
        before, step = literal_eval(notebook.evaluate("(shown[-1][1], panel.steps)"))
        hand.press("ArrowLeft")
        notebook.until(f"shown[-1][1] != {before}")
        later = notebook.evaluate(f"next(at for at, command in shown if at >= {step} and command != {before})")
        waits.append(int(later) - step)
    return waits


def test_controls_answer_and_nothing_queues_while_all_cores_are_busy(open_notebook, busy):
    notebook = open_notebook("14_live_lab.ipynb")
    notebook.start_panel()
    notebook.page.get_by_role("button", name="estimate p online").click()
    notebook.until("panel.session.estimating")
    waits = steps_until_shown(notebook, 10)
    assert np.median(waits) <= MOST, waits

    hand = slider(notebook.page, "shoulder")
    for _ in range(BURST):
        hand.press("ArrowRight")
    asked = float(hand.input_value())
    begun = int(notebook.evaluate("panel.steps"))
    notebook.until(f"abs(panel.session.hand[0] - {asked}) < 0.05 or panel.steps > {begun} + {MOST}")
    assert notebook.evaluate(f"bool(abs(panel.session.hand[0] - {asked}) < 0.05)") == "True"
    assert int(notebook.evaluate("panel.frame['number'] - panel.drawn")) <= 1  # a frame waits for the one before
    notebook.evaluate("panel.check()")
