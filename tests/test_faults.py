"""Signal 9 at any moment, a full disk, a folder for reading only, two writers, a clock that jumps: nothing is lost.

`CLOTHLAB_FAULTS` says at how many moments; `make nightly` asks for a hundred.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest

from clothlab.lab.recorder import Recorder, _boot

MOMENTS = int(os.environ.get("CLOTHLAB_FAULTS", "10"))

# What writes, and what there must be whatever happened to it. Version 0 is there before.
WRITERS = """
import mmap, os, random, resource, signal, sys, time
from pathlib import Path
import numpy as np
import torch
from clothlab import artifacts
from clothlab._files import LEFT_OVER
from clothlab.learning.autoencoder import Autoencoder
from clothlab.simulation.cloth import get_cloth
from clothlab.experiments._kept import once
from clothlab.lab.recorder import Recorder
from clothlab.trials import Trial, load_trial, save_trial

torch.set_num_threads(1)
kinds, moments, folder = sys.argv[1].split(), int(sys.argv[2]), Path(sys.argv[3])
data = folder
network = Autoencoder()
images = np.random.default_rng(0).random((200, 96, 128)) < 0.5
about = {"cloth": get_cloth("damp0.05-mass0.10"), "arm": "torque", "policy": "x", "seed": 0}
acknowledged = mmap.mmap(-1, 8)  # how far the writer has come, seen by whoever killed it


class Writer:
    def saved(self, n):
        acknowledged[:] = n.to_bytes(8, "little")

    def known(self):
        return int.from_bytes(acknowledged[:], "little")

    def check(self):
        n = self.read()  # whole, or there would be an error
        assert n >= self.known(), f"version {n} is there, {self.known()} was acknowledged"
        return n


class Trials(Writer):
    def write(self, n):
        save_trial(Trial(images, np.zeros((200, 4)), np.full((200, 2), n / 1e6), **about), data / "x.npz")
    def read(self):
        u = load_trial(data / "x.npz").commands * 1e6
        assert (u == u[0, 0]).all()
        return round(u[0, 0])


class Weights(Writer):
    def write(self, n):
        artifacts.save_autoencoder(network, [float(n)] * 3, "x", data=data)
    def read(self):
        return int(artifacts.load_autoencoder("x", data=data)[1][0])


class Results(Writer):
    def write(self, n):
        artifacts.save_results({"n": [n] * 20_000}, "x", data=data)
    def read(self):
        (n,) = set(artifacts.load_results("x", data=data)["n"])
        return n


class Kept(Writer):
    def write(self, n):
        assert once("x", {"n": n}, lambda: [n] * 20_000, folder=data)[0] == n
    def read(self):
        (n,) = set(artifacts.load_results("x", data=data)["answer"])
        assert once("x", {"n": n}, lambda: 1 / 0, folder=data)[0] == n  # not made again
        return n


class Target(Writer):
    def write(self, n):
        mask = np.zeros((96, 128), bool)
        mask.ravel()[: n + 1] = True
        artifacts.save_target(mask, "x", data=data)
    def read(self):
        return int(artifacts.load_target("x", data=data).sum()) - 1


def add(recorder, k):
    recorder.add({"image": images[k % 200].astype(np.int8), "robot": np.zeros(4)}, np.array([k / 1e6, 0.0]), about)


def steps(path):
    found = (1e6 * load_trial(path).commands[:, 0]).round().astype(int).tolist()
    assert found == list(range(len(found))), "steps are missing, or out of order"
    return len(found)


class Recording(Writer):
    def begin(self):
        self.recorder = Recorder(data)
        self.recorder.start()
        self.saved(0)
    def write(self, n):
        add(self.recorder, n - 1)
    def check(self):
        after, known = Recorder(data), self.known()
        if known < 5 and not after.waiting:
            return known
        found = steps(after.save("x"))
        assert found >= known - 5, f"{known} steps happened, {found} were kept"
        (data / "x.npz").unlink()
        return found


class Saving(Recording):
    # The moment when the pieces are joined: 40 steps are either in the file, or still in their pieces.
    def begin(self):
        super().begin()
        for k in range(40):
            add(self.recorder, k)
    def write(self, n):
        self.recorder.save("x")
        time.sleep(1)
    def check(self):
        path = data / "x.npz"
        if not path.exists():
            Recorder(data).save("x")
        found = steps(path)
        assert found == 40, f"{found} of 40 steps are left"
        path.unlink()
        Recorder(data).discard()
        return found


WRITERS = {"trial": Trials, "weights": Weights, "results": Results, "kept": Kept, "target": Target}
WRITERS |= {"recording": Recording, "saving": Saving}


def each_kind(suffer):
    global data
    for kind in kinds:
        random.seed(kind)
        print(kind, flush=True)  # by which one knows whose fault it was
        writer, data = WRITERS[kind](), folder / kind
        data.mkdir()
        if not hasattr(writer, "begin"):
            writer.write(0)
            writer.saved(0)
            writer.read()  # what is imported late is imported
        suffer(writer)
