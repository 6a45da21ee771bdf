"""The map of p in notebook 06: a click shows another motion, or what is wrong with the callback."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_clicks_and_arrow_keys_on_the_map_of_p(open_notebook, page, screenshot):
    notebook = open_notebook("06_parametric_bias.ipynb")
    notebook.run_all()
    the_map = page.locator(".clothlab-map")
    the_map.wait_for(timeout=120_000)
    the_map.scroll_into_view_if_needed()
    notebook.connect()
    picture = page.locator(".jp-Cell", has=the_map).locator(".jp-RenderedImage img")

    def shows_another(before):
        expect(picture).not_to_have_attribute("src", before, timeout=15_000)
        return picture.get_attribute("src")

    first = picture.get_attribute("src")
    notebook.evaluate("None", "before = list(pb_map.current)")
    the_map.click(position={"x": 60, "y": 150})
    second = shows_another(first)
    notebook.until("pb_map.current != before")
    notebook.evaluate("None", "before = list(pb_map.current)")
    the_map.press("ArrowUp")
    shows_another(second)
    notebook.until("pb_map.current[1] > before[1]")
    screenshot("11-notebook-06")

    notebook.evaluate("None", "def predict_motion(p):\n    raise ZeroDivisionError('on purpose')")
    the_map.click(position={"x": 200, "y": 200})
    page.locator(".jp-Cell", has=the_map).get_by_text("ZeroDivisionError: on purpose").first.wait_for()
