"""The panel of control alone: predicted beside achieved images, stiffness and its
ellipse, and a fault that shows.
"""

import re

import cv2
import numpy as np
import pytest
from browser_lab import slider
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

CODE = "from clothlab.lab import LivePanel, LiveSession\npanel = LivePanel(LiveSession(), only='control')\npanel"


def ellipse_length(page):
    png = page.evaluate(
        "fetch(document.querySelector('img.ellipse').src).then(async (r) => [...await r.bytes()])"
    )
    picture = cv2.imdecode(np.array(png, np.uint8), cv2.IMREAD_COLOR).astype(int)
    # Of the blue line
    return np.linalg.norm(
        np.ptp(np.argwhere(picture[..., 0] - picture[..., 2] > 120), axis=0)
    )


def test_predicted_and_achieved_images_of_a_drawn_target_and_a_softer_arm(
    lab, open_notebook, page, screenshot
):
    lab.add("mpc.ipynb", [CODE])
    notebook = open_notebook("mpc.ipynb")
    notebook.run_all()
    panel, canvas = (
        page.locator(".clothlab"),
        page.get_by_role("application", name=re.compile("^target")),
    )
    canvas.wait_for(timeout=60_000)
    notebook.connect()
    press = lambda name: panel.get_by_role("button", name=name, exact=True).click()  # noqa: E731
    expect(
        panel.get_by_text(
            re.compile("^(record|projector|estimate p online|Your own hand)$")
        )
    ).to_have_count(0)
    press("clear")
    canvas.drag_to(
        canvas,
        source_position={"x": 128, "y": 108},
        target_position={"x": 184, "y": 108},
    )
    press("step")
    expect(
        panel.get_by_alt_text("predicted for the end of this period")
    ).to_be_visible()
    press("start")
    notebook.until(
        "any(m.period and m.period.achieved < 0.8 * panel.session.still_distance for m in panel.history)",
        60,
    )
    expect(
        panel.get_by_alt_text(re.compile("achieved at the end|for it when it began"))
    ).to_have_count(2)
    screenshot("mpc-torque")
    panel.get_by_role("combobox", name="arm").select_option("muscle")
    panel.get_by_role("checkbox", name="fix the stiffness").check()
    notebook.until("panel.session.tension and len(panel.history) > 8", 60)
    press("pause")
    lengths = []
    for key, tension in (("End", 70), ("Home", 10)):
        slider(page, "f_const").press(key)
        notebook.until(f"panel.session.tension == {tension}")
        page.wait_for_timeout(1000)  # until the browser has the picture
        lengths.append(ellipse_length(page))
    assert lengths[1] > 1.5 * lengths[0]
    screenshot("mpc-muscle")
    notebook.evaluate("None", "panel.session.set_target = None")
    press("target: recorded 2")
    expect(panel.locator(".message.fault").first).to_contain_text("TypeError")
    with pytest.raises(RuntimeError, match="TypeError"):
        notebook.evaluate("panel.check()")
