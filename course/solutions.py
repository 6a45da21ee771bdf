"""Solutions of exercises: folded text in `notebooks/`, which nobody runs by accident,
and code for all that runs them.

In a committed notebook, a solution is a Markdown cell (tag `solution`) under the stub:
one click away in JupyterLab, on GitHub and on Colab, and never run over a reader's own
answer. From the first stub on, code cells carry the tag `raises-exception`: an exercise
without an answer does not stop "Run all". `solved` turns both back, for everything that
executes a notebook with its answers, where an error must show.

`python course/solutions.py --format NOTEBOOKS` lints and formats the solutions and sets
the tags (`make format`); `python course/solutions.py --into FOLDER NOTEBOOKS` writes
solved copies (`make notebooks`).
"""

import argparse
import copy
import re
import subprocess
import sys
from pathlib import Path

import nbformat
from nbformat import NotebookNode

from clothlab._files import write_bytes

ROOT = Path(__file__).resolve().parents[1]
# Nbclient and JupyterLab go on after an error in a cell with this tag
UNSTOPPED = "raises-exception"
HEAD = "<details><summary>Solution</summary>\n\n```python\n"
TAIL = "\n```\n\n</details>"
FOLDED = re.compile(re.escape(HEAD) + "(?P<code>.*)" + re.escape(TAIL), re.DOTALL)


def tags(cell: NotebookNode) -> list[str]:
    """The tags of a cell."""
    return cell.metadata.get("tags", [])


def without(notebook: NotebookNode, *unwanted: str) -> NotebookNode:
    """The notebook itself, whose cells with one of these tags are gone."""
    notebook.cells = [
        cell for cell in notebook.cells if {*unwanted}.isdisjoint(tags(cell))
    ]
    return notebook


def solved(notebook: NotebookNode) -> NotebookNode:
    """A copy whose solutions are code that runs after the stubs, and in which every
    error stops the run.

    Raises:
        ValueError: a solution is not the folded code that `unsolved` writes.
    """
    edition = copy.deepcopy(notebook)
    edition.cells = [
        _code_cell(cell) if _is_text(cell) else cell for cell in edition.cells
    ]
    for cell in edition.cells:
        if UNSTOPPED in tags(cell):
            _set_tags(cell, [tag for tag in tags(cell) if tag != UNSTOPPED])
    return edition


def unsolved(notebook: NotebookNode) -> NotebookNode:
    """A copy as it is committed: solutions are folded text, and no error stops the run
    from the first stub on.
    """
    edition = copy.deepcopy(notebook)
    edition.cells = [
        _text_cell(cell) if "solution" in tags(cell) else cell for cell in edition.cells
    ]
    unanswered = False
    for cell in edition.cells:
        unanswered = unanswered or "stub" in tags(cell)
        if cell.cell_type == "code":
            kept = [tag for tag in tags(cell) if tag != UNSTOPPED]
            _set_tags(cell, [*kept, UNSTOPPED] if unanswered else kept)
    return edition


def small(notebook: NotebookNode, like: NotebookNode | None = None) -> NotebookNode:
    """A copy with the small parameters of CI, which nbmake puts in as well; `like` is
    the notebook that names them.
    """
    edition = copy.deepcopy(notebook)
    mocks = [
        cell.metadata.get("nbmake", {}).get("mock", {})
        for cell in (like or notebook).cells
    ]
    lines = "".join(
        f"\n{name} = {value!r}" for mock in mocks for name, value in mock.items()
    )
    for cell in edition.cells:
        if "parameters" in tags(cell) and cell.cell_type == "code":
            cell.source += lines
    return edition


def _is_text(cell: NotebookNode) -> bool:
    return "solution" in tags(cell) and cell.cell_type == "markdown"


def _text_cell(cell: NotebookNode) -> NotebookNode:
    """The text that a solution is committed as."""
    if cell.cell_type == "markdown":
        return cell
    return nbformat.v4.new_markdown_cell(
        HEAD + cell.source + TAIL, id=cell.id, metadata={"tags": ["solution"]}
    )


def _code_cell(cell: NotebookNode) -> NotebookNode:
    """The folded code cell that a solution's text stands for."""
    found = FOLDED.fullmatch(cell.source.strip())
    if not found:
        raise ValueError(
            f"a solution must be {HEAD!r}, the code, {TAIL!r}; this one is {cell.source!r}"
        )
    metadata = {"jupyter": {"source_hidden": True}, "tags": ["solution"]}
    return nbformat.v4.new_code_cell(found["code"], id=cell.id, metadata=metadata)


def _set_tags(cell: NotebookNode, wanted: list[str]) -> None:
    """Give a cell these tags; a cell without tags has no list of them."""
    if wanted:
        cell.metadata["tags"] = wanted
    else:
        cell.metadata.pop("tags", None)


def formatted(notebook: NotebookNode, name: str) -> NotebookNode:
    """The notebook as it is committed, its solutions linted and formatted as the code
    of `notebooks/NAME`.

    Raises: subprocess.CalledProcessError: the linter finds what it can't mend; it has
        said what.
    """
    text = nbformat.writes(solved(notebook))
    for command in (["check", "--fix"], ["format"]):
        ruff = [
            sys.executable,
            "-m",
            "ruff",
            *command,
            "--quiet",
            "--stdin-filename",
            f"notebooks/{name}",
            "-",
        ]
        text = subprocess.run(
            ruff, input=text, stdout=subprocess.PIPE, text=True, check=True, cwd=ROOT
        ).stdout
    return unsolved(nbformat.reads(text, as_version=4))


def main() -> None:
    """Format the named notebooks, or write solved copies of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("notebooks", nargs="+", type=Path)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--format",
        action="store_true",
        help="lint and format the solutions, and set the tags",
    )
    what.add_argument("--into", type=Path, help="the folder for solved copies")
    arguments = parser.parse_args()
    for path in arguments.notebooks:
        before = path.read_bytes()
        notebook = nbformat.reads(before.decode(), as_version=4)
        result = (
            formatted(notebook, path.name) if arguments.format else solved(notebook)
        )
        target = path if arguments.format else arguments.into / path.name
        text = (nbformat.writes(result) + "\n").encode()
        if not (
            arguments.format and text == before
        ):  # a notebook that is right keeps its date
            write_bytes(target, text)


if __name__ == "__main__":
    main()
