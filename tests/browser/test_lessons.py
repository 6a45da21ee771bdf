"""The controls of lessons: each slider, menu and map draws another figure.

A lesson runs with CI's small sizes and its solutions up to its last control, which
somebody without a mouse then moves.
"""

import ast
import os
from collections import Counter

import nbformat
import pytest
from browser_lab import Notebook
from playwright.sync_api import Locator, Page

from course.solutions import solved, tags

pytestmark = pytest.mark.browser

# The controls of each lesson, by their names in its code
LESSONS = {
    "00_start_here": ["tasks"],
    "01_cloth_simulation": ["spring_control", "control"],
    "02_variable_stiffness": ["pair_control", "push_control", "control"],
    "03_data_and_images": ["player", "walk"],
    "06_online_estimation": ["viewer"],
    "07_model_predictive_control": ["by_hand"],
    "07b_why_the_plan_fails": ["both_plans"],
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
deaf
"""


def code_before(lesson: nbformat.NotebookNode, controls: list[str]) -> str:
    """All code of a lesson up to the last of these controls, which shows nothing."""
    ends = [cell.source.split("\n")[-1] in controls for cell in lesson.cells]
    last = len(ends) - ends[::-1].index(True)
    lines = ["%%capture"]
    for cell in lesson.cells[:last]:
        if cell.cell_type == "code" and not {"stub", "claim"} & {*tags(cell)}:
            lines.append(cell.source)
    return "\n".join(lines)


def run(notebook: Notebook, page: Page) -> None:
    """Run all, and wait for the first figure: a lesson computes before that."""
    notebook.run_all()
    page.locator(".jp-CodeCell").nth(1).scroll_into_view_if_needed()
    page.locator("img.widget-image").first.wait_for(timeout=240_000)
    notebook.connect()


def moved(
    notebook: Notebook, page: Page, number: int, name: str, patience: float = 40
) -> dict[str, bool]:
    """Which parts of a control draw another figure within some time when moved.

    It stands in the cell of this number.
    """
    cell = page.locator(".jp-CodeCell").nth(number)
    cell.scroll_into_view_if_needed()
    parts = f"[(k, type(w).__name__) for k, w in {name}.controls.items()]"
    drawn = {}
    counts = Counter()
    for part, kind in ast.literal_eval(notebook.evaluate(parts)):
        role = ROLES.get(kind, "slider")
        element = cell.get_by_role(role).nth(counts[role])
        counts[role] += 1
        drawn[part] = draws(notebook, element, role, name, part, patience)
    return drawn


def draws(
    notebook: Notebook,
    element: Locator,
    role: str,
    name: str,
    part: str,
    patience: float,
) -> bool:
    """Whether another figure is drawn when one part of a control is moved."""
    value = f"{name}.controls[{part!r}].value"
    text = f"str({value})"
    picture = f"hash({name}.picture.value)"
    start = notebook.evaluate(value)
    before = notebook.evaluate(text)
    figure = notebook.evaluate(picture)

    # Move it, and see what comes of it
    for act in ACTS[role]:
        if notebook.evaluate(text) == before:
            act(element)
            notebook.page.wait_for_timeout(500)
    notebook.until(f"{text} != {before}")
    try:
        notebook.until(f"{picture} != {figure}", patience)
        drawn = True
    except TimeoutError:
        drawn = False
    notebook.until(f"{name}.message.value == ''")

    # Back to where it was: at another end a second control may have no effect
    if role == "slider":
        notebook.evaluate(f"setattr({name}.controls[{part!r}], 'value', {start})")
        notebook.until(f"{picture} == {figure}", 40)
    return drawn


@pytest.mark.parametrize("lesson", TRIED)
def test_every_control_draws_another_figure_and_a_deaf_one_is_told(
    lab, page, screenshot, lesson
):
    controls = LESSONS[lesson]
    whole = nbformat.read(lab.notebooks / f"{lesson}.ipynb", as_version=4)
    file = f"controls_{lesson}.ipynb"
    lab.add(file, [code_before(solved(whole), controls), *controls, DEAF])
    notebook = Notebook(lab, page, file)
    run(notebook, page)
    try:
        for number, name in enumerate(controls, start=1):
            drawn = moved(notebook, page, number, name)
            assert drawn == dict.fromkeys(drawn, True), name
            assert drawn
            notebook.evaluate(f"{name}.check()")
        screenshot(f"controls-{lesson}")
        deaf = moved(notebook, page, len(controls) + 1, "deaf", patience=2)
        assert deaf == {"size": False}
    finally:
        lab.stop_kernel(notebook.name)
    assert notebook.errors == []
