"""The notebooks as one series: one template, every finding with its condition, nothing
that stalls or hides errors.
"""

import ast
import re
from itertools import pairwise
from pathlib import Path

import nbformat
import pytest
import series
from repository import number_of
from solutions import solved

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PARTS = ("**Goals**", "**Prerequisites**: ", "**Working time**: ", "**Running time**: ")

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path, kind=None):
    """The cells with solutions as code."""
    return [
        cell
        for cell in solved(nbformat.read(path, as_version=4)).cells
        if kind in (None, cell.cell_type)
    ]


def tags(cell):
    return cell.metadata.get("tags", [])


@each_notebook
def test_it_is_stripped(path):
    metadata = nbformat.read(path, as_version=4).metadata
    assert metadata.kernelspec.name == "python3"
    assert "nbmake" not in metadata, (
        "mock belongs to the cell that is tagged parameters"
    )
    assert not any(cell.outputs or cell.execution_count for cell in cells(path, "code"))


@each_notebook
def test_it_begins_and_ends_as_all_do(path):
    first = cells(path)[0].source
    assert re.match(rf"# {number_of(path)} \w", first)
    assert [part for part in PARTS if part not in first] == []
    titles = [
        line
        for cell in cells(path, "markdown")
        for line in cell.source.splitlines()
        if line.startswith("## ")
    ]
    ends = ["## Exercises", "## Questions", "## Summary", "## References"]
    part_two = number_of(path).startswith("1")
    optional = ["## Questions"] if part_two else ["## Exercises", "## Questions"]
    ends = [end for end in ends if end not in optional or end in titles]
    assert titles[-len(ends) :] == ends


def visible(path):
    """Code that a reader sees: neither folded nor a condition."""
    return [
        cell.source
        for cell in cells(path, "code")
        if not cell.metadata.get("jupyter", {}).get("source_hidden")
    ]


def lines(sources):
    return [line for source in sources for line in source.splitlines() if line.strip()]


def nested(source):
    """Whether a comprehension stands within another one."""
    kinds = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
    found = [node for node in ast.walk(ast.parse(source)) if isinstance(node, kinds)]
    return any(
        isinstance(inner, kinds)
        for node in found
        for inner in ast.walk(node)
        if inner is not node
    )


@each_notebook
def test_cells_are_read_at_a_glance(path):
    code = cells(path, "code")
    assert [
        cell.source
        for cell in code
        if len(cell.source.splitlines()) > 20 and "claim" not in tags(cell)
    ] == []
    assert [
        line for line in lines(cell.source for cell in code) if len(line) > 80
    ] == []
    assert [source for source in visible(path) if nested(source)] == []


@each_notebook
def test_headings_open_their_cells_and_imports_come_before_parameters(path):
    code_on_the_page = re.compile(r"```.*?```", re.DOTALL)  # where # is a comment
    texts = [code_on_the_page.sub("", cell.source) for cell in cells(path, "markdown")]
    assert [text for text in texts if re.search(r"\n#{1,4} ", text)] == []
    code = [cell for cell in cells(path, "code") if "colab" not in tags(cell)]
    assert re.match("(import|from) ", code[0].source)
    assert [k for k, cell in enumerate(code) if "parameters" in tags(cell)] in ([], [1])


def imports(source):
    """The statements of a cell that import from the package; studies come on top."""
    found = []
    for node in ast.walk(ast.parse(source)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module]
        found += [name for name in names if name.split(".")[0] == "clothlab"]
    return found


@each_notebook
def test_it_imports_from_the_package_in_five_lines(path):
    code = [cell for cell in cells(path, "code") if "claim" not in tags(cell)]
    assert len([name for cell in code for name in imports(cell.source)]) <= 5


@each_notebook
def test_its_last_text_says_how_to_free_its_memory(path):
    assert cells(path, "markdown")[-1].source.endswith(
        "\n\nFinished? *Kernel, Shut Down Kernel* frees its memory."
    )


@pytest.mark.parametrize(("path", "following"), [*pairwise(NOTEBOOKS)])
def test_it_leads_to_the_next_one(path, following):
    title = cells(following)[0].source.splitlines()[0].removeprefix("# ")
    text = "\n".join(cell.source for cell in cells(path, "markdown"))
    for link in re.findall(r"^Next: (\[.*?\]\(.*?\))", text, re.MULTILINE):
        assert link == f"[{title}]({following.name})"


@each_notebook
def test_the_readme_has_its_title_and_the_teachers_page_its_minutes(path):
    first = cells(path)[0].source
    title = first.splitlines()[0].removeprefix("# ")
    readme = (ROOT / "README.md").read_text("utf-8")
    appendix = path.name.startswith("A")  # the teacher's page lists them
    assert appendix or f"[{title}](notebooks/{path.name})" in readme
    (minutes,) = re.findall(
        rf"^\| \[{re.escape(title)}\]\(\.\./\.\./notebooks/{path.name}\) \| (\d+) \|",
        (ROOT / "docs" / "course" / "README.md").read_text("utf-8"),
        re.MULTILINE,
    )
    assert f"**Working time**: about {minutes} minutes." in first, "run `make format`"
    assert re.search(
        r"\*\*Running time\*\*: about \d+ (seconds|minutes) on two cores\.", first
    )


