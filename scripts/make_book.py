"""`make book`: the executed series as a web site, in `build/book`; with `--student` in `build/book-student`.

The pages are the notebooks themselves, found by their names, in order, titled by their first cells. They are run as
`make editions` runs them, about fifteen minutes for the whole series on two cores; what ran already is taken again as
long as neither the notebook nor the package nor the data have changed. The site opens from its folder, without a server
and without a network.
"""

import argparse
import copy
import html
import io
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

import nbformat
from make_course import write_syllabus
from make_editions import ROOT, is_fresh, student_edition, without_solutions, write_editions
from tqdm.auto import tqdm

from clothlab._files import write_bytes

BUILD = ROOT / "build"
WIDGET = "application/vnd.jupyter.widget-view+json"
FOLDED = {"solution": "a solution", "plot": "the code of this figure", "claim": "the condition that was checked"}
HOW_TO_RUN = "A picture of controls that move when the notebook runs; the downloads say how to run it."
EDITIONS = {"student": "stubs, no solutions, no outputs", "instructor": "with solutions and all outputs"}
BESIDE = (
    "README.md",
    "CHANGELOG.md",
    "LICENSE",
    "data/README.md",
    "docs/scaling.md",
    "docs/nightly.md",
    "docs/control.gif",
)  # what pages link to


def ran(path: Path, *, small: bool, old: bool = False) -> nbformat.NotebookNode:
    """The notebook with the outputs of its run, which is made now unless there is a fresh one.

    Args:
        path: of the notebook.
        small: take the run of `make notebooks`, which has the smaller parameters of CI.
        old: a run that was made before something changed is good enough.

    Raises:
        FileNotFoundError: no small run is there.
        nbclient.exceptions.CellExecutionError: a cell fails.
    """
    kept = BUILD / ("small" if small else "instructor") / path.name
    if not (old and kept.exists()) and not is_fresh(kept, path):
        if small:
            raise FileNotFoundError(f"{kept} is missing or older than the notebook: run `make notebooks`")
        write_editions(path, BUILD)
    return with_outputs(nbformat.read(path, as_version=4), nbformat.read(kept, as_version=4))


