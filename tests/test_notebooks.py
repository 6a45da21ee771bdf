"""The notebooks as one series: one template, every finding with its condition, nothing that stalls or hides errors."""

import ast
import json
import re
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PARTS = ("**Goals**", "**Prerequisites**: ", "**Working time**: ", "**Running time**: ")
FORMS = r"\*\*(Predict|Finding|Change this|Paper and here)\*\*"

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path, kind=None):
    return [cell for cell in json.loads(path.read_text())["cells"] if kind in (None, cell["cell_type"])]


def source(cell):
    return "".join(cell["source"])


def tags(cell):
    return cell["metadata"].get("tags", [])


@each_notebook
def test_it_is_stripped(path):
    notebook = json.loads(path.read_text())
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"
    assert "nbmake" not in notebook["metadata"], "mock belongs to the cell that is tagged parameters"
    for cell in cells(path, "code"):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


@each_notebook
def test_it_begins_and_ends_as_all_do(path):
    first = source(cells(path)[0])
    assert re.match(rf"# {path.stem[:2]} \w", first)
    for part in PARTS:
        assert part in first, f"the first cell lacks {part}"
    titles = [line for cell in cells(path, "markdown") for line in source(cell).splitlines() if line.startswith("## ")]
    assert titles[-3:] == ["## Exercises", "## Summary", "## References"]


@each_notebook
def test_cells_are_read_at_a_glance(path):
    for cell in cells(path, "code"):
        assert len(source(cell).splitlines()) <= 20, f"{source(cell)[:80]!r}… is too long for one idea"


def test_long_notebooks_stay_within_an_hour_and_a_half():
    size = {path.stem: len(cells(path)) for path in NOTEBOOKS}
    assert size["02_variable_stiffness"] <= 60
    assert size["08_control"] <= 60


@each_notebook
def test_predictions_findings_and_changes_have_one_form(path):
    for cell in cells(path, "markdown"):
        for line in source(cell).splitlines():
            if re.search(FORMS, line):
                assert re.match(rf"{FORMS}: \S", line), f"one form for all, at the start of a line: {line[:60]!r}"
            assert not re.search(r"\*\*(Predict|Finding|Change this)[.:]\*\*", line), f"{line[:60]!r}"


def claimed(path):
    """Each cell with a finding, and the cell after it."""
    all_cells = cells(path)
    for cell, after in zip(all_cells, [*all_cells[1:], None], strict=True):
        if cell["cell_type"] == "markdown" and re.search(
            r"^\*\*(Finding|Paper and here)\*\*", source(cell), re.MULTILINE
        ):
            yield source(cell), after


@each_notebook
def test_every_finding_is_followed_by_its_condition(path):
    for text, after in claimed(path):
        assert after is not None, f"nothing follows {text[:60]!r}"
        assert "claim" in tags(after), f"no condition follows {text[:60]!r}"
        assert re.search(r"findings\.(stored|live)\(", source(after))
        assert after["metadata"]["jupyter"]["source_hidden"], "a condition is folded"


@each_notebook
def test_conditions_follow_a_finding(path):
    claims = [cell for cell in cells(path) if "claim" in tags(cell)]
    assert len(claims) == len(list(claimed(path)))


@each_notebook
def test_there_are_findings(path):
    assert list(claimed(path)), f"{path.stem} finds nothing"


@each_notebook
def test_figures_in_findings_are_printed_and_not_typed(path):
    for text, _ in claimed(path):
        for paragraph in text.split("\n\n"):
            if paragraph.startswith("**Finding**"):
                assert not re.search(r"\d\.\d|\d ?%|\d per cent", paragraph), f"a figure is typed: {paragraph[:80]!r}"


def parameters(path):
    """The parameters of a notebook by name, as written and as CI has them."""
    for cell in cells(path, "code"):
        if "parameters" in tags(cell):
            body = ast.parse(source(cell)).body
            written = {node.targets[0].id: ast.literal_eval(node.value) for node in body}
            return written, cell["metadata"].get("nbmake", {}).get("mock", {})
    return {}, {}


@each_notebook
def test_parameters_are_plain_and_in_capitals(path):
    written, mock = parameters(path)
    assert all(name.isupper() for name in written), f"{list(written)}"
    assert set(mock) <= set(written), "CI changes only parameters that exist"
    for cell in cells(path, "code"):
        assert "parameters" in tags(cell) or "nbmake" not in cell["metadata"]


@each_notebook
def test_stored_findings_were_recorded_with_the_parameters_as_written(path):
    stored = ROOT / "data" / "results" / f"findings-{path.stem}.json"
    live = any("findings.live(" in source(cell) for cell in cells(path, "code"))
    assert stored.exists() == live, f"run `make findings RECORD=1` for {path.stem}"
    if live:
        written, _ = parameters(path)
        recorded = json.loads(stored.read_text())
        for name, value in recorded["parameters"].items():
            assert written[name] == value, f"{name} has changed: run `make findings RECORD=1`"
        code = "".join(source(cell) for cell in cells(path, "code"))
        for claim in recorded["figures"]:
            assert json.dumps(claim, ensure_ascii=False)[1:-1] in code or claim in code, f"nobody claims {claim!r}"


@each_notebook
def test_nothing_stalls_the_runner_or_swallows_errors(path):
    for cell in cells(path, "code"):
        assert not re.search(r"\binteract\w*\(|\bOutput\(", source(cell)), "use clothlab.lab.Control"
        code = ast.parse(source(cell))
        silent = [node for node in ast.walk(code) if isinstance(node, ast.Try)]
        assert not silent, "an error must show"


@each_notebook
def test_a_notebook_with_controls_ends_by_raising_their_errors(path):
    code = [source(cell) for cell in cells(path, "code")]
    controls = {name for each in code for name in re.findall(r"^(\w+) = (?:Control|LivePanel)\(", each, re.MULTILINE)}
    for name in controls:
        assert any(re.search(rf"^{name}\.check\(\)", each, re.MULTILINE) for each in code), f"{name}.check() is missing"


@each_notebook
def test_where_things_lie_is_asked_and_not_counted(path):
    for cell in cells(path, "code"):
        found = re.search(r"\[\.\.\., :3\]|\[:, :3\]|DPMPB\(7, 2|commands?\[[^\]]*, 2\]", source(cell))
        assert not found, f"{found[0]!r}: ask arm.layout or arm.stiffness_command"


@each_notebook
def test_links_lead_to_notebooks_that_exist(path):
    for cell in cells(path, "markdown"):
        for link in re.findall(r"\]\(([^)#:]+)\)", source(cell)):
            assert (path.parent / link).exists(), f"{link}"


def test_the_readme_maps_every_notebook():
    readme = (ROOT / "README.md").read_text()
    for path in NOTEBOOKS:
        assert f"notebooks/{path.name}" in readme
