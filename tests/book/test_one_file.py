"""The page "Throw a cloth" as one file, in a folder where nothing else lies."""

import numpy as np
import pytest
from live_page import LOADING, Lab
from playwright.sync_api import expect

from course.lab_page import ONE_FILE, write_one_file

pytestmark = pytest.mark.book

PERIODS = 3


@pytest.fixture
def file(folder, tmp_path):
    path = tmp_path / ONE_FILE
    write_one_file(path, folder / "_static" / "lab")
    return path


def test_a_robot_throws_in_it(file, visit, gate):
    gate("one file", file.stat().st_size / 1e6)
    page = visit(file)
    page.wait_for_selector("[data-frame]", timeout=LOADING)
    lab = Lab(page)
    for _ in range(8 * PERIODS):
        lab.tell("step")
    lab.wait(f"get('frame').clock.endsWith('step {8 * PERIODS}')")
    distances, still = lab.distances
    assert np.min(distances) < 0.6 * still


def test_the_recorded_run_is_in_it(file, visit):
    page = visit(file, "#recorded-run")
    time = page.get_by_role("slider", name="time [s]")
    expect(time).to_be_visible()
    Lab(page).press("start")
    expect(time).not_to_have_value("0")


def test_it_brings_the_licences_of_what_it_carries(file, visit):
    page = visit(file)
    with page.expect_download() as download:
        page.get_by_role("link", name="their licences").click()
    text = download.value.path().read_text("utf-8")
    assert "Apache License" in text
    assert "MIT License" in text
