"""The site of `make book`, opened from its folder in a browser without a network, as a
student would.
"""

import html
import re
from functools import cache
from urllib.parse import unquote, urlsplit

import nbformat
import pytest
from browser_lab import ROOT
from bs4 import BeautifulSoup
from playwright.sync_api import expect

from course import repository
from course.solutions import solved

pytestmark = pytest.mark.book

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@cache
def parsed(file):
    return BeautifulSoup(file.read_text("utf-8"), "html.parser")


@cache
def anchors(file):
    return {
        html.unescape(each)
        for each in re.findall(r'\bid="([^"]+)"', file.read_text("utf-8"))
    }


def test_it_opens_without_a_network_and_without_complaint(page_file, visit, axe):
    page = visit(page_file)
    broken = "[...document.images].filter((each) => !each.hidden && each.complete && !each.naturalWidth).map((each) => each.src)"
    assert page.evaluate(broken) == []
    assert (
        page.evaluate(
            "[...document.querySelectorAll('mjx-merror')].map((each) => each.textContent)"
        )
        == []
    )
    unset = "[...document.querySelectorAll('.math')].filter((each) => !each.querySelector('mjx-container')).length"
    assert page.evaluate(unset) == 0, "formulas that were not set"
    page.evaluate(axe)
    # It would fetch style sheets, which are files
    options = {"resultTypes": ["violations"], "preload": False}
    found = page.evaluate("(options) => axe.run(document, options)", options)[
        "violations"
    ]
    serious = [each for each in found if each["impact"] in ("serious", "critical")]
    assert [(each["id"], each["nodes"][0]["html"][:200]) for each in serious] == []


def test_pictures_have_alternative_texts(page_file):
    for image in parsed(page_file).find_all("img"):
        alt = image.get("alt", "")
        assert re.search(r"\w{3}", alt), image["src"][:80]
        assert not re.search(r"\.(png|jpe?g|gif|svg)$", alt), (
            "a file's name says nothing"
        )


def test_links_lead_somewhere(page_file):
    for tag in parsed(page_file).find_all(
        lambda tag: tag.get("href") or tag.get("src")
    ):
        link = tag.get("href") or tag["src"]
        ours = f"{repository.address()}/blob/{repository.BRANCH}/"
        if link.startswith(ours):
            assert (ROOT / unquote(urlsplit(link[len(ours) :]).path)).exists(), tag
        parts = urlsplit(link)
        if parts.scheme in ("http", "https", "data", "mailto"):
            continue
        target = (
            (page_file.parent / unquote(parts.path)).resolve()
            if parts.path
            else page_file
        )
        assert target.is_file(), tag
        if parts.fragment and target.suffix == ".html":
            assert unquote(parts.fragment) in anchors(target), tag


def test_a_page_begins_with_where_its_notebook_runs_without_an_installation(page_file):
    found = parsed(page_file).select("article .open-elsewhere a")
    if page_file.stem in ("search", "genindex"):
        assert found == []
        return
    own = f"notebooks/{page_file.stem}.ipynb"
    notebook = own if page_file.parent.name == "notebooks" else repository.START
    doors = repository.doors(notebook) | {"repository": repository.address()}
    throw, *others = found
    assert (page_file.parent / throw["href"]).name in ("throw.html", "#")
    assert {link.text: link["href"] for link in others} == doors


def test_the_series_is_listed_in_order_by_the_titles_of_the_notebooks(site, visit):
    listed = visit(site / "index.html").locator(".sidebar-tree a[href^='notebooks/']")
    first = [nbformat.read(path, as_version=4).cells[0].source for path in NOTEBOOKS]
    titles = [text.splitlines()[0].removeprefix("# ") for text in first]
    assert [each.strip() for each in listed.all_text_contents()] == titles


def test_a_search_finds_the_page(site, visit):
    page = visit(site / "search.html")
    page.get_by_role("searchbox").or_(page.locator("input[name=q]")).last.fill(
        "chamfer"
    )
    page.keyboard.press("Enter")
    expect(
        page.locator("#search-results a").filter(has_text="Data and images").first
    ).to_be_visible(timeout=15_000)


def test_a_solution_is_folded_and_opens_and_videos_wait(site, visit):
    page = visit(site / "notebooks" / "10_iterative_learning_control.html")
    solution = page.locator("details", has_text="Show a solution")
    assert bool(solution.count()) == (site.parent.name == "book")
    if solution.count():
        code = solution.first.locator("pre")
        expect(code).to_be_hidden()
        solution.first.locator("summary").click()
        expect(code).to_be_visible()
    video = page.locator("video").first
    assert video.get_attribute("aria-label")
    assert video.evaluate("each => [each.autoplay, each.controls]") == [False, True]
    video.evaluate("each => { each.muted = true; return each.play(); }")
    page.wait_for_function(
        "document.querySelector('video').currentTime > 0.2", timeout=15_000
    )


def answers(path):
    """Lines that only a notebook's solutions have."""
    cells = solved(nbformat.read(path, as_version=4)).cells
    solutions = [cell for cell in cells if "solution" in cell.metadata.get("tags", [])]
    others = "\n".join(cell.source for cell in cells if cell not in solutions)
    lines = [line for cell in solutions for line in cell.source.splitlines()]
    long = [line.strip() for line in lines if len(line) > 30]
    return [line for line in long if line not in others]


def test_students_find_no_solution_in_any_file():
    site = ROOT / "build" / "book-student" / "html"
    if not site.exists():
        pytest.skip("NO STUDENT SITE: run `make book STUDENT=1`")
    files = [
        file
        for kind in ("html", "js", "txt")
        for file in site.rglob(f"*.{kind}")
        if "mathjax" not in file.parts
    ]
    texts = [
        html.unescape(re.sub(r"<[^>]*>", "", file.read_text("utf-8", errors="replace")))
        for file in files
    ]
    texts += [
        cell.source
        for file in site.rglob("*.ipynb")
        for cell in nbformat.read(file, as_version=4).cells
    ]
    read = "\n".join(texts)
    assert [
        (path.stem, line)
        for path in NOTEBOOKS
        for line in answers(path)
        if line in read
    ] == []
