"""The site of `make docs`, opened from its folder in a browser, as a student would."""

import html
import re
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat
import pytest
import repository
from bs4 import BeautifulSoup
from playwright.sync_api import expect
from repository import ROOT

pytestmark = pytest.mark.book

SITE = ROOT / "build" / "book" / "html"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
# A page of each kind stands for its kind
NAMES = (
    "index",
    "README",
    "docs/glossary",
    "docs/course/README",
    "notebooks/03_data_and_images",
    "notebooks/07_model_predictive_control",
    "reference/clothlab.method.control",
)

each_page = pytest.mark.parametrize("file", [SITE / f"{name}.html" for name in NAMES])


@pytest.fixture(autouse=True)
def built():
    """Nothing is said about a site that is not there, and that loudly."""
    if not SITE.exists():
        pytest.skip("NO SITE IN build/book: run `make docs SMALL=1`")


@pytest.fixture
def visit(page):
    """Open a file; what the page complained of, beside the network, ends the test."""
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.route(re.compile("^https?:"), lambda asked: asked.abort())

    def visit(file):
        page.goto(file.as_uri())
        return page

    yield visit
    assert complaints == []


@cache
def parsed(file):
    return BeautifulSoup(file.read_text("utf-8"), "html.parser")


@cache
def anchors(file):
    text = file.read_text("utf-8")
    return {html.unescape(each) for each in re.findall(r'\bid="([^"]+)"', text)}


@each_page
def test_it_opens_without_complaint_and_can_be_read_by_all(file, visit):
    page = visit(file)
    broken = "[...document.images].filter((each) => !each.hidden && each.complete && !each.naturalWidth).map((each) => each.src)"
    assert page.evaluate(broken) == []
    package = pytest.importorskip("axe_playwright_python")
    page.evaluate((Path(package.__file__).parent / "axe.min.js").read_text())
    # It would fetch style sheets, which are files
    options = {"resultTypes": ["violations"], "preload": False}
    judge = "(options) => axe.run(document, options)"
    found = page.evaluate(judge, options)["violations"]
    serious = [each for each in found if each["impact"] in ("serious", "critical")]
    assert [(each["id"], each["nodes"][0]["html"][:200]) for each in serious] == []


@each_page
def test_pictures_have_alternative_texts(file):
    for image in parsed(file).find_all("img"):
        alt = image.get("alt", "")
        assert re.search(r"\w{3}", alt), image["src"][:80]
        assert not re.search(r"\.(png|jpe?g|gif|svg)$", alt), (
            "a file's name says nothing"
        )


@each_page
def test_links_lead_somewhere(file):
    for tag in parsed(file).find_all(lambda tag: tag.get("href") or tag.get("src")):
        link = tag.get("href") or tag["src"]
        ours = f"{repository.address()}/blob/{repository.BRANCH}/"
        if link.startswith(ours):
            assert (ROOT / unquote(urlsplit(link[len(ours) :]).path)).exists(), tag
        parts = urlsplit(link)
        if parts.scheme in ("http", "https", "data", "mailto"):
            continue
        target = file
        if parts.path:
            target = (file.parent / unquote(parts.path)).resolve()
        assert target.is_file(), tag
        if parts.fragment and target.suffix == ".html":
            assert unquote(parts.fragment) in anchors(target), tag


@each_page
def test_a_page_begins_with_where_its_notebook_runs_without_an_installation(file):
    links = parsed(file).select("article .open-elsewhere a")
    found = {link.text: link["href"] for link in links}
    found.pop("Throw a cloth now", None)  # another test follows it
    own = f"notebooks/{file.stem}.ipynb"
    notebook = own if file.parent.name == "notebooks" else repository.START
    places = repository.without_installation(notebook)
    if repository.address():
        places["repository"] = repository.address()
    assert found == places


def test_the_series_is_listed_in_order_by_the_titles_of_the_notebooks(visit):
    listed = visit(SITE / "index.html").locator(".sidebar-tree a[href^='notebooks/']")
    first = [nbformat.read(path, as_version=4).cells[0].source for path in NOTEBOOKS]
    titles = [text.splitlines()[0].removeprefix("# ") for text in first]
    assert [each.strip() for each in listed.all_text_contents()] == titles


def test_a_search_finds_the_page(visit):
    page = visit(SITE / "search.html")
    page.get_by_role("searchbox").or_(page.locator("input[name=q]")).last.fill(
        "hourglass"
    )
    page.keyboard.press("Enter")
    found = page.locator("#search-results a").filter(
        has_text="Three numbers for an image"
    )
    expect(found.first).to_be_visible(timeout=15_000)


def test_a_solution_is_folded_and_opens_and_videos_wait(visit):
    page = visit(SITE / "notebooks" / "10_iterative_learning_control.html")
    solution = page.locator("details", has_text="Show a solution")
    code = solution.first.locator("pre")
    expect(code).to_be_hidden()
    solution.first.locator("summary").click()
    expect(code).to_be_visible()
    video = page.locator("video").first
    assert video.get_attribute("aria-label")
    assert video.evaluate("each => [each.autoplay, each.controls]") == [False, True]
