"""Notebook 12 in JupyterLab in a real browser, as a student would use it."""

import json
import time

import pytest

from clothlab.artifacts import DATA, OWN_TRIALS
from clothlab.trials import load_trial

pytestmark = pytest.mark.browser


@pytest.fixture
def notebook(open_notebook):
    notebook = open_notebook("12_live_lab.ipynb")
    started = time.monotonic()
    notebook.run_all()
    notebook.page.wait_for_selector("[data-frame]", timeout=60_000)
    notebook.connect()
    notebook.until("panel.steps > 3", 60)
    print(f"from run all to a moving robot: {time.monotonic() - started:.1f} s")
    yield notebook
    notebook.evaluate("panel.close()")
    assert notebook.errors == []
    assert "Traceback" not in notebook.lab.log.read_text()


def frame(page) -> int:
    return page.eval_on_selector("[data-frame]", "element => +element.dataset.frame")


def test_a_session_in_the_live_lab(notebook):
    page = notebook.page
    before = frame(page)
    page.wait_for_function(f"+document.querySelector('[data-frame]').dataset.frame > {before + 3}")
    notebook.screenshot("1-running")

    believed = notebook.evaluate("panel.verdict.value")
    canvas = page.locator(".clothlab-target")
    canvas.hover(position={"x": 60, "y": 60})
    page.mouse.down()
    canvas.hover(position={"x": 200, "y": 140})
    page.mouse.up()
    notebook.until(f"panel.verdict.value != {believed}")
    notebook.screenshot("2-drawn")

    p = notebook.evaluate("panel.session.p.tolist()")
    page.locator(".clothlab-map").click(position={"x": 110, "y": 120})
    notebook.until(f"panel.session.p.tolist() != {p}")
    p = notebook.evaluate("panel.session.p.tolist()")
    page.locator(".clothlab-map").press("ArrowLeft")
    notebook.until(f"panel.session.p.tolist() != {p}")
    notebook.screenshot("3-another-p")

    damping = notebook.evaluate("panel.session.env.cloth.damping")
    page.locator(".widget-slider", has_text="C_damp").locator(".noUi-handle").press("ArrowRight")
    notebook.until(f"panel.session.env.cloth.damping > {damping}")
    notebook.screenshot("4-more-drag")

    page.locator(".widget-dropdown", has_text="arm").locator("select").select_option("muscle")
    notebook.until("panel.session.arm.name == 'muscle' and len(panel._history) > 3", 30)
    page.locator(".widget-checkbox", has_text="fix the stiffness").locator("input").check()
    notebook.until("panel._history[-1].command[2] == panel.tension.value")
    page.locator(".widget-slider", has_text="f_const").first.locator(".noUi-handle").press("ArrowRight")
    notebook.until("panel._history[-1].command[2] == panel.tension.value == 35")
    notebook.screenshot("5-stiff")

    name = f"browser-test-{time.time_ns()}"
    path = DATA / OWN_TRIALS / f"{name}.npz"
    try:
        page.locator("button", has_text="record").click()
        page.wait_for_timeout(3000)
        page.locator(".widget-text input").fill(name)
        page.locator(".widget-text input").press("Tab")
        page.locator("button", has_text="save").last.click()
        notebook.until("'saved as' in panel.message.value")
        assert 10 <= len(load_trial(path)) <= 25
    finally:
        path.unlink(missing_ok=True)
    notebook.screenshot("6-saved")

    page.locator("button", has_text="pause").click()
    notebook.until("not panel.running")
    steps = notebook.evaluate("panel.steps")
    page.wait_for_timeout(1500)
    assert notebook.evaluate("panel.steps") == steps
    notebook.evaluate("panel.check()")
    notebook.screenshot("7-paused")


def test_a_broken_callback_fails_loudly(notebook):
    notebook.evaluate(
        "None", "def broken(*a, **k):\n    raise ZeroDivisionError('on purpose')\npanel.session.set_p = broken"
    )
    notebook.page.locator(".clothlab-map").click(position={"x": 90, "y": 100})
    notebook.until("len(panel.errors) == 1")
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        notebook.evaluate("panel.check()")
    steps = json.loads(notebook.evaluate("panel.steps"))
    notebook.until(f"panel.steps > {steps}")  # the panel lives on
