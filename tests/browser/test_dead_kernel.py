"""A kernel that is gone is seen: each widget says so within two seconds, and what would
only pretend to work is off.

Three ends: it is restarted from the menu, it dies, it is shut down. And the notebook is
saved and opened again.
"""

import json
import os
import re
import signal
import time

import pytest
from browser_lab import Notebook
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

IMPORTS = """
from matplotlib.figure import Figure
from clothlab import data
from clothlab.lab import Control, LivePanel, LiveSession, PBMap, RecordedRun

def draw(p, k=1):
    figure = Figure()
    figure.subplots().plot(p)
    return figure

biases = data.load("torque-0").biases
"""
WIDGETS = {
    "Control": "control = Control(draw, p=PBMap(biases, {}, p=biases['damp0.05-mass0.10']), k=(1, 3, 1))\ncontrol",
    "PBMap": "PBMap(biases, {}, p=biases['damp0.05-mass0.10'])",
    "RecordedRun": "RecordedRun(20)",
    "LivePanel": "panel = LivePanel(LiveSession())\npanel.start()\npanel",
}
GONE = re.compile("run the cells again")
PARTS = "button, input, select, canvas, [role=slider], [role=application]"
WITHIN = 2.0  # [s] from the end of the kernel to the words, as the page is asked


@pytest.fixture(scope="module")
def left():
    """Notebooks that a test has left with a living kernel and all widgets."""
    return []


@pytest.fixture
def notebook(lab, browser, request, left):
    """A notebook with one of each widget, all of them shown, and its kernel.

    It is the one that the test before has left alive, or else a fresh one.
    """
    notebook = left.pop() if left else fresh(lab, browser, request.node.name)
    notebook.connect()
    page = notebook.page
    expect(page.locator(".clothlab-alive")).to_have_count(len(WIDGETS))
    expect(page.get_by_text(GONE).locator("visible=true")).to_have_count(0)
    yield notebook
    if page.get_by_text(GONE).locator("visible=true").count() == 0:
        left.append(notebook)
        return
    page.context.close()
    if lab.kernel(notebook.name):
        lab.stop_kernel(notebook.name)


def fresh(lab, browser, test):
    """A notebook of a test that was run in a window of its own."""
    name = f"{test.replace('[', '-').strip(']')}.ipynb"
    lab.add(name, [IMPORTS, *WIDGETS.values()])
    page = browser.new_context(viewport={"width": 1400, "height": 2600}).new_page()
    notebook = Notebook(lab, page, name)
    run(notebook)
    return notebook


def run(notebook):
    """Run all, and wait until the robot moves."""
    notebook.run_all()
    notebook.page.wait_for_function(
        "document.querySelector('[data-frame]')?.textContent.match(/step [1-9]/)",
        timeout=90_000,
    )


def outputs(page):
    return [
        page.locator(".jp-CodeCell").nth(k + 1).locator(".jp-Cell-outputWrapper")
        for k in range(len(WIDGETS))
    ]


def expect_all_gone(page, since):
    """Within the time, each widget says it, and nothing in it can be used."""
    for name, output in zip(WIDGETS, outputs(page), strict=True):
        left = max(0.001, since + WITHIN - time.monotonic())
        expect(output.get_by_text(GONE).locator("visible=true"), name).to_have_count(
            1, timeout=1000 * left
        )
    print(f"all of them after {time.monotonic() - since:.2f} s at most")
    for name, output in zip(WIDGETS, outputs(page), strict=True):
        usable = output.locator(PARTS).evaluate_all(
            "parts => parts.filter(e => !e.closest('[inert]')).length"
        )
        assert usable == 0, name
    expect(page.locator(".clothlab .status")).to_have_text("✗ no kernel")


def kernel_process(notebook):
    return int(
        notebook.evaluate("None", "import os") and notebook.evaluate("os.getpid()")
    )


def test_a_kernel_that_lives_is_not_called_dead(notebook):
    """Neither while a cell computes, nor by a server that would stop an idle kernel."""
    page = notebook.page
    notebook.client.execute(
        "import time\nend = time.time() + 5\nwhile time.time() < end: pass"
    )
    page.wait_for_timeout(4000)
    expect(page.get_by_text(GONE).locator("visible=true")).to_have_count(0)
    notebook.evaluate("None", "panel.pause()")
    page.wait_for_timeout(1500)
    before = notebook.lab.kernel(notebook.name)["last_activity"]
    page.wait_for_timeout(5000)
    assert notebook.lab.kernel(notebook.name)["last_activity"] == before
    expect(page.locator(".clothlab .status")).to_have_text("❚❚ paused")


def test_a_restart_from_the_menu_is_seen(notebook):
    page = notebook.page
    page.locator(".lm-MenuBar-itemLabel", has_text=re.compile("^Kernel$")).click()
    page.locator(".lm-Menu-itemLabel", has_text=re.compile("^Restart Kernel…$")).click()
    page.get_by_role("button", name="Confirm Kernel Restart").click()
    expect_all_gone(page, time.monotonic())
    # The new kernel is idle now, and knows none of these widgets
    page.wait_for_timeout(4000)
    expect(page.locator(".clothlab .status")).to_have_text("✗ no kernel")


def test_a_shutdown_is_seen_and_below_each_widget_of_the_notebook_opened_again(
    notebook, screenshot_of
):
    page, lab = notebook.page, notebook.lab
    page.keyboard.press("Control+s")
    path = lab.folder / "notebooks" / notebook.name
    end = time.monotonic() + 20
    while "clothlab-reopened" not in path.read_text():
        assert time.monotonic() < end, "it is not saved"
        page.wait_for_timeout(200)
    lab.stop_kernel(notebook.name)
    expect_all_gone(page, time.monotonic())
    page.goto("about:blank")
    again = Notebook(lab, page, notebook.name)
    for name, output in zip(WIDGETS, outputs(page), strict=True):
        if (
            name != "PBMap"
        ):  # it is shown within a Control, and has no picture of its own
            expect(output.get_by_text(GONE), name).to_be_visible(timeout=15_000)
    screenshot_of(page, "opened-again")
    saved = json.loads(path.read_text())
    assert (
        sum(
            "clothlab-reopened" in json.dumps(cell.get("outputs", []))
            for cell in saved["cells"]
        )
        == 3
    )
    run(again)
    expect(page.get_by_text(GONE).locator("visible=true")).to_have_count(0)


def test_a_death_is_seen(notebook):
    process = kernel_process(notebook)
    os.kill(process, signal.SIGKILL)
    expect_all_gone(notebook.page, time.monotonic())
