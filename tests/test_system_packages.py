"""What a fresh machine lacks is installed where that is allowed; elsewhere the rest
runs, and a sentence says what.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
COPIED = (
    "Makefile",
    "scripts/system_packages.sh",
    "environment.txt",
    "environment-dev.txt",
    "docs/requirements.txt",
    "docs/course/requirements.txt",
)
TOOLS = [
    "sh",
    "bash",
    "make",
    "env",
    "grep",
    "sed",
    "cat",
    "rm",
    "mkdir",
    "cp",
    "ls",
    "touch",
    "tail",
    "mktemp",
    "tr",
    "basename",
    "sort",
    "expand",
    "uname",
    "date",
    "sleep",
    "nice",
]
VENV = [
    "python",
    "pip",
    "pytest",
    "ruff",
    "mypy",
    "playwright",
    "jupyter",
    "sphinx-build",
]
LINUX = pytest.mark.skipif(
    not sys.platform.startswith("linux"),
    reason="the packages are those of Debian and Ubuntu",
)
pytestmark = [LINUX, pytest.mark.skipif(not shutil.which("make"), reason="no make")]


class Machine:
    """A folder with the repository's Makefile, tools that only note their calls, and a
    PATH with nothing else.
    """

    def __init__(self, folder):
        self.folder, self.bin, self.calls = folder, folder / "bin", folder / "calls.log"
        self.bin.mkdir()
        self.calls.touch()
        for name in TOOLS:
            (self.bin / name).symlink_to(shutil.which(name))
        for name in [*COPIED, "pyproject.toml"]:
            (folder / name).parent.mkdir(exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
        (folder / "notebooks").mkdir()
        (folder / "notebooks" / "00_start_here.ipynb").touch()
        for name in VENV:
            self.fake(name, where=folder / ".venv" / "bin")
        self.fake("playwright", "exit 1", where=folder / ".venv" / "bin")
        for stamp in ("installed", "developer", "grading", "book"):
            (folder / ".venv" / stamp).touch()
        self.fake("python3")
        self.fake("git")
        self.fake("id", "echo 1000")
        self.fake("dpkg-query", "echo installed")

    def fake(self, name, does="exit 0", where=None):
        """Put a program on the PATH, or elsewhere, that notes its call and does
        something.
        """
        path = (where or self.bin) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/sh\necho "{name} $*" >>"{self.calls}"\n{does}\n')
        path.chmod(0o755)

    def run(self, *command):
        """Run a command there: its exit status, and the lines of what it printed,
        without make's own.
        """
        environment = {"PATH": str(self.bin), "HOME": str(self.folder)}
        done = subprocess.run(
            command,
            cwd=self.folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return done.returncode, [
            line for line in done.stdout.splitlines() if not line.startswith("make")
        ]

    def called(self, words):
        """The calls that begin with these words."""
        return [
            line
            for line in self.calls.read_text().splitlines()
            if line.startswith(words)
        ]


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


TESTS = ("make", "--keep-going", "test", "pages")
PARTS = (
    "ruff check",
    "mypy",
    "pytest --numprocesses=auto",
    "pytest --nbmake",
    "pytest -m browser",
)


def test_where_nothing_can_be_installed_the_rest_runs_and_the_end_is_red_with_one_sentence(
    machine,
):
    machine.fake("apt-get", "exit 100")
    status, printed = machine.run(*TESTS)
    assert status
    assert [
        words for words in (*PARTS, "pytest -m book") if not machine.called(words)
    ] == []
    sentence = "This machine lacks chromium: install by `sudo apt-get install chromium`, or what your system calls them."
    assert printed[-1] == sentence
    assert machine.called("apt-get") == [], "nobody may install here"


def test_a_failure_among_the_rest_does_not_stop_it_there_and_the_end_is_red(machine):
    machine.fake("pytest", "exit 1", where=machine.folder / ".venv" / "bin")
    status, printed = machine.run(*TESTS)
    assert status
    assert machine.called("pytest --nbmake")
    assert printed[-1].startswith("This machine lacks chromium")


def test_where_nothing_is_missing_a_failure_stops_it(machine):
    machine.fake("chromium")
    machine.fake("pytest", "exit 1", where=machine.folder / ".venv" / "bin")
    assert machine.run("make", "test")[0]
    assert not machine.called("pytest --nbmake")


def test_all_is_well_where_nothing_is_missing(machine):
    machine.fake("chromium")
    status, printed = machine.run(*TESTS)
    assert status == 0, printed
    assert [words for words in PARTS if not machine.called(words)] == []


def test_the_tests_in_python_need_no_browser(machine):
    status, printed = machine.run("make", "test")
    assert status == 0, printed
    assert machine.called("pytest --nbmake")
    assert not machine.called("pytest -m browser")


def test_pages_without_a_run_of_the_notebooks_make_one(machine):
    machine.fake("chromium")
    assert machine.run("make", "pages")[0] == 0
    assert machine.called("pytest --nbmake")


APT = 'case "$*" in *install*chromium) cp "{there}" "{bin}/chromium";; *install*libegl1) touch "{there}.egl";; esac'


@pytest.mark.parametrize("who", ["root", "a user of sudo"])
def test_what_is_missing_is_installed_by_who_may(machine, who):
    machine.fake("apt-get", APT.format(there=machine.bin / "git", bin=machine.bin))
    machine.fake(
        "dpkg-query",
        f'[ "$3" != libegl1 ] || [ -e "{machine.bin}/git.egl" ] && echo installed',
    )
    if who == "root":
        machine.fake("id", "echo 0")
    else:
        machine.fake("sudo", '[ "$1" != -n ] && exec "$@" || exit 0')
    status, printed = machine.run(
        "sh", "scripts/system_packages.sh", "python", "git", "egl", "chromium"
    )
    assert (status, printed) == (0, ["installing libegl1 chromium"])
    assert (
        len(machine.called("apt-get install"))
        == len(machine.called("apt-get")) - 1
        == 2
    )
    machine.calls.write_text("")
    assert machine.run("sh", "scripts/system_packages.sh", "egl", "chromium") == (0, [])
    assert machine.called("apt-get") == []


def test_a_failing_apt_leaves_one_sentence_and_every_other_package_has_its_try(machine):
    machine.fake("id", "echo 0")
    machine.fake("apt-get", "echo E: no network >&2; exit 100")
    machine.fake("dpkg-query", "exit 1")
    status, printed = machine.run("sh", "scripts/system_packages.sh", "egl", "chromium")
    assert status == 1
    assert len(machine.called("apt-get install")) == 5
    missing = "libegl1 libopengl0 libgl1-mesa-dri libatomic1 chromium"
    assert printed[-1].startswith(
        f"This machine lacks {missing}: install by `sudo apt-get install {missing}`"
    )


def test_a_python_without_venv_is_named_before_anything_else_is_tried(machine):
    machine.fake("python3.12", "exit 1")
    (machine.folder / ".venv" / "installed").unlink()
    status, printed = machine.run("make", "PYTHON=python3.12", "lab")
    assert status
    assert printed == [
        "This machine lacks python3 python3.12-venv: install by `sudo apt-get install python3 python3.12-venv`, "
        "or what your system calls them."
    ]


@pytest.mark.slow
def test_tests_in_a_browser_are_skipped_with_the_reason_where_there_is_none(tmp_path):
    names = ("chromium", "chromium-browser", "google-chrome")
    folders = [
        folder
        for folder in os.environ["PATH"].split(os.pathsep)
        if not any(Path(folder, n).exists() for n in names)
    ]
    environment = os.environ | {
        "PATH": os.pathsep.join(folders),
        "PLAYWRIGHT_BROWSERS_PATH": str(tmp_path),
    }
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-rs"]
    command += ["-m", "browser or book", "-k", "canvas or search"]
    command += ["tests/browser/test_target_canvas.py", "tests/book"]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout
    assert "passed" not in done.stdout
    skipped = [line for line in done.stdout.splitlines() if line.startswith("SKIPPED")]
    no_browser = "NO CHROMIUM: apt-get install chromium"
    reasons = {
        "tests/browser/": (no_browser,),
        "tests/book/": (no_browser, "NO student SITE"),
    }
    for folder, sentences in reasons.items():
        said = [line for line in skipped if folder in line]
        assert said, (folder, done.stdout)
        assert any(words in line for line in said for words in sentences), said
