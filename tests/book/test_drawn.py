"""Widgets of notebooks in a page: they show what Python drew for where they stand."""

import re

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from playwright.sync_api import expect

from clothlab.lab import Control, PBMap
from clothlab.lab._drawn import MIME
from course import book
from course.drawn import write_controls, write_figures
from course.editions import ROOT

pytestmark = pytest.mark.book

STILL = "data:image/png;base64,"
WEBP = "data:image/webp;base64,"
PAGE = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>A lesson</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{css}</style>
<main><h1>A lesson</h1><div class="cell_output"><img alt="the still" src="{still}">{shown}</div></main>
<script defer src="../_static/lab/drawn.js"></script></html>"""
BIASES = {
    "light": np.array([1.0, 0.5]),
    "heavy": np.array([-1.0, 0.2]),
    "stiff": np.array([0.1, -0.9]),
}


def draw(height=0.5, kind="sine", p=(0, 0)):
    figure, ax = plt.subplots(figsize=(4, 2))
    x = np.linspace(0, 6, 50)
    label = f"{kind}, {height:.1f}, {p[0]:.2f}, {p[1]:.2f}"
    ax.plot(x, height * getattr(np, kind[:3])(x + p[0]), label=label)
    ax.plot(x, 0 * x + p[1])
    ax.set_ylim(-2, 2)
    ax.legend(loc="upper right")
    return figure


class Lesson:
    """A page with a widget, and what was drawn for it."""

    def __init__(self, folder):
        pb_map = PBMap(BIASES, {name: name for name in BIASES}, p=BIASES["heavy"])
        choices = {"height": (0.0, 1.0, 0.05), "kind": ["sine", "cosine"], "p": pb_map}
        control = Control(draw, labels={"height": "height [m]"}, **choices)
        data, metadata = control._repr_mimebundle_()
        self.still = data["image/png"]
        self.drawn = control.drawn(70)
        self.file = folder / "notebooks" / "lesson.html"

        # As `make book` lays it out, in a page as Sphinx writes it
        output = nbformat.v4.new_output(
            "display_data", data | {MIME: self.drawn}, metadata=metadata
        )
        _, *others = book.web_output(output)
        shown = "".join(each.data["text/html"] for each in others)
        cell = nbformat.v4.new_code_cell(outputs=others)
        page = nbformat.v4.new_notebook(cells=[cell])
        write_figures(page, folder / "_static" / "drawn")
        write_controls(folder / "_static" / "lab")
        css = (ROOT / "docs" / "book" / "static" / "book.css").read_text("utf-8")
        self.file.parent.mkdir()
        self.file.write_text(
            PAGE.format(css=css, still=STILL + self.still, shown=shown)
        )

    @property
    def starts(self):
        return [each["start"] for each in self.drawn["controls"]]

    def figure(self, *choices):
        """What Python drew for these choices."""
        return self.drawn["figures"][np.ravel_multi_index(choices, self.drawn["sizes"])]


@pytest.fixture(scope="module")
def lesson(tmp_path_factory):
    return Lesson(tmp_path_factory.mktemp("site"))


def base64_of(image):
    return image.get_attribute("src").split(",")[1]


def shows(page, figure):
    """Wait until a page shows a figure, byte by byte, and says what it is."""
    image = page.locator("img")
    expect(image).to_have_attribute("src", WEBP + figure["picture"])
    expect(image).to_have_attribute("alt", figure["alt"])
    words = page.locator(".figure-in-words p")
    assert words.all_text_contents() == figure["details"]
    assert image.evaluate("each => each.decode().then(() => each.naturalWidth)") > 100


def test_the_picture_is_the_one_that_python_drew_for_where_the_controls_stand(
    lesson, visit
):
    page = visit(lesson.file)
    _, kind, p = lesson.starts
    slider = page.get_by_role("slider", name="height [m]", exact=True)
    expect(page.locator("img")).to_have_attribute("src", STILL + lesson.still)
    assert page.locator("script[src*=drawn]").count() == 1, "figures wait for a touch"

    slider.focus()
    slider.press("End")
    last = lesson.drawn["sizes"][0] - 1
    shows(page, lesson.figure(last, kind, p))
    expect(slider).to_have_attribute("aria-valuetext", "1.00")
    slider.press("ArrowLeft")
    shows(page, lesson.figure(last - 1, kind, p))
    page.get_by_role("combobox", name="kind").select_option("cosine")
    shows(page, lesson.figure(last - 1, 1, p))
    slider.press("Home")
    shows(page, lesson.figure(0, 1, p))


def test_a_click_on_the_map_takes_the_nearest_place_and_arrows_the_next_one(
    lesson, visit
):
    page = visit(lesson.file)
    height, kind, _ = lesson.starts
    the_map = page.get_by_role(
        "application", name=re.compile("map of the parametric bias")
    )
    control = lesson.drawn["controls"][2]
    places = np.array(control["places"])
    said = page.locator(".place output")
    expect(said).to_have_text("heavy")

    # A place of the lattice, which has no name: a click beside it
    chosen = len(places) - 1
    side = the_map.bounding_box()["width"]
    half = side / 2 - 1.9 * 14  # what the names of the axes leave, in their letters
    x, y = side / 2 + half * places[chosen] / control["map"]["reach"] * [1, -1]
    the_map.click(position={"x": x + 5, "y": y - 5})
    x, y = (f"{value:.2f}" for value in places[chosen])
    expect(said).to_have_text(f"PC1 of p: {x}, PC2 of p: {y}")
    shows(page, lesson.figure(height, kind, chosen))

    # An arrow key takes a place that lies in its direction, and shows its figure
    the_map.focus()
    before = base64_of(page.locator("img"))
    the_map.press("ArrowLeft")
    expect(page.locator("img")).not_to_have_attribute("src", WEBP + before)
    shown = base64_of(page.locator("img"))
    figures = [lesson.figure(height, kind, k) for k in range(len(places))]
    (left,) = [k for k, each in enumerate(figures) if each["picture"] == shown]
    way = places[left] - places[chosen]
    assert way[0] <= -abs(way[1])


def test_without_javascript_the_still_stands_alone(lesson, browser):
    page = browser.new_context(java_script_enabled=False, offline=True).new_page()
    page.goto(lesson.file.as_uri())
    expect(page.locator("img")).to_have_attribute("src", STILL + lesson.still)
    expect(page.locator("img")).to_be_visible()
    assert page.locator("input, select, canvas").count() == 0
    page.context.close()


def test_on_paper_a_figure_stands_without_its_controls(lesson, visit):
    page = visit(lesson.file)
    page.emulate_media(media="print")
    expect(page.locator("img")).to_be_visible()
    for control in page.locator("input, select, canvas").all():
        expect(control).to_be_hidden()


def test_it_fits_a_phone_and_everything_has_a_name(lesson, visit, axe):
    page = visit(lesson.file)
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.evaluate(axe)
    found = page.evaluate(
        "axe.run(document, {resultTypes: ['violations'], preload: false})"
    )
    assert [
        (each["id"], each["nodes"][0]["html"][:99]) for each in found["violations"]
    ] == []
    expect(
        page.get_by_text("fewer stops here than in a running notebook")
    ).to_be_visible()


def test_where_the_figures_are_missing_it_says_so_and_the_still_stands(lesson, page):
    page.route("**/drawn/*", lambda route: route.abort())
    page.goto(lesson.file.as_uri())
    page.get_by_role("slider").press("End")
    expect(page.locator(".drawn p[role=status]")).to_contain_text("can't be shown")
    expect(page.locator("img")).to_have_attribute("src", STILL + lesson.still)


def last_figures(name):
    """The last figure that each widget drew in the runs of a notebook."""
    for kind in ("small", "instructor"):
        run = ROOT / "build" / kind / f"{name}.ipynb"
        cells = nbformat.read(run, as_version=4).cells if run.exists() else []
        for output in (each for cell in cells for each in cell.get("outputs", [])):
            if figures := output.get("data", {}).get(MIME):
                yield figures["figures"][-1]["picture"]


def test_a_page_of_a_notebook_has_the_figures_of_its_run(site, visit):
    page = visit(site / "notebooks" / "07_model_predictive_control.html")
    figure = page.locator(".drawn").first
    figure.get_by_role("slider").press("End")
    image = figure.locator("img")
    expect(image).to_have_attribute("src", re.compile(WEBP))
    assert base64_of(image) in [*last_figures("07_model_predictive_control")]
