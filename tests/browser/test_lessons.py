"""The controls of lessons: each slider, menu and map draws another figure.

A lesson runs with CI's small sizes and its solutions up to its last control, which
somebody without a mouse then moves.
"""

import os

import nbformat.v4
import pytest
from browser_lab import Notebook
from playwright.sync_api import Page

from course.solutions import solved, tags

pytestmark = pytest.mark.browser

# The controls of each lesson, by their names in its code
LESSONS = {
    "00_start_here": ["tasks"],
    "01_cloth_simulation": ["spring_control", "control"],
    "02_variable_stiffness": ["push_control", "control"],
    "03_data_and_images": ["player", "walk"],
    "06_online_estimation": ["walker"],
    "07_model_predictive_control": ["by_hand"],
}
# One stands for all where not every page is asked for (`make nightly` does)
TRIED = [*LESSONS] if "CLOTHLAB_PAGES" in os.environ else ["02_variable_stiffness"]
ROLES = {"Dropdown": "combobox", "PBMap": "application"}
# What moves each; a slider that is at its end goes to its beginning
ACTS = {
    "slider": [lambda it: it.press("End"), lambda it: it.press("Home")],
    "combobox": [lambda it: it.select_option(index=1)],
    "application": [lambda it: it.press("ArrowUp")],
}
DEAF = """
from matplotlib.figure import Figure
from clothlab.lab import Control

def draw(size=1.0):
    return Figure()

deaf = Control(draw, size=(0.0, 2.0, 1.0))
"""


def shown(notebook_of_lesson, controls: list[str]):
    """A notebook with all code of a lesson in its first cell, and a control in each of
    the others.
    """
    lines = ["%%capture"]
    end = max(
        k
        for k, cell in enumerate(notebook_of_lesson.cells)
        if cell.source.split("\n")[-1] in controls
    )
    for cell in notebook_of_lesson.cells[: end + 1]:
        if cell.cell_type == "code" and not {"stub", "claim"} & {*tags(cell)}:
            lines.append(cell.source)
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    cells = ["\n".join(lines), *controls]
    return nbformat.v4.new_notebook(
        cells=[nbformat.v4.new_code_cell(source) for source in cells], metadata=kernel
    )


def run(notebook: Notebook, page: Page) -> None:
    """Run all, and wait for the first figure: a lesson computes before that."""
    notebook.run_all()
    page.locator(".jp-CodeCell").nth(1).scroll_into_view_if_needed()
    page.locator("img.widget-image").first.wait_for(timeout=240_000)
    notebook.connect()


def moved(notebook: Notebook, page: Page, number: int, name: str) -> dict[str, bool]:
    """Which parts of a control draw another figure when an arrow key moves them."""
    cell = page.locator(".jp-CodeCell").nth(number)
    cell.scroll_into_view_if_needed()
    drawn = {}
    kinds = notebook.evaluate(
        f"'|'.join(f'{{k}}={{type(w).__name__}}' for k, w in {name}.controls.items())"
    )
    counts: dict[str, int] = {}  # parts of each role so far
    for each in kinds.strip("'").split("|"):
        part, kind = each.split("=")
        role = ROLES.get(kind, "slider")
        element = cell.get_by_role(role).nth(counts.get(role, 0))
        counts[role] = counts.get(role, 0) + 1

        raw = f"{name}.controls[{part!r}].value"
        value, start = f"str({raw})", notebook.evaluate(raw)
        picture = f"hash({name}.picture.value)"
        before, figure = notebook.evaluate(value), notebook.evaluate(picture)
        for act in ACTS[role]:
            if notebook.evaluate(value) == before:
                act(element)
                page.wait_for_timeout(500)
        notebook.until(f"{value} != {before}")
        try:
            notebook.until(f"{picture} != {figure}", 2 if name == "deaf" else 40)
            drawn[part] = True
        except TimeoutError:
            drawn[part] = False
        notebook.until(f"{name}.message.value == ''")

        # Back to where it was: at another end a second control may have no effect
        if role == "slider":
            notebook.evaluate(f"setattr({name}.controls[{part!r}], 'value', {start})")
            notebook.until(f"{picture} == {figure}", 40)
    return drawn


@pytest.mark.parametrize("lesson", TRIED)
def test_every_control_draws_another_figure(lab, page, screenshot, lesson):
    file = lab.folder / "notebooks" / f"{lesson}.ipynb"
    controls = LESSONS[lesson]
    made = shown(solved(nbformat.read(file, as_version=4)), controls)
    nbformat.write(made, lab.folder / "notebooks" / f"controls_{lesson}.ipynb")
    notebook = Notebook(lab, page, f"controls_{lesson}.ipynb")
    run(notebook, page)
    try:
        for number, name in enumerate(controls, start=1):
            drawn = moved(notebook, page, number, name)
            assert drawn == dict.fromkeys(drawn, True), name
            assert drawn
            notebook.evaluate(f"{name}.check()")
        screenshot(f"controls-{lesson}")
    finally:
        lab.stop_kernel(notebook.name)
    assert notebook.errors == []


def test_a_control_that_hears_nothing_is_told(lab, page):
    cells = [nbformat.v4.new_code_cell(source) for source in (DEAF, "deaf")]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    made = nbformat.v4.new_notebook(cells=cells, metadata=kernel)
    nbformat.write(made, lab.folder / "notebooks" / "deaf.ipynb")
    notebook = Notebook(lab, page, "deaf.ipynb")
    run(notebook, page)
    try:
        assert moved(notebook, page, 1, "deaf") == {"size": False}
    finally:
        lab.stop_kernel(notebook.name)
