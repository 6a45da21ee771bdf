"""`make editions`: the notebooks for a class, in `build/`, about eight minutes for all
of them on two cores.

`build/student` has the stubs and no solutions. `build/instructor` has the solutions,
executed with the parameters that are written in them, with all outputs, and each
notebook as a web page, too. So every claim is checked on what was measured; `--record`
stores the figures (`make findings RECORD=1`).
"""

import argparse
import os
import time
from pathlib import Path

import nbformat
from nbconvert import HTMLExporter
from nbconvert.preprocessors import ExecutePreprocessor

from clothlab import data
from clothlab._files import write_bytes
from clothlab.claims import RECORD
from course.repository import portable
from course.solutions import ROOT, solved, unsolved, without

CELL_SECONDS = 600  # [s] a cell that takes longer has hung


def student_edition(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook without its solutions and claims: each check then finds the stub,
    and says what to do.
    """
    return without(unsolved(portable(notebook)), "solution", "claim")


def instructor_edition(
    notebook: nbformat.NotebookNode, folder: Path
) -> nbformat.NotebookNode:
    """The notebook after a run in a folder, with solutions as unfolded code; an error
    in a cell ends it.
    """
    edition = solved(portable(notebook))
    for cell in edition.cells:
        cell.metadata.get("jupyter", {}).pop("source_hidden", None)
    return executed(edition, folder)


def executed(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook itself after a run in a folder.

    Raises: nbclient.exceptions.CellExecutionError: an error in a cell without the tag
        `raises-exception`.
    """
    # Each kernel would warn that it speaks TCP
    quiet = ["--IPKernelApp.log_level=ERROR"]
    run = ExecutePreprocessor(timeout=CELL_SECONDS, extra_arguments=quiet)
    return run.preprocess(notebook, {"metadata": {"path": str(folder)}})[0]


def write_editions(path: Path, build: Path) -> nbformat.NotebookNode:
    """Write both editions of the notebook at `path` into `build`, the second only if no
    cell fails, and return it.
    """
    notebook = nbformat.read(path, as_version=4)
    write_bytes(
        build / "student" / path.name,
        nbformat.writes(student_edition(notebook)).encode(),
    )
    edition = instructor_edition(notebook, path.parent)
    page, _ = HTMLExporter().from_notebook_node(
        edition, {"metadata": {"name": path.stem}}
    )
    write_bytes(build / "instructor" / f"{path.stem}.html", page.encode())
    write_bytes(build / "instructor" / path.name, nbformat.writes(edition).encode())
    return edition


def main() -> None:
    """Make both editions of each notebook that is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("notebooks", nargs="+", type=Path)
    parser.add_argument(
        "--record",
        action="store_true",
        help="store what is measured as the new figures",
    )
    arguments = parser.parse_args()
    os.environ |= {RECORD: "1"} if arguments.record else {}
    for path in arguments.notebooks:
        start = time.perf_counter()
        edition = write_editions(path.resolve(), ROOT / "build")
        printed = [
            output.get("text", "")
            for cell in edition.cells
            for output in cell.get("outputs", [])
        ]
        held = sum(
            line.startswith("✓") for text in printed for line in text.splitlines()
        )
        print(
            f"{path.stem}: {held} claims hold, {time.perf_counter() - start:.0f} s",
            flush=True,
        )
    if arguments.record:
        data.write_checksums()


if __name__ == "__main__":
    main()