def with_outputs(notebook: nbformat.NotebookNode, executed: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A notebook as it is written, with the outputs of its run."""
    page = copy.deepcopy(notebook)
    for cell, run in zip(page.cells, executed.cells, strict=True):
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = copy.deepcopy(run.outputs), run.execution_count
    return page


def web_page(notebook: nbformat.NotebookNode, name: str, *, student: bool) -> nbformat.NotebookNode:
    """A notebook as the site shows it.

    Args:
        notebook: with its outputs, if it ran.
        name: of its file, for the downloads.
        student: without solutions, and without what they printed.
    """
    page = without_answers(notebook) if student else copy.deepcopy(notebook)
    page.metadata.pop("widgets", None)  # or their library would be fetched
    for cell in page.cells:
        if cell.cell_type != "code":
            continue
        tags = cell.metadata.setdefault("tags", [])
        what = next((FOLDED[tag] for tag in FOLDED if tag in tags), "the code")
        if cell.metadata.get("jupyter", {}).get("source_hidden"):
            tags.append("hide-input")
            prompts = {"code_prompt_show": f"Show {what}", "code_prompt_hide": f"Hide {what}"}
            cell.metadata["mystnb"] = {**cell.metadata.get("mystnb", {}), **prompts}
        words = [
            output.metadata["image/png"]["alt"] for output in cell.outputs if "image/png" in output.get("metadata", {})
        ]
        alt = "; ".join(words) or cell.metadata.get("alt", "")
        if alt:  # MyST-NB takes it from the cell only
            cell.metadata["mystnb"] = {**cell.metadata.get("mystnb", {}), "image": {"alt": alt}}
        cell.outputs = [shown for output in cell.outputs for shown in web_output(output)]
    editions = ["student"] if student else list(EDITIONS)
    links = [f"{{download}}`{edition} edition <../downloads/{edition}/{name}>`" for edition in editions]
    page.cells.insert(1, nbformat.v4.new_markdown_cell(f"This page as a notebook to run: {' · '.join(links)}."))
    return page


def without_answers(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The student edition; from a stub to the next text, nothing is left of what came out with the solution."""
    edition = copy.deepcopy(notebook)
    answered = False
    for cell in edition.cells:
        if cell.cell_type != "code":
            answered = False
        elif answered := answered or bool({"stub", "solution"} & set(cell.metadata.get("tags", []))):
            cell.outputs = []
    return without_solutions(edition)


def web_output(output: nbformat.NotebookNode) -> Iterable[nbformat.NotebookNode]:
    """An output as the site shows it, and what belongs below it; nothing of progress bars."""
    data = output.get("data", {})
    if output.output_type == "stream" or not data:
        if output.get("name") != "stderr":
            yield output
        return
    if WIDGET in data and "image/png" not in data:
        return
    shown, widget = copy.deepcopy(output), WIDGET in data
    if "image/png" in data:
        shown.data = {"image/png": data["image/png"]}
    elif "text/html" in data:
        shown.data["text/html"] = quiet_videos(data["text/html"])
    yield shown
    if widget:
        yield html_output(f'<p class="how-to-run">{HOW_TO_RUN}</p>')
    details = shown.get("metadata", {}).get("image/png", {}).get("details", [])
    if details:
        paragraphs = "".join(f"<p>{html.escape(each)}</p>" for each in details)
        yield html_output(f'<details class="figure-in-words"><summary>In words</summary>{paragraphs}</details>')


def quiet_videos(page: str) -> str:
    """Videos wait until somebody starts them."""
    return re.sub(r"<video\b[^>]*>", lambda video: re.sub(r"\s(autoplay|loop)\b", "", video[0]), page)


def html_output(text: str) -> nbformat.NotebookNode:
    """HTML as an output."""
    return nbformat.v4.new_output("display_data", {"text/html": text})


def lay_out(paths: list[Path], folder: Path, pages: dict[str, nbformat.NotebookNode], *, student: bool) -> None:
    """Write all that Sphinx reads: pages, downloads, and the files of the repository that they link to.

    Args:
        paths: of the notebooks.
        folder: to write to; what was there is replaced.
        pages: notebooks with their outputs, by the names of their files.
        student: lay out the student edition.
    """
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs" / "book", folder)
    for name in BESIDE:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    shutil.copytree(ROOT / "docs" / "course", folder / "course")
    write_bytes(
        folder / "course" / "syllabus.md", write_syllabus(ROOT / "docs" / "course" / "weeks.toml", paths).encode()
    )
    table = (folder / "downloads.md").read_text()
    for edition in ["student"] if student else EDITIONS:
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as files:
            for path in paths:
                notebook = pages[path.name] if edition == "instructor" else student_edition(nbformat.read(path, 4))
                text = nbformat.writes(notebook)
                write_bytes(folder / "downloads" / edition / path.name, text.encode())
                files.writestr(path.name, text)
        write_bytes(folder / "downloads" / f"{edition}.zip", archive.getvalue())
        table += f"| {{download}}`{edition} <downloads/{edition}.zip>` | {EDITIONS[edition]} |\n"
    write_bytes(folder / "downloads.md", table.encode())
    for path in paths:
        page = web_page(pages[path.name], path.name, student=student)
        write_bytes(folder / "notebooks" / path.name, nbformat.writes(page).encode())


def build_site(source: Path, site: Path, *, student: bool) -> None:
    """Let Sphinx make the site; a warning, such as of a broken link, ends it.

    Raises:
        subprocess.CalledProcessError: Sphinx said what is wrong.
    """
    shutil.rmtree(site, ignore_errors=True)
    command = [sys.executable, "-m", "sphinx", "--builder", "html", "--quiet", "--fail-on-warning", "--keep-going"]
    doctrees = ["--doctree-dir", str(source.with_name("doctrees"))]
    edition = {"CLOTHLAB_BOOK": "student" if student else "instructor"}
    subprocess.run([*command, *doctrees, str(source), str(site)], check=True, env=os.environ | edition)


def main() -> None:
    """Make the site of the chosen notebooks."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=notebooks, default=list(notebooks), help="numbers to run")
    parser.add_argument("--small", action="store_true", help="take the run of `make notebooks`")
    parser.add_argument("--old", action="store_true", help="take earlier runs although something changed since")
    parser.add_argument("--student", action="store_true", help="leave out the solutions and what they printed")
    arguments = parser.parse_args()
    pages = {}
    progress = tqdm(notebooks.items(), unit="notebook")
    for number, path in progress:
        progress.set_description(path.stem)
        chosen = number in arguments.only
        how = {"small": arguments.small, "old": arguments.old}
        pages[path.name] = ran(path, **how) if chosen else nbformat.read(path, as_version=4)
    folder = BUILD / ("book-student" if arguments.student else "book")
    lay_out(list(notebooks.values()), folder / "source", pages, student=arguments.student)
    build_site(folder / "source", folder / "html", student=arguments.student)
    print(f"{folder / 'html' / 'index.html'}: open it in a browser")


if __name__ == "__main__":
    main()
