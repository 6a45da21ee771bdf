"""Google Colab: the first cell of a published notebook does nothing elsewhere, and there
gets all that is needed.
"""

import os
import subprocess
import sys
import types

import on_colab
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from repository import ROOT

ADDRESS = "https://github.com/someone/cloth"
CELL = on_colab.first_cell(ADDRESS).source
FAKE = """
import sys, types
google, colab, output = (types.ModuleType(name) for name in ("google", "google.colab", "google.colab.output"))
output.enable_custom_widget_manager = lambda: print("widgets")
google.colab, colab.output = colab, output
sys.modules |= {"google": google, "google.colab": colab, "google.colab.output": output}
"""
SEEN = "\nimport clothlab\nprint(clothlab.__file__, os.getcwd(), os.environ['MUJOCO_GL'], sep='\\n')\n"


def test_elsewhere_it_does_nothing(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = dict(os.environ), list(sys.path)
    exec(compile(CELL, "cell", "exec"), {})
    assert (dict(os.environ), list(sys.path)) == before
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Colab is Linux")
def test_on_colab_it_clones_moves_into_the_notebooks_and_runs_twice(tmp_path):
    git = tmp_path / "bin" / "git"
    git.parent.mkdir()
    # A clone by a link: what is tested is the cell, and nothing is fetched.
    git.write_text(
        f'#!/bin/sh\necho "git $*"\nfor last; do :; done\nln -s "{ROOT}" "$last"\n'
    )
    git.chmod(0o755)
    content = tmp_path / "content"
    content.mkdir()
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("MUJOCO_GL", "PYTHONPATH")
    }
    environment["PATH"] = f"{git.parent}{os.pathsep}{environment['PATH']}"
    command = [sys.executable, "-c", FAKE + CELL + "\n" + CELL + SEEN]
    done = subprocess.run(
        command, cwd=content, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    cloned, *widgets, package, folder, drawing = done.stdout.splitlines()
    assert cloned == f"git clone --quiet --depth=1 {ADDRESS} clothlab"
    assert widgets == ["widgets", "widgets"]
    assert os.path.samefile(package, ROOT / "clothlab" / "__init__.py")
    assert os.path.samefile(folder, ROOT / "notebooks")
    assert drawing == "egl"


LOCK = "# a lock\nanywidget==0.11.0\nmujoco==4.0.0\npandas==3.1.1\npywinpty==3 ; os_name == 'nt'\ntorch==2.13.0\n-e .\n"


def test_what_colab_has_stays_and_what_it_lacks_comes_as_it_is_locked():
    needs = [
        Requirement(each) for each in ("anywidget", "mujoco>=4", "pandas>=3.1", "torch")
    ]
    installed = {"pandas": "2.2.2", "torch": "2.9.0+cu128", "mujoco": "4.0.1"}
    wanted = on_colab.lacking(needs, LOCK, installed)
    assert wanted == {"anywidget": "anywidget==0.11.0", "pandas": "pandas==3.1.1"}


def test_all_that_is_needed_is_locked():
    lock = (ROOT / "environment.txt").read_text("utf-8")
    names = {canonicalize_name(need.name) for need in on_colab.needed()}
    assert (
        set(on_colab.lacking(on_colab.needed(), lock, {}))
        == names
        >= {"mujoco", "torch", "imageio"}
    )


@pytest.mark.parametrize("version", ["2.2.2", "3.1.1"])
def test_a_package_in_use_that_gets_a_newer_version_asks_for_a_restart(
    version, monkeypatch
):
    ran = []
    colab = types.SimpleNamespace(
        output=types.SimpleNamespace(
            enable_custom_widget_manager=lambda: ran.append("on")
        )
    )
    monkeypatch.setitem(sys.modules, "google.colab", colab)
    monkeypatch.setattr(
        on_colab.subprocess, "run", lambda command, check: ran.append(command)
    )
    monkeypatch.setattr(
        on_colab,
        "needed",
        lambda: [Requirement("pandas>=3.1"), Requirement("none-such>=1")],
    )
    monkeypatch.setattr(
        on_colab,
        "pins",
        lambda _: {"pandas": "pandas==3.1.1", "none-such": "none-such==1.0"},
    )
    have = types.SimpleNamespace(name="pandas", version=version)
    monkeypatch.setattr(on_colab, "distributions", lambda: [have])
    pip = [sys.executable, "-m", "pip", "install", "--quiet"]
    if version == "3.1.1":
        on_colab.install()
        assert ran[1:] == [[*pip, "none-such==1.0"], "on"]
    else:
        with pytest.raises(
            SystemExit, match="Restart session, then run all again: pandas is in use"
        ):
            on_colab.install()
        assert ran[1:] == [[*pip, "pandas==3.1.1", "none-such==1.0"]]
