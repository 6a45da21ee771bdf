"""`make editions`: the notebooks for a class, in `build/`.

That takes about ten minutes for all of them on two cores. `build/student` has the stubs
and no solutions. `build/instructor` has the solutions, executed with the parameters
that are written in them, with all outputs, and each notebook as a web page, too. So
every claim is checked on what was measured; `--record` stores the figures (`make
findings RECORD=1`).
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import nbformat
from nbconvert import HTMLExporter
from nbconvert.preprocessors import ExecutePreprocessor

from clothlab import _store
from clothlab._files import write_bytes
from clothlab.claims import Findings
from course.repository import portable
from course.solutions import ROOT, solved, unsolved, without

CELL_SECONDS = 1200  # [s] a cell that takes longer has hung
RECORDINGS = "CLOTHLAB_RECORDINGS"  # variable: where own recordings and tries lie


def student_edition(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook without its solutions and claims.

    Each check then finds the stub, and says what to do.
    """
    return without(unsolved(portable(notebook)), "solution", "claim")


def instructor_edition(
    notebook: nbformat.NotebookNode, folder: Path
) -> nbformat.NotebookNode:
    """The notebook after a run in a folder, with solutions as unfolded code.

    An error in a cell ends the run.
    """
    edition = solved(portable(notebook))
    for cell in edition.cells:
        cell.metadata.get("jupyter", {}).pop("source_hidden", None)
    return executed(edition, folder)


def executed(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook itself after a run in a folder, as of who has recorded nothing yet.

    Raises:
        nbclient.exceptions.CellExecutionError: an error in a cell without the tag
            `raises-exception`.
    """
    # Each kernel would warn that it speaks TCP
    quiet = ["--IPKernelApp.log_level=ERROR"]
    run = ExecutePreprocessor(timeout=CELL_SECONDS, extra_arguments=quiet)
    with _nothing_recorded():
        return run.preprocess(notebook, {"metadata": {"path": str(folder)}})[0]


@contextmanager
def _nothing_recorded() -> Iterator[None]:
    """Kernels that start meanwhile find no own recordings or tries, and leave none.

    Else an edition would show those of whoever makes it.
    """
    before = os.environ.get(RECORDINGS)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[RECORDINGS] = folder
        try:
            yield
        finally:
            del os.environ[RECORDINGS]
            if before is not None:
                os.environ[RECORDINGS] = before


def write_editions(path: Path, build: Path) -> nbformat.NotebookNode:
    """Write both editions of the notebook at `path` into `build`.

    The instructor's is written only if no cell fails, and returned.
    """
    notebook = nbformat.read(path, as_version=4)
    stubs = nbformat.writes(student_edition(notebook))
    write_bytes(build / "student" / path.name, stubs.encode())

    edition = instructor_edition(notebook, path.parent)
    title = {"metadata": {"name": path.stem}}
    page, _ = HTMLExporter().from_notebook_node(edition, title)
    folder = build / "instructor"
    write_bytes(folder / f"{path.stem}.html", page.encode())
    write_bytes(folder / path.name, nbformat.writes(edition).encode())
    return edition


def claims_held(edition: nbformat.NotebookNode) -> int:
    """How many claims a run has found to hold: each has a line with a mark."""
    outputs = [each for cell in edition.cells for each in cell.get("outputs", [])]
    said = [output.get("data", {}).get("text/plain", "") for output in outputs]
    lines = "\n".join(said).splitlines()
    return sum(line.startswith("✓") for line in lines)


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

    if arguments.record:
        os.environ[Findings.RECORD] = "1"
    for path in arguments.notebooks:
        start = time.perf_counter()
        held = claims_held(write_editions(path.resolve(), ROOT / "build"))
        seconds = time.perf_counter() - start
        print(f"{path.stem}: {held} claims hold, {seconds:.0f} s", flush=True)
    if arguments.record:
        _store.write_checksums()


if __name__ == "__main__":
    main()
