"""The pages of `make book`, in `build/book/source`; with `--student` in
`build/book-student/source`.

The pages are the notebooks with the outputs of `make editions`, or of `make notebooks`
with `--small`. Sphinx makes a site of them that opens from its folder, without a server
and without a network.
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
from course.solutions import solved, without

BUILD = ROOT / "build"
WIDGET = "application/vnd.jupyter.widget-view+json"
FOLDED = {"solution": "a solution", "plot": "the code of this figure"}
PAGES = (
    "*.md",
    "LICENSE",
    "data/README.md",
    "docs/*.*",
    "docs/course/*",
    "docs/gallery/*",
)


def executed(path: Path, *, small: bool) -> nbformat.NotebookNode:
    """The solved notebook at `path` with the outputs of its run: `make editions`, or
    `make notebooks` if small.
    """
    notebook = solved(nbformat.read(path, as_version=4))
    run = nbformat.read(
        BUILD / ("small" if small else "instructor") / path.name, as_version=4
    )
    for cell, ran in zip(notebook.cells, run.cells, strict=True):
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = ran.outputs, ran.execution_count
    return notebook


def web_page(
    notebook: nbformat.NotebookNode, name: str, *, student: bool
) -> nbformat.NotebookNode:
    """A notebook with outputs as the site shows it, with the file of this name to
    download.
    """
    page = without(
        without_answers(notebook) if student else copy.deepcopy(notebook),
        "claim",
        "colab",
    )
    page.metadata.pop("widgets", None)  # or their library would be fetched
    for cell in page.cells:
        if cell.cell_type != "code":
            continue
        tags = cell.metadata.setdefault("tags", [])
        shown = cell.metadata.setdefault("mystnb", {})
        if cell.metadata.get("jupyter", {}).get("source_hidden"):
            folded = next((FOLDED[tag] for tag in FOLDED if tag in tags), "the code")
            tags.append("hide-input")
            shown |= {
                "code_prompt_show": f"Show {folded}",
                "code_prompt_hide": f"Hide {folded}",
            }
        words = [
            output.get("metadata", {}).get("image/png", {}).get("alt")
            for output in cell.outputs
        ]
        if alt := "; ".join(filter(None, words)) or cell.metadata.get("alt"):
            shown["image"] = {"alt": alt}  # MyST-NB takes it from the cell only
        cell.outputs = [each for output in cell.outputs for each in web_output(output)]
    link = f"This page as a notebook to run: {{download}}`without solutions <../downloads/{name}>`."
    page.cells.insert(1, nbformat.v4.new_markdown_cell(link))
    return page


def without_answers(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy without solutions; from a stub to the next text, nothing is left of what
    came out with the solution.
    """
    edition = copy.deepcopy(notebook)
    answered = False
    for cell in edition.cells:
        if cell.cell_type != "code":
            answered = False
        elif answered := answered or bool(
            {"stub", "solution"} & set(cell.metadata.get("tags", []))
        ):
            cell.outputs = []
    return without(edition, "solution")


def web_output(output: nbformat.NotebookNode) -> Iterable[nbformat.NotebookNode]:
    """An output as the site shows it, with a figure's numbers in words below it;
    nothing of live controls.
    """
    output, data = copy.deepcopy(output), output.get("data", {})
    if "image/png" in data:
        output.data = {"image/png": data["image/png"]}
    elif WIDGET in data or data.get("text/html") == REOPENED:
        return
    elif "<video" in data.get("text/html", ""):  # it waits until somebody starts it
        output.data = {
            "text/html": re.sub(
                r"(<video\b[^>]*?)((?:\s(?:autoplay|loop)\b)+)",
                r"\1",
                data["text/html"],
            )
        }
    yield output
    if details := output.get("metadata", {}).get("image/png", {}).get("details"):
        paragraphs = "".join(f"<p>{html.escape(each)}</p>" for each in details)
        words = f'<details class="figure-in-words"><summary>In words</summary>{paragraphs}</details>'
        yield nbformat.v4.new_output("display_data", {"text/html": words})


def lay_out(
    notebooks: dict[str, nbformat.NotebookNode], folder: Path, *, student: bool
) -> None:
    """Write all that Sphinx reads into a folder: pages of the notebooks, by name,
    downloads, and what they link to.
    """
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs" / "book", folder)
    for path in [path for pattern in PAGES for path in ROOT.glob(pattern)]:
        write_bytes(folder / path.relative_to(ROOT), path.read_bytes())
    for name, notebook in notebooks.items():
        write_bytes(
            folder / "notebooks" / name,
            nbformat.writes(web_page(notebook, name, student=student)).encode(),
        )
        download = student_edition(
            nbformat.read(ROOT / "notebooks" / name, as_version=4)
        )
        write_bytes(folder / "downloads" / name, nbformat.writes(download).encode())
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
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    notebooks = {path.name: executed(path, small=arguments.small) for path in paths}
    lay_out(
        notebooks,
        BUILD / f"book{'-student' * arguments.student}" / "source",
        student=arguments.student,
    )


if __name__ == "__main__":
    main()
