"""The map of p in notebook 06: a click shows another motion, or what is wrong with the function that draws it."""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_clicks_and_arrow_keys_on_the_map_of_p(open_notebook, page, screenshot):
    notebook = open_notebook("06_parametric_bias.ipynb")
    notebook.run_all()
    the_map = page.get_by_role("application", name=re.compile("^map of the parametric bias"))
    the_map.wait_for(timeout=120_000)
    the_map.scroll_into_view_if_needed()
    notebook.connect()
    cell = page.locator(".jp-Cell", has=the_map)
    picture = cell.locator("img.widget-image")

    def shows_another(before):
        expect(picture).not_to_have_attribute("src", before, timeout=15_000)
        return picture.get_attribute("src")

    first = picture.get_attribute("src")
    before = notebook.evaluate("pb_map.chosen")
    the_map.click(position={"x": 60, "y": 150})
    second = shows_another(first)
    notebook.until(f"pb_map.chosen != {before}")
    before = notebook.evaluate("pb_map.chosen")
    the_map.press("ArrowUp")
    shows_another(second)
    notebook.until(f"pb_map.chosen[1] > {before}[1]")
    screenshot("11-notebook-06")

    notebook.evaluate("None", "def imagined(p):\n    raise ZeroDivisionError('on purpose')")
    the_map.click(position={"x": 200, "y": 200})
    cell.get_by_text("ZeroDivisionError: on purpose").wait_for()
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        notebook.evaluate("strips.check()")
