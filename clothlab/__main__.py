"""`python -m clothlab doctor` checks the machine, `python -m clothlab checksums`
records the hashes of `data/`.
"""

import argparse
import os
import platform
import sys
import time
from collections import Counter
from importlib.metadata import distributions, version
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from clothlab._store import LEFT_TO_MAKE, check_data, cure, data_folder, write_checksums
from clothlab.simulation.env import ClothEnv

_ENVIRONMENT = Path(__file__).resolve().parents[1] / "environment.txt"


def _check_versions() -> list[str]:
    """Compare installed packages with `environment.txt`; return one line of advice for
    each difference.
    """
    shown = {name: version(name) for name in ("mujoco", "torch", "numpy", "gymnasium")}
    print(
        f"Python    {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    print(
        "packages  " + ", ".join(f"{name} {number}" for name, number in shown.items())
    )
    if not _ENVIRONMENT.exists():
        return []  # installed as a wheel, whose user chooses versions
    pins = pins_of(_ENVIRONMENT.read_text("utf-8"))
    installed = {
        str(canonicalize_name(each.name)): each.version.split("+")[0]
        for each in distributions()
    }
    found = {name: installed.get(name, "missing") for name in pins}
    wrong = [name for name in pins if found[name] != pins[name]]
    print(f"          {len(pins) - len(wrong)} of {len(pins)} pins met")
    return [
        f"{name} is {found[name]}, pinned is {pins[name]}: pip install {name}=={pins[name]}"
        for name in wrong
    ]


def pins_of(lock: str) -> dict[str, str]:
    """The versions that the text of a lock pins for this platform and Python, by the
    package's canonical name.
    """
    lines = (
        line for line in lock.splitlines() if "==" in line and not line.startswith("#")
    )
    asked = [Requirement(line) for line in lines]
    here = [each for each in asked if each.marker is None or each.marker.evaluate()]
    return {
        canonicalize_name(each.name): str(each.specifier).removeprefix("==")
        for each in here
    }


def _check_drawing() -> list[str]:
    """Draw a few camera pictures; return advice where that fails."""
    back_end = os.environ.get("MUJOCO_GL", "MuJoCo's choice")
    try:
        env = ClothEnv()
        env.reset()
        start = time.perf_counter()
        for _ in range(20):
            env.camera_picture()
        milliseconds = (time.perf_counter() - start) / 20 * 1e3
        env.close()
    except RuntimeError as error:
        print(f"OpenGL    {back_end}: does not draw")
        return [str(error)]
    print(f"OpenGL    {back_end}: {milliseconds:.1f} ms for each 128×96 image")
    return []


def check_files() -> list[str]:
    """Compare `data/` with its recorded hashes; return advice for each file that
    differs.
    """
    try:
        folder, verdict = data_folder(), check_data()
    except FileNotFoundError as error:
        return [str(error)]
    counts = Counter(ok=0)  # named first
    counts.update(verdict.values())
    print(
        f"data      {folder}: "
        + ", ".join(f"{number} {word}" for word, number in counts.items())
    )
    if not verdict:
        return ["data/ is empty: git checkout data, or make data train"]
    known = {"not recorded": "record its hash with `python -m clothlab checksums`"}
    faults = {
        name: word for name, word in verdict.items() if word not in ("ok", LEFT_TO_MAKE)
    }
    return [
        f"data/{name} is {word}: {known.get(word) or cure(name)}"
        for name, word in faults.items()
    ]


def doctor() -> int:
    """Print versions, drawing speed and state of the data, and a line of advice for
    each fault; the exit status.
    """
    advice = _check_versions() + _check_drawing() + check_files()
    for line in advice:
        print(f"  ✗ {line}")
    if not advice:
        print("  ✓ all is well")
    return bool(advice)


def main() -> int:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(prog="python -m clothlab", description=__doc__)
    parser.add_argument("command", choices=["doctor", "checksums"])
    arguments = parser.parse_args()
    if arguments.command == "doctor":
        return doctor()
    try:
        write_checksums()
    except OSError as error:
        print(f"  ✗ {error}", file=sys.stderr)
        return 1
    print(f"wrote {data_folder() / 'SHA256SUMS'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
