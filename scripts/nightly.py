"""`make nightly`: what takes hours, in one command, with a summary in
`build/nightly.md`.

Generated inputs, faults, eight simulated hours of the live lab, an interrupted
reproduction, the checks of exercises on many inputs, the grading of every notebook,
every notebook at full size, a wheel of every pin for every platform, the student
edition's site, speed, and 200 mutants of the method and the simulation. `python
scripts/nightly.py --only soak` does one and writes nothing.
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
    "findings": (("make", "findings"), {}),
    "locks": ((sys.executable, "scripts/make_locks.py", "--check"), {}),
    "student site": (("make", "book", "STUDENT=1"), {}),
    "every page": (
        (sys.executable, "-m", "pytest", "-m", "book", "tests/book"),
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
    """Run one part and show what it prints: whether it went well, and its section of
    the summary.
    """
    command, settings = PARTS[name]
    start, lines = time.perf_counter(), []
    environment, both = (
        os.environ | settings,
        {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT},
    )
    with subprocess.Popen(
        command, cwd=ROOT, env=environment, text=True, **both
    ) as process:
        for line in process.stdout or ():
            print(line, end="", flush=True)
            lines.append(line.rsplit("\r", 1)[-1].rstrip())  # the end of a progress bar
    verdict = f"{'failed' if process.returncode else 'passed'}, {(time.perf_counter() - start) / 60:.1f} minutes"
    return not process.returncode, "\n".join(
        [f"## {name}: {verdict}", "", "```", *filter(SHOWN.match, lines), "```"]
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
    if names == list(PARTS):
        commit = subprocess.check_output(
            ["git", "describe", "--always", "--dirty"], cwd=ROOT, text=True
        ).strip()
        today = datetime.datetime.now(datetime.UTC).date().isoformat()
        where = f"Commit {commit}; {platform.platform()}, {os.cpu_count()} cores, Python {platform.python_version()}."
        REPORT.write_text(
            "\n\n".join(
                [f"# Nightly run of {today}", where, *(text for _, text in outcomes)]
            )
            + "\n"
        )
    return not all(well for well, _ in outcomes)


if __name__ == "__main__":
    sys.exit(main())
