"""Importing the package: cheap, and able to draw in whatever order."""

import os
import subprocess
import sys

import pytest


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


def test_importing_the_package_imports_little():
    heavy = "{'torch', 'sklearn', 'matplotlib'} & set(sys.modules)"
    code = "import clothlab, sys; print({'mujoco', 'numpy'} & set(sys.modules)); import clothlab.simulation.env"
    assert run(f"{code}; print({heavy})") == "set()\nset()\n"


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
