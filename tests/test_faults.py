"""Signal 9 at any moment, a full disk, a folder for reading only: nothing is lost.

`CLOTHLAB_FAULTS` says at how many moments; `make nightly` asks for a hundred.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

MOMENTS = int(os.environ.get("CLOTHLAB_FAULTS", "10"))

# For each kind of file: how version n is written, and how the version that is there is
# read. Version 0 is there before.
SUFFERING = """
import mmap, os, random, resource, signal, sys, time
from pathlib import Path
import numpy as np
import torch
from clothlab.data import _writing
from clothlab import data as stored
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.checkpoint import Checkpoint
from clothlab.method.model import DPMPB
from clothlab.simulation.cloth import get_cloth
from clothlab.trials import Trial, load_trial, save_trial

torch.set_num_threads(1)  # threads do not survive a fork
moments, folder = int(sys.argv[1]), Path(sys.argv[2])
network, model, images = Autoencoder(), DPMPB(2, 1), np.random.default_rng(0).random((200, 96, 128)) < 0.5
about = {"cloth": get_cloth("damp0.05-mass0.10"), "arm": "torque", "policy": "x", "seed": 0}

def save_mask(n, data):
    mask = np.zeros((96, 128), bool)
    mask.ravel()[: n + 1] = True
    _writing.save_target(mask, "x", data=data)

def read_trial(data):
    u = load_trial(data / "x.npz").commands * 1e6
    assert (u == u[0, 0]).all()
    return round(u[0, 0])

def make_trial(n):
    return Trial(images, np.zeros((200, 4)), np.full((200, 2), n / 1e6), **about)

def write_checkpoint(n, data):
    trained = Checkpoint(name="x", model=model, biases={}, losses=np.full(3, float(n)))
    trained.save(data / "x.safetensors", overwrite=True)

WRITE = {
    "checkpoint": write_checkpoint,
    "trial": lambda n, data: save_trial(make_trial(n), data / "x.npz"),
    "weights": lambda n, data: _writing.save_autoencoder(network, [float(n)] * 3, "x", data=data, overwrite=True),
    "target": save_mask,
}
READ = {
    "checkpoint": lambda data: int(Checkpoint.load(data / "x.safetensors").losses[0]),
    "trial": read_trial,
    "weights": lambda data: int(stored.load_autoencoder("x", data=data)[1][0]),
    "target": lambda data: int(stored.load_target("x", data=data).sum()) - 1,
}

def killed(data, write, read):
    acknowledged = mmap.mmap(-1, 8)  # seen by the parent after the child is dead
    for _ in range(moments):
        first = read() + 1
        child = os.fork()
        if child == 0:
            for n in range(first, first + 1000):
                write(n)
                acknowledged[:] = n.to_bytes(8, "little")
            os._exit(0)
        time.sleep(random.uniform(0, 0.06))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert read() >= int.from_bytes(acknowledged[:], "little")  # whole, or there would be an error

def full(data, write, read):
    write(1)
    whole = max(path.stat().st_size for path in data.rglob("*") if path.is_file())
    for _ in range(moments):
        child, limit = os.fork(), random.randrange(whole - 1)
        if child == 0:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            try:
                write(2)
            except OSError as error:
                os._exit(7 if "cannot write this file (File too large)" in str(error) else 8)
            os._exit(9)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        assert read() == 1

def read_only(data, write, read):
    folders = [path for path in [data, *data.rglob("*")] if path.is_dir()]
    for path in folders:
        path.chmod(0o555)
    child = os.fork()
    if child == 0:
        if os.getuid() == 0:
            os.setuid(65534)
        try:
            write(2)
        except PermissionError as error:
            os._exit(7 if read() == 0 and "cannot write this file (Permission denied)" in str(error) else 8)
        os._exit(9)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    for path in folders:
        path.chmod(0o755)
    assert code == 7, code
for kind in WRITE:
    for suffer in (full, read_only, killed):
        random.seed(kind)
        data = folder / f"{kind}-{suffer.__name__}"
        data.mkdir()
        write, read = (lambda n: WRITE[kind](n, data)), (lambda: READ[kind](data))
        write(0)
        read()  # what is imported late is imported
        suffer(data, write, read)
        assert suffer is killed or not list(data.rglob("*.part")), "something is left over"
"""


@pytest.mark.slow
def test_nothing_that_was_there_is_lost():
    with (
        tempfile.TemporaryDirectory() as folder
    ):  # pytest closes its own to others whenever another pytest begins
        Path(folder).chmod(0o755)  # another user must get in
        process = [sys.executable, "-c", SUFFERING, str(MOMENTS), folder]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        done = subprocess.run(
            process,
            env=environment,
            capture_output=True,
            text=True,
            timeout=100 + 10 * MOMENTS,
        )
    assert done.returncode == 0, done.stderr[-2000:]
