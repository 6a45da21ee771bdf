"""The page "Throw a cloth": the panel with the recorded run, from its folder, without
Python and without a network.
"""

import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest
from playwright.sync_api import expect

from clothlab.lab._playback import _moments, load_recording
from clothlab.simulation.env import CONTROL_PERIOD

pytestmark = pytest.mark.book

# What moves through time, and what only arranges the page
STEER = {"start", "pause", "step", "reset", "time [s]"}
ARRANGE = {"projector", "target", "material", "hand", "more plots"}
CONTROLS = """root => [...root.querySelectorAll("button, select, input:not([type=file])")]
    .map((each) => [each.ariaLabel ?? each.textContent.trim(), each.disabled, each.title])"""


@pytest.fixture(scope="module")
def moments():
    """What the panel has to show at each step."""
    return _moments(load_recording())


class Lab:
    """What a visitor does at the panel, and sees of it."""

    def __init__(self, page):
        self.page = page
        self.panel = page.locator(".clothlab")
        self.time = page.get_by_role("slider", name="time [s]")

    def press(self, name):
        self.panel.get_by_role("button", name=name, exact=True).click()

    def seek(self, step):
        """Move the slider to a step."""
        self.time.evaluate(
            "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }",
            step * CONTROL_PERIOD,
        )

    @property
    def shown(self):
        """The step that is seen."""
        return round(float(self.time.input_value()) / CONTROL_PERIOD)

    @property
    def texts(self):
        """What stands below the robot, and what is said of it."""
        below = self.panel.locator("figcaption", has_text="the robot, ").inner_text()
        return below, self.panel.get_by_role("alert").inner_text()


@pytest.fixture
def lab(site, visit):
    """The panel on its page."""
    page = visit(site / "throw.html", "#recorded-run")
    page.wait_for_selector("[data-frame]")
    return Lab(page)


def expected(moment):
    return f"the robot, {moment['frame']['clock']}", moment["caption"]


def test_it_plays_stops_goes_on_step_by_step_and_begins_again(lab, moments):
    assert lab.texts == expected(moments[0])
    lab.press("start")
    expect(lab.time).not_to_have_value(re.compile(r"^0(\.\d)?$"))
    expect(lab.panel.locator(".status")).to_have_text("▶ running")
    lab.press("pause")
    expect(lab.panel.locator(".status")).to_have_text("❚❚ paused")
    stopped = lab.shown
    lab.page.wait_for_timeout(500)
    assert lab.shown == stopped
    lab.press("step")
    assert lab.shown == stopped + 1
    assert lab.texts == expected(moments[stopped + 1])
    lab.press("reset")
    assert lab.texts == expected(moments[0])


@pytest.mark.parametrize("share", [0.1, 0.4, 0.75, 1.0])
def test_the_slider_shows_each_moment_as_it_was(lab, moments, share):
    step = round(share * (len(moments) - 1))
    lab.seek(len(moments) - 1)  # from where each way back leads over other targets
    lab.seek(step)
    moment = moments[step]
    assert lab.texts == expected(moment)
    assert lab.panel.get_by_text(moment["target"]["verdict"]).is_visible()
    drives = lab.panel.get_by_role("combobox", name="driven by")
    expect(drives).to_have_value(moment["state"]["driver"])
    pixels = lab.panel.get_by_role("img", name="target", exact=True).evaluate(
        "each => [...each.getContext('2d').getImageData(0, 0, 128, 96).data].filter((v, k) => k % 4 === 0).map((v) => +(v > 127))"
    )
    assert bytes(pixels) == moment["target"]["image"]


def test_keys_move_through_time_and_the_end_stops_it(lab, moments):
    lab.time.focus()
    lab.time.press("End")
    assert lab.shown == len(moments) - 1
    lab.time.press("ArrowLeft")
    assert lab.texts == expected(moments[-2])
    lab.press("start")
    expect(lab.panel.locator(".status")).to_have_text("❚❚ paused")
    assert lab.shown == len(moments) - 1
    lab.press("start")  # once more from the beginning
    assert lab.shown < 10


def test_what_a_recording_cannot_do_is_off_and_says_why(lab):
    controls = lab.panel.evaluate(CONTROLS)
    assert {name for name, disabled, _ in controls if not disabled} == STEER | ARRANGE
    for name, disabled, why in controls:
        assert not disabled or "recording" in why, name
    the_map = lab.panel.get_by_role("img", name="map of the parametric bias p")
    assert "recording" in the_map.get_attribute("title")
    before = the_map.evaluate("canvas => canvas.toDataURL()")
    the_map.click(position={"x": 60, "y": 60})
    assert the_map.evaluate("canvas => canvas.toDataURL()") == before
    assert lab.panel.get_by_role("application").count() == 0


def test_on_a_phone_it_is_no_wider_than_the_screen(lab):
    lab.page.set_viewport_size({"width": 390, "height": 844})
    over = "[...document.querySelectorAll('.clothlab *')].filter((each) => each.getBoundingClientRect().right > innerWidth).map((each) => each.outerHTML.slice(0, 80))"
    assert lab.page.evaluate(over) == []
    assert lab.page.evaluate("document.documentElement.scrollWidth") == 390
    camera = lab.panel.get_by_alt_text("what the camera sees").bounding_box()
    decoded = lab.panel.get_by_alt_text("what z says of it").bounding_box()
    assert camera["y"] == decoded["y"]


def test_a_page_that_nobody_sees_pauses(lab):
    lab.press("start")
    lab.page.evaluate(
        "Object.defineProperty(document, 'hidden', { value: true }); document.dispatchEvent(new Event('visibilitychange'))"
    )
    expect(lab.panel.locator(".status")).to_have_text("❚❚ paused")


def test_the_page_may_ask_for_nothing_outside(site, page):
    page.goto((site / "throw.html").as_uri())
    broken = page.evaluate(
        """() => new Promise((resolve) => {
            addEventListener("securitypolicyviolation", (event) => resolve(event.blockedURI));
            fetch("https://example.org/").catch(() => {});
        })"""
    )
    assert re.match("https://example.org", broken)


@pytest.fixture
def address(site, monkeypatch):
    """The site from a server that knows nothing but files."""
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    files = partial(SimpleHTTPRequestHandler, directory=site)
    with ThreadingHTTPServer(("127.0.0.1", 0), files) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,)).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_any_server_of_files_will_do(address, browser):
    page = browser.new_page()
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda asked: complaints.append(asked.url))
    page.goto(f"{address}/throw.html#recorded-run")
    page.wait_for_selector("[data-frame]")
    page.get_by_role("button", name="start", exact=True).click()
    expect(Lab(page).time).not_to_have_value("0")
    page.close()
    ours = (f"{address}/", "blob:", "data:")
    assert [each for each in complaints if not each.startswith(ours)] == []
