"""The page in Chromium, from its folder: a visitor throws a cloth with each arm."""

import re
from io import BytesIO

import mujoco
import numpy as np
import pytest
from conftest import LOADING
from PIL import Image
from playwright.sync_api import expect
from test_scene import FIRST, OWN, filled

from clothlab.lab import LiveSession
from web.build import ONE_FILE
from web.scene import any_cloth_scene

PERIODS = 8
BOUND = 1e-9  # [rad], [m]
SOFTEST = 10.0  # [N], of the muscle arm's stiffness command
# Of a page that was opened, how a trait of its model stands
TRAIT = "name => document.getElementById('clothlab-lab').model.get(name)"
WIDE = """[...document.querySelectorAll('.clothlab *')]
    .filter((each) => each.checkVisibility() && each.getBoundingClientRect().right > innerWidth)
    .map((each) => each.outerHTML.slice(0, 80))"""
# Commands of the hand, each for a control period, and where everything is then
MOVED = """async (commands) => {
    const places = [];
    for (const u of commands) {
        session.actions["set hand"]({ u });
        await session.actions.step({ solve: true });
        places.push([...session.world().data.qpos]);
    }
    return places;
}"""


class Lab:
    """What a visitor does at the panel, and sees of it."""

    def __init__(self, page):
        self.page = page
        self.panel = page.locator(".clothlab")
        self.message = self.panel.get_by_role("alert").first
        page.wait_for_selector("[data-frame]", timeout=LOADING)

    def press(self, name):
        self.panel.get_by_role("button", name=name, exact=True).click()

    def choose(self, menu, option):
        self.panel.get_by_label(menu, exact=True).select_option(option)

    def move(self, name, value):
        """Move a slider, also beyond its end."""
        self.panel.get_by_role("slider", name=name).first.evaluate(
            """(slider, value) => {
                slider.min = Math.min(slider.min, value);
                slider.value = value;
                slider.dispatchEvent(new Event("change"));
            }""",
            value,
        )

    def get(self, trait):
        return self.page.evaluate(TRAIT, trait)

    def wait(self, condition):
        self.page.wait_for_function(
            f"() => {{ const get = {TRAIT}; return {condition}; }}", timeout=LOADING
        )

    def run_until(self, step):
        self.press("start")
        self.wait(f"+get('frame').clock.match(/step (\\d+)/)[1] >= {step}")
        self.press("pause")
        self.wait("!get('state').running")

    def throw(self, driver, periods=PERIODS):
        """The best distance of each period, over that of a cloth that hangs still."""
        self.choose("driven by", driver)
        self.press("reset")
        self.wait(f"get('state').driver === '{driver}'")
        self.wait("get('frame').clock.includes('step 0')")
        steps = 8 * periods
        self.page.evaluate(  # as fast as it can: nothing is left out then
            """async (steps) => {
                const { model } = document.getElementById("clothlab-lab");
                for (let k = 0; k < steps; k++) await model.send({ do: "step", id: "" });
            }""",
            steps,
        )
        self.wait(f"get('frame').clock.includes('step {steps}')")
        plot = self.get("frame")["traces"][0]
        distances = np.reshape(plot["lines"][0]["values"], (periods, -1))
        return distances.min(axis=1) / plot["limit"][1]

    def inside(self, expression, argument=None):
        """Ask in the worker, where `session` is."""
        return self.page.workers[0].evaluate(expression, argument)


@pytest.fixture
def lab(folder, visit):
    return Lab(visit(folder / "index.html"))


def in_python(cloth, commands):
    """Coordinates after each command, from a cloth that hangs still."""
    template = any_cloth_scene("torque", FIRST["torque"])
    model = mujoco.MjModel.from_xml_string(filled(template, cloth))
    data = mujoco.MjData(model)
    for name, values in template["start"].items():
        getattr(data, name)[:] = values
    mujoco.mj_forward(model, data)
    mujoco.mj_step(model, data, template["settle"])
    places = []
    for u in commands:
        mujoco.mj_forward(model, data)
        data.ctrl[:] = u
        mujoco.mj_step(model, data, template["substeps"])
        places.append(data.qpos.tolist())
    return np.array(places)


def draw_target(lab):
    """Draw a shape with the pointer; what is aimed at then."""
    before = lab.get("target")
    lab.press("clear")
    expect(lab.message).to_contain_text("draw a target")
    canvas = lab.panel.get_by_role("application", name=re.compile("^target"))
    box = canvas.bounding_box()
    mouse = lab.page.mouse
    for k, (x, y) in enumerate([(0.45, 0.5), (0.55, 0.5), (0.56, 0.75), (0.5, 0.6)]):
        place = (box["x"] + x * box["width"], box["y"] + y * box["height"])
        mouse.move(*place, steps=5)
        if k == 0:
            mouse.down()
    mouse.up()
    lab.wait(f"get('target').reason !== {before['reason']!r}")
    drawn = lab.get("target")
    assert drawn["image"] != before["image"]
    return np.array(drawn["image"], bool)


