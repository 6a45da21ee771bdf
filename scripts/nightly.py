"""`make nightly`: what takes hours, in one command.

Generated inputs, faults, eight simulated hours of the live lab, an interrupted
reproduction, the checks of exercises on many inputs, the grading of every notebook,
what is rarely broken, every notebook at full size, full-size graphs, a wheel of every
pin, the student edition's site, every control of the lessons, speed, and 200 mutants of
the method and the simulation. A summary goes to `build/nightly.md`; `python
scripts/nightly.py --only soak` does one part and writes nothing.
"""

import argparse
import datetime
import os
import platform
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "build" / "nightly.md"
PYTEST = (sys.executable, "-m", "pytest", "-s", "-m", "slow or not slow", "--tb=short")
# Files whose other tests are enough by day
RARE = (
    "tests/test_logs.py",
    "tests/test_notebooks.py",
    "tests/test_packaging.py",
    "tests/course/test_problems.py",
)
PARTS = {  # what it is: command, and settings in the environment
    "inputs": ((*PYTEST, "tests/test_properties.py"), {"CLOTHLAB_INPUTS": "10000"}),
    "faults": ((*PYTEST, "tests/test_faults.py"), {"CLOTHLAB_FAULTS": "100"}),
    "soak": ((*PYTEST, "tests/test_soak.py"), {"CLOTHLAB_SOAK": "480"}),
    "operations": (
        (*PYTEST, "tests/test_lab_fuzz.py"),
        {"CLOTHLAB_OPERATIONS": "3000"},
    ),
    "reproduction": ((*PYTEST, "tests/studies/test_reproduce.py", "-m", "nightly"), {}),
    "checks": (
        (*PYTEST, "tests/test_checks.py", "-k", "whatever_is_drawn"),
        {"CLOTHLAB_INPUTS": "200"},
    ),
    "grades": ((*PYTEST, "tests/course/test_grades.py", "-m", "nightly"), {}),
    "rare": ((*PYTEST, *RARE, "-m", "nightly"), {}),
    "onnx": ((*PYTEST, "tests/test_onnx_export.py", "-m", "nightly"), {}),
    "page": ((*PYTEST, "tests/book", "-m", "nightly"), {}),
    "findings": (("make", "findings"), {}),
    "locks": ((sys.executable, "scripts/make_locks.py", "check"), {}),
    "student site": (("make", "book", "STUDENT=1"), {}),
    "every page": (
        (sys.executable, "-m", "pytest", "-m", "book", "tests/book"),
        {"CLOTHLAB_PAGES": "1"},
    ),
    "every control": (
        (
            sys.executable,
            "-m",
            "pytest",
            "-m",
            "browser",
            "tests/browser/test_lessons.py",
        ),
        {"CLOTHLAB_PAGES": "1"},
    ),
    "bench": ((sys.executable, "scripts/bench.py"), {}),
    "mutants": ((sys.executable, "scripts/mutate.py"), {"OMP_NUM_THREADS": "1"}),
}
# Lines of the summary
SHOWN = re.compile(
    r"^(?!.*%\|).*(\d+ (passed|failed)|claims|minutes|[≤≥]|:.*\d)|^[-+] "
)


def run(name: str) -> tuple[bool, str]:
    """Run one part and show what it prints.

    Returned are whether it went well, and its section of the summary.
    """
    command, settings = PARTS[name]
    start = time.perf_counter()

    # Printed as it comes, and kept
    lines = []
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env=os.environ | settings,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as process:
        for line in process.stdout or ():
            print(line, end="", flush=True)
            lines.append(line.rsplit("\r", 1)[-1].rstrip())  # the end of a progress bar

    # Of the summary only the lines that say what came out
    well = process.returncode == 0
    minutes = (time.perf_counter() - start) / 60
    head = f"## {name}: {'passed' if well else 'failed'}, {minutes:.1f} minutes"
    shown = filter(SHOWN.match, lines)
    return well, "\n".join([head, "", "```", *shown, "```"])


def where() -> str:
    """Commit and machine, in words."""
    describe = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.check_output(describe, cwd=ROOT, text=True).strip()
    return (
        f"Commit {commit}; {platform.platform()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}."
    )


def main() -> int:
    """Run all, or those named; the exit status says whether all went well."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="+", choices=PARTS, default=list(PARTS), help="which parts"
    )
    names = parser.parse_args().only
    outcomes = [run(name) for name in names]

    # A summary of a part would look like one of all
    if names == list(PARTS):
        today = datetime.datetime.now(datetime.UTC).date().isoformat()
        sections = [text for _, text in outcomes]
        parts = [f"# Nightly run of {today}", where(), *sections]
        REPORT.write_text("\n\n".join(parts) + "\n")
    return not all(well for well, _ in outcomes)


if __name__ == "__main__":
    sys.exit(main())
