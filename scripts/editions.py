"""`make editions`: the notebooks for a class.

`build/student` has the stubs and no solutions. `build/full/notebooks` has the
notebooks with their solutions, executed with the parameters that are written in them,
so that every finding is judged by what was measured (`make findings`).
`build/instructor` has the same to hand out. That takes about ten minutes for all of
them on two cores.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode
from repository import ROOT, portable
from solutions import solved, unsolved, without

from clothlab._files import write_bytes

BUILD = ROOT / "build"
CELL_SECONDS = 1200  # [s] a cell that takes longer has hung
# Each kernel would warn that it speaks TCP
QUIET = ["--IPKernelApp.log_level=ERROR"]


def student_edition(notebook: NotebookNode) -> NotebookNode:
    """The notebook without its solutions and claims.

    Each check then finds the stub, and says what to do.
    """
    return without(unsolved(portable(notebook)), "solution", "claim")


def executed(notebook: NotebookNode, folder: Path) -> NotebookNode:
    """The notebook itself after a run in a folder.

    Its kernel finds nothing of whoever makes it, no recordings, tries or networks, and
    leaves none.

    Raises:
        nbclient.exceptions.CellExecutionError: an error in a cell without the tag
            `raises-exception`.
    """
    resources = {"metadata": {"path": str(folder)}}
    run = NotebookClient(
        notebook, timeout=CELL_SECONDS, resources=resources, extra_arguments=QUIET
    )
    with tempfile.TemporaryDirectory() as recordings:
        environment = os.environ | {
            "CLOTHLAB_RECORDINGS": recordings,
            "CLOTHLAB_MINE": "",
        }
        return run.execute(env=environment)


def write(notebook: NotebookNode, path: Path) -> None:
    """Write a notebook, whole or not at all."""
    write_bytes(path, nbformat.writes(notebook).encode())


def write_editions(path: Path, build: Path) -> None:
    """Write the editions of the notebook at `path` into `build`.

    The executed ones are written only if no cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    write(student_edition(notebook), build / "student" / path.name)
    run = executed(solved(notebook), path.parent)
    write(run, build / "full" / "notebooks" / path.name)
    edition = portable(run)
    for cell in edition.cells:  # nothing is folded
        cell.metadata.get("jupyter", {}).pop("source_hidden", None)
    write(edition, build / "instructor" / path.name)


def main() -> None:
    """Make the editions of each notebook that is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("notebooks", nargs="+", type=Path)
    arguments = parser.parse_args()

    for path in arguments.notebooks:
        start = time.perf_counter()
        write_editions(path.resolve(), BUILD)
        print(f"{path.stem}: {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
