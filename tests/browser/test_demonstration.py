"""The demonstration of docs/course/demo.md in a browser, to the letter: each row of its
table is done and looked at.

A row is found by what its column "click" says. So a text that changes has to be changed
here, too, and looked at again.
"""

import json
import re
import shutil

import pytest
from browser_lab import ROOT, slider
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

TEXT = (ROOT / "docs" / "course" / "demo.md").read_text("utf-8")
TABLE = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in TEXT.splitlines()
    if re.match(r"\| \d+ \|", line)
]
PERIOD = 8  # control steps


class Demonstration:
    """A teacher at the panel, on a projector: what each row clicks, and what must come
    of it.
    """

    def __init__(self, notebook, page):
        self.notebook, self.page, self.panel = notebook, page, page.locator(".clothlab")

    def press(self, name):
        self.panel.get_by_role("button", name=name, exact=True).click()

    def drive(self, driver):
        self.panel.get_by_role("combobox", name="driven by").select_option(driver)
        self.notebook.until(f"panel.session.driver == {driver!r}")

    def value(self, expression):
        return json.loads(
            self.notebook.evaluate(f"__import__('json').dumps({expression})").strip("'")
        )

    def wait(self, steps):
        """Wait for so many control steps."""
        end = self.value("panel.steps") + steps
        self.notebook.until(f"panel.steps >= {end}", 180)

    def verdict(self):
        return self.panel.locator(".aim [role=status]")

    def nothing_at_first(self):
        assert self.value("(panel.running, panel.session.step_number)") == [False, 0]
        lit = self.panel.get_by_alt_text("what the camera sees").evaluate(
            """image => {
              const canvas = Object.assign(document.createElement("canvas"), { width: 128, height: 96 });
              const context = canvas.getContext("2d");
              context.drawImage(image, 0, 0, 128, 96);
              return context.getImageData(0, 0, 128, 96).data.filter((v, k) => k % 4 === 0 && v > 127).length;
            }"""
        )
        assert lit == self.value("int(panel.session.observation['image'].sum())") > 100

    def chance(self):
        self.drive("random")
        self.press("start")
        self.wait(40)
        texts = self.panel.locator("canvas.plot").first.evaluate(
            "canvas => canvas.texts.map(({ text }) => text)"
        )
        assert any(text.startswith("hanging still") for text in texts)
        below = "sum(m.distance < panel.session.still_distance for m in panel.history) / len(panel.history)"
        assert self.value(below) < 0.3

    def control(self):
        self.drive("control")
        ended = self.value("sum(m.period is not None for m in panel.history)")
        self.notebook.until(
            f"sum(m.period is not None for m in panel.history) >= {ended} + 5", 60
        )
        near = "[min(m.distance for m in list(panel.history)[-40:][k:k + 8]) for k in range(0, 40, 8)]"
        assert sorted(self.value(near))[2] < self.value("panel.session.still_distance")
        expect(
            self.panel.locator("figcaption", has_text="distance to the target")
        ).to_contain_text("predicted")

    def nothing(self):
        self.wait(PERIOD)

    def wrong_p(self):
        self.press("material")
        before = self.value("panel.session.p.tolist()")
        the_map = self.panel.get_by_role(
            "application", name=re.compile("^map of the parametric bias")
        )
        box = the_map.bounding_box()
        the_map.click(position={"x": 0.85 * box["width"], "y": 0.15 * box["height"]})
        self.notebook.until(f"abs(panel.session.p - {before}).max() > 0.05")
        self.wait(2 * PERIOD)

    def estimate(self):
        before = self.value("panel.session.p.tolist()")
        self.press("estimate p online")
        self.notebook.until(
            f"panel.session.estimating and abs(panel.session.p - {before}).max() > 0.02",
            30,
        )
        self.wait(5 * PERIOD)
        assert self.value("len({tuple(at) for at in panel.frame['trail']})") > PERIOD

    def heavy(self):
        slider(self.page, "C_mass").press("End")
        self.notebook.until("panel.session.env.cloth.mass == 0.2")
        before = self.value("panel.session.p.tolist()")
        self.notebook.until(f"abs(panel.session.p - {before}).max() > 0.02", 30)
        self.wait(8 * PERIOD)
        quoted = re.findall(r"\*([^*]+ the trained ones)\*", TEXT)
        assert len(quoted) == 2
        shown = self.panel.locator(
            ".drawer .no"
        ).text_content()  # it comes often, not each time
        assert not shown or any(text in shown for text in quoted)

    def letter(self):
        self.press("target")
        self.press("clear")
        expect(self.verdict()).to_have_text("")
        canvas = self.panel.get_by_role("application", name=re.compile("^target"))
        box = canvas.bounding_box()

        def at(x, y):
            return box["x"] + x * box["width"] / 128, box["y"] + y * box["height"] / 96

        for start, end in (((40, 30), (90, 30)), ((65, 30), (65, 75))):
            self.page.mouse.move(*at(*start))
            self.page.mouse.down()
            self.page.mouse.move(*at(*end), steps=5)
            self.page.mouse.up()
        expect(self.verdict()).to_have_text(
            re.compile("^✗ Not reachable"), timeout=15_000
        )
        expect(self.panel.get_by_alt_text("reconstruction")).to_be_visible()

    def iterative(self):
        self.press("target: target-2")
        expect(self.verdict()).to_have_text(re.compile("^✓"), timeout=15_000)
        self.drive("iterative")
        self.wait(18 * PERIOD)
        near = "[min(m.distance for m in list(panel.history)[-144:][k:k + 8]) for k in range(0, 144, 8)]"
        distances = self.value(near)
        # Each run is another one, and some begin with a good throw: what it learned is
        # seen in the results, not in eighteen periods of one run.
        still = self.value("panel.session.still_distance")
        assert min(distances[9:]) < 0.75 * still

    def hand(self):
        self.press("hand")
        slider(self.page, "shoulder").press("ArrowRight")
        self.notebook.until("panel.session.driver == 'manual'")
        expect(self.panel.get_by_role("combobox", name="driven by")).to_have_value(
            "manual"
        )


