"""`python -m clothlab doctor` checks this machine: versions, drawing, and `data/`."""

import io
import os
import platform
import sys
import time
from importlib.metadata import version

import clothlab

_PICTURES = 20  # drawn to measure how long one takes


def check_drawing() -> list[str]:
    """Draw a few camera pictures; return advice where that fails."""
    try:
        from clothlab.simulation.env import ClothEnv

        env = ClothEnv()
        env.reset()
        start = time.perf_counter()
        for _ in range(_PICTURES):
            env.camera_picture()
        milliseconds = (time.perf_counter() - start) / _PICTURES * 1e3
        env.close()
    except Exception as error:  # each back end raises its own kind, one at its import
        # What follows draws nothing, but imports MuJoCo
        os.environ["MUJOCO_GL"] = "disable"
        print("drawing   fails")
        return [str(error)]
    print(f"drawing   {milliseconds:.1f} ms for a picture of the scene")
    return []


def check_data() -> list[str]:
    """Compare `data/` with its hashes; return advice for each file that differs."""
    from clothlab import data

    try:
        folder = data.data_folder()
    except FileNotFoundError as error:
        return [str(error)]
    faults = data.faults()
    print(f"data      {folder}: {len(faults) or 'no'} files missing or altered")
    return faults


def main() -> int:
    """Print what was found, then a line of advice for each fault."""
    if sys.argv[1:] != ["doctor"]:
        print("write: python -m clothlab doctor", file=sys.stderr)
        return 2

    # A file or a pipe may have no place for letters of a path
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    print(f"Python    {platform.python_version()} on {system}")
    packages = [f"{name} {version(name)}" for name in ("torch", "mujoco", "numpy")]
    print(f"packages  clothlab {clothlab.__version__}, {', '.join(packages)}")
    advice = check_drawing() + check_data()
    for line in advice:
        print(f"  - {line}")
    if not advice:
        print("all is well")
    return bool(advice)


if __name__ == "__main__":
    sys.exit(main())
