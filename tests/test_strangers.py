"""Files from strangers: nothing in them runs, and none takes more memory than an honest one, whatever it claims."""

import io
import json
import os
import pickle
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors.torch import save as to_bytes

from clothlab import artifacts
from clothlab._files import LARGEST_TENSORS, LARGEST_TEXT, read_arrays, read_json, write_bytes
from clothlab.artifacts import filled
from clothlab.experiments.race import load_network
from clothlab.experiments.sysid import Regressor
from clothlab.lab.recorder import Recorder
from clothlab.learning.autoencoder import Autoencoder
from clothlab.trials import LONGEST, Trial, load_trial, save_trial

BOMB = 150 << 20  # [byte] unpacked

READER = """
import json, os, resource, sys, time
from pathlib import Path
import torch
from clothlab import artifacts
from clothlab.experiments.race import load_network
from clothlab.trials import load_trial
from clothlab.simulation.vision import mask_from_file

data = Path(sys.argv[1])
readers = {
    ".npz": load_trial,
    ".png": lambda path: mask_from_file(path.read_bytes()),
    ".jpg": lambda path: mask_from_file(path.read_bytes()),
    ".json": lambda path: artifacts.load_results(path.stem, data=data),
    ".safetensors": lambda path: artifacts.load_autoencoder(path.stem.removeprefix("autoencoder-"), data=data),
    ".network": load_network,
}
def read(path, honest):
    def peak():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    readers[path.suffix](honest)  # what is imported or prepared once
    before, start = peak(), time.perf_counter()
    try:
        readers[path.suffix](path)
        said = ["nothing", ""]
    except BaseException as error:
        said = [type(error).__name__, str(error)]
    return *said, peak() - before, time.perf_counter() - start

torch.set_num_threads(1)
for path, honest in json.loads(sys.argv[2]):
    answer, pipe = os.pipe()
    if os.fork() == 0:  # each file has a process of its own, so that peaks and deaths are its own
        os.write(pipe, json.dumps(read(Path(path), Path(honest))).encode())
        os._exit(0)
    os.close(pipe)
    os.wait()
    print(os.read(answer, 1 << 16).decode(), flush=True)
"""


class Malice:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def npy(shape: object, content: bytes = b"", descr: str = "|u1") -> bytes:
    """An array whose header claims what it likes."""
    words = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(words)) + words + content


def npz(compression: int = zipfile.ZIP_DEFLATED, about: object = None, **members: bytes) -> bytes:
    """A trial's file with other arrays than a trial has."""
    content, words = io.BytesIO(), io.BytesIO()
    np.save(words, np.array(about if isinstance(about, str) else json.dumps(about)))
    honest = {"about": words.getvalue(), "images": npy((1, 96, 16), bytes(1536))}
    honest |= {"robot": npy((1, 4), bytes(32), "<f8"), "commands": npy((1, 2), bytes(16), "<f8")}
    with zipfile.ZipFile(content, "w", compression) as archive:
        for name, member in (honest | members).items():
            archive.writestr(f"{name}.npy", member)
    return content.getvalue()


def lying(content: bytes, size: int) -> bytes:
    """The same archive, whose list says that the images have another size."""
    place = content.index(b"images.npy", content.index(b"PK\x01\x02")) - 46 + 24
    return content[:place] + struct.pack("<I", size) + content[place + 4 :]


