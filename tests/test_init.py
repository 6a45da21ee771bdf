"""Importing the package: cheap, and able to draw in whatever order."""

import os
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import mujoco
import pytest

import clothlab
from clothlab.simulation.rendering import make_renderer

ROOT = Path(clothlab.__file__).parents[1]


def run(code: str, **environment: str) -> str:
    """What Python prints, started afresh without a choice of OpenGL."""
    inherited = {
        name: value
        for name, value in os.environ.items()
        if name not in ("MUJOCO_GL", "CLOTHLAB_OPENGL", "PYOPENGL_PLATFORM")
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


@pytest.mark.slow
@pytest.mark.parametrize("chosen", ["osmesa", "glfw", "disable"])
def test_what_draws_nothing_needs_no_opengl(chosen):
    code = """import ctypes.util
    ctypes.util.find_library = lambda name: None
    import clothlab
    from clothlab.simulation.env import ClothEnv
    env = ClothEnv()
    env.advance(env.arm.home_command)
    try:
        env.camera_picture()
    except RuntimeError as error:
        print(error)
    """
    lacking = {"MUJOCO_GL": chosen, "DISPLAY": "", "PYTHONWARNINGS": "ignore"}
    remedy = "is set, and does not draw here: unset it and restart Python"
    found = run(textwrap.dedent(f"    {code}"), **lacking)
    assert found.startswith(f"MUJOCO_GL={chosen} {remedy}"), found


@pytest.mark.parametrize(
    ("system", "remedy"),
    [("linux", "apt-get install"), ("darwin", "where there is a display")],
)
def test_the_remedy_is_one_of_this_system(env, system, remedy, monkeypatch):
    monkeypatch.setattr(clothlab, "opengl_named", "")
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(mujoco, "Renderer", None)
    with pytest.raises(RuntimeError, match=remedy):
        make_renderer(env.model, 30, 40)


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


def test_a_choice_of_the_package_is_no_user_s_in_a_process_below():
    code = "import clothlab, subprocess, sys; subprocess.run([sys.executable, '-c', 'import clothlab; print([clothlab.opengl_named])'])"
    assert run(code) == "['']\n"
    assert run(code, MUJOCO_GL="disable") == "['disable']\n"


def test_every_name_of_the_table_of_contents_is_there():
    assert 40 <= len(clothlab.__all__) <= 52
    assert all(hasattr(clothlab, name) for name in clothlab.__all__)


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="DPMBP"):
        clothlab.DPMBP  # noqa: B018
    assert not hasattr(clothlab, "trained")


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == clothlab.__version__
    assert f"version: {clothlab.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {clothlab.__version__}" in (ROOT / "CHANGELOG.md").read_text()
