"""`make mutate`: change the method and the simulation, and count what the tests notice.

Of all mutants (`scripts/mutants.py`) of `FOLDERS` a sample is drawn, the same for the
same seed. First every test runs once, to learn which lines it passes through. Then, for
each mutant, those that pass through its line run in a copy of the repository, the
quickest first, until one fails; running out of time is failing, too. Survivors that
somebody has looked at stand in `tests/mutants.toml`, each with a reason, and count as
survivors all the same. The exit status says whether enough were killed.

Why neither mutmut nor cosmic-ray: the first leaves out whatever has a decorator or
stands outside of functions, such as properties and settings. The second changes
annotations, too, and most of what it makes of arithmetic (`a << b` of floats) fails by
itself, which says nothing about the tests. Neither draws a sample.
"""

import argparse
import importlib
import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import coverage
import pytest
from mutants import Mutant, mutants_of

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("clothlab/method", "clothlab/simulation")
ACCEPTED = ROOT / "tests" / "mutants.toml"
ENOUGH = 85  # [%]
OF_SETTINGS = ("tests/test_settings.py",)  # which name no module, and import all
LONGEST = 60.0  # of the tests of a mutant [s]
GROUPS = "not browser and not book and not nightly and not container"
# What takes seconds to import, and has nothing of this repository in it.
HEAVY = (
    *("torch", "scipy.optimize", "scipy.spatial", "pandas", "gymnasium", "mujoco"),
    *("sklearn.decomposition", "sklearn.gaussian_process", "sklearn.cluster"),
    *(
        "matplotlib.pyplot",
        "cv2",
        "mediapy",
        "imageio_ffmpeg",
        "anywidget",
        "hypothesis",
    ),
)
# Of the plugins only those that the tests here need: importing nbmake takes a second.
OPTIONS = ["-q", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist"]
OPTIONS += ["-p", "no:nbmake", "-p", "no:playwright"]
OPTIONS += ["-W", "ignore:Module already imported"]


class Recorder:
    """A pytest plugin: how long each test takes, and which lines it passes through.

    What a fixture does that tests share is done by all tests that use it.
    """

    def __init__(self, measured: coverage.Coverage):
        self.measured = measured
        self.durations: dict[str, float] = {}  # of tests that pass [s]
        self.users: dict[str, list[str]] = {}  # tests, by what they run as, or share
        self.slow: list[str] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        for name in [item.nodeid, *getattr(item, "fixturenames", [])]:
            self.users.setdefault(name, []).append(item.nodeid)
        if item.get_closest_marker("slow"):
            self.slow.append(item.nodeid)
        self.measured.switch_context(item.nodeid)
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request) -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        self.measured.switch_context(fixturedef.argname)
        try:
            return (yield)
        finally:
            self.measured.switch_context(request._pyfuncitem.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            self.durations[report.nodeid] = report.duration


def record(folder: Path, only: list[str]) -> int:
    """Run the tests of a copy once; `reached.json` in it says what was recorded."""
    # Run them all, while every line is noted with the test that it runs for
    sources = [str(folder / each) for each in FOLDERS]
    measured = coverage.Coverage(data_file=None, config_file=False, source=sources)
    recorder = Recorder(measured)
    measured.start()
    status = pytest.main([*OPTIONS, "-m", GROUPS, *only], plugins=[recorder])
    measured.stop()
    if status not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        return int(status)

    # Of each line keep the numbers of the tests that pass
    data = measured.get_data()
    numbers = {name: k for k, name in enumerate(recorder.durations)}
    reached: dict[str, dict[int, list[int]]] = {}
    for path in data.measured_files():
        lines = reached.setdefault(str(Path(path).relative_to(folder)), {})
        for line, contexts in data.contexts_by_lineno(path).items():
            tests = {t for name in contexts for t in recorder.users.get(name, [])}
            lines[line] = [numbers[test] for test in tests if test in numbers]

    found = {"durations": recorder.durations, "slow": recorder.slow, "reached": reached}
    (folder / "reached.json").write_text(json.dumps(found))
    return 0


@cache
def texts() -> dict[str, str]:
    """The text of each file of tests, by its path from the repository's root."""
    paths = sorted((ROOT / "tests").rglob("test_*.py"))
    return {str(path.relative_to(ROOT)): path.read_text() for path in paths}


def tests_of(mutant: Mutant, recorded: dict) -> dict[str, float]:
    """Tests that concern a mutant, and how long each takes [s].

    Those of its own file come first, then the quickest; slow ones of other files come
    last, and only where the file names the module. What takes longer than `LONGEST`
    in all is left out.
    """
    # All that pass through its lines. What runs only when the module is imported may
    # be told by all that pass through the file or name it, or look at every setting.
    lines = recorded["reached"].get(mutant.path, {})
    durations = list(recorded["durations"].items())
    module = Path(mutant.path).with_suffix("")
    naming = {path for path, text in texts().items() if ".".join(module.parts) in text}
    here = set()
    if mutant.inside:
        here.update(*[lines.get(str(line), []) for line in mutant.lines])
    if not here:
        here.update(*lines.values())
        for k, (test, _) in enumerate(durations):
            if test.split("::")[0] in {*naming, *OF_SETTINGS}:
                here.add(k)

    # In order of what they may tell
    order = {}
    for test, duration in [durations[k] for k in here]:
        file = test.split("::")[0]
        slow = test in recorded["slow"]
        if not slow or file in naming:
            own = Path(file).stem == f"test_{module.stem}"
            order[test] = (not own, slow, duration)

    # As many as there is time for
    found: dict[str, float] = {}
    for test in sorted(order, key=order.get):
        duration = order[test][-1]
        if sum(found.values()) + duration <= LONGEST:
            found[test] = duration
    return found


def copy_repository(into: Path) -> Path:
    """Copy the files that git knows or would know."""
    listed = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
    for name in subprocess.check_output(listed, cwd=ROOT, text=True).splitlines():
        if (ROOT / name).exists():
            (into / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, into / name)
    return into


def start(folder: Path, work: Callable[[], int]) -> int:
    """Do some work in a copy of the repository and a process of its own: its number.

    It is a copy of this one, which has imported what takes seconds to import.
    """
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        os.setsid()
        os.chdir(folder)
        log = os.open("mutate.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, sys.stdout.fileno())
        os.dup2(log, sys.stderr.fileno())
        os.environ["PYTHONPATH"] = str(folder)
        sys.path.insert(0, str(folder))
        status = int(work())
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def outcome(process: int, limit: float) -> str:
    """Wait for a process: "survived" if all tests passed, "killed", or "timeout"."""
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return "killed" if status else "survived"
        time.sleep(0.02)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return "timeout"


def judge(task: tuple[Mutant, dict[str, float]]) -> str:
    """Run a mutant's tests in the copy where this process is; mend the copy after."""
    mutant, tests = task
    if not tests:
        return "unreached"
    folder = Path.cwd()
    original = (folder / mutant.path).read_text()
    (folder / mutant.path).write_text(mutant.source)
    arguments = [*OPTIONS, "-x", "-m", GROUPS, *tests]
    process = start(folder, lambda: pytest.main(arguments))
    found = outcome(process, 30 + 3 * sum(tests.values()))
    (folder / mutant.path).write_text(original)
    return found


def all_mutants() -> list[Mutant]:
    """Every mutant of every file, in order."""
    found = []
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).glob("*.py")):
            found += mutants_of(str(path.relative_to(ROOT)), path.read_text())
    return found