def test_the_torque_arm_throws_estimates_and_aims_at_a_drawn_target(lab):
    assert np.median(lab.throw("control")[2:]) < 0.6
    assert min(lab.throw("iterative")[3:]) < 0.4

    # In time, with another belief, which is found to be wrong
    right = lab.get("frame")["at"]
    the_map = lab.panel.get_by_role("application", name=re.compile("^map"))
    the_map.click(position={"x": 240, "y": 60})
    lab.wait(f"get('frame').at[0] !== {right[0]}")
    wrong = lab.get("frame")["at"]
    lab.choose("driven by", "random")
    lab.press("reset")
    lab.press("estimate p online")
    lab.run_until(60)
    gap = np.linalg.norm(np.subtract(lab.get("frame")["at"], right))
    assert gap < 0.5 * np.linalg.norm(np.subtract(wrong, right))

    # A drawn target is the one that Python would aim at
    lab.press("reset")
    session = LiveSession("torque")
    session.set_target(draw_target(lab).reshape(session.target.shape))
    lab.press("step")
    lab.wait("get('frame').clock.includes('step 1')")
    _, still = lab.get("frame")["traces"][0]["limit"]
    assert still == pytest.approx(session.still_distance, abs=0.1)
    session.close()

    # Ones own hand takes over
    slider = lab.panel.get_by_role("slider", name="θ_ref shoulder [rad]")
    slider.focus()
    slider.press("ArrowRight")
    lab.wait("get('state').driver === 'manual'")


def test_a_cloth_made_by_sliders_moves_as_in_python_and_one_too_light_is_refused(lab):
    lab.move("C_damp [N s/m]", OWN.damping)
    lab.wait(f"get('state').cloth.material[0] === {OWN.damping}")
    lab.move("C_mass [kg]", OWN.mass)
    lab.wait(f"get('state').cloth.material[1] === {OWN.mass}")
    commands = [[-0.6, -1.2], [-0.6, -1.2], [0.9, -0.1], [0.2, -0.9]]
    found = lab.inside(MOVED, commands)
    assert np.abs(np.array(found) - in_python(OWN, commands)).max() < BOUND

    before = lab.get("state")["cloth"]
    lab.move("C_mass [kg]", 0.005)
    expect(lab.message).to_contain_text("too light")
    assert lab.get("state")["cloth"] == before


def blue_columns(png):
    """How many columns of a picture apart the outermost blue pixels are."""
    picture = np.asarray(Image.open(BytesIO(png)), int)
    blue = picture[..., 2] - picture[..., 0] > 100
    return np.ptp(np.flatnonzero(blue.any(axis=0)))


def test_the_muscle_arm_throws_soft_or_stiff(lab):
    lab.choose("arm", "muscle")
    lab.wait("get('state').arm === 'muscle' && get('state').message.text === ''")
    assert np.median(lab.throw("control")[2:]) < 0.6

    # The ellipse shows how soft it is, and every command has that stiffness
    drawn = lab.panel.get_by_role("img", name="where a push of 1 N moves the hand, ×10")
    lab.panel.get_by_label("fix the stiffness").check()
    lab.wait("get('state').fixed")
    widths = {}
    for tension in (SOFTEST, 7 * SOFTEST):
        lab.move("f_const [N]", tension)
        lab.wait(f"get('state').tension[0] === {tension}")
        lab.page.wait_for_timeout(300)
        widths[tension] = blue_columns(drawn.screenshot())
    assert widths[SOFTEST] > 1.5 * widths[7 * SOFTEST] > 0
    lab.throw("iterative", periods=1)
    (plot,) = (
        plot
        for plot in lab.get("frame")["traces"]
        if plot["title"] == "stiffness command"
    )
    assert set(plot["lines"][0]["values"]) == {7 * SOFTEST}


def test_what_needs_a_kernel_is_not_there_and_on_a_phone_all_fits(lab):
    for name in ("record", "save", "from a file"):
        expect(lab.panel.get_by_role("button", name=name, exact=True)).to_have_count(0)
    lab.page.set_viewport_size({"width": 390, "height": 844})
    assert lab.page.evaluate(WIDE) == []
    assert lab.page.evaluate("document.documentElement.scrollWidth") == 390


def test_a_page_that_nobody_sees_pauses(lab):
    lab.press("start")
    lab.wait("get('frame').clock.includes('step 2')")
    lab.page.evaluate(
        """() => {
            Object.defineProperty(document, "hidden", { value: true });
            document.dispatchEvent(new Event("visibilitychange"));
        }"""
    )
    expect(lab.message).to_contain_text("paused while nobody saw the page")
    assert not lab.get("state")["running"]


def test_where_no_robot_can_run_the_page_says_why(folder, visit, page):
    page.add_init_script("delete globalThis.WebAssembly")
    visit(folder / "index.html")
    note = page.locator("#clothlab-lab").get_by_role("status")
    expect(note).to_have_text(
        "The robot can't run here: this browser has no WebAssembly."
    )


def test_one_file_throws_where_nothing_else_lies(folder, visit, tmp_path):
    alone = tmp_path / ONE_FILE
    alone.write_bytes((folder / ONE_FILE).read_bytes())
    lab = Lab(visit(alone))
    assert min(lab.throw("control", periods=3)) < 0.6
    lab.choose("arm", "muscle")
    lab.wait("get('state').arm === 'muscle'")
    with lab.page.expect_download() as download:
        lab.page.get_by_role("link", name="their licences").click()
    text = download.value.path().read_text("utf-8")
    assert "Apache License" in text
    assert "MIT License" in text
