"""Notebook 12 in JupyterLab in a real browser, as a student would use it."""

import json
import time

import cv2
import numpy as np
import pytest
from browser_lab import frame, slider

from clothlab.artifacts import DATA, OWN_TRIALS
from clothlab.trials import load_trial

pytestmark = pytest.mark.browser

GAMEPAD = """
navigator.getGamepads = () => [window.pad ?? null];
window.movePad = (axes, trigger) => {
  const buttons = Array.from({ length: 17 }, (_, k) => ({ value: k == 7 ? trigger : 0, pressed: false }));
  const about = { index: 0, id: "pad", mapping: "standard", connected: true };
  window.pad = { ...about, timestamp: performance.now(), axes, buttons };
};
"""


@pytest.fixture
def notebook(open_notebook, page):
    page.add_init_script(GAMEPAD)
    notebook = open_notebook("12_live_lab.ipynb")
    print(f"from run all to a moving robot: {notebook.start_panel():.1f} s")
    yield notebook
    notebook.evaluate("panel.close()")


@pytest.fixture
def recording():
    """A name for a recording, which is gone afterwards."""
    name = f"browser-test-{time.time_ns()}"
    yield name
    (DATA / OWN_TRIALS / f"{name}.npz").unlink(missing_ok=True)


def button(page, name):
    return page.locator("button.widget-button, button.widget-toggle-button", has_text=name).first


def choose(page, menu, option):
    page.locator(".widget-dropdown", has_text=menu).locator("select").select_option(option)


def draw(page, start, end):
    canvas = page.locator(".clothlab-target")
    canvas.hover(position={"x": start[0], "y": start[1]})
    page.mouse.down()
    canvas.hover(position={"x": end[0], "y": end[1]})
    page.mouse.up()


def test_a_session_in_the_live_lab(notebook, page, screenshot, recording):
    before, clock = frame(page), page.locator("[data-frame] figcaption").first.text_content()
    page.wait_for_function(f"+document.querySelector('[data-frame]').dataset.frame > {before + 3}")
    assert page.locator("[data-frame] figcaption").first.text_content() != clock
    screenshot("1-running")

    believed = notebook.evaluate("hash(panel.understood.value)")
    draw(page, (60, 60), (200, 140))
    notebook.until(f"hash(panel.understood.value) != {believed}")
    notebook.until("'no such cloth' in panel.verdict.value")
    screenshot("2-drawn")
    drawn = notebook.evaluate("panel.canvas.mask.sum()")
    for key in ("ArrowUp", "ArrowUp", " "):
        page.locator(".clothlab-target").press(key)
    notebook.until(f"panel.canvas.mask.sum() != {drawn}")

    page.get_by_role("button", name="target: recorded 2").click()
    notebook.until("(panel.session.target == panel.session.gallery['recorded 2']).all()")

    p = notebook.evaluate("panel.session.p.tolist()")
    page.locator(".clothlab-map").click(position={"x": 110, "y": 120})
    notebook.until(f"panel.session.p.tolist() != {p}")
    p = notebook.evaluate("panel.session.p.tolist()")
    page.locator(".clothlab-map").press("ArrowLeft")
    notebook.until(f"panel.session.p.tolist() != {p}")
    screenshot("3-another-p")

    damping = notebook.evaluate("panel.session.env.cloth.damping")
    slider(page, "C_damp").press("ArrowRight")
    notebook.until(f"panel.session.env.cloth.damping > {damping}")
    screenshot("4-more-drag")

    choose(page, "arm", "muscle")
    notebook.until("panel.session.arm.name == 'muscle' and len(panel._history) > 3", 30)
    page.locator(".widget-checkbox", has_text="fix the stiffness").locator("input").check()
    notebook.until("panel._history[-1].command[2] == panel.tension.value")
    slider(page, "f_const").press("ArrowRight")
    notebook.until("panel._history[-1].command[2] == panel.tension.value == 35")
    screenshot("5-stiff")

    button(page, "record").click()
    page.wait_for_timeout(3000)
    page.locator(".widget-text input").fill(recording)
    page.locator(".widget-text input").press("Tab")
    button(page, "save").click()
    notebook.until("'saved as' in panel.message.value")
    assert 10 <= len(load_trial(DATA / OWN_TRIALS / f"{recording}.npz")) <= 25
    button(page, "record").click()
    button(page, "save").click()
    notebook.until("'exists' in panel.message.value")
    button(page, "discard").click()
    screenshot("6-saved")

    button(page, "pause").click()
    notebook.until("not panel.running")
    steps = notebook.evaluate("panel.steps")
    page.wait_for_timeout(1500)
    assert notebook.evaluate("panel.steps") == steps
    notebook.evaluate("panel.check()")
    screenshot("7-paused")


