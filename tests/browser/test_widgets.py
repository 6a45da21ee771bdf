"""The widgets of the lessons in JupyterLab: each control draws another figure when a
person moves it, and shows what is wrong with the function that draws.
"""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

CODE = """
from matplotlib.figure import Figure
from clothlab import data
from clothlab.lab import Control, PBMap

def figure_of(p, period, recording):
    figure = Figure()
    ax = figure.subplots()
    ax.plot(p * period)
    ax.set_title(recording)
    return figure

def draw(p, period=8, recording="a"):
    return figure_of(p, period, recording)

biases = data.load("torque-0").biases
pb_map = PBMap(biases, {}, p=biases["damp0.05-mass0.10"])
control = Control(draw, p=pb_map, period=(1, 12, 1), recording=["a", "b"])
control
"""
BROKEN = """
def figure_of(p, period, recording):
    raise ZeroDivisionError("on purpose")
"""


def test_a_map_a_slider_and_a_menu_draw_another_figure_each(
    open_notebook, page, screenshot
):
    notebook = open_notebook("widgets.ipynb", [CODE])
    the_map = page.get_by_role(
        "application", name=re.compile("^map of the parametric bias")
    )
    the_map.wait_for(timeout=60_000)
    picture = page.locator("img.widget-image")

    # Each of them, with the pointer or a key
    slider = page.get_by_role("slider")
    for act, moved in (
        (lambda: the_map.click(position={"x": 60, "y": 150}), "pb_map.chosen"),
        (lambda: the_map.press("ArrowUp"), "pb_map.chosen"),
        (lambda: slider.press("End"), "control.controls['period'].value"),
        (
            lambda: page.get_by_role("combobox", name="recording").select_option("b"),
            "control.controls['recording'].value",
        ),
    ):
        before = picture.get_attribute("src")
        value = notebook.evaluate(moved)
        act()
        notebook.until(f"{moved} != {value}")
        expect(picture).not_to_have_attribute("src", before, timeout=15_000)
    notebook.evaluate("control.check()")
    expect(page.get_by_text("run the cells again")).to_be_hidden()
    screenshot("widgets")

    # A function that fails
    notebook.evaluate("None", BROKEN)
    the_map.click(position={"x": 200, "y": 200})
    page.get_by_text("ZeroDivisionError: on purpose").wait_for()
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        notebook.evaluate("control.check()")


CANVAS = """
from clothlab.data import load_target
from clothlab.lab import Control, TargetCanvas
from clothlab.plots import image_grid

canvas = TargetCanvas(load_target("drawn/bar"))
control = Control(lambda mask: image_grid([mask]), mask=canvas)
control
"""


def test_a_stroke_on_the_canvas_draws_another_figure(open_notebook, page, screenshot):
    notebook = open_notebook("canvas.ipynb", [CANVAS])
    canvas = page.get_by_role("application", name=re.compile("^target: draw"))
    canvas.wait_for(timeout=60_000)
    picture = page.locator("img.widget-image")
    before = picture.get_attribute("src")
    size = notebook.evaluate("int(canvas.value.sum())")

    # A stroke, and then nothing is left
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 80, box["y"] + 20)
    page.mouse.up()
    notebook.until(f"canvas.value.sum() > {size} + 100")
    expect(picture).not_to_have_attribute("src", before, timeout=15_000)
    screenshot("canvas")
    page.get_by_role("button", name="clear").click()
    notebook.until("canvas.value.sum() == 0")
    notebook.evaluate("control.check()")
