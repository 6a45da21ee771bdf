"""What README and docs tell a reader to run is there, and runs."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import numpy as np
import pytest
from PIL import Image

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
PAGES = sorted([*PAGES, ROOT / "data" / "README.md", ROOT / "web" / "README.md"])
PAGES.remove(ROOT / "CHANGELOG.md")  # it names what was there once
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
TARGETS = set(re.findall(r"^([a-z][a-z-]*):", MAKEFILE, re.MULTILINE))
# As a person calls make: `make test`, which runs this, has options of its own
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}

each_page = pytest.mark.parametrize(
    "page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix()
)


def commands(text):
    """What a page quotes as a command: lines of its blocks, and words in backticks."""
    blocks = re.findall(r"```(?:sh|powershell)\n(.*?)```", text, re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return lines + [" ".join(each.split()) for each in re.findall(r"`([^`]+)`", text)]


def test_the_readme_throws_a_cloth_near_the_target(capsys):
    readme = (ROOT / "README.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    exec(compile(code, "README", "exec"), {})
    printed = capsys.readouterr().out
    (said,) = re.findall(r"# best IoU (0\.\d\d)\n", code)
    assert re.fullmatch(r"best IoU 0\.\d\d\n", printed)
    # Other graphics or another processor change the last digits, and so the throw
    assert float(printed.split()[-1]) == pytest.approx(float(said), abs=0.1)


def targets_of(command):
    """The targets of a call of make: neither options nor variables."""
    words = shlex.split(command, comments=True)[1:]
    folder = words.index("--directory") + 1 if "--directory" in words else None
    return [
        word
        for k, word in enumerate(words)
        if k != folder and not word.startswith("-") and "=" not in word
    ]


@each_page
def test_every_target_of_make_that_a_page_names_is_there(page):
    called = [
        each for each in commands(page.read_text("utf-8")) if re.match(r"make\b", each)
    ]
    named = {target for each in called for target in targets_of(each)}
    assert named - TARGETS == set()


def test_every_target_of_make_that_notebooks_and_errors_name_is_there():
    texts = [path.read_text("utf-8") for path in (ROOT / "clothlab").rglob("*.py")]
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        cells = nbformat.read(path, as_version=4).cells
        texts += [cell.source for cell in cells]
    named = {name for text in texts for name in re.findall(r"`make ([a-z-]+)", text)}
    assert "data" in named
    assert named - TARGETS == set()


def test_help_lists_a_dozen_targets_in_groups(tmp_path):
    said = subprocess.run(
        ["make"], cwd=ROOT, env=ENVIRONMENT, check=True, capture_output=True, text=True
    ).stdout
    listed = re.findall(r"^  make ([a-z-]+)", said, re.MULTILINE)
    assert {"lab", "throw", "test", "editions", "grade", "results"} <= set(listed)
    assert set(listed) <= TARGETS
    assert len(listed) <= 16
    groups = [line for line in said.splitlines() if line and line[0] != " "]
    assert groups[:4] == [
        "To learn and to look",
        "To teach",
        "To compute the results again",
        "To change it",
    ]


@pytest.mark.skipif(shutil.which("setpriv") is None, reason="Linux has setpriv")
def test_where_nothing_can_be_written_make_says_what_to_type(tmp_path):
    for name in ("Makefile", "environment.txt", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    tmp_path.chmod(0o555)
    # Root could write all the same, were it not for this
    plain = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"]
    command = [*(plain if os.getuid() == 0 else []), "make", "lab"]
    done = subprocess.run(
        command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True
    )
    tmp_path.chmod(0o755)
    assert done.returncode == 2
    assert done.stdout.count("\n") == 1
    assert f"cp -R '{tmp_path}' ~/clothlab && make -C ~/clothlab lab" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="make installs on Linux alone")
@pytest.mark.parametrize("offline", ["pip", "uv"])
def test_the_last_word_on_a_missing_network_is_what_to_type(tmp_path, offline):
    for name in ("Makefile", "environment.txt", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    for name in ("pip", "uv"):
        does = "false" if name == offline else "true"
        (tmp_path / ".venv" / "bin" / name).symlink_to(f"/bin/{does}")
    done = subprocess.run(
        ["make", "lab", "PYTHON=true"],  # makes no environment over this one
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stdout.splitlines()[-1].endswith("and type again: make lab")
    assert not (tmp_path / ".venv" / "installed").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="make installs on Linux alone")
@pytest.mark.parametrize(
    ("target", "package"),
    [
        *((target, "libegl1") for target in ("lab", "throw", "paper", "check")),
        *((target, "libatomic1") for target in ("check", "tested", "test-site")),
    ],
)
def test_what_a_bare_system_lacks_is_installed_by_whatever_needs_it(target, package):
    done = subprocess.run(
        ["make", "--dry-run", target],
        cwd=ROOT,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    installs = [line.split() for line in done.stdout.splitlines() if "packages" in line]
    assert any(package in each for each in installs)


@pytest.mark.skipif(sys.platform != "linux", reason="make installs on Linux alone")
def test_the_last_word_on_a_missing_browser_is_what_to_type(tmp_path):
    for name in ("Makefile", "scripts/system_packages.sh"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    for name, does in {
        "id": "echo 1000",
        "playwright": "echo no network >&2; exit 1",
    }.items():
        fake = tmp_path / ".venv" / "bin" / name
        fake.write_text(f"#!/bin/sh\n{does}\n")
        fake.chmod(0o755)
    for name in ("sudo", "dpkg-query"):
        (tmp_path / ".venv" / "bin" / name).symlink_to("/bin/false")
    for name in ("environment.txt", "pyproject.toml", ".venv/installed"):
        (tmp_path / name).touch()
    path = f"{tmp_path / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["make", "chromium"],
        cwd=tmp_path,
        env=ENVIRONMENT | {"PATH": path},
        capture_output=True,
        text=True,
    )
    *_, said, _ = done.stderr.splitlines()  # the last line is make's
    assert done.returncode == 2
    assert "sudo apt-get install chromium" in said


@each_page
def test_every_file_and_module_that_a_page_names_is_there(page):
    """Files of the repository by their path, and what `python -m` runs."""
    quoted = commands(page.read_text("utf-8"))
    folders = r"(?:clothlab|studies|scripts|tests|web|docs|notebooks|data)"
    kinds = r"(?:py|md|toml|ipynb|csv|js|sh|svg|png|gif)"
    paths = {
        path
        for each in quoted
        for path in re.findall(rf"(?<![\w/.]){folders}/[\w./-]+\.{kinds}\b", each)
        if not re.search(r"[A-Z]{4,}\.(?!md)|NAME", path)
    }
    assert {path for path in paths if not (ROOT / path).exists()} == set()
    modules = {
        name
        for each in quoted
        for name in re.findall(r"python -m (?!pip|venv)([\w.]+)", each)
    }
    missing = {
        name
        for name in modules
        if not (ROOT / name.replace(".", "/")).with_suffix(".py").is_file()
        and not (ROOT / name.replace(".", "/") / "__main__.py").is_file()
    }
    assert missing == set()


def test_a_target_or_file_that_is_not_there_is_found():
    text = "```sh\nmake lab --jobs=2 NAMES=x  # make all\n```\n`make\nnone-such`"
    called = commands(text)
    assert [targets_of(each) for each in called] == [["lab"], ["none-such"]]


@each_page
def test_brackets_of_a_page_are_closed(page):
    """A link that lost its beginning shows its address to the reader."""
    text = re.sub(
        r"```.*?```|`[^`]*`|\$[^$]*\$", "", page.read_text("utf-8"), flags=re.S
    )
    for paragraph in text.split("\n\n"):
        assert paragraph.count("[") == paragraph.count("]"), paragraph
        assert "](" not in re.sub(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(", "", paragraph)


def test_installations_by_hand_are_the_ones_of_the_lock():
    """Windows and macOS have no make here: what they type is what make does."""
    install = (ROOT / "docs" / "install.md").read_text("utf-8")
    for python in (r".venv\Scripts\python", ".venv/bin/python"):
        assert f"{python} -m pip install -r environment.txt" in install
        assert f"{python} -m clothlab doctor" in install


def test_the_moving_picture_halts_where_it_is_nearest_to_the_target():
    overlaps, halts = [], []
    with Image.open(ROOT / "docs" / "control.gif") as film:
        for k in range(film.n_frames):
            film.seek(k)
            side = np.asarray(film.convert("L"))[:, -film.width // 3 :] > 150
            side[:30] = side[144:174] = False  # captions
            target, seen = side[:144], side[144:]
            overlaps.append((seen & target).sum() / (seen | target).sum())
            halts.append(film.info["duration"] > 500)

    # It begins at a halt, somewhere in a period; of each step, the camera sees the last
    # of three frames
    assert halts[0]
    seen = np.array(overlaps)[::3]
    halted = np.flatnonzero(halts) // 3
    best = []
    for shift in range(8):
        steps = np.roll(np.arange(len(seen)), shift).reshape(-1, 8)
        best.append(sorted(steps[range(len(steps)), seen[steps].argmax(axis=1)]))
    assert list(halted) in best
    assert seen[halted].min() > 0.6
