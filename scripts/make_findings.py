"""`make findings`: every notebook at full size, and every claim checked on what it measured. About eight
minutes on two cores.

CI runs the notebooks with smaller parameters, where the claims are checked on stored figures alone. This runs them with
the parameters that are written in them. `--record` stores what they measured as the new figures.
"""

import argparse
import os
import time
from pathlib import Path

import nbformat
from make_editions import ROOT, execute
from tqdm.auto import tqdm

from clothlab import artifacts
from clothlab.experiments.claims import RECORD


def run(path: Path) -> list[str]:
    """Run a notebook in its folder and return the claims that it printed.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell fails, such as a claim that does not hold.
    """
    notebook = nbformat.read(path, as_version=4)
    execute(notebook, path.parent)
    printed = [output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", [])]
    return [line for text in printed for line in text.splitlines() if line.startswith("✓")]


def main() -> None:
    """Run those that were asked for."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=notebooks, default=list(notebooks), help="numbers of notebooks")
    parser.add_argument("--record", action="store_true", help="store what is measured as the new figures")
    arguments = parser.parse_args()
    if arguments.record:
        os.environ[RECORD] = "1"
    for number in tqdm(arguments.only, unit="notebook"):
        start = time.perf_counter()
        claims = run(notebooks[number])
        tqdm.write(f"{notebooks[number].stem}: {len(claims)} claims hold, {time.perf_counter() - start:.0f} s")
        for claim in claims:
            tqdm.write(f"  {claim}")
    if arguments.record:
        artifacts.write_checksums()


if __name__ == "__main__":
    main()
