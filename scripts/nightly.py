"""`make nightly`: what takes hours, in one command, with a summary in `docs/nightly.md`.

Ten thousand generated inputs, faults at a hundred moments, eight simulated hours of the live lab, every notebook at
full size, the student edition's site, and the speed measurements. `python scripts/nightly.py --only soak` does one of
them and writes nothing.
"""

import argparse
import datetime
import os
import platform
import re
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "docs" / "nightly.md"
PYTEST = (sys.executable, "-m", "pytest", "-s", "-m", "slow or nightly or not slow", "--tb=short")
PARTS = {  # what it is: command, and settings in the environment
    "inputs": ((*PYTEST, "tests/test_properties.py"), {"CLOTHLAB_INPUTS": "10000"}),
    "faults": ((*PYTEST, "tests/test_faults.py"), {"CLOTHLAB_FAULTS": "100"}),
    "soak": ((*PYTEST, "tests/test_soak.py"), {"CLOTHLAB_SOAK": "480"}),
    "findings": ((sys.executable, "scripts/make_findings.py"), {}),
    "student site": (("make", "book", "STUDENT=1"), {}),
    "bench": ((sys.executable, "scripts/bench.py"), {}),
}
SHOWN = re.compile(r"^(?!.*%\|).*(\d+ (passed|failed)|claims|minutes|ratio|:.*\d).*")  # lines of the summary


def run(name: str) -> tuple[bool, str]:
    """Run one part and show what it prints: whether it went well, and its section of the summary."""
    command, settings = PARTS[name]
    start, lines = time.perf_counter(), []
    print(f"## {name}", flush=True)
    with subprocess.Popen(
        command, cwd=ROOT, env=os.environ | settings, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            last = line.rsplit("\r", 1)[-1].rstrip()  # of a progress bar
            if SHOWN.match(last):
                lines.append(last)
    verdict = "failed" if process.returncode else "passed"
    heading = f"## {name}: {verdict}, {(time.perf_counter() - start) / 60:.1f} minutes"
    return not process.returncode, "\n".join([heading, "", "```", *lines[-60:], "```"])


def machine() -> str:
    """Commit, system, cores and versions."""
    asked = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True).stdout.strip()
    packages = ", ".join(f"{name} {version(name).split('+')[0]}" for name in ("mujoco", "torch", "numpy"))
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return f"Commit {commit}; {system}, {packages}."


def main() -> int:
    """Run all, or those named; the exit status says whether all went well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="which parts")
    names = parser.parse_args().only
    outcomes = [run(name) for name in names]
    if names == list(PARTS):
        today = datetime.datetime.now(datetime.UTC).date().isoformat()
        sections = [f"# Nightly run of {today}", machine(), *(section for _, section in outcomes)]
        REPORT.write_text("\n\n".join(sections) + "\n")
    return not all(well for well, _ in outcomes)


if __name__ == "__main__":
    sys.exit(main())