ROWS = {
    ("0", "nothing"): Demonstration.nothing_at_first,
    ("1", "driven by **random**, then **start**"): Demonstration.chance,
    ("2", "driven by **control**"): Demonstration.control,
    ("3", "nothing"): Demonstration.nothing,
    ("4", "**material**; on the map, far from the cross"): Demonstration.wrong_p,
    ("5", "**estimate p online**"): Demonstration.estimate,
    ("6", "the slider for **C_mass**, to its right end"): Demonstration.heavy,
    (
        "7",
        "**target**, **clear**, then draw a letter, a T for one",
    ): Demonstration.letter,
    ("8", "a target of the gallery, driven by **iterative**"): Demonstration.iterative,
    ("9", "**hand**; a slider or a gamepad"): Demonstration.hand,
}


@pytest.fixture(scope="module")
def demonstration(lab, open_notebook, page):
    """As the page says under "Before the class"; on a copy, since JupyterLab saves
    outputs into the notebook.
    """
    folder = lab.folder / "notebooks"
    shutil.copy(folder / "08_live_lab.ipynb", folder / "demonstration.ipynb")
    # JupyterLab draws only what is in its window
    page.set_viewport_size({"width": 1500, "height": 1100})
    notebook = open_notebook("demonstration.ipynb")
    notebook.start_panel()
    page.set_viewport_size({"width": 1280, "height": 720})
    at_the_panel = Demonstration(notebook, page)
    for name in ("pause", "reset", "projector"):
        at_the_panel.press(name)
    notebook.until("not panel.running and panel.session.step_number == 0")
    yield at_the_panel
    notebook.evaluate("panel.check()")
    notebook.evaluate("panel.close()")


def test_the_table_and_what_is_tested_are_the_same():
    assert [(minute, click) for minute, click, *_ in TABLE] == list(ROWS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"minute {row[0]}")
def test_a_row_does_what_it_says(demonstration, screenshot, row):
    ROWS[row](demonstration)
    screenshot(f"demonstration-{row[0]}")
    assert demonstration.value("panel.state['message']['kind']") == "info"
