"""The site of `make book`, opened from its folder in a browser without a network, as a student would."""

import re
from functools import cache
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import nbformat
import pytest
from browser_lab import ROOT
from playwright.sync_api import expect

pytestmark = pytest.mark.book

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SERIOUS = ("serious", "critical")


class Page(HTMLParser):
    """What a page links to, what can be linked to in it, and its pictures.

    Attributes:
        links: addresses that it links to or loads.
        anchors: names within it.
        images: attributes of each picture.
        titles: texts of its headings of the first level.
    """

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self.images, self.titles = [], set(), [], []
        self._title = False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        about = dict(attributes)
        self.links += [about[name] for name in ("href", "src") if about.get(name)]
        self.anchors |= {about[name] for name in ("id", "name") if about.get(name)}
        self.images += [about] if tag == "img" else []
        if tag == "h1":
            self.titles.append("")
        self._title = tag == "h1" or (self._title and tag != "a")

    def handle_endtag(self, tag):
        self._title = self._title and tag != "h1"

    def handle_data(self, data):
        if self._title:
            self.titles[-1] += data


@cache
def parsed(file):
    return Page(file.read_text("utf-8"))


def test_it_opens_without_a_network_and_without_complaint(page_file, visit, axe):
    page = visit(page_file)
    broken = "[...document.images].filter((each) => each.complete && !each.naturalWidth).map((each) => each.src)"
    assert page.evaluate(broken) == []
    assert page.evaluate("[...document.querySelectorAll('mjx-merror')].map((each) => each.textContent)") == []
    unset = "[...document.querySelectorAll('.math')].filter((each) => !each.querySelector('mjx-container')).length"
    assert page.evaluate(unset) == 0, "formulas that were not set"
    page.evaluate(axe)
    options = {"resultTypes": ["violations"], "preload": False}  # it would fetch style sheets, which are files
    found = page.evaluate("(options) => axe.run(document, options)", options)["violations"]
    serious = [(each["id"], each["nodes"][0]["html"][:200]) for each in found if each["impact"] in SERIOUS]
    assert serious == []


def test_pictures_have_alternative_texts(page_file):
    for image in parsed(page_file).images:
        alt = image.get("alt") or ""
        assert re.search(r"\w{3}", alt), image["src"][:80]
        assert not re.search(r"\.(png|jpe?g|gif|svg)$", alt), "a file's name says nothing"


def test_figures_are_folded_in_words(page_file):
    figures = [image for image in parsed(page_file).images if "chart" in image.get("alt", "").split(";")[0]]
    assert page_file.read_text("utf-8").count('class="figure-in-words"') >= len(figures)


def test_links_lead_somewhere(page_file):
    for link in parsed(page_file).links:
        parts = urlsplit(link)
        if parts.scheme in ("http", "https", "data", "mailto"):
            continue
        target = (page_file.parent / unquote(parts.path)).resolve() if parts.path else page_file
        assert target.is_file(), link
        if parts.fragment and target.suffix == ".html":
            assert unquote(parts.fragment) in parsed(target).anchors, link


def test_nothing_is_loaded_from_elsewhere(page_file):
    text = page_file.read_text("utf-8")
    assert not re.search(r"<(?:script|link|img|source|iframe)\b[^>]*(?:src|href)=\"(?:https?:)?//", text)


def test_a_page_has_one_title(page_file):
    if page_file.name not in ("search.html",):
        assert len(parsed(page_file).titles) == 1


def test_the_series_is_listed_in_order_by_the_titles_of_the_notebooks(site, visit):
    listed = visit(site / "index.html").locator(".sidebar-tree ul").first.locator("a")
    first = [nbformat.read(path, as_version=4).cells[0].source for path in NOTEBOOKS]
    assert [each.strip() for each in listed.all_text_contents()] == [
        text.splitlines()[0].removeprefix("# ") for text in first
    ]


def test_a_search_finds_the_page(site, visit):
    page = visit(site / "search.html")
    page.get_by_role("searchbox").or_(page.locator("input[name=q]")).last.fill("chamfer")
    page.keyboard.press("Enter")
    expect(page.locator("#search-results a").filter(has_text="Seeing the cloth").first).to_be_visible(timeout=15_000)


def test_a_solution_is_folded_and_opens(visit):
    site = ROOT / "build" / "book" / "html"
    if not site.exists():
        pytest.skip("NO SITE IN build/book: run `make book`")
    page = visit(site / "notebooks" / "00_start_here.html")
    solution = page.locator("details", has_text="Show a solution").first
    code = solution.locator("pre")
    expect(code).to_be_hidden()
    solution.locator("summary").click()
    expect(code).to_be_visible()


def test_videos_wait_and_can_be_played(site, visit):
    page = visit(site / "notebooks" / "00_start_here.html")
    if not page.locator("video").count():
        pytest.skip("THIS SITE WAS BUILT WITHOUT A RUN of notebook 00")
    video = page.locator("video").first
    assert video.get_attribute("aria-label")
    assert video.evaluate("each => [each.autoplay, each.controls]") == [False, True]
    video.evaluate("each => { each.muted = true; return each.play(); }")
    page.wait_for_function("document.querySelector('video').currentTime > 0.2", timeout=15_000)


def test_every_notebook_can_be_downloaded(site):
    editions = ["student"] if site.parent.name == "book-student" else ["student", "instructor"]
    held = {file.name for file in (site / "_downloads").rglob("*.ipynb")}
    assert {path.name for path in NOTEBOOKS} <= held
    for path in NOTEBOOKS:
        links = [link for link in parsed(site / "notebooks" / f"{path.stem}.html").links if link.endswith(path.name)]
        assert len(links) == len(editions)
    assert {file.stem for file in (site / "_downloads").rglob("*.zip")} == set(editions)


def answers(path):
    """Lines that only a notebook's solutions have."""
    cells = nbformat.read(path, as_version=4).cells
    others = {line for cell in cells if "solution" not in tags(cell) for line in cell.source.splitlines()}
    for cell in cells:
        if "solution" in tags(cell):
            yield from (line.strip() for line in cell.source.splitlines() if line not in others and len(line) > 30)


def tags(cell):
    return cell.metadata.get("tags", [])


def test_students_find_no_solution_in_any_file():
    site = ROOT / "build" / "book-student"
    if not site.exists():
        pytest.skip("NO STUDENT SITE: run `make book STUDENT=1`")
    strip = re.compile(r"<[^>]*>")
    told = ""
    for file in (site / "html").rglob("*"):
        if file.suffix == ".html":
            told += strip.sub("", file.read_text("utf-8"))
        elif file.suffix == ".ipynb":
            told += "\n".join(cell.source for cell in nbformat.read(file, as_version=4).cells)
        elif file.suffix in (".js", ".txt", ".inv") and "mathjax" not in file.parts:
            told += file.read_text("utf-8", errors="replace")
    told = told.replace("&quot;", '"').replace("&#39;", "'").replace("&lt;", "<").replace("&gt;", ">")
    told = told.replace("&amp;", "&")
    given = [(path.stem, line) for path in NOTEBOOKS for line in answers(path) if line in told]
    assert given == []


def test_the_site_says_which_edition_it_is(site):
    assert ("student edition" in (site / "index.html").read_text("utf-8")) == (site.parent.name == "book-student")
