"""`make book`: the pages of the web site, in `build/book/source`.

With `--student` they have no solutions, and lie in `build/book-student/source`. They
are the notebooks with the outputs of `make editions`, or of `make notebooks` with
`--small`. Sphinx makes a site of them that opens from its folder, without a server and
without a network.
"""

import argparse
import copy
import html
import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import nbformat

from clothlab._files import write_bytes
from clothlab.lab._widget import REOPENED
from course.editions import ROOT, student_edition
from course.lab_page import ONE_FILE, SOURCES, write_lab, write_one_file, write_robot
from course.solutions import solved, tags, without

BUILD = ROOT / "build"
WIDGET = "application/vnd.jupyter.widget-view+json"
FOLDED = {"solution": "a solution", "plot": "the code of this figure"}
# A video that starts by itself, or again and again
STARTED = re.compile(r"(<video\b[^>]*?)((?:\s(?:autoplay|loop)\b)+)")
PAGES = (
    "*.md",
    "LICENSE",
    "data/README.md",
    "docs/*.*",
    "docs/course/*.*",
    "docs/course/problems/*.md",
    "docs/gallery/*",
    "docs/results/*",
)


def executed(path: Path, *, small: bool) -> nbformat.NotebookNode:
    """The solved notebook at `path` with the outputs of its run.

    That is the run of `make editions`, or of `make notebooks` if small.
    """
    notebook = solved(nbformat.read(path, as_version=4))
    folder = BUILD / ("small" if small else "instructor")
    run = nbformat.read(folder / path.name, as_version=4)
    for cell, ran in zip(notebook.cells, run.cells, strict=True):
        if cell.cell_type == "code":
            cell.outputs = ran.outputs
            cell.execution_count = ran.execution_count
    return notebook


def web_page(
    notebook: nbformat.NotebookNode, name: str, *, student: bool
) -> nbformat.NotebookNode:
    """A notebook with outputs as the site shows it.

    Below its title is a link to download the file of this name.
    """
    page = without_answers(notebook) if student else copy.deepcopy(notebook)
    page = without(page, "claim", "colab")
    page.metadata.pop("widgets", None)  # or their library would be fetched
    for cell in page.cells:
        if cell.cell_type == "code":
            show(cell)
    link = (
        "This page as a notebook to run: "
        f"{{download}}`without solutions <../downloads/{name}>`."
    )
    page.cells.insert(1, nbformat.v4.new_markdown_cell(link))
    return page


def show(cell: nbformat.NotebookNode) -> None:
    """Say in a code cell's metadata how MyST-NB shows it, and prepare its outputs."""
    marks = cell.metadata.setdefault("tags", [])
    shown = cell.metadata.setdefault("mystnb", {})

    # Code that is folded in JupyterLab is folded here
    if cell.metadata.get("jupyter", {}).get("source_hidden"):
        folded = next((FOLDED[tag] for tag in FOLDED if tag in marks), "the code")
        marks.append("hide-input")
        shown["code_prompt_show"] = f"Show {folded}"
        shown["code_prompt_hide"] = f"Hide {folded}"

    # What a figure shows, for those who don't see it; MyST-NB takes it from the cell
    words = [about(output).get("alt") for output in cell.outputs]
    alt = "; ".join(filter(None, words)) or cell.metadata.get("alt")
    if alt:
        shown["image"] = {"alt": alt}
    cell.outputs = [each for output in cell.outputs for each in web_output(output)]


def about(output: nbformat.NotebookNode) -> dict:
    """What an output says of its figure, if it is one."""
    return output.get("metadata", {}).get("image/png", {})


def without_answers(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy without solutions.

    From a stub to the next text, nothing is left of what came out with the solution.
    """
    edition = copy.deepcopy(notebook)
    answered = False
    for cell in edition.cells:
        if cell.cell_type != "code":
            answered = False
            continue
        if {"stub", "solution"} & set(tags(cell)):
            answered = True
        if answered:
            cell.outputs = []
    return without(edition, "solution")


def web_output(output: nbformat.NotebookNode) -> Iterable[nbformat.NotebookNode]:
    """An output as the site shows it; of live controls, only their picture.

    Below a figure are its numbers in words.
    """
    output = copy.deepcopy(output)
    data = output.get("data", {})
    page = data.get("text/html", "")
    if "image/png" in data:
        output.data = {"image/png": data["image/png"]}
    elif WIDGET in data or page == REOPENED:
        return
    elif "<video" in page:  # it waits until somebody starts it
        output.data = {"text/html": STARTED.sub(r"\1", page)}
    yield output

    # For those who don't see it, or want to know it exactly
    if details := about(output).get("details"):
        paragraphs = "".join(f"<p>{html.escape(each)}</p>" for each in details)
        words = (
            '<details class="figure-in-words"><summary>In words</summary>'
            f"{paragraphs}</details>"
        )
        yield nbformat.v4.new_output("display_data", {"text/html": words})


def lay_out(
    notebooks: dict[str, nbformat.NotebookNode], folder: Path, *, student: bool
) -> None:
    """Write all that Sphinx reads into a folder.

    Pages of the notebooks, by name, downloads, and what they link to.
    """
    # The site's own files, and pages that are no notebooks
    shutil.rmtree(folder, ignore_errors=True)
    aside = shutil.ignore_patterns(SOURCES.name)
    shutil.copytree(ROOT / "docs" / "book", folder, ignore=aside)
    write_lab(folder / "static" / "lab")
    for pattern in PAGES:
        for path in ROOT.glob(pattern):
            write_bytes(folder / path.relative_to(ROOT), path.read_bytes())

    # Each notebook as a page, and as a file to run
    for name, notebook in notebooks.items():
        page = web_page(notebook, name, student=student)
        write_bytes(folder / "notebooks" / name, nbformat.writes(page).encode())
        source = nbformat.read(ROOT / "notebooks" / name, as_version=4)
        download = nbformat.writes(student_edition(source))
        write_bytes(folder / "downloads" / name, download.encode())
    shutil.make_archive(str(folder / "notebooks"), "zip", folder / "downloads")


def main() -> None:
    """Lay out the pages of all notebooks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--small", action="store_true", help="take the run of `make notebooks`"
    )
    parser.add_argument(
        "--student",
        action="store_true",
        help="leave out the solutions and what they printed",
    )
    arguments = parser.parse_args()

    # The pages
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    notebooks = {path.name: executed(path, small=arguments.small) for path in paths}
    site = BUILD / ("book-student" if arguments.student else "book")
    lay_out(notebooks, site / "source", student=arguments.student)

    # A robot in one of them, where there is what it is made of
    scripts = site / "source" / "static" / "lab"
    try:
        write_robot(scripts)
    except FileNotFoundError as error:
        print(f"NO ROBOT in the page of the live lab: {error}")
    write_one_file(scripts / ONE_FILE, scripts)


if __name__ == "__main__":
    main()
