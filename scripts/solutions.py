"""Solutions of exercises: folded text in `notebooks/`, code for all that runs them.

In a committed notebook, a solution is a Markdown cell (tag `solution`) under the stub:
one click away in JupyterLab, on GitHub and on Colab, and never run over a reader's own
answer. From the first stub on, code cells carry the tag `raises-exception`: an exercise
without an answer does not stop "Run all". `solved` turns both back, for everything that
executes a notebook with its answers, where an error must show.

Two commands: `solutions.py format NOTEBOOKS` lints and formats the solutions and sets
the tags (`make format`); `solutions.py solve --into FOLDER NOTEBOOKS` writes solved
copies (`make notebooks`).
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
    """A copy whose solutions are code that runs after the stubs.

    In it, every error stops the run.

    Raises:
        ValueError: a solution is not the folded code that `unsolved` writes.
    """
    edition = copy.deepcopy(notebook)
    edition.cells = [_as_code(cell) for cell in edition.cells]
    for cell in edition.cells:
        if UNSTOPPED in tags(cell):
            _set_tags(cell, [tag for tag in tags(cell) if tag != UNSTOPPED])
    return edition


def unsolved(notebook: NotebookNode) -> NotebookNode:
    """A copy as it is committed: solutions are folded text.

    From the first stub on, no error stops the run.
    """
    edition = copy.deepcopy(notebook)
    edition.cells = [_as_text(cell) for cell in edition.cells]
    unanswered = False
    for cell in edition.cells:
        unanswered = unanswered or "stub" in tags(cell)
        if cell.cell_type == "code":
            kept = [tag for tag in tags(cell) if tag != UNSTOPPED]
            _set_tags(cell, [*kept, UNSTOPPED] if unanswered else kept)
    return edition


def small(notebook: NotebookNode, like: NotebookNode | None = None) -> NotebookNode:
    """A copy with the small parameters of CI, which nbmake puts in as well.

    `like` is the notebook that names them, by default this one.
    """
    lines = ""
    for cell in (like or notebook).cells:
        mock = cell.metadata.get("nbmake", {}).get("mock", {})
        for name, value in mock.items():
            lines += f"\n{name} = {value!r}"

    edition = copy.deepcopy(notebook)
    for cell in edition.cells:
        if "parameters" in tags(cell) and cell.cell_type == "code":
            cell.source += lines
    return edition


def _as_text(cell: NotebookNode) -> NotebookNode:
    """The text that a solution is committed as; any other cell as it is."""
    if "solution" not in tags(cell) or cell.cell_type == "markdown":
        return cell
    return nbformat.v4.new_markdown_cell(
        HEAD + cell.source + TAIL, id=cell.id, metadata={"tags": ["solution"]}
    )


def _as_code(cell: NotebookNode) -> NotebookNode:
    """The folded code cell that a solution's text stands for; others as they are."""
    if "solution" not in tags(cell) or cell.cell_type != "markdown":
        return cell
    found = FOLDED.fullmatch(cell.source.strip())
    if not found:
        raise ValueError(
            f"a solution must be {HEAD!r}, the code, {TAIL!r}; "
            f"this one is {cell.source!r}"
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
    """The notebook as it is committed, its solutions linted and formatted.

    They are treated as the code of `notebooks/NAME`.

    Raises:
        subprocess.CalledProcessError: the linter finds what it can't mend; it has said
            what.
    """
    ruff = [sys.executable, "-m", "ruff"]
    options = ["--quiet", "--stdin-filename", f"notebooks/{name}", "-"]
    text = nbformat.writes(solved(notebook))
    for words in (["check", "--fix"], ["format"]):
        text = subprocess.run(
            [*ruff, *words, *options],
            input=text,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            cwd=ROOT,
        ).stdout
    return unsolved(nbformat.reads(text, as_version=4))


def format_all(paths: list[Path]) -> None:
    """Lint and format the solutions in these notebooks, and set the tags."""
    for path in paths:
        before = path.read_bytes()
        notebook = nbformat.reads(before.decode(), as_version=4)
        text = _bytes(formatted(notebook, path.name))
        if text != before:  # a notebook that is right keeps its date
            write_bytes(path, text)


def solve_all(paths: list[Path], folder: Path) -> None:
    """Write solved copies of these notebooks into a folder."""
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        write_bytes(folder / path.name, _bytes(solved(notebook)))


def _bytes(notebook: NotebookNode) -> bytes:
    return (nbformat.writes(notebook) + "\n").encode()


def main() -> None:
    """Format the named notebooks, or write solved copies of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True, dest="command")
    commands.add_parser("format", help=format_all.__doc__)
    solve = commands.add_parser("solve", help=solve_all.__doc__)
    solve.add_argument("--into", type=Path, required=True, metavar="FOLDER")
    for command in commands.choices.values():
        command.add_argument("notebooks", nargs="+", type=Path)
    arguments = parser.parse_args()
    if arguments.command == "format":
        format_all(arguments.notebooks)
    else:
        solve_all(arguments.notebooks, arguments.into)


if __name__ == "__main__":
    main()
