"""JupyterLab and Chromium for the tests, and screenshots of what they do."""

import pytest
from browser_lab import ROOT, Lab, Notebook, faults_in, lacks_chromium, launch_options

SCREENSHOTS = ROOT / "build" / "screenshots"


@pytest.fixture(scope="session")
def browser_type_launch_args(browser_type_launch_args, browser_type):
    if reason := lacks_chromium(browser_type):
        pytest.skip(reason)
    return browser_type_launch_args | launch_options()


@pytest.fixture(scope="session")
def browser_context_args(browser_context_args):
    return browser_context_args | {"viewport": {"width": 1500, "height": 1100}}


@pytest.fixture(scope="session")
def lab(
    tmp_path_factory, browser_type_launch_args
):  # no server without a browser to look at it
    folder = tmp_path_factory.mktemp("lab")
    lab = Lab(folder)
    lab.folder = folder
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
    """A notebook by its name; in the end, neither its page nor the server may have
    complained.
    """
    opened = []

    def open_notebook(name):
        opened.append(Notebook(lab, page, name))
        return opened[0]

    yield open_notebook
    for notebook in opened:
        lab.stop_kernel(notebook.name)
    assert opened[0].errors == []
    assert faults_in(lab.log.read_text()) == []


@pytest.fixture
def screenshot_of():
    """Keeps what a page shows, under a name."""

    def screenshot_of(page, name):
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=SCREENSHOTS / f"{name}.png")

    return screenshot_of


@pytest.fixture
def screenshot(page, screenshot_of):
    return lambda name: screenshot_of(page, name)
