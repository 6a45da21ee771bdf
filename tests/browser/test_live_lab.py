"""The live lab in JupyterLab, as a student would use it: one panel, with pointer, keys
and a gamepad, from the start to a saved recording.
"""

import re

import pytest
from playwright.sync_api import expect

from clothlab.trials import load_trial
from studies.motion import replay

pytestmark = pytest.mark.browser

CODE = """
from pathlib import Path
from clothlab.lab import LivePanel, LiveSession

panel = LivePanel(LiveSession(recordings=Path("mine")))
panel.start()
panel
"""
GAMEPAD = """
navigator.getGamepads = () => [window.pad ?? null];
window.movePad = (axes, trigger) => {
  const buttons = Array.from({ length: 17 }, (_, k) => ({ value: k == 7 ? trigger : 0, pressed: false }));
  const about = { index: 0, id: "pad", mapping: "standard", connected: true };
  window.pad = { ...about, timestamp: performance.now(), axes, buttons };
};
"""


class Student:
    """Somebody at the panel."""

    def __init__(self, notebook, page):
        self.notebook = notebook
        self.page = page
        self.panel = page.locator(".clothlab")

    def press(self, name):
        self.panel.get_by_role("button", name=name, exact=True).click()

    def choose(self, menu, option):
        self.panel.get_by_role("combobox", name=menu).select_option(option)

    def slider(self, name):
        return self.panel.get_by_role("slider", name=name).first

    def canvas(self, name):
        return self.panel.get_by_role("application", name=re.compile(f"^{name}"))

    def draw(self, *places):
        """A stroke on the target [pixel of the page]."""
        canvas = self.canvas("target")
        for k, (x, y) in enumerate(places):
            canvas.hover(position={"x": x, "y": y})
            if k == 0:
                self.page.mouse.down()
        self.page.mouse.up()

    def reads(self, text):
        """The panel's message says this."""
        expect(self.panel.locator(".message").first).to_contain_text(
            text, timeout=15_000
        )

    def value(self, expression):
        return self.notebook.evaluate(expression)

    def until(self, expression, seconds=30):
        self.notebook.until(expression, seconds)


@pytest.fixture(scope="module")
def student(open_notebook, page):
    page.add_init_script(GAMEPAD)
    notebook = open_notebook("live_lab.ipynb", [CODE])
    page.locator("[data-frame]").wait_for(timeout=90_000)
    page.locator(".clothlab").evaluate("element => element.scrollIntoView()")
    yield Student(notebook, page)
    notebook.evaluate("panel.check()")
    notebook.evaluate("panel.close()")


def test_time_goes_by_until_it_is_paused(student, screenshot):
    status = student.panel.locator(".status")
    student.until("sum(moment.period is not None for moment in panel.history) >= 2")
    expect(status).to_have_text(re.compile("▶ (running|late)"))
    screenshot("live-lab")
    student.press("pause")
    expect(status).to_have_text("❚❚ paused")
    steps = int(student.value("panel.steps"))
    student.press("step")
    student.until(f"panel.steps == {steps + 1}")
    student.press("start")


def test_a_target_is_drawn_with_the_pointer_and_with_keys(student):
    verdict = student.panel.get_by_text("The autoencoder does not reproduce it.")
    student.press("clear")
    student.draw((60, 60), (200, 140))
    expect(verdict).to_be_visible(timeout=15_000)
    drawn = student.value("int(panel.session.target.sum())")
    for key in ("ArrowUp", "ArrowUp", " "):
        student.canvas("target").press(key)
    student.until(f"panel.session.target.sum() != {drawn}")

    # One of the gallery, and a mistake
    student.press("target: recorded 2")
    student.until("(panel.session.target == panel.session.gallery['recorded 2']).all()")
    expect(verdict).to_be_hidden()
    student.press("clear")
    student.press("eraser")
    student.draw((60, 60), (200, 140))
    student.reads("no cloth in the image")
    student.press("eraser")


def test_p_is_set_by_a_click_and_estimated(student):
    p = student.value("panel.session.p.tolist()")
    student.canvas("map of the parametric bias").click(position={"x": 110, "y": 120})
    student.until(f"panel.session.p.tolist() != {p}")
    student.slider("C_damp").press("ArrowRight")
    student.until("panel.session.env.cloth.label == '(0.055, 0.10)'")
    p = student.value("panel.session.p.tolist()")
    student.press("estimate p online")
    student.until(f"panel.session.estimating and panel.session.p.tolist() != {p}")
    student.press("estimate p online")


def test_a_person_drives_with_sliders_and_with_a_gamepad(student, page):
    student.slider("shoulder").press("ArrowRight")
    student.until("panel.session.driver == 'manual'")
    for _ in range(10):  # faster than the answers come back
        for name in ("shoulder", "elbow"):
            student.slider(name).press("ArrowLeft")
    asked = [float(student.slider(k).input_value()) for k in ("shoulder", "elbow")]
    student.until(f"abs(panel.session.hand - {asked}).max() < 1e-6")
    student.choose("driven by", "control")
    student.until("panel.session.driver == 'control'")
    page.evaluate("movePad([0, 0, 0, 0], 0)")
    student.reads("left stick")
    page.evaluate("movePad([0, -1, 0, 1], 0)")
    student.until("panel.session.driver == 'manual'")


def test_an_arm_with_muscles_is_stiffened_and_recorded(student, lab, screenshot):
    student.choose("arm", "muscle")
    student.until("panel.session.arm.name == 'muscle' and len(panel.history) > 3", 60)
    student.panel.get_by_role("checkbox", name="fix the stiffness").check()
    expect(student.slider("f_const")).to_be_enabled(timeout=15_000)
    student.slider("f_const").press("End")
    student.until("panel.history[-1].command[2] == panel.session.tension == 70")
    expect(student.panel.locator("img.ellipse")).to_be_visible()

    # A recording is made, and can be replayed
    student.press("record")
    student.reads("recording, from the hanging cloth")
    expect(student.panel.locator(".status")).to_contain_text("● recording")
    student.until("len(panel.history) >= 5")
    student.panel.get_by_role("textbox", name="name of the recording").fill("swing")
    student.press("save")
    student.reads("saved as swing")
    screenshot("live-lab-muscle")
    trial = load_trial(lab.folder / "mine" / "swing.npz")
    assert len(trial) >= 5
    replay(trial)


def test_a_projector_shows_the_panel_alone(student, page, screenshot):
    expect(page.get_by_text("run the cells again")).to_be_hidden()
    page.set_viewport_size({"width": 1280, "height": 720})
    student.press("projector")
    expect(student.panel).to_have_class(re.compile("projector"))
    box = student.panel.bounding_box()
    assert (box["x"], box["y"], box["width"], box["height"]) == (0, 0, 1280, 720)
    student.press("hand")
    screenshot("live-lab-projector")
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    expect(student.panel.locator("h3", has_text="Target")).to_be_visible()


def test_a_closed_page_pauses_the_panel(student, page):
    page.goto("about:blank")
    student.until("not panel.running")
