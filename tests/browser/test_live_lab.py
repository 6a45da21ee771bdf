"""Notebook 08 in JupyterLab in a real browser, as a student would use it: one page and
one panel for all checks.
"""

import json
import os
import re
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
from browser_lab import frame, slider
from playwright.sync_api import expect

from clothlab._store import OWN_TRIALS, data_folder
from clothlab.trials import load_trial
from studies.motion import replay

pytestmark = pytest.mark.browser

GAMEPAD = """
navigator.getGamepads = () => [window.pad ?? null];
window.movePad = (axes, trigger) => {
  const buttons = Array.from({ length: 17 }, (_, k) => ({ value: k == 7 ? trigger : 0, pressed: false }));
  const about = { index: 0, id: "pad", mapping: "standard", connected: true };
  window.pad = { ...about, timestamp: performance.now(), axes, buttons };
};
"""
FRESH = """
panel.session.recorder.discard()
panel.session.set_driver("control")
panel.session.exploring, panel.session.estimating = True, False
if panel.session.arm.name != "torque":
    panel.set_arm("torque")
panel.session.set_cloth("damp0.05-mass0.10")
panel.session.set_p(panel.session.trained.biases["damp0.05-mass0.10"])
panel.aim(panel.session.gallery["target-2"])
panel.reset()
panel.start()
"""
BURST = 30  # presses in a row, as fast as they come


@pytest.fixture(scope="module")
def live_lab(open_notebook, page):
    page.add_init_script(GAMEPAD)
    notebook = open_notebook("08_live_lab.ipynb")
    print(f"from run all to a moving robot: {notebook.start_panel():.1f} s")
    yield notebook
    notebook.evaluate("panel.close()")


@pytest.fixture
def notebook(live_lab, page):
    """The panel as at its start."""
    page.set_viewport_size({"width": 1500, "height": 1100})
    live_lab.evaluate("None", FRESH)
    yield live_lab
    live_lab.evaluate("panel.check()")


@pytest.fixture
def says(page):
    """The panel's message."""
    return lambda text: expect(
        page.locator(".clothlab .message").first
    ).to_contain_text(text, timeout=15_000)


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def choose(page, menu, option):
    page.get_by_role("combobox", name=menu).select_option(option)


def target_canvas(page):
    return page.get_by_role("application", name=re.compile("^target"))


def map_of_p(page):
    return page.get_by_role(
        "application", name=re.compile("^map of the parametric bias")
    )


def status(page):
    return page.locator(".clothlab .status")


def draw(page, start, end):
    canvas = target_canvas(page)
    canvas.hover(position={"x": start[0], "y": start[1]})
    page.mouse.down()
    canvas.hover(position={"x": end[0], "y": end[1]})
    page.mouse.up()


VERMILION = [0xD5, 0x5E, 0x00]


def count_pixels(caption, colour):
    """How many pixels of the plot under this caption have a colour, about."""
    return caption.evaluate(
        """(caption, colour) => {
          const { width, height } = caption.nextSibling;
          const { data } = caption.nextSibling.getContext("2d").getImageData(0, 0, width, height);
          let count = 0;
          for (let k = 0; k < data.length; k += 4) count += colour.every((c, j) => Math.abs(data[k + j] - c) < 9);
          return count;
        }""",
        colour,
    )


def test_time_goes_by_until_it_is_paused(notebook, page, screenshot):
    before, clock = frame(page), page.locator("[data-frame] figcaption").first
    seen = clock.text_content()
    page.wait_for_function(
        f"+document.querySelector('[data-frame]').dataset.frame > {before + 3}"
    )
    assert clock.text_content() != seen
    # Late where the machine has much to do
    expect(status(page)).to_have_text(re.compile("▶ (running|late)"))
    page.locator(".clothlab").evaluate("element => element.scrollIntoView()")
    screenshot("torque")
    button(page, "pause").click()
    expect(status(page)).to_have_text("❚❚ paused")
    steps = notebook.evaluate("panel.steps")
    button(page, "step").click()
    notebook.until(f"panel.steps == {steps} + 1")


