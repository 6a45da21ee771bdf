"""`make lock`: three locks out of the names in `pyproject.toml`, and a table of the
machines that can install them.

| lock | who installs it |
| --- | --- |
| `environment.txt` | whoever runs the notebooks: JupyterLab, the method, the simulation, the widgets |
| `environment-dev.txt` | developers, beside it: tests, linters, Dask, Playwright, this script's own tool |
| `docs/requirements.txt` | `make book`, beside both |

One version serves every platform and every Python from `OLDEST` on. A version that is
locked stays until `--upgrade`. `--check` writes nothing, and only asks for every
platform and Python whether each pin has a wheel there.
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
    """One lock file, and what of `pyproject.toml` it holds that the locks before it
    don't.
    """

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
        extras=("cluster",),
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
    found = ((PIN.match(line), line) for line in text.splitlines())
    return {match["name"]: line for match, line in found if match}


def uv(*words: str) -> subprocess.CompletedProcess[str]:
    """Run uv of this environment in the repository; the caller looks at how it ended."""
    command = [sys.executable, "-m", "uv", *words]
    environment = os.environ | {"MACOSX_DEPLOYMENT_TARGET": OLDEST_MACOS}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True
    )


def resolve(locks: tuple[Lock, ...], known: str, *, upgrade: bool) -> dict[str, str]:
    """Pins of all that these locks ask for, for every platform; versions in the text
    `known` stay unless upgraded.

    Raises:
        SystemExit: no set of versions fits, with uv's reason.
    """
    asked = [
        word for lock in locks for extra in lock.extras for word in ("--extra", extra)
    ]
    asked += [word for lock in locks if lock.group for word in ("--group", lock.group)]
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "lock.txt"
        output.write_text(known)
        options = [
            "--universal",
            "--python-version",
            OLDEST,
            "--fork-strategy",
            "fewest",
        ]
        options += [
            "--no-header",
            "--no-annotate",
            "--quiet",
            *(["--upgrade"] if upgrade else []),
        ]
        done = uv(
            "pip",
            "compile",
            "pyproject.toml",
            *asked,
            *options,
            "--output-file",
            str(output),
        )
        if done.returncode:
            raise SystemExit(done.stderr)
        found = pins(output.read_text())
    return {name: line for name, line in found.items() if not CUDA.fullmatch(name)}


def write_locks(*, upgrade: bool) -> None:
    """Resolve all names together, then the first lock's alone and so on; each file has
    what those before it lack.
    """
    known = "\n".join(
        line for lock in LOCKS for line in pins((ROOT / lock.path).read_text()).values()
    )
    # All names together settle the versions, so that a later lock never contradicts an
    # earlier one.
    settled = "\n".join(resolve(LOCKS, known, upgrade=upgrade).values())
    written: set[str] = set()
    for k, lock in enumerate(LOCKS):
        found = resolve(LOCKS[: k + 1], settled, upgrade=False)
        lines = [line for name, line in found.items() if name not in written]
        written |= set(found)
        head = f"# {lock.purpose}, each package and its version: `make lock` makes it from pyproject.toml."
        text = "\n".join([head, *lock.first_lines, *lines, *lock.last_lines]) + "\n"
        (ROOT / lock.path).write_text(text, newline="\n")
        print(f"{lock.path}: {len(lines)} packages", flush=True)


def fault(lines: list[str], platform: str, python: str) -> str:
    """Why these pins can't be installed from wheels on a platform with a Python; empty
    if they can.
    """
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "asked.txt"
        asked.write_text("\n".join(lines))
        options = [
            "--python-platform",
            platform,
            "--python-version",
            python,
            "--only-binary",
            ":all:",
            "--quiet",
        ]
        done = uv(
            "pip",
            "compile",
            str(asked),
            *options,
            "--no-header",
            "--output-file",
            str(Path(folder) / "out"),
        )
    return " ".join(done.stderr.split()) if done.returncode else ""


def check_locks() -> list[str]:
    """Print a table of Pythons and platforms, and return a line for each that can't
    install one of the locks.
    """
    faults = []
    lines: list[str] = []
    machines = [(platform, python) for python in PYTHONS for platform in PLATFORMS]
    for lock in LOCKS:
        lines += pins((ROOT / lock.path).read_text()).values()
        with ThreadPoolExecutor(4) as pool:  # they wait for the network
            asked = (
                (lines, PLATFORMS[platform], python) for platform, python in machines
            )
            verdicts = dict(
                zip(machines, pool.map(lambda each: fault(*each), asked), strict=True)
            )
        print(
            f"\n{lock.path}\n{'':28}"
            + "".join(f"{platform:18}" for platform in PLATFORMS)
        )
        for python, where in PYTHONS.items():
            words = [
                "FAULT" if verdicts[platform, python] else "all wheels"
                for platform in PLATFORMS
            ]
            print(
                f"{python} ({where})".ljust(28)
                + "".join(f"{word:18}" for word in words),
                flush=True,
            )
        for (platform, python), reason in verdicts.items():
            faults += (
                [f"{lock.path}, Python {python}, {platform}: {reason}"]
                if reason
                else []
            )
    return faults


def main() -> int:
    """Write the locks and check them; the exit status says whether every machine can
    install them.
    """
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--upgrade", action="store_true", help="take the newest versions that fit"
    )
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args()
    if not arguments.check:
        write_locks(upgrade=arguments.upgrade)
    faults = check_locks()
    for line in faults:
        print(f"  ✗ {line}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
