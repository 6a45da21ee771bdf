"""What the package does from the command line.

`python -m clothlab doctor` checks the machine, `checksums` records the hashes of
`data/`, and `fetch` gets the data where the package came without a clone.
"""

import argparse
import os
import platform
import sys
import time
from collections import Counter
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path

from clothlab._store import (
    Verdict,
    check_data,
    cure,
    data_folder,
    fetch,
    fetchable,
    is_cache,
    write_checksums,
)

_ENVIRONMENT = Path(__file__).resolve().parents[1] / "environment.txt"
_PICTURES = 20  # drawn to measure how long one takes


def _check_versions() -> list[str]:
    """Compare installed packages with `environment.txt`.

    Returns one line of advice for each difference.
    """
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    print(f"Python    {platform.python_version()} on {system}")
    shown = ("mujoco", "torch", "numpy", "gymnasium")
    print("packages  " + ", ".join(f"{name} {_version(name)}" for name in shown))
    if not _ENVIRONMENT.exists():
        return []  # installed as a wheel, whose user chooses versions

    from packaging.utils import canonicalize_name  # comes with `clothlab[cloth]`

    pins = pins_of(_ENVIRONMENT.read_text("utf-8"))
    installed = {}
    for each in distributions():
        # The build of a version, as in 2.13.0+cpu, is nobody's choice.
        installed[str(canonicalize_name(each.name))] = each.version.split("+")[0]
    advice = []
    for name, pinned in pins.items():
        found = installed.get(name, "missing")
        if found != pinned:
            cured = f"pip install {name}=={pinned}"
            advice.append(f"{name} is {found}, pinned is {pinned}: {cured}")
    print(f"          {len(pins) - len(advice)} of {len(pins)} pins met")
    return advice


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


def pins_of(lock: str) -> dict[str, str]:
    """The versions that the text of a lock pins for this platform and Python.

    They stand under the packages' canonical names.
    """
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    pins = {}
    for line in lock.splitlines():
        if "==" in line and not line.startswith("#"):
            asked = Requirement(line)
            if asked.marker is None or asked.marker.evaluate():
                pinned = str(asked.specifier).removeprefix("==")
                pins[str(canonicalize_name(asked.name))] = pinned
    return pins


def _check_drawing() -> list[str]:
    """Draw a few camera pictures; return advice where that fails."""
    back_end = os.environ.get("MUJOCO_GL", "MuJoCo's choice")
    try:
        from clothlab.simulation.env import ClothEnv

        env = ClothEnv()
        env.reset()
        start = time.perf_counter()
        for _ in range(_PICTURES):
            env.camera_picture()
        milliseconds = (time.perf_counter() - start) / _PICTURES * 1e3
        env.close()
    except (RuntimeError, ModuleNotFoundError) as error:
        print(f"OpenGL    {back_end}: does not draw")
        return [str(error)]
    print(f"OpenGL    {back_end}: {milliseconds:.1f} ms for each 128×96 image")
    return []


def check_files() -> list[str]:
    """Compare `data/` with its recorded hashes.

    Returns advice for each file that differs.
    """
    try:
        folder = data_folder()
    except (FileNotFoundError, ModuleNotFoundError) as error:
        return [str(error)]
    verdicts = check_data()

    # One line for all of them.
    counts = Counter({Verdict.OK: 0})  # named first
    counts.update(verdicts.values())
    summary = ", ".join(f"{number} {word}" for word, number in counts.items())
    print(f"data      {folder}: {summary}")
    if not verdicts:
        return ["data/ is empty: git checkout data, or make data train"]

    # Each fault has its cure; what is still to come is none.
    advice = []
    for name, verdict in verdicts.items():
        if verdict in (Verdict.MISSING, Verdict.ALTERED):
            advice.append(f"data/{name} is {verdict}: {cure(name)}")
        elif verdict is Verdict.NOT_RECORDED:
            cured = "record its hash with `python -m clothlab checksums`"
            advice.append(f"data/{name} is {verdict}: {cured}")
    return advice


def doctor() -> int:
    """Print versions, drawing speed and state of the data; return the exit status.

    A line of advice follows for each fault.
    """
    advice = _check_versions() + _check_drawing() + check_files()
    for line in advice:
        print(f"  ✗ {line}")
    if not advice:
        print("  ✓ all is well")
    return bool(advice)


def checksums() -> int:
    """Record the hash of every file in `data/`; return the exit status."""
    try:
        write_checksums()
        print(f"wrote {data_folder() / 'SHA256SUMS'}")
    except (OSError, ValueError) as error:
        print(f"  ✗ {error}", file=sys.stderr)
        return 1
    return 0


def fetch_files(parts: list[str]) -> int:
    """Fetch all files of these parts of `data/`; return the exit status."""
    try:
        folder = data_folder()
        if not is_cache(folder):
            print(f"nothing to fetch: the data are in {folder}")
            return 0
        names = {name for part in parts or [""] for name in fetchable(part)}
        for name in sorted(names):
            fetch(name, folder)
    except (OSError, ValueError, ModuleNotFoundError) as error:
        print(f"  ✗ {error}", file=sys.stderr)
        return 1
    print(f"{len(names)} files are in {folder}")
    return 0


def main() -> int:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(prog="python -m clothlab", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("doctor", help="check versions, drawing and data")
    commands.add_parser("checksums", help="record the hash of every file in data/")
    fetching = commands.add_parser("fetch", help="get the data without a clone")
    fetching.add_argument(
        "parts", nargs="*", metavar="PART", help="such as weights or trials/train"
    )

    arguments = parser.parse_args()
    if arguments.command == "doctor":
        return doctor()
    if arguments.command == "checksums":
        return checksums()
    return fetch_files(arguments.parts)


if __name__ == "__main__":
    sys.exit(main())