"""

KILLED = """
def suffer(writer):
    for _ in range(moments):
        ready, go = os.pipe()
        child = os.fork()
        if child == 0:
            if hasattr(writer, "begin"):
                writer.begin()
                first = 1
            else:
                first = writer.check() + 1
            os.write(go, b"x")
            for n in range(first, first + 1000):
                writer.write(n)
                writer.saved(n)
            os._exit(0)
        os.read(ready, 1)
        time.sleep(random.uniform(0, 0.06))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(ready)
        os.close(go)
        writer.check()
each_kind(suffer)
"""

FULL = """
def suffer(writer):
    writer.write(1)
    whole = max(path.stat().st_size for path in data.rglob("*") if path.is_file())
    for _ in range(moments):
        limit = random.randrange(whole - 1)
        child = os.fork()
        if child == 0:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            try:
                writer.write(2)
            except OSError as error:
                os._exit(7 if error.strerror else 8)
            os._exit(9)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7, "a full disk is to be told of"
        assert writer.read() == 1
        assert not list(data.rglob(f".*{LEFT_OVER}")), "something is left over"
each_kind(suffer)
"""

READ_ONLY = """
def read_only(folder, mode):
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir():
            path.chmod(mode)
def suffer(writer):
    child = os.fork()
    read_only(data, 0o555)
    if child == 0:
        if os.getuid() == 0:
            os.setuid(65534)
        try:
            writer.write(2)
        except PermissionError:
            os._exit(7 if writer.read() == 0 else 8)
        os._exit(9)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    read_only(data, 0o755)
    assert code == 7, code
each_kind(suffer)
"""

TWO = """
def suffer(writer):
    children = []
    for k in range(2):
        child = os.fork()
        if child == 0:
            for n in range(k, 2 * moments + k, 2):
                writer.write(n)
            os._exit(0)
        children.append(child)
    for child in children:
        while os.waitpid(child, os.WNOHANG) == (0, 0):
            assert 0 <= writer.read() < 2 * moments + 1  # whole, at any moment
    assert writer.read() >= 2 * moments - 2
    assert not list(data.rglob(f".*{LEFT_OVER}"))
each_kind(suffer)
"""


def suffer(script: str, kinds: str, folder: Path) -> None:
    """Let a process write while something happens to it; it fails if anything is lost."""
    process = [sys.executable, "-c", WRITERS + script, kinds, str(MOMENTS), str(folder)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(process, env=environment, capture_output=True, text=True, timeout=100 + 10 * MOMENTS)
    assert done.returncode == 0, f"{done.stdout.split()[-1]}: {done.stderr[-2000:]}"


def test_killed_at_any_moment_nothing_that_was_there_is_lost(tmp_path):
    suffer(KILLED, "trial weights results kept target recording saving", tmp_path)


def test_where_the_disk_is_full_the_old_file_stays_and_nothing_is_left_over(tmp_path):
    suffer(FULL, "trial weights results kept target", tmp_path)


def test_a_folder_for_reading_only_can_be_read_and_says_so_when_written_to():
    with tempfile.TemporaryDirectory() as folder:  # pytest closes its own to others whenever another pytest begins
        Path(folder).chmod(0o755)  # whoever is not root must get in
        suffer(READ_ONLY, "trial weights results target", Path(folder))


def test_of_two_processes_that_write_one_name_each_file_is_whole(tmp_path):
    suffer(TWO, "trial weights results target", tmp_path)


@pytest.fixture
def sleeper():
    """Another process that lives."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield psutil.Process(process.pid)
        process.kill()


def unfinished(folder, *, started: float, pid: int, boot: int, clock: float):
    """A recording of another process, that began so many seconds since the epoch and since the machine's start."""
    place = folder / "unfinished" / f"{int(started * 1e9)}-{pid}-{boot}-{int(clock * 1e9)}"
    place.mkdir(parents=True)
    (place / "00000000.npz").write_bytes(b"some steps")
    return place


@pytest.mark.parametrize("jump", [-86_400, -60, 0, 60, 86_400])
def test_a_clock_that_is_set_takes_no_recording_away_from_the_process_that_makes_it(tmp_path, sleeper, jump):
    place = unfinished(tmp_path, started=time.time() - jump, pid=sleeper.pid, boot=_boot(), clock=time.monotonic())
    assert not Recorder(tmp_path).waiting
    assert place.exists()


@pytest.mark.parametrize("since", [{"clock": -3600}, {"boot": 1}, {"boot": 1, "clock": 3600}])
def test_a_process_with_the_number_of_a_dead_one_keeps_no_recording_back(tmp_path, sleeper, since):
    clock, boot = time.monotonic() + since.get("clock", 0), _boot() + since.get("boot", 0)
    unfinished(tmp_path, started=time.time() - 3600, pid=sleeper.pid, boot=boot, clock=clock)
    assert Recorder(tmp_path).waiting
