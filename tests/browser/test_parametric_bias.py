"""The map of p in a notebook: a click draws another figure, or shows what is wrong with
the function that draws it.
"""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

CODE = """
from matplotlib.figure import Figure
from clothlab import data
from clothlab.lab import Control, PBMap

def draw(p):
    figure = Figure()
    figure.subplots().plot(p)
    return figure

biases = data.load("torque-0").biases
pb_map = PBMap(biases, {}, p=next(iter(biases.values())))
control = Control(lambda p: draw(p), p=pb_map)
control
"""


def test_clicks_and_arrow_keys_on_the_map_of_p(lab, open_notebook, page, screenshot):
    lab.add("map.ipynb", [CODE], texts=3)
    notebook = open_notebook("map.ipynb")
    notebook.run_all()
    the_map = page.get_by_role(
        "application", name=re.compile("^map of the parametric bias")
    )
    the_map.wait_for(timeout=60_000)
    notebook.connect()
    cell = page.locator(".jp-Cell", has=the_map)
    picture = cell.locator("img.widget-image")
    for act in (
        lambda: the_map.click(position={"x": 60, "y": 150}),
        lambda: the_map.press("ArrowUp"),
    ):
        before, chosen = (
            picture.get_attribute("src"),
            notebook.evaluate("pb_map.chosen"),
        )
        act()
        expect(picture).not_to_have_attribute("src", before, timeout=15_000)
        notebook.until(f"pb_map.chosen != {chosen}")
    screenshot("map-of-p")

    notebook.evaluate("None", "def draw(p):\n    raise ZeroDivisionError('on purpose')")
    the_map.click(position={"x": 200, "y": 200})
    cell.get_by_text("ZeroDivisionError: on purpose").wait_for()
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        notebook.evaluate("control.check()")
