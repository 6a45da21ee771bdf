"""Three locks out of the names in `pyproject.toml`, and who can install them.

- `environment.txt`: for whoever runs the notebooks: JupyterLab, the method, the
  simulation, the widgets,
- `environment-dev.txt`: for developers, beside it: tests, linters, Dask, Playwright,
  this script's own tool,
- `docs/requirements.txt`: for `make book`, beside both.

One version serves every platform and every Python from `OLDEST` on. `make_locks.py
write` makes them, and checks them (`make lock`); a version that is locked stays until
`--upgrade`. `make_locks.py check` asks for every platform and Python whether each pin
has a wheel there.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OLDEST = "3.11.2"  # Python of Debian 12
PYTHONS = {  # where it comes from
    OLDEST: "Debian 12",
    "3.12.3": "Ubuntu 24.04",
    "3.13.5": "Debian 13, Colab",
    "3.14.0": "the newest",
}
PLATFORMS = {  # as uv calls them; glibc 2.36 is that of Debian 12
    "Linux x86-64": "x86_64-manylinux_2_36",
    "Windows x86-64": "x86_64-pc-windows-msvc",
    "macOS arm64": "aarch64-apple-darwin",
}
OLDEST_MACOS = "14.0"  # that PyTorch's wheels are made for
# On Linux, PyTorch's default build asks for these, several gigabytes. No lock names
# them: pip takes what the build at hand asks for, which is nothing where the small
# build for processors alone is already installed or found first.
CUDA = re.compile(r"(nvidia|cuda)-[\w-]+|triton")
PIN = re.compile(r"(?P<name>[\w.-]+)==(?P<version>[^\s;]+)")


@dataclass(frozen=True)
class Lock:
    """A lock file: what of `pyproject.toml` it holds and the locks before it don't."""

    path: str
    purpose: str
    extras: tuple[str, ...] = ()
    group: str = ""
    first_lines: tuple[str, ...] = ()
    last_lines: tuple[str, ...] = ()


LOCKS = (
    Lock(
        "environment.txt",
        "What runs the notebooks",
        extras=("cloth", "notebooks", "sysid", "robots"),
        last_lines=("-e .",),
    ),
    Lock(
        "environment-dev.txt",
        "What developers need beside environment.txt",
        extras=("cluster", "onnx"),
        group="dev",
        first_lines=("-r environment.txt",),
    ),
    Lock(
        "docs/requirements.txt",
        "What `make book` needs beside environment.txt and environment-dev.txt",
        group="book",
    ),
)


def pins(text: str) -> dict[str, str]:
    """The lines of a lock that pin a package, by the package's name."""
    found = {}
    for line in text.splitlines():
        if match := PIN.match(line):
            found[match["name"]] = line
    return found


def uv(*words: str) -> subprocess.CompletedProcess[str]:
    """Run uv of this environment in the repository.

    The caller looks at how it ended.
    """
    command = [sys.executable, "-m", "uv", *words]
    environment = os.environ | {"MACOSX_DEPLOYMENT_TARGET": OLDEST_MACOS}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True
    )


def resolve(locks: tuple[Lock, ...], known: str, *, upgrade: bool) -> dict[str, str]:
    """Pins of all that these locks ask for, for every platform.

    Versions in the text `known` stay unless upgraded.

    Raises:
        SystemExit: no set of versions fits, with uv's reason.
    """
    # What is asked for, and how: one version for all machines
    options = ["--universal", f"--python-version={OLDEST}", "--fork-strategy=fewest"]
    options += ["--no-header", "--no-annotate", "--quiet"]
    for lock in locks:
        options += [f"--extra={extra}" for extra in lock.extras]
        options += [f"--group={lock.group}"] if lock.group else []
    if upgrade:
        options.append("--upgrade")

    # uv keeps the versions that it finds in the file which it writes
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "lock.txt"
        output.write_text(known)
        done = uv(
            "pip", "compile", "pyproject.toml", *options, f"--output-file={output}"
        )
        if done.returncode:
            raise SystemExit(done.stderr)
        found = pins(output.read_text())
    return {name: line for name, line in found.items() if not CUDA.fullmatch(name)}


