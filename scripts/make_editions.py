"""`make editions`: the notebooks for a class, in `build/`, about eight minutes for all of them on two cores.

`build/student` has the stubs and no solutions. `build/instructor` has the solutions, executed with the parameters that
are written in them, with all outputs, and each notebook as a web page, too. So every claim is checked on what was
measured; `--record` stores the figures (`make findings RECORD=1`).
"""

import argparse
import os
import time
from pathlib import Path

import nbformat
from nbconvert import HTMLExporter
from nbconvert.preprocessors import ExecutePreprocessor
from repository import portable

from clothlab import artifacts
from clothlab._files import write_bytes
from clothlab.experiments.claims import RECORD

ROOT = Path(__file__).resolve().parents[1]
CELL_SECONDS = 600  # [s] a cell that takes longer has hung


def student_edition(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook without its solutions and claims: each check then finds the stub, and says what to do.

    From the first stub on, an error stops no "Run all": what follows an exercise that is not solved is seen, too.
    """
    edition = without(portable(notebook), "solution", "claim")
    unsolved = False
    for cell in edition.cells:
        if unsolved and cell.cell_type == "code":
            cell.metadata["tags"] = [*cell.metadata.get("tags", []), "raises-exception"]
        unsolved = unsolved or "stub" in cell.metadata.get("tags", [])
    return edition


def without(notebook: nbformat.NotebookNode, *tags: str) -> nbformat.NotebookNode:
    """The notebook itself, whose cells with one of these tags are gone."""
    notebook.cells = [cell for cell in notebook.cells if not {*tags} & {*cell.metadata.get("tags", [])}]
    return notebook


def instructor_edition(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook after a run in a folder, with solutions unfolded; an error in a cell ends it."""
    edition = portable(notebook)
    for cell in edition.cells:
        cell.metadata.get("jupyter", {}).pop("source_hidden", None)
    quiet = ["--IPKernelApp.log_level=ERROR"]  # each kernel would warn that it speaks TCP
    run = ExecutePreprocessor(timeout=CELL_SECONDS, extra_arguments=quiet)
    return run.preprocess(edition, {"metadata": {"path": str(folder)}})[0]


def write_editions(path: Path, build: Path) -> nbformat.NotebookNode:
    """Write both editions of the notebook at `path` into `build`, the second only if no cell fails, and return it."""
    notebook = nbformat.read(path, as_version=4)
    write_bytes(build / "student" / path.name, nbformat.writes(student_edition(notebook)).encode())
    executed = instructor_edition(notebook, path.parent)
    page, _ = HTMLExporter().from_notebook_node(executed, {"metadata": {"name": path.stem}})
    write_bytes(build / "instructor" / f"{path.stem}.html", page.encode())
    write_bytes(build / "instructor" / path.name, nbformat.writes(executed).encode())
    return executed


def main() -> None:
    """Make both editions of each notebook that is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("notebooks", nargs="+", type=Path)
    parser.add_argument("--record", action="store_true", help="store what is measured as the new figures")
    arguments = parser.parse_args()
    os.environ |= {RECORD: "1"} if arguments.record else {}
    for path in arguments.notebooks:
        start = time.perf_counter()
        executed = write_editions(path.resolve(), ROOT / "build")
        printed = [output.get("text", "") for cell in executed.cells for output in cell.get("outputs", [])]
        held = sum(line.startswith("✓") for text in printed for line in text.splitlines())
        print(f"{path.stem}: {held} claims hold, {time.perf_counter() - start:.0f} s", flush=True)
    if arguments.record:
        artifacts.write_checksums()


if __name__ == "__main__":
    main()