def report(outcomes: list[tuple[Mutant, str]]) -> bool:
    """Print survivors and the score; whether it is enough."""
    accepted = {}
    for each in tomllib.loads(ACCEPTED.read_text())["mutant"]:
        accepted[each["path"], each["before"], each["after"]] = each["reason"]
    alive = [(m, how) for m, how in outcomes if how not in ("killed", "timeout")]
    for mutant, how in alive:
        key = (mutant.path, mutant.before, mutant.after)
        print(f"\n{mutant.path}:{mutant.line}: {how}; {accepted.get(key, 'no reason')}")
        print(f"- {mutant.before}\n+ {mutant.after}")

    score = 100 * (1 - len(alive) / len(outcomes))
    late = sum(how == "timeout" for _, how in outcomes)
    print(f"\n{len(outcomes)} mutants: {len(alive)} survive, {late} run out of time")
    print(f"score: {score:.1f} % are killed, at least {ENOUGH} % are to be")
    return score >= ENOUGH


def judge_all(mutants: list[Mutant], folders: list[Path]) -> list[tuple[Mutant, str]]:
    """The outcome of each mutant, by as many processes as there are folders."""
    recorded = json.loads((folders[0] / "reached.json").read_text())
    tasks = [(mutant, tests_of(mutant, recorded)) for mutant in mutants]
    context = multiprocessing.get_context("fork")
    free = context.SimpleQueue()
    for folder in folders:
        free.put(folder)

    found = []
    with context.Pool(len(folders), lambda: os.chdir(free.get())) as pool:
        # Without a change all tests pass, or no score would mean anything
        mutant, tests = max(tasks, key=lambda task: len(task[1]))
        unchanged = replace(mutant, source=(ROOT / mutant.path).read_text())
        if pool.apply(judge, [(unchanged, tests)]) != "survived":
            sys.exit("tests that passed fail when they run again, without a change")
        for mutant, how in zip(mutants, pool.imap(judge, tasks), strict=True):
            found.append((mutant, how))
            print(how, mutant.path, mutant.line, flush=True)
    return found


def main() -> int:
    """Draw, run and report."""
    # What is asked for.
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--count", type=int, default=200, help="mutants to draw")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--tests", nargs="+", default=[], help="only these files")
    options = parser.parse_args()
    mutants = random.Random(options.seed).sample(all_mutants(), options.count)

    # No compiled files: a stale one of the same second would be read
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    for name in HEAVY:
        importlib.import_module(name)

    # Copies of the repository, one for each process; then all mutants.
    with tempfile.TemporaryDirectory() as temporary:
        folders = []
        for k in range(options.processes):
            folders.append(copy_repository(Path(temporary) / str(k)))
        process = start(folders[0], lambda: record(folders[0], options.tests))
        if os.waitpid(process, 0)[1]:
            sys.exit((folders[0] / "mutate.log").read_text())
        return not report(judge_all(mutants, folders))


if __name__ == "__main__":
    sys.exit(main())