def test_targets_and_materials_are_changed(notebook, page):
    verdict = page.get_by_text("The autoencoder does not reproduce it.")
    draw(page, (60, 60), (200, 140))
    expect(verdict).to_be_visible(timeout=15_000)
    drawn = notebook.evaluate("panel.session.target.sum()")
    for key in ("ArrowUp", "ArrowUp", " "):
        target_canvas(page).press(key)
    notebook.until(f"panel.session.target.sum() != {drawn}")
    button(page, "target: recorded 2").click()
    notebook.until(
        "(panel.session.target == panel.session.gallery['recorded 2']).all()"
    )
    expect(verdict).to_be_hidden()

    p = notebook.evaluate("panel.session.p.tolist()")
    map_of_p(page).click(position={"x": 110, "y": 120})
    notebook.until(f"panel.session.p.tolist() != {p}")
    p = notebook.evaluate("panel.session.p.tolist()")
    map_of_p(page).press("ArrowLeft")
    notebook.until(f"panel.session.p.tolist() != {p}")
    button(page, "estimate p online").click()
    notebook.until("panel.session.estimating")

    damping = notebook.evaluate("panel.session.env.cloth.damping")
    slider(page, "C_damp").press("ArrowRight")
    notebook.until(f"panel.session.env.cloth.damping > {damping}")
    expect(page.get_by_role("combobox", name="cloth", exact=True)).to_have_value("")
    own = page.get_by_role("combobox", name="cloth", exact=True).locator("option").first
    expect(own).to_have_text("own: (0.055, 0.10)")


def test_a_muscle_arm_is_stiffened_and_recorded(notebook, page, screenshot, says):
    choose(page, "arm", "muscle")
    notebook.until("panel.session.arm.name == 'muscle' and len(panel.history) > 3", 30)
    page.get_by_role("checkbox", name="fix the stiffness").check()
    notebook.until("panel.history[-1].command[2] == panel.session.tension")
    fixed = notebook.evaluate("panel.session.tension")
    slider(page, "f_const").press("ArrowRight")
    notebook.until(
        f"panel.history[-1].command[2] == panel.session.tension == {fixed} + 5"
    )
    expect(
        page.get_by_role("slider", name="f_const").last
    ).to_be_disabled()  # the hand's

    recording = f"browser-test-{time.time_ns()}"
    path = data_folder() / OWN_TRIALS / f"{recording}.npz"
    button(page, "record").click()
    says("recording, from the hanging cloth")
    expect(status(page)).to_contain_text("● recording")
    notebook.until("len(panel.history) >= 5")
    page.get_by_role("textbox", name="name of the recording").fill(recording)
    button(page, "save").click()
    says(f"saved as {recording}")
    try:
        trial = load_trial(path)
        assert len(trial) >= 5
        replay(trial)
        button(page, "record").click()
        notebook.until("len(panel.history) >= 1")
        button(page, "save").click()
        says("exists")
    finally:
        path.unlink()
    button(page, "discard").click()
    says("discarded")
    page.locator(".clothlab").evaluate("element => element.scrollIntoView()")
    notebook.until("panel.drawn == panel.frame['number']")
    screenshot("muscle")


def test_a_person_drives_with_sliders_and_with_a_gamepad(notebook, page, says):
    button(page, "reset").click()
    slider(page, "shoulder").press("ArrowRight")
    notebook.until("panel.session.driver == 'manual'")
    expect(page.get_by_text("Your sliders drive.")).to_be_visible()
    # Where control had the arm
    start = json.loads(notebook.evaluate("panel.session.hand.tolist()"))
    for _ in range(10):  # faster than the answers come back
        for name in ("shoulder", "elbow"):
            slider(page, name).press("ArrowLeft")
    asked = [float(slider(page, name).input_value()) for name in ("shoulder", "elbow")]
    assert all(now < before for now, before in zip(asked, start, strict=True))
    notebook.until(f"abs(panel.session.hand - {asked}).max() < 1e-6")
    choose(page, "driven by", "control")
    expect(
        page.get_by_text("Inactive: control drives; the sliders show what it sends.")
    ).to_be_visible()
    page.evaluate("movePad([0, 0, 0, 0], 0)")
    says("left stick")
    steps = notebook.evaluate("panel.steps")
    page.evaluate("movePad([0, 0.02, 0, 0.03], 0)")  # it trembles
    notebook.until(f"panel.steps > {steps} + 3")
    assert notebook.evaluate("panel.session.driver") == "'control'"
    page.evaluate("movePad([0, -1, 0, 1], 0)")
    notebook.until("panel.session.driver == 'manual'")
    notebook.until(
        "(panel.history[-1].command == [panel.session.arm.lower[0], panel.session.arm.upper[1]]).all()"
    )
    page.evaluate("window.pad = null")


def test_iterative_learning_shows_its_prediction_beside_the_outcome(notebook, page):
    caption = page.locator("figcaption", has_text="distance to the target")
    switch = button(page, "explore new plans")
    expect(switch).to_be_disabled()
    expect(switch).to_have_attribute("title", re.compile("now control does"))
    choose(page, "driven by", "random")
    notebook.until("panel.session.driver == 'random'")
    button(page, "reset").click()  # nothing was predicted in this history
    expect(caption).not_to_contain_text("predicted")
    assert count_pixels(caption, VERMILION) == 0

    choose(page, "driven by", "iterative")
    notebook.until("sum(moment.period_ended for moment in panel.history) >= 2", 60)
    expect(caption).to_contain_text("predicted")
    assert count_pixels(caption, VERMILION) > 50
    expect(switch).to_have_attribute("aria-pressed", "true")
    switch.click()
    expect(switch).to_have_attribute("aria-pressed", "false")
    notebook.until("not panel.session.exploring")