def test_tables_get_titles_minutes_and_hours_from_first_cells():
    times = {"00_a.ipynb": 70, "01_b.ipynb": 20, "10_c.ipynb": 60, "A1_d.ipynb": 99}
    begins = {
        name: f"# {name[:2]} New\n\n**Working time**: about {minutes} minutes."
        for name, minutes in times.items()
    }
    before = (
        "| [00 Old](notebooks/00_a.ipynb) | Why? | 5 |\n"
        "| [01 Old](../../notebooks/01_b.ipynb) | 5 | `one` · `two` |\n"
        "| 1. First | 00, 01 | 0.2 | discuss |\n"
        "Part I is about 9 hours, Part II 9."
    )
    assert series.with_times(before, begins) == (
        "| [00 New](notebooks/00_a.ipynb) | Why? | 70 |\n"
        "| [01 New](../../notebooks/01_b.ipynb) | 20 | `one` · `two` |\n"
        "| 1. First | 00, 01 | 1.5 | discuss |\n"
        "Part I is about 2 hours, Part II 1."
    )


@pytest.mark.parametrize("page", series.PAGES, ids=lambda page: page.parent.name)
def test_titles_minutes_and_hours_are_those_of_the_first_cells(page):
    text = page.read_text("utf-8")
    assert series.HOURS.search(text)
    assert series.with_times(text, series.first_cells()) == text, "run `make format`"


@each_notebook
def test_every_finding_has_a_condition_in_the_last_cell_and_types_no_figure(path):
    found = cells(path)
    texts = [cell.source for cell in found if cell.cell_type == "markdown"]
    findings = [
        each
        for text in texts
        for each in text.split("\n\n")
        if each.startswith("**Finding")
    ]
    assert [
        each for each in findings if re.search(r"\d\.\d|\d ?%|\d per cent", each)
    ] == []
    claims = [cell for cell in found if "claim" in tags(cell)]
    if findings or claims:
        assert claims == [found[-1]], "conditions stand in one cell, the last one"
        assert (
            len(re.findall(r"claims\.state\(|finding\(", claims[0].source))
            >= len(findings)
            > 0
        )
        assert claims[0].metadata.jupyter.source_hidden, "conditions are folded"
        assert len(lines([claims[0].source])) <= max(
            10, 0.16 * len(lines(cell.source for cell in cells(path, "code")))
        )
    assert [
        source
        for source in visible(path)
        if re.search(r"Findings\(|full_size|set_num_threads", source)
    ] == []


@each_notebook
def test_what_a_reader_may_change_has_an_expected_answer(path):
    texts = [
        cell.source
        for cell in cells(path, "markdown")
        if "**Change this**" in cell.source
    ]
    assert [text[:60] for text in texts if "<details>" not in text] == []


WORDS = r"\bpromis\w*|told apart|\bwhoever\b|\bnobody\b|\beyes\b|\bcame of (?:it|them)\b|\bbold\b"


@each_notebook
def test_words_are_the_fields(path):
    assert [
        text
        for cell in cells(path, "markdown")
        for text in re.findall(rf".{{0,30}}(?:{WORDS})", cell.source)
    ] == []
    assert not any(
        r"\boldsymbol" in cell.source or r"\mathbf" in cell.source
        for cell in cells(path, "markdown")
    )


def parameters(path):
    """The parameters of a notebook by name, as written and as CI has them."""
    for cell in cells(path, "code"):
        if "parameters" in tags(cell):
            written = {
                node.targets[0].id: ast.literal_eval(node.value)
                for node in ast.parse(cell.source).body
            }
            return written, cell.metadata.get("nbmake", {}).get("mock", {})
    return {}, {}


@each_notebook
def test_parameters_are_plain_and_in_capitals(path):
    written, mock = parameters(path)
    assert all(name.isupper() for name in written)
    assert set(mock) <= set(written), "CI changes only parameters that exist"
    assert all(
        "parameters" in tags(cell)
        for cell in cells(path, "code")
        if "nbmake" in cell.metadata
    )


@each_notebook
def test_nothing_stalls_the_runner_or_swallows_errors(path):
    code = [cell.source for cell in cells(path, "code")]
    for each in code:
        assert not re.search(r"\binteract\w*\(|\bOutput\(", each), (
            "use clothlab.lab.Control"
        )
        assert not any(
            isinstance(node, ast.Try) and node.handlers
            for node in ast.walk(ast.parse(each))
        ), "an error must show"
    for name in {
        name
        for each in code
        for name in re.findall(r"^(\w+) = (?:Control|LivePanel)\(", each, re.MULTILINE)
    }:
        assert re.search(rf"^{name}\.check\(\)", code[-1], re.MULTILINE), (
            f"{name}.check() is missing"
        )
