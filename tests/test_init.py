"""Importing the package: cheap, and able to draw in whatever order."""

import ast
import importlib
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]


def run(code: str, **environment: str) -> str:
    """What Python prints, started afresh without a choice of OpenGL."""
    inherited = {
        name: value
        for name, value in os.environ.items()
        if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")
    }
    process = [sys.executable, "-c", code]
    return subprocess.run(
        process, env=inherited | environment, capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.slow
def test_importing_the_package_imports_little():
    without = {  # what each import, after those before it, does without
        "clothlab": {"mujoco", "numpy"},
        "clothlab.simulation.env": {"torch", "sklearn", "matplotlib"},
        "clothlab.analysis, clothlab.checks": {"sklearn", "scipy.stats"},
        "clothlab.lab, studies": {"sklearn", "scipy.stats"},
    }
    lines = [
        f"import {each}; print({names} & {{*sys.modules}})"
        for each, names in without.items()
    ]
    assert run("\n".join(["import sys", *lines])) == len(without) * "set()\n"


@pytest.mark.slow
def test_it_draws_where_mujoco_was_imported_first():
    code = "import mujoco; from clothlab.simulation.env import ClothEnv; print(ClothEnv().reset()[0]['image'].sum() > 100)"
    assert run(code) == "True\n"


def test_a_choice_of_opengl_is_respected():
    assert (
        run("import clothlab, os; print(os.environ['MUJOCO_GL'])", MUJOCO_GL="disable")
        == "disable\n"
    )


CHOICES = {
    "{'EGL', 'OpenGL'}": "egl",
    "{'EGL', 'GL'}": "egl",
    "{'EGL'}": "disable",  # as on a bare Debian with libegl1 alone
    "{'EGL', 'OSMesa'}": "osmesa",
    "{'OSMesa'}": "osmesa",
    "set()": "disable",
}


@pytest.mark.parametrize(("found", "chosen"), CHOICES.items())
def test_opengl_is_chosen_by_what_is_installed(found, chosen):
    code = f"import ctypes.util, os; ctypes.util.find_library = lambda name: name in {found} or None"
    assert (
        run(f"{code}; import clothlab; print(os.environ['MUJOCO_GL'])") == f"{chosen}\n"
    )


# As if these packages were not installed
BLOCK = """
from importlib.machinery import PathFinder

BLOCKED = {blocked}
find = PathFinder.find_spec

def seem_missing(name, *where):
    return None if name.split(".")[0] in BLOCKED else find(name, *where)

PathFinder.find_spec = seem_missing
"""


def test_the_table_of_contents_holds_and_its_stub_says_the_same():
    found = {name: getattr(clothlab, name) for name in clothlab.__all__}
    assert set(clothlab.__all__) <= set(dir(clothlab))
    assert 40 <= len(found) <= 52
    stub = ast.parse(Path(clothlab.__file__).with_suffix(".pyi").read_text())
    places = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                assert alias.asname == alias.name  # or it would not be exported
                places[alias.name] = getattr(
                    importlib.import_module(node.module), alias.name
                )
    assert places == found


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'clothlab' has no attribute 'DPMBP'"):
        clothlab.DPMBP  # noqa: B018
    assert not hasattr(clothlab, "trained")


@pytest.mark.parametrize(
    ("blocked", "code", "message"),
    [
        pytest.param(
            "cv2",
            "import clothlab; clothlab.load_target",
            "clothlab.load_target needs cv2: pip install 'clothlab[cloth]'",
            marks=pytest.mark.slow,  # OpenCV comes late
        ),
        (
            "matplotlib",
            "from clothlab import plots",
            "clothlab.plots needs matplotlib: pip install 'clothlab[notebooks]'",
        ),
        (
            "mujoco",
            "import clothlab.simulation.env",
            "clothlab.simulation needs mujoco: pip install 'clothlab[cloth]'",
        ),
    ],
)
def test_a_missing_extra_is_one_sentence(blocked, code, message):
    block = BLOCK.replace("{blocked}", repr({blocked}))
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run(block + code)
    assert caught.value.stderr.splitlines()[-1] == f"ModuleNotFoundError: {message}"


def test_gymnasium_without_a_simulation_is_no_fault():
    block = BLOCK.replace("{blocked}", repr({"mujoco"}))
    assert (
        run(block + "import gymnasium, clothlab; print(clothlab.iou.__name__)")
        == "iou\n"
    )


@pytest.mark.slow
def test_intervals_need_no_simulation():
    """Examples of robots that are no cloth end with one."""
    block = BLOCK.replace("{blocked}", repr({"mujoco", "cv2"}))
    code = "from clothlab.analysis import crossed_interval as f; print(f.__name__)"
    assert run(block + code) == "crossed_interval\n"


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == clothlab.__version__
    assert f"version: {clothlab.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {clothlab.__version__}" in (ROOT / "CHANGELOG.md").read_text()
