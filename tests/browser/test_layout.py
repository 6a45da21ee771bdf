"""The widgets where a student has little room: 1366 × 768 with JupyterLab's file
browser open, and at 150 % zoom.

A browser that zooms to 150 % lays a page out as if its window were smaller by a half:
911 × 512.
"""

import pytest
from browser_lab import Notebook
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

CODE = {  # what notebooks 00, 04 and 05, and 08 show
    "00": "from clothlab.lab import RecordedRun\nRecordedRun(170, 88)",
    "05": """
from matplotlib.figure import Figure
from clothlab import data
from clothlab.lab import Control, PBMap

def draw(p, recording="a"):
    figure = Figure(figsize=(9.0, 3.0))
    figure.subplots(1, 3)[0].plot(p)
    return figure

biases = data.load("torque-0").biases
Control(draw, recording=["a", "b"], p=PBMap(biases, {}, p=biases["damp0.05-mass0.10"]))
""",
    "08": "from clothlab.lab import LivePanel, LiveSession\npanel = LivePanel(LiveSession())\npanel",
}
SIZES = {"1366 × 768": (1366, 768), "150 %": (911, 512)}
# Widths of the pictures [CSS pixel]
LEAST = {"00": [340, 190, 190], "05": [440], "08": [390, 190, 190]}
JUDGE = """
output => {
  // What scrolls, what sticks out on the right, and which text is cut off.
  const all = [...output.querySelectorAll("*")].filter((each) => each.checkVisibility());
  const sizes = ({ clientWidth, scrollWidth, clientHeight, scrollHeight }) =>
    `${clientWidth}<${scrollWidth} ${clientHeight}<${scrollHeight}`;
  const name = (each) => `${each.tagName} ${each.className} ${sizes(each)}`;
  const larger = (each) => each.scrollWidth > each.clientWidth + 1 || each.scrollHeight > each.clientHeight + 1;
  const scrolls = all.filter((each) => larger(each) && /auto|scroll/.test(getComputedStyle(each).overflow)).map(name);
  const edge = output.getBoundingClientRect().right + 1;
  const out = all.filter((each) => each.tagName !== "OPTION" && each.getBoundingClientRect().right > edge).map(name);
  const texts = all.filter((each) => each.childElementCount === 0 && each.textContent.trim());
  const hides = (each) => getComputedStyle(each).overflow !== "visible";
  const cut = texts.filter((each) => each.scrollWidth > each.clientWidth + 1 && hides(each));
  return { scrolls, out, cut: cut.map((each) => `${name(each)}: ${each.textContent}`) };
}
"""


@pytest.fixture(scope="module")
def shown(lab, browser):
    """A notebook with the three, run."""
    lab.add("layout.ipynb", [*CODE.values()])
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    page = context.new_page()
    notebook = Notebook(lab, page, "layout.ipynb")
    notebook.run_all()
    page.locator(".clothlab [data-frame]").wait_for(timeout=90_000)
    expect(page.locator("#filebrowser")).to_be_visible()
    yield page
    context.close()
    lab.stop_kernel("layout.ipynb")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("number", CODE)
def test_it_wraps_and_nothing_is_cut(shown, screenshot_of, size, number):
    shown.set_viewport_size(dict(zip(("width", "height"), SIZES[size], strict=True)))
    output = (
        shown.locator(".jp-CodeCell")
        .nth(list(CODE).index(number))
        .locator(".jp-OutputArea-output")
        .first
    )
    output.evaluate("each => each.scrollIntoView()")
    shown.wait_for_timeout(1000)
    output.evaluate("each => each.scrollIntoView()")
    screenshot_of(shown, f"layout-{number}-{size.split()[0]}")
    assert output.evaluate(JUDGE) == {"scrolls": [], "out": [], "cut": []}
    pictures = output.locator("img").evaluate_all(
        "all => all.filter((each) => each.checkVisibility() && each.clientWidth).map((each) => each.clientWidth)"
    )
    for width, least in zip(pictures, LEAST[number], strict=False):
        assert width >= least, pictures
    assert len(pictures) >= len(LEAST[number])
