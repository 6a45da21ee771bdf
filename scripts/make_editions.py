"""`make editions`: the notebooks for a class, in `build/`.

`build/student` has the stubs and no solutions. `build/instructor` has the solutions, executed, with all outputs, and
each notebook as a web page, too. About eight minutes for the whole series on two cores.
"""

import argparse
import copy
import hashlib
from pathlib import Path

import nbformat
from nbconvert import HTMLExporter
from nbconvert.preprocessors import ExecutePreprocessor
from tqdm.auto import tqdm

from clothlab._files import write_bytes

ROOT = Path(__file__).resolve().parents[1]
CELL_SECONDS = 600  # [s] a cell that takes longer has hung


def student_edition(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook without its solutions: each check then finds the stub, and says what to do.

    From the first stub on, an error stops no "Run all": what follows an exercise that is not solved is seen, too.
    """
    edition = without_solutions(_moved(notebook))
    unsolved = False
    for cell in edition.cells:
        if unsolved and cell.cell_type == "code":
            cell.metadata["tags"] = [*cell.metadata.get("tags", []), "raises-exception"]
        unsolved = unsolved or "stub" in cell.metadata.get("tags", [])
    return edition


def without_solutions(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook itself, whose solutions are gone."""
    notebook.cells = [cell for cell in notebook.cells if "solution" not in cell.metadata.get("tags", [])]
    return notebook


def instructor_edition(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook after a run from top to bottom, solutions unfolded.

    Args:
        notebook: as in the repository.
        folder: where its cells run.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell fails.
    """
    edition = _moved(notebook)
    for cell in edition.cells:
        cell.metadata.get("jupyter", {}).pop("source_hidden", None)
    execute(edition, folder)
    return edition


def execute(notebook: nbformat.NotebookNode, folder: Path) -> None:
    """Run a notebook's cells in a folder, and keep their outputs in it.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell fails.
    """
    quiet = ["--IPKernelApp.log_level=ERROR"]  # each kernel would warn that it speaks TCP
    ExecutePreprocessor(timeout=CELL_SECONDS, extra_arguments=quiet).preprocess(
        notebook, {"metadata": {"path": str(folder)}}
    )


def write_editions(path: Path, build: Path) -> None:
    """Write both editions of the notebook at `path` into `build`: nothing of the second if a cell fails."""
    notebook = nbformat.read(path, as_version=4)
    write_bytes(build / "student" / path.name, nbformat.writes(student_edition(notebook)).encode())
    executed = instructor_edition(notebook, path.parent)
    executed.metadata["made_from"] = made_from(path)
    page, _ = HTMLExporter().from_notebook_node(executed, {"metadata": {"name": path.stem}})
    write_bytes(build / "instructor" / path.name, nbformat.writes(executed).encode())
    write_bytes(build / "instructor" / f"{path.stem}.html", page.encode())


def write_small_copies(paths: list[Path], folder: Path) -> None:
    """Copies that `make notebooks` runs with the parameters of CI; tests, the site and the slides share that run."""
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        notebook.metadata["made_from"] = made_from(path)
        write_bytes(folder / path.name, nbformat.writes(notebook).encode())


def made_from(path: Path) -> str:
    """What a run of the notebook at `path` depends on, as a hash: its cells, the package, and the data."""
    package = sorted(each for each in (ROOT / "clothlab").rglob("*") if each.suffix in (".py", ".js"))
    read = hashlib.sha256()
    for each in (path, *package, ROOT / "data" / "SHA256SUMS"):
        read.update(each.name.encode() + b"\0" + each.read_bytes())
    return read.hexdigest()


def is_fresh(executed: Path, path: Path) -> bool:
    """Whether the run at `executed` is one of the notebook at `path`, with the package and the data as they are now."""
    return executed.exists() and nbformat.read(executed, as_version=4).metadata.get("made_from") == made_from(path)


def _moved(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy whose links to the repository lead out of `build/EDITION` instead of `notebooks`."""
    edition = copy.deepcopy(notebook)
    for cell in edition.cells:
        if cell.cell_type == "markdown":
            cell.source = cell.source.replace("](../", "](../../")
    return edition


def main() -> None:
    """Make both editions of the chosen notebooks."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=notebooks, default=list(notebooks), help="numbers of notebooks")
    parser.add_argument("--copies", action="store_true", help="only write build/small, which `make notebooks` runs")
    arguments = parser.parse_args()
    if arguments.copies:
        write_small_copies([notebooks[number] for number in arguments.only], ROOT / "build" / "small")
        return
    progress = tqdm(arguments.only, unit="notebook")
    for number in progress:
        progress.set_description(notebooks[number].stem)
        write_editions(notebooks[number], ROOT / "build")
    print(f"{ROOT / 'build'}: student, instructor")


if __name__ == "__main__":
    main()
