"""`make format`: what every notebook shares, and what the README says of them.

Both are written out of one place. Every notebook begins, after its title, with the cell
that sets up Google Colab, its summary leads to the notebook after it, and its last
text ends with a word on its kernel. The
README's first line leads to where they run without an installation, and its tables say
how long each one takes, as the notebook's own first cell does.
"""

import re
from itertools import pairwise
from pathlib import Path

import nbformat

from course.repository import ROOT, address, doors
from course.solutions import without

COLAB = """# @title On Google Colab only: get the repository and what Colab lacks
import os
import subprocess
import sys

if "google.colab" in sys.modules:
    os.environ["MUJOCO_GL"] = "egl"  # draws without a display
    if not os.path.exists("../environment.txt"):
        if not os.path.exists("clothlab"):
            clone = ["git", "clone", "--quiet", "--depth=1"]
            clone += ["ADDRESS", "clothlab"]
            subprocess.run(clone, check=True)
        os.chdir("clothlab/notebooks")
    sys.path[:0] = [os.path.abspath(".."), os.path.abspath("../scripts")]
    import on_colab

    on_colab.install()"""
FOLDED = {"cellView": "form", "jupyter": {"source_hidden": True}, "tags": ["colab"]}
FINISHED = "Finished? *Kernel, Shut Down Kernel* frees its memory."
TIMES = re.compile(
    r"\*\*Working time\*\*: about (?P<learning>\d+) minutes\. "
    r"\*\*Running time\*\*: about (?P<running>\d+) (?P<unit>minutes|seconds)"
)
ROW = re.compile(
    r"^(?P<start>\| \[[^]]*\]\(notebooks/(?P<name>[\w.]+)\) \| [^|]* \|)"
    r" [^|]* \| [^|]* \|$",
    re.MULTILINE,
)
NEXT = re.compile(r"^Next: \[[^]]*\]\([^)]*\)", re.MULTILINE)
OPEN = re.compile(r"(?<=<!-- open -->\n).*?(?=\n<!-- /open -->)", re.DOTALL)


def colab_cell() -> nbformat.NotebookNode:
    """The first code cell of every notebook, folded: nothing outside of Colab."""
    code = COLAB.replace("ADDRESS", address())
    cell = nbformat.v4.new_code_cell(code, metadata=FOLDED)
    cell.id = "colab"
    return cell


def finish(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook itself, with what all of them share.

    The cell for Colab after its title, and the sentence at the end of its last text.
    """
    cells = without(notebook, "colab").cells
    texts = [cell for cell in cells if cell.cell_type == "markdown"]
    for cell in texts:
        cell.source = cell.source.removesuffix(f"\n\n{FINISHED}")
    texts[-1].source += f"\n\n{FINISHED}"
    notebook.cells = [cells[0], colab_cell(), *cells[1:]]
    return notebook


def lead_on(
    notebook: nbformat.NotebookNode, path: Path, following: nbformat.NotebookNode
) -> None:
    """Let "Next: …", where a notebook says it, name the one that follows, at `path`."""
    title = following.cells[0].source.splitlines()[0].removeprefix("# ")
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = NEXT.sub(f"Next: [{title}]({path.name})", cell.source)


def open_elsewhere() -> str:
    """The README's line of links to where the notebooks run without an installation."""
    links = " · ".join(f"[{name}]({link})" for name, link in doors().items())
    return f"**Without an installation**: {links} · [repository]({address()})"


def times(notebook: nbformat.NotebookNode) -> tuple[str, str]:
    """How long a notebook takes to learn and to run, such as `("90 min", "20 s")`.

    Its first cell says it; a ValueError says that the cell names none.
    """
    found = TIMES.search(notebook.cells[0].source)
    if not found:
        raise ValueError("the first cell says neither working time nor running time")
    units = {"minutes": "min", "seconds": "s"}
    return f"{found['learning']} min", f"{found['running']} {units[found['unit']]}"


def with_times(readme: str, notebooks: dict[str, nbformat.NotebookNode]) -> str:
    """The README with the times of the notebooks in the last columns of its tables.

    Notebooks are named as their files.
    """

    def row(line: re.Match[str]) -> str:
        learning, running = times(notebooks[line["name"]])
        return f"{line['start']} {learning} | {running} |"

    return ROW.sub(row, readme)


def finished() -> dict[Path, str]:
    """The text of each notebook and of the README as they should be."""
    # Notebooks, in the order of their numbers: 07, 07b, 08
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    notebooks = {path: finish(nbformat.read(path, as_version=4)) for path in paths}
    for path, following in pairwise(paths):
        lead_on(notebooks[path], following, notebooks[following])
    texts = {path: nbformat.writes(each) + "\n" for path, each in notebooks.items()}

    # The README
    readme = ROOT / "README.md"
    linked = OPEN.sub(lambda _: open_elsewhere(), readme.read_text("utf-8"))
    named = {path.name: each for path, each in notebooks.items()}
    texts[readme] = with_times(linked, named)
    return texts


def main() -> None:
    """Write what differs from what is there."""
    for path, text in finished().items():
        if path.read_text("utf-8") != text:
            path.write_text(text, "utf-8", newline="\n")


if __name__ == "__main__":
    main()
