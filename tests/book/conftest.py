"""The sites that `make book` made, and a Chromium that has no network."""

import json
import os
import subprocess
from pathlib import Path

import format_javascript
import pytest
from browser_lab import ROOT, lacks_chromium, launch_options
from live_page import LOADING, WITHOUT_CHANCE, write_page

from course.lab_gates import GATES, keep
from course.lab_page import SOURCES
from course.npm import packages

SITES = {
    "instructor": ROOT / "build" / "book" / "html",
    "student": ROOT / "build" / "book-student" / "html",
}


# `make nightly` asks for it; else a page of each kind stands for its kind
ALL = "CLOTHLAB_PAGES" in os.environ
KINDS = {
    "index",
    "README",
    "results",
    "syllabus",
    "throw",
    "03_data_and_images",
    "07_model_predictive_control",
    "clothlab.method.control",
}


def pytest_generate_tests(metafunc):
    """A test of a `page_file` runs for pages of every site that was built."""
    if "page_file" in metafunc.fixturenames:
        found = [
            (name, file)
            for name, site in SITES.items()
            for file in sorted(site.rglob("*.html"))
        ]
        found = [each for each in found if ALL or each[1].stem in KINDS]
        ids = [f"{name}-{file.relative_to(SITES[name])}" for name, file in found]
        metafunc.parametrize(
            "page_file", [file for _, file in found] or [None], ids=ids or ["not built"]
        )


@pytest.fixture(autouse=True)
def built(request):
    """Nothing is said about a site that is not there, and that loudly."""
    if (
        "page_file" in request.fixturenames
        and request.getfixturevalue("page_file") is None
    ):
        pytest.skip(
            "NO SITE IN build/book: run `make book` (or `make book SMALL=1`, which is sooner)"
        )


@pytest.fixture(params=SITES)
def site(request):
    """The folder of a site."""
    if not (SITES[request.param] / "index.html").exists():
        pytest.skip(
            f"NO {request.param} SITE: run `make book{' STUDENT=1' * (request.param == 'student')}`"
        )
    return SITES[request.param]


@pytest.fixture(scope="session")
def browser_type_launch_args(browser_type_launch_args, browser_type):
    if reason := lacks_chromium(browser_type):
        pytest.skip(reason)
    return browser_type_launch_args | launch_options()


@pytest.fixture(scope="session")
def browser_context_args(browser_context_args):
    return browser_context_args | {
        "viewport": {"width": 1280, "height": 900},
        "offline": True,
    }


@pytest.fixture(scope="session")
def axe():
    """The source of axe-core, which its package brings along."""
    package = pytest.importorskip(
        "axe_playwright_python", reason="NO axe-core: `make book` installs it"
    )
    return (Path(package.__file__).parent / "axe.min.js").read_text()


@pytest.fixture
def visit(page):
    """Open a file in the browser; what it asked for beside files, and what it
    complained of, ends the test.
    """
    complaints = []
    page.on(
        "request",
        lambda asked: (
            asked.url.startswith(("file:", "data:", "blob:"))
            or complaints.append(asked.url)
        ),
    )
    page.on(
        "requestfailed",
        lambda asked: complaints.append(f"{asked.url[:200]}: {asked.failure}"),
    )
    page.on(
        "console",
        lambda said: said.type in ("error", "warning") and complaints.append(said.text),
    )
    page.on("pageerror", lambda error: complaints.append(str(error)))

    def visit(file, more=""):
        page.goto(file.as_uri() + more)
        page.wait_for_function(
            "!window.MathJax?.startup || MathJax.startup.promise.then(() => true)"
        )
        return page

    yield visit
    assert complaints == []


@pytest.fixture(scope="session")
def node(tmp_path_factory):
    """Run a script beside this file in the Node.js that Playwright brings along, with
    MuJoCo, the page's sources and what it is given as JSON; what it prints as JSON.
    """
    mujoco = packages()["@mujoco/mujoco"].folder / "mujoco.js"
    if not mujoco.exists():
        pytest.skip("NO FILES OF NPM: run `make npm`")
    given = tmp_path_factory.mktemp("node") / "given.json"

    def run(script, content):
        given.write_text(json.dumps(content))
        path = Path(__file__).with_name(script)
        command = [format_javascript.node(), path, mujoco, SOURCES, given]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="session")
def gate():
    """Hold a measured figure to its bound, and keep it for the table of gates."""

    def hold(name, measured):
        keep(name, float(measured))
        assert GATES[name].holds(measured), f"{name}: {measured}"

    return hold


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """The page "Throw a cloth" by itself."""
    if not packages()["onnxruntime-web"].folder.exists():
        pytest.skip("NO FILES OF NPM: run `make npm`")
    folder = tmp_path_factory.mktemp("page")
    write_page(folder)
    return folder


@pytest.fixture(scope="module")
def one_page(folder, browser):
    """A page that most tests share, and what it complained of."""
    page = browser.new_page(offline=True, viewport={"width": 1280, "height": 900})
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "console",
        lambda said: said.type in ("error", "warning") and complaints.append(said.text),
    )
    page.on(
        "request",
        lambda asked: (
            asked.url.startswith(("file:", "data:", "blob:"))
            or complaints.append(asked.url)
        ),
    )
    page.goto((folder / "throw.html").as_uri())
    page.wait_for_selector("[data-frame]", timeout=LOADING)
    page.workers[0].evaluate(WITHOUT_CHANCE)
    yield page, complaints
    page.close()