def write_locks(*, upgrade: bool) -> None:
    """Resolve all names together, then the first lock's alone and so on.

    Each file has what those before it lack.
    """
    # All names together settle the versions, so that a later lock never contradicts an
    # earlier one.
    known: list[str] = []
    for lock in LOCKS:
        known += pins((ROOT / lock.path).read_text()).values()
    settled = "\n".join(resolve(LOCKS, "\n".join(known), upgrade=upgrade).values())

    # Of those, each lock holds its own
    written: set[str] = set()
    for k, lock in enumerate(LOCKS):
        found = resolve(LOCKS[: k + 1], settled, upgrade=False)
        lines = [line for name, line in found.items() if name not in written]
        written |= set(found)
        head = (
            f"# {lock.purpose}, each package and its version: "
            "`make lock` makes it from pyproject.toml."
        )
        text = "\n".join([head, *lock.first_lines, *lines, *lock.last_lines]) + "\n"
        (ROOT / lock.path).write_text(text, newline="\n")
        print(f"{lock.path}: {len(lines)} packages", flush=True)


def fault(lines: list[str], platform: str, python: str) -> str:
    """Why these pins can't be installed from wheels; empty if they can.

    On one platform with one Python.
    """
    options = [f"--python-platform={platform}", f"--python-version={python}"]
    options += ["--only-binary=:all:", "--quiet", "--no-header"]
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "asked.txt"
        asked.write_text("\n".join(lines))
        output = Path(folder) / "out.txt"
        done = uv("pip", "compile", str(asked), *options, f"--output-file={output}")
    return " ".join(done.stderr.split()) if done.returncode else ""


Verdicts = dict[tuple[str, str], str]  # of platform and Python: what is at fault


def verdicts_on(lines: list[str]) -> Verdicts:
    """Whether these pins can be installed: of every platform and Python a reason."""
    machines = [(platform, python) for python in PYTHONS for platform in PLATFORMS]

    def verdict(machine: tuple[str, str]) -> str:
        platform, python = machine
        return fault(lines, PLATFORMS[platform], python)

    with ThreadPoolExecutor(4) as pool:  # they wait for the network
        return dict(zip(machines, pool.map(verdict, machines), strict=True))


def show(title: str, verdicts: Verdicts) -> None:
    """Print a table of Pythons and platforms."""
    heads = "".join(f"{platform:18}" for platform in PLATFORMS)
    print(f"\n{title}\n{'':28}{heads}")
    for python, where in PYTHONS.items():
        line = f"{python} ({where})".ljust(28)
        for platform in PLATFORMS:
            word = "FAULT" if verdicts[platform, python] else "all wheels"
            line += f"{word:18}"
        print(line, flush=True)


def check_locks() -> list[str]:
    """Print a table for each lock, and return a line for each machine that can't."""
    faults = []
    lines: list[str] = []
    for lock in LOCKS:
        # A lock is installed beside those before it
        lines += pins((ROOT / lock.path).read_text()).values()
        verdicts = verdicts_on(lines)
        show(lock.path, verdicts)
        for (platform, python), reason in verdicts.items():
            if reason:
                faults.append(f"{lock.path}, Python {python}, {platform}: {reason}")
    return faults


def main() -> int:
    """Write the locks and check them, or only check them.

    The exit status says whether every machine can install them.
    """
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True, dest="command")
    write = commands.add_parser("write", help="make the locks, and check them")
    write.add_argument(
        "--upgrade", action="store_true", help="take the newest versions that fit"
    )
    commands.add_parser("check", help="ask whether every machine can install them")
    arguments = parser.parse_args()
    if arguments.command == "write":
        write_locks(upgrade=arguments.upgrade)
    faults = check_locks()
    for line in faults:
        print(f"  ✗ {line}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