def crowded() -> bytes:
    """An archive of very many entries, whose list alone takes a hundred times the memory of the file."""
    one = npz()
    start, end = one.index(b"PK\x01\x02"), one.index(b"PK\x05\x06")
    entry, count = one[start : one.index(b"PK\x01\x02", start + 4)], 400_000
    tail = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 65_535, 65_535, len(entry) * count, start, 0)
    return one[:start] + entry * count + tail + one[end + 22 :]


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width: int, height: int, *more: bytes, rows: int = 0) -> bytes:
    """A picture of one bit a pixel, of which only some rows are there."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(bytes(rows * (1 + width // 8))))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(more) + body + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    """A small picture that says it is a large one."""
    content = cv2.imencode(".jpg", np.zeros((8, 8), np.uint8))[1].tobytes()
    place = content.index(b"\xff\xc0") + 5
    return content[:place] + struct.pack(">HH", height, width) + content[place + 4 :]


def safetensors(header: object, content: bytes = b"", length: int | None = None) -> bytes:
    words = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(words) if length is None else length) + words + content


def weights(latent_size: object, **tensors: torch.Tensor) -> bytes:
    about = {"format": 1, "kind": "autoencoder", "latent_size": latent_size}
    return to_bytes({"losses": torch.zeros(1)} | tensors, metadata={"clothlab": json.dumps(about)})


TERABYTES = {"a": {"dtype": "F32", "shape": [1 << 40], "data_offsets": [0, 1 << 42]}}
NESTED = "[" * 1_000_000
HOSTILE = {
    "bomb.npz": lambda: npz(images=npy((BOMB,), bytes(BOMB))),
    "bomb-of-words.npz": lambda: npz(robot=npy((), bytes(BOMB), f"<U{BOMB // 4}")),
    "lying-bomb.npz": lambda: lying(npz(images=npy((BOMB,), bytes(BOMB))), 200),
    "bzip2.npz": lambda: npz(zipfile.ZIP_BZIP2, images=npy((BOMB,), bytes(BOMB))),
    "lzma.npz": lambda: npz(zipfile.ZIP_LZMA),
    "terabytes.npz": lambda: npz(images=npy((1 << 42,))),
    "more-than-there-is.npz": lambda: npz(images=npy((1 << 62, 1 << 62))),
    "negative.npz": lambda: npz(images=npy((-1, 96, 16))),
    "no-shape.npz": lambda: npz(images=npy("'x'")),
    "no-type.npz": lambda: npz(images=npy((1,), b"x", "[('a', 'O')]")),
    "huge-items.npz": lambda: npz(images=npy((1,), b"x", f"|V{1 << 30}")),
    "long-header.npz": lambda: npz(images=b"\x93NUMPY\x02\x00" + struct.pack("<I", 1 << 31) + b"{" * 100),
    "version.npz": lambda: npz(images=b"\x93NUMPY\x09\x00"),
    "crowded.npz": crowded,
    "nested.npz": lambda: npz(about=NESTED),
    "digits.npz": lambda: npz(about="9" * 1_000_000),
    "not-a-number.npz": lambda: npz(about='{"format": 1, "seed": NaN}'),
    "other-words.npz": lambda: npz(about={"format": 1, "cloth": {}, "folder": "/"}),
    "plain-pickle.npz": lambda: pickle.dumps(["a trial"]),
    "large.png": lambda: png(60_000, 60_000),
    "bomb.png": lambda: png(24_000, 24_000, rows=24_000),
    "wide.png": lambda: png(0x7FFFFFFF, 1),
    "zero.png": lambda: png(0, 0),
    "half.png": lambda: png(128, 96, rows=4)[:60],
    "words.png": lambda: png(128, 96, chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(BOMB))), rows=96),
    "colours.png": lambda: png(128, 96, chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(BOMB))), rows=96),
    "long.png": lambda: png(128, 96, chunk(b"tEXt", bytes(2 << 20))),
    "large.jpg": lambda: jpeg(65_000, 65_000),
    "nested.json": lambda: NESTED.encode(),
    "nested-words.json": lambda: b'{"a":' * 1_000_000,
    "digits.json": lambda: b'{"format": 1, "x": ' + b"9" * 1_000_000 + b"}",
    "not-a-number.json": lambda: b'{"format": 1, "x": [NaN]}',
    "infinite.json": lambda: b'{"format": 1, "x": -Infinity}',
    "wide.json": lambda: b"[" + b"[]," * (LARGEST_TEXT // 3) + b"[]]",
    "header.safetensors": lambda: safetensors(b"", length=1 << 40),
    "whole-header.safetensors": lambda: safetensors(b" " * (8 << 20)),
    "negative-header.safetensors": lambda: b"\xff" * 8,
    "terabytes.safetensors": lambda: safetensors(TERABYTES),
    "nested.safetensors": lambda: safetensors(b'{"a":' * 100_000),
    "large-model.safetensors": lambda: weights(10**9),
    "endless-model.safetensors": lambda: weights(10**400),
    "empty-tensor.safetensors": lambda: weights(3, extra=torch.zeros(0, 1 << 40)),
    "pickle.safetensors": lambda: pickle.dumps(["weights"]),
    "empty-tensors.network": lambda: to_bytes(
        {"head.0.weight": torch.zeros(1 << 30, 0), "mean": torch.zeros(2), "gru.bias_hh_l0": torch.zeros(3)}
    ),
}
HONEST = {".npz": "one.npz", ".png": "one.png", ".jpg": "one.png", ".json": "results/one.json"}
HONEST |= {".safetensors": "weights/autoencoder-one.safetensors", ".network": "one.network"}
FOLDERS = {".json": "results/", ".safetensors": "weights/autoencoder-"}


@pytest.fixture(scope="module")
def honest(tmp_path_factory, trial) -> Path:
    """A file of each kind as it should be."""
    data = tmp_path_factory.mktemp("data")
    save_trial(trial, data / "one.npz")
    _, content = cv2.imencode(".png", trial.images[0].astype(np.uint8) * 255)
    write_bytes(data / "one.png", content.tobytes())
    artifacts.save_results({}, "one", data=data)
    artifacts.save_autoencoder(Autoencoder(), [0.1], "one", data=data)
    write_bytes(data / "one.network", to_bytes(Regressor(6, 0, 8).state_dict()))
    return data


def limited() -> None:
    """Terabytes are refused here by the system, so that a test that fails does not take the machine with it."""
    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))


@pytest.fixture(scope="module")
def found(honest) -> dict[str, list]:
    """What became of each hostile file, `{name: [error, message, more memory at the peak [MiB], time [s]]}`."""
    paths = {name: honest / f"{FOLDERS.get(Path(name).suffix, '')}{name}" for name in HOSTILE}
    for name, path in paths.items():
        write_bytes(path, HOSTILE[name]())
    cases = [(str(path), str(honest / HONEST[path.suffix])) for path in paths.values()]
    process = [sys.executable, "-c", READER, str(honest), json.dumps(cases)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(process, env=environment, capture_output=True, text=True, timeout=200, preexec_fn=limited)
    for path in paths.values():
        path.unlink()
    answers = [json.loads(line) if line else ["death", done.stderr, 0, 0] for line in done.stdout.splitlines()]
    return dict(zip(paths, answers, strict=True))


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_in_a_sentence_and_takes_no_memory(found, name):
    kind, message, growth, seconds = found[name]
    assert kind == "ValueError", message
    assert "allocate" not in message, "refused by the system, not by us"
    if not name.endswith((".png", ".jpg")):
        assert f"{name} is damaged or holds no " in message
    assert growth < (400 if name == "wide.json" else 60), f"{growth:.0f} MiB more"
    assert seconds < 10


def test_nothing_in_a_file_runs(tmp_path):
    marker, path = tmp_path / "marker", tmp_path / "x.npz"
    with path.open("wb") as file:
        np.savez(file, images=np.array([Malice(marker)]), robot=np.zeros(1), commands=np.zeros(1), about=np.array("{}"))
    with pytest.raises(ValueError, match=r"x.npz is damaged or holds no trial"):
        load_trial(path)
    torch.save({"mean": Malice(marker)}, path)
    with pytest.raises(ValueError, match=r"x.npz is damaged or holds no network"):
        load_network(path)
    assert not marker.exists()
    pickle.loads(pickle.dumps(Malice(marker)))
    assert marker.exists(), "the malice works where it is let in"


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_file_is_not_waited_for(tmp_path, make):
    make(tmp_path / "x.npz")
    with pytest.raises(ValueError, match=r"x.npz is damaged or holds no trial: it is a folder, a pipe or a device"):
        load_trial(tmp_path / "x.npz")


@pytest.mark.parametrize("size", [LARGEST_TENSORS + 1, 1 << 40])
def test_a_file_that_is_too_long_is_not_read(tmp_path, size):
    for name, load in (("x.npz", load_trial), ("x.safetensors", load_network)):
        with (tmp_path / name).open("wb") as file:
            file.truncate(size)
        with pytest.raises(ValueError, match=r"it has more than the \d+ MiB that such a file has at most"):
            load(tmp_path / name)


def test_the_longest_trial_that_can_be_saved_can_be_read_and_no_longer_one_is_saved(tmp_path, trial):
    rng = np.random.default_rng(0)  # noise, which no packing makes smaller
    images = rng.random((LONGEST, 96, 128), np.float32) < 0.5
    robot, commands = rng.uniform(-0.5, 0.5, (LONGEST, 12)), np.zeros((LONGEST, 3))
    longest = Trial(images, robot, commands, trial.cloth, "muscle", "x", 0)
    save_trial(longest, tmp_path / "x.npz")
    assert len(load_trial(tmp_path / "x.npz")) == LONGEST
    blank = np.zeros((LONGEST + 1, 96, 128), bool)
    longer = Trial(blank, np.zeros((len(blank), 4)), np.zeros((len(blank), 2)), trial.cloth, "torque", "x", 0)
    with pytest.raises(ValueError, match=rf"a trial's file has {LONGEST} steps at most, got {LONGEST + 1}"):
        save_trial(longer, tmp_path / "y.npz")


def test_results_that_could_not_be_read_again_are_not_saved(tmp_path):
    with pytest.raises(ValueError, match="results have less than 8 MiB, or no one could read them again"):
        artifacts.save_results({"x": "y" * LARGEST_TEXT}, "x", data=tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_list_of_hashes_leads_to_no_other_folder(tmp_path, trial, square):
    secret = tmp_path / "secret"
    data = secret / "data"
    save_trial(trial, secret / "x.npz")
    save_trial(trial, data / "y.npz")
    artifacts.save_target(square, "a", data=data)
    artifacts.write_checksums(data)
    line = "0" * 64 + "  "
    names = ("trials/../x.npz", "trials/../../x.npz", f"{secret}/x.npz", "targets/../../x.png", "../x.npz")
    write_bytes(data / artifacts.CHECKSUMS, "".join(f"{line}{name}\n" for name in names).encode())
    assert artifacts.check_data(data)[artifacts.CHECKSUMS] == "damaged"
    with pytest.raises(KeyError, match=r"unknown trials '..'; choose from mine"):
        artifacts.load_trials("..", data=data)
    with pytest.raises(KeyError, match=r"unknown set of targets"):
        artifacts.load_target("../x", data=data)


def test_a_recording_that_is_a_link_is_not_taken_for_ones_own(tmp_path):
    treasure = tmp_path / "treasure"
    write_bytes(treasure / "thesis.txt", b"years of work")
    unfinished = tmp_path / "mine" / "unfinished"
    unfinished.mkdir(parents=True)
    (unfinished / "1-1").symlink_to(treasure)
    (unfinished / ("9" * 5000 + "-1")[:200]).mkdir()
    recorder = Recorder(tmp_path / "mine")
    assert not recorder.waiting
    recorder.discard()
    assert (treasure / "thesis.txt").read_bytes() == b"years of work"


def test_a_network_is_filled_with_its_own_weights_only():
    def make():
        return torch.nn.Linear(2, 3)

    weights = make().state_dict()
    filled_in = filled(make, weights)
    assert torch.equal(filled_in.weight, weights["weight"])
    assert not filled_in.training
    wrong = [weights | {"x": torch.zeros(1)}, {"bias": weights["bias"]}, weights | {"bias": torch.zeros(2)}]
    for tensors, name in zip(wrong, ("x", "weight", "bias"), strict=True):
        with pytest.raises(ValueError, match=rf"{name} has the shape .*, where the network has "):
            filled(make, tensors)
    with pytest.raises(ValueError, match=r"weight has the shape \[3, 2\], where the network has \[3, 10*\]"):
        filled(lambda: torch.nn.Linear(10**12, 3), weights)


NO_JSON = ["NaN", "[1, Infinity]", '{"a": -Infinity}', "[" * 10**5, "9" * 10**5, "", b"\xff", "{"]


@pytest.mark.parametrize("text", NO_JSON, ids=lambda text: str(text)[:8])
def test_json_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match=r".+"):
        read_json(text)


def test_arrays_of_any_order_and_kind_are_read_as_they_are(tmp_path):
    arrays = {"a": np.asfortranarray(np.arange(6).reshape(2, 3)), "b": np.array("words"), "c": np.zeros((0, 4))}
    np.savez(tmp_path / "x.npz", **arrays)
    read = read_arrays(tmp_path / "x.npz", arrays)
    assert all(np.array_equal(read[name], array) and read[name].dtype == array.dtype for name, array in arrays.items())
    with pytest.raises(KeyError, match=r"d.npy"):
        read_arrays(tmp_path / "x.npz", ["d"])
