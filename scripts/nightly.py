"""`make nightly`: everything that takes hours, in one command, with a summary in `docs/nightly.md`.

Ten thousand hostile inputs, a hundred moments of each fault, eight simulated hours of the live lab, every notebook at
full size, and the speed measurements. A night that was interrupted goes on where it stopped, as long as the commit is
the same; one that had to be mended on the way goes on with `--night COMMIT`, the one it began at, and its summary says
which part ran at which. `python scripts/nightly.py --small` does the first three in a tenth of the time and writes
nothing; `--only faults` does one of them.
"""

import argparse
import datetime
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

from clothlab.experiments._kept import once

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "docs" / "nightly.md"
KEPT = ROOT / "build" / "nightly"  # what an interrupted night had done
SMALL = 10  # times less of whatever can be made less
FAILED = "**failed**"
PYTEST = (sys.executable, "-m", "pytest", "-s", "-m", "slow or not slow", "--tb=short", "-p", "no:cacheprovider")


@dataclass(frozen=True)
class Part:
    """Something to run, and how to say what came out.

    Attributes:
        what: it is, in words, with a place for how much.
        command: that runs it.
        variable: of the environment, which says how much; "" where there is no choice.
        amount: of it.
        told: pattern of the lines that belong into the summary.
        went: what to say of it when it went well.
    """

    what: str
    command: tuple[str, ...]
    variable: str = ""
    amount: int = 0
    told: str = r"^(=+ )?\d+ (passed|failed).*"
    went: str = "held"


PARTS = {
    "inputs": Part("{} hostile inputs", (*PYTEST, "tests/test_properties.py"), "CLOTHLAB_INPUTS", 10_000),
    "files": Part("Files", (*PYTEST, "tests/test_files.py")),
    "faults": Part("Faults at {} moments", (*PYTEST, "tests/test_faults.py"), "CLOTHLAB_FAULTS", 100),
    "soak": Part(
        "{} simulated minutes of the live lab",
        (*PYTEST, "tests/test_soak.py"),
        "CLOTHLAB_SOAK",
        480,
        r"^(torque|muscle): .*|.* simulated minutes in .*|^(=+ )?\d+ (passed|failed).*",
    ),
    "findings": Part(
        "Every notebook at full size", (sys.executable, "scripts/make_findings.py"), told=r"^\d\d_\w+: \d+ claims .*"
    ),
    "bench": Part(
        "Speed",
        (sys.executable, "scripts/bench.py"),
        told=r"^(?!.*%\|).*\S",  # all but progress
        went="measured",  # its lines say by which bound, and whether it is met depends on the machine
    ),
}


@dataclass(frozen=True)
class Outcome:
    """How a part went, in a word, its time [s], at which commit, and the lines that it left."""

    what: str
    went: str
    seconds: float
    commit: str
    lines: list[str]

    @property
    def well(self) -> bool:
        """Whether it did not fail."""
        return self.went != FAILED


def run(part: Part, *, small: bool) -> Outcome:
    """Run one part, and show what it prints."""
    amount = max(1, part.amount // SMALL) if small else part.amount
    environment = os.environ | ({part.variable: str(amount)} if part.variable else {})
    start, what = time.perf_counter(), part.what.format(f"{amount:,}")
    print(f"## {what}", flush=True)
    lines = []
    with subprocess.Popen(
        part.command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            last = line.rsplit("\r", 1)[-1]  # of a progress bar
            if re.match(part.told, last):
                lines.append(re.sub(r"^=+ | =+$", "", last.rstrip()))
    went = FAILED if process.returncode else part.went
    return Outcome(what, went, time.perf_counter() - start, commit(), lines)


def commit() -> str:
    """Which state of the project this is."""
    return subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()


class Broken(Exception):
    """A part that failed: it is not kept, so that it is done again."""


def well(name: str) -> dict:
    """Run a part at full size, and say how it went.

    Raises:
        Broken: not well.
    """
    outcome = run(PARTS[name], small=False)
    if not outcome.well:
        raise Broken(outcome)
    return asdict(outcome)


def machine() -> str:
    """What it ran on, without its name."""
    packages = ", ".join(f"{name} {version(name).split('+')[0]}" for name in ("mujoco", "torch", "numpy"))
    system = f"{platform.system()} {platform.machine()}"
    return f"{system}, {os.cpu_count()} cores, Python {platform.python_version()}, {packages}"


def report(outcomes: list[Outcome], when: datetime.date) -> str:
    """The summary, in Markdown."""
    parts = [f"# Nightly run of {when.isoformat()}", f"Written by `make nightly` on {machine()}."]
    rows = [f"| {each.what} | {each.went} | {each.seconds / 60:.1f} | {each.commit} |" for each in outcomes]
    parts.append("\n".join(["| part | outcome | minutes | commit |", "| --- | --- | --: | --- |", *rows]))
    for each in outcomes:
        if each.lines:
            parts.append("\n".join([f"## {each.what}", "", "```", *each.lines, "```"]))
    return "\n\n".join(parts) + "\n"


def night(names: list[str], began_at: str = "") -> list[Outcome]:
    """Run parts at full size, each unless it went well earlier in this night, which is called by its first commit."""
    made_with, outcomes = {"commit": began_at or commit()}, []
    for name in names:
        try:
            outcomes.append(Outcome(**once(name, made_with, partial(well, name), folder=KEPT)))
        except Broken as error:
            outcomes.append(*error.args)
    return outcomes


def main() -> int:
    """Run all, or those named; the exit status says whether all went well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="which parts")
    parser.add_argument("--night", metavar="COMMIT", default="", help="at which this night began, if it is another now")
    parser.add_argument("--small", action="store_true", help="a tenth, of what can be made less; nothing is written")
    arguments = parser.parse_args()
    chosen = [name for name in arguments.only if PARTS[name].variable or not arguments.small]
    outcomes = [run(PARTS[name], small=True) for name in chosen] if arguments.small else night(chosen, arguments.night)
    summary = report(outcomes, datetime.datetime.now(datetime.UTC).date())
    print("\n" + summary)
    if not arguments.small and set(chosen) == set(PARTS):  # half of it is not the record of a night
        REPORT.write_text(summary)
        shutil.rmtree(KEPT, ignore_errors=True)
    return not all(each.well for each in outcomes)


if __name__ == "__main__":
    sys.exit(main())
