"""What the first cell of a published notebook does on Google Colab.

The cell clones the repository there, and then calls `install`. Colab comes with its own
PyTorch, NumPy and Jupyter, and its kernel is already running. What it has and
`pyproject.toml` can live with stays; what it lacks comes in the version of
`environment.txt`.
"""

import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping
from importlib.metadata import distributions, packages_distributions
from pathlib import Path

import nbformat
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
# Colab shows the notebooks itself, and the package is a clone beside them.
NOT_NEEDED = {"jupyterlab", "clothlab"}
CELL_ID = "colab"
CELL = """\
# @title On Google Colab only: get the repository and what Colab lacks
import os
import subprocess
import sys

if "google.colab" in sys.modules:
    os.environ["MUJOCO_GL"] = "egl"  # draws without a display
    if not os.path.exists("../environment.txt"):
        if not os.path.exists("clothlab"):
            clone = ["git", "clone", "--quiet", "--depth=1"]
            clone += ["{address}", "clothlab"]
            subprocess.run(clone, check=True)
        os.chdir("clothlab/notebooks")
    sys.path[:0] = [os.path.abspath(".."), os.path.abspath("../scripts")]
    import on_colab

    on_colab.install()"""


def first_cell(address: str) -> nbformat.NotebookNode:
    """The cell of a repository that is published at this address, folded."""
    return nbformat.v4.new_code_cell(
        CELL.format(address=address),
        id=CELL_ID,
        metadata={
            "cellView": "form",
            "jupyter": {"source_hidden": True},
            "tags": ["colab"],
        },
    )


def needed() -> list[Requirement]:
    """What the package and the notebooks import, as `pyproject.toml` says it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    needs = [Requirement(need) for need in project["dependencies"]]
    return [need for need in needs if need.name not in NOT_NEEDED]


def pins(lock: str) -> dict[str, str]:
    """What a lock pins, by canonical name: "numpy==2.4.1"."""
    found = {}
    for line in lock.splitlines():
        if "==" in line and not line.startswith("#"):
            pin = Requirement(line)
            found[canonicalize_name(pin.name)] = f"{pin.name}{pin.specifier}"
    return found


def lacking(
    needs: Iterable[Requirement], lock: str, installed: Mapping[str, str]
) -> dict[str, str]:
    """What pip has to install, by canonical name: pins for each need that is not met.

    Args:
        needs: what is imported, perhaps with the oldest version that will do.
        lock: text of the lock.
        installed: versions by canonical name.
    """
    pinned = pins(lock)
    unmet = {}
    for need in needs:
        name = canonicalize_name(need.name)
        version = installed.get(name)
        if version is None or not need.specifier.contains(version, prereleases=True):
            unmet[name] = pinned[name]
    return unmet


def imported_already(names: Iterable[str]) -> list[str]:
    """Which of these installed packages this process has imported.

    A new version would come too late for them.
    """
    wanted = set(names)
    found = []
    for module, owners in packages_distributions().items():
        theirs = {canonicalize_name(owner) for owner in owners}
        if module in sys.modules and wanted & theirs:
            found.append(module)
    return found


def install() -> None:
    """Install what this machine lacks, and let Colab show the widgets.

    Raises:
        SystemExit: the kernel has to start anew, since a package in use got a newer
            version.
    """
    # What draws without a display
    script = ROOT / "scripts" / "system_packages.sh"
    opengl = ["libegl1", "libopengl0", "libgl1-mesa-dri"]
    subprocess.run(["sh", str(script), *opengl], check=True)

    # Packages that are not there, or too old
    installed = {canonicalize_name(each.name): each.version for each in distributions()}
    unmet = lacking(needed(), (ROOT / "environment.txt").read_text("utf-8"), installed)
    stale = imported_already(set(unmet) & set(installed))
    if unmet:
        pip = [sys.executable, "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, *unmet.values()], check=True)
    if stale:
        raise SystemExit(
            "Choose Runtime, Restart session, then run all again: "
            f"{', '.join(stale)} is in use here."
        )

    # Widgets of other makers are off by default
    from google.colab import output

    output.enable_custom_widget_manager()
