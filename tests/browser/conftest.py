"""JupyterLab and Chromium for the tests, and screenshots of what they do."""

import pytest
from jupyter import ROOT, Lab, Notebook, lacks_chromium, launch_options

SCREENSHOTS = ROOT / "build" / "screenshots"


@pytest.fixture(scope="session")
def browser_type_launch_args(browser_type_launch_args, browser_type):
    if lacks_chromium(browser_type):
        pytest.skip("NO CHROMIUM: apt-get install chromium")
    return browser_type_launch_args | launch_options()


@pytest.fixture(scope="session")
def browser_context_args(browser_context_args):
    return browser_context_args | {"viewport": {"width": 1500, "height": 1100}}


@pytest.fixture(scope="session")
def lab(
    tmp_path_factory, browser_type_launch_args
):  # no server without a browser to look at it
    lab = Lab(tmp_path_factory.mktemp("lab"))
    lab.wait()
    yield lab
    lab.close()


@pytest.fixture(scope="module")
def page(browser, browser_context_args):
    """One page for all tests of a module."""
    context = browser.new_context(**browser_context_args)
    yield context.new_page()
    context.close()


@pytest.fixture(scope="module")
def open_notebook(lab, page):
    """Opens and runs a notebook of these cells; in the end, its page may not have
    complained.
    """
    opened = []

    def open_notebook(name, cells):
        lab.add(name, cells)
        opened.append(Notebook(lab, page, name))
        opened[-1].run_all()
        return opened[-1]

    yield open_notebook
    assert [error for each in opened for error in each.errors] == []


@pytest.fixture
def screenshot(page):
    """Keeps what the page shows, under a name."""

    def screenshot(name):
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=SCREENSHOTS / f"{name}.png")

    return screenshot