SIZES = {"720p": (1280, 720), "1080p": (1920, 1080)}
TEXTS = """
root => {
  // Every text that can be seen: [{text, size, box, cut}], as the page or a canvas says.
  const found = [];
  function note(text, size, box, element) {
    let [left, top, right, bottom] = box;
    for (let each = element; each && root.contains(each); each = each.parentElement) {
      if (getComputedStyle(each).overflowY === "visible" && each !== root) continue;
      const clip = each.getBoundingClientRect();
      [left, top] = [Math.max(left, clip.left), Math.max(top, clip.top)];
      [right, bottom] = [Math.min(right, clip.right), Math.min(bottom, clip.bottom)];
    }
    if (right - left < 1 || bottom - top < 1) return; // scrolled away
    const there = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    if (!there || !(element.contains(there) || there.contains(element))) return; // covered
    const cut = [left, top, right, bottom].some((edge, k) => Math.abs(edge - box[k]) > 3);
    found.push({ text, size, box: [left, top, right, bottom], cut, scrolls: Boolean(element.closest(".drawer")) });
  }
  const size = element => parseFloat(getComputedStyle(element).fontSize);
  const corners = ({ left, top, right, bottom }) => [left, top, right, bottom];
  const walk = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const element = node.parentElement;
    if (!node.data.trim() || element.closest("select, style") || !element.checkVisibility()) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const rect of range.getClientRects()) note(node.data, size(element), corners(rect), element);
  }
  for (const element of root.querySelectorAll("select, input[type=text]"))
    if (element.checkVisibility()) {
      const text = element.selectedOptions?.[0].text ?? element.placeholder;
      note(text, size(element), corners(element.getBoundingClientRect()), element);
    }
  for (const canvas of root.querySelectorAll("canvas"))
    if (canvas.checkVisibility() && canvas.texts) {
      const at = canvas.getBoundingClientRect(), scale = at.width / canvas.clientWidth, [x, y] = [at.left, at.top];
      for (const { text, size, box } of canvas.texts)
        note(text, size * scale, box.map((edge, k) => (k % 2 ? y : x) + edge * scale), canvas);
    }
  return found;
}
"""


def judge_texts(page):
    """Text that is too small for a projector, cut off, or covers other text."""
    width, height = page.viewport_size["width"], page.viewport_size["height"]
    texts = page.locator(".clothlab").evaluate(TEXTS)
    assert len(texts) > 20
    problems = [f"small: {each}" for each in texts if each["size"] < 0.02 * height]
    problems += [
        f"cut: {each}" for each in texts if each["cut"] and not each["scrolls"]
    ]
    for k, each in enumerate(texts):
        a = each["box"]
        if a[0] < 0 or a[1] < 0 or a[2] > width + 1 or a[3] > height + 1:
            problems.append(f"outside: {each}")
        for other in texts[k + 1 :]:
            b = other["box"]
            if (
                min(a[2], b[2]) - max(a[0], b[0]) > 2
                and min(a[3], b[3]) - max(a[1], b[1]) > 2
            ):
                problems.append(f"on each other: {each} {other}")
    return problems