def test_a_hand_on_sliders_and_on_a_gamepad(notebook, page, screenshot):
    assert notebook.evaluate("panel.session.driver") == "'control'"
    slider(page, "shoulder").press("ArrowRight")
    notebook.until("panel.session.driver == 'hand' and panel._history[-1].command[0] > 0.4")
    choose(page, "driven by", "control")
    page.evaluate("movePad([0, 0, 0, 0], 0)")
    notebook.until("'left stick' in panel.message.value")
    page.wait_for_timeout(1000)
    assert notebook.evaluate("panel.session.driver") == "'control'"
    page.evaluate("movePad([0, -1, 0, 1], 0)")
    notebook.until("panel.session.driver == 'hand'")
    notebook.until("(panel._history[-1].command == [panel.session.arm.lower[0], panel.session.arm.upper[1]]).all()")
    screenshot("8-gamepad")
    notebook.evaluate("panel.check()")


def test_mistakes_are_messages_and_the_panel_lives_on(notebook, page, screenshot, tmp_path):
    def says(text):
        notebook.until(f"{text!r} in panel.message.value")
        page.locator(".widget-label", has_text=text).first.wait_for()

    def upload(path):
        with page.expect_file_chooser() as chooser:
            page.locator("button", has_text="from a file").click()
        chooser.value.set_files(path)

    button(page, "clear").click()
    says("draw a target")
    button(page, "eraser").click()
    draw(page, (60, 60), (200, 140))
    says("no cloth in the image")
    screenshot("9-empty-drawing")
    (tmp_path / "text.png").write_text("no picture")
    upload(tmp_path / "text.png")
    says("not a picture")
    cv2.imwrite(str(tmp_path / "small.png"), np.full((10, 10), 255, np.uint8))
    upload(tmp_path / "small.png")
    says("this picture 10×10")
    button(page, "record").click()
    page.locator(".widget-text input").fill("../escape")
    page.locator(".widget-text input").press("Tab")
    button(page, "save").click()
    says("letters, digits")
    button(page, "discard").click()
    notebook.evaluate(
        "None",
        "from pathlib import Path\nfrom clothlab import artifacts\n"
        "artifacts.load_dpmpb.__kwdefaults__['data'] = Path('nowhere')",
    )
    choose(page, "arm", "muscle")
    says("make data train")
    screenshot("10-missing-weights")
    steps = json.loads(notebook.evaluate("panel.steps"))
    notebook.until(f"panel.steps > {steps} and panel.session.arm.name == 'torque'")
    notebook.evaluate("panel.check()")


def test_nothing_is_left_behind(notebook, page):
    notebook.evaluate("None", "first, panel = panel, None")
    notebook.run_all()
    notebook.until("panel is not None and panel.steps > 3", 60)
    assert notebook.evaluate("first.running, first.box.comm is None") == "(False, True)"
    page.goto("about:blank")  # as closing the tab
    notebook.until("not panel.running", 30)
    assert notebook.evaluate("'does not answer' in panel.message.value") == "True"


def test_a_broken_callback_fails_loudly(notebook, page):
    notebook.evaluate(
        "None", "def broken(*a, **k):\n    raise ZeroDivisionError('on purpose')\npanel.session.set_p = broken"
    )
    page.locator(".clothlab-map").click(position={"x": 90, "y": 100})
    notebook.until("len(panel.errors) == 1")
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        notebook.evaluate("panel.check()")
    steps = json.loads(notebook.evaluate("panel.steps"))
    notebook.until(f"panel.steps > {steps}")  # the panel lives on