@pytest.fixture
def project(notebook, page, screenshot):
    """Shows the panel as on a projector of this size; its `look` names a screenshot and
    judges its texts.
    """
    problems = []

    def project(size):
        page.set_viewport_size(dict(zip(("width", "height"), SIZES[size], strict=True)))
        button(page, "projector").click()
        expect(button(page, "projector")).to_have_attribute("aria-pressed", "true")

        def look(name):
            page.evaluate(
                "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
            )
            screenshot(f"projector-{size}-{name.replace(' ', '-')}")
            problems.extend(f"{name}: {problem}" for problem in judge_texts(page))

        return look

    yield project
    page.keyboard.press("Escape")  # the drawer, if any
    if button(page, "projector").get_attribute("aria-pressed") == "true":
        page.keyboard.press("p")
    expect(button(page, "projector")).to_have_attribute("aria-pressed", "false")
    expect(page.locator(".clothlab h3", has_text="Target")).to_be_visible()
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize("size", SIZES)
def test_a_projector_shows_three_views_in_large_text(notebook, page, project, size):
    look = project(size)
    box = page.locator(".clothlab").bounding_box()
    assert (box["x"], box["y"], box["width"], box["height"]) == (0, 0, *SIZES[size])
    notebook.until(
        "sum(moment.period is not None for moment in panel.history) >= 2", 30
    )
    for name in (
        "the robot,",
        "what the camera sees",
        "the target✓",
        "distance to the target",
    ):
        expect(page.locator("figcaption:visible", has_text=name)).to_be_in_viewport(
            ratio=1
        )
    expect(page.get_by_text("The autoencoder reproduces it.")).to_be_in_viewport(
        ratio=1
    )
    for name in ("joint angles", "at each step"):
        expect(page.locator("figcaption:visible", has_text=name)).to_have_count(0)
    look("views")
    for name in ("target", "hand", "more plots", "material"):
        button(page, name).click()
        look(name)
        if name != "target":  # that one is beside the target, the others lie over it
            covered, drawer = (
                page.locator(each).bounding_box()
                for each in (".aim [role=status]", ".drawer")
            )
            assert drawer["y"] <= covered["y"]
            assert (
                covered["y"] + covered["height"] <= drawer["y"] + drawer["height"] + 1
            ), "the verdict sticks out"
    button(page, "estimate p online").click()
    slider(page, "C_damp").press("ArrowRight")
    notebook.until(
        "panel.session.env.cloth.damping > 0.05 and panel.session.tracker.report is not None",
        30,
    )
    look("estimate")
    page.keyboard.press("Escape")
    expect(slider(page, "C_damp")).to_have_count(0)
    draw(page, (60, 60), (200, 140))
    expect(
        page.get_by_text("The autoencoder does not reproduce it.")
    ).to_be_in_viewport(ratio=1, timeout=15_000)
    notebook.evaluate(
        "None",
        "panel._messages.say('⚠ ' + 16 * 'a long message, ', 'mistake'); panel._refresh()",
    )
    look("long-message")


def test_a_projector_shows_a_muscle_arm_and_a_recorded_run(
    notebook, page, project, says
):
    look = project("720p")
    choose(page, "arm", "muscle")
    notebook.until("panel.session.arm.name == 'muscle' and len(panel.history) > 3", 30)
    button(page, "hand").click()
    choose(page, "driven by", "iterative")
    notebook.until("panel.session.driver == 'iterative'")
    button(page, "record").click()
    says("recording, from")
    look("muscle")
    button(page, "discard").click()
    button(page, "pause").click()
    expect(status(page)).to_have_text("❚❚ paused")
    expect(button(page, "pause")).to_have_attribute("aria-disabled", "true")
    look("paused")
    button(page, "step").click()
    expect(status(page)).to_have_text("❚❚ paused")
    expect(page.get_by_role("combobox", name="arm")).to_have_value("muscle")


def test_mistakes_are_messages_and_the_panel_lives_on(notebook, page, tmp_path, says):
    button(page, "clear").click()
    button(page, "eraser").click()
    draw(page, (60, 60), (200, 140))
    says("no cloth in the image")
    button(page, "eraser").click()
    cv2.imwrite(str(tmp_path / "small.png"), np.full((10, 10), 255, np.uint8))
    with page.expect_file_chooser() as chooser:
        button(page, "from a file").click()
    chooser.value.set_files(tmp_path / "small.png")
    says("this picture 10×10")
    steps = json.loads(notebook.evaluate("panel.steps"))
    notebook.until(f"panel.steps > {steps}")


@pytest.fixture
def busy():
    """As many endless loops as there are cores."""
    loops = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(os.cpu_count() or 1)
    ]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


def test_nothing_queues_while_all_cores_are_busy(notebook, page, busy):
    button(page, "estimate p online").click()
    hand = slider(page, "shoulder")
    for _ in range(BURST):
        hand.press("ArrowRight")
        # a frame waits for the one before
        assert int(notebook.evaluate("panel.frame['number'] - panel.drawn")) <= 1
    notebook.until(f"abs(panel.session.hand[0] - {float(hand.input_value())}) < 0.05")
    assert notebook.evaluate("panel.session.estimating") == "True"


def test_a_fault_is_shown_and_raised_and_the_panel_lives_on(notebook, page):
    notebook.evaluate(
        "None",
        "def broken(*a, **k):\n    raise ZeroDivisionError('on purpose')\npanel.session.set_p = broken",
    )
    map_of_p(page).click(position={"x": 90, "y": 100})
    notebook.until("len(panel.errors) == 1")
    expect(page.locator(".clothlab .message.fault").first).to_contain_text(
        "ZeroDivisionError: on purpose"
    )
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        notebook.evaluate("panel.check()")
    steps = json.loads(notebook.evaluate("panel.steps"))
    notebook.until(f"panel.steps > {steps}")
    notebook.evaluate("None", "del panel.session.set_p\npanel.errors.clear()")


def test_a_closed_page_stops_the_panel(notebook, page):
    page.goto("about:blank")
    notebook.until("not panel.running", 30)
    assert (
        notebook.evaluate("'does not answer' in panel.state['message']['text']")
        == "True"
    )
