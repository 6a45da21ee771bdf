"""Recordings on disk: nothing is lost, mixed or out of order, whoever dies when."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import clothlab
from clothlab import artifacts
from clothlab.lab.recorder import Recorder
from clothlab.simulation.cloth import get_cloth
from clothlab.trials import load_trial

ABOUT = {"cloth": get_cloth("damp0.05-mass0.10"), "arm": "torque", "policy": "hand", "seed": 7}


@pytest.fixture
def recorder(tmp_path):
    return Recorder(tmp_path / "mine")


def add(recorder, first, count, **about):
    """Steps that can be told apart by their first command."""
    for k in range(first, first + count):
        observation = {"image": np.eye(96, 128, dtype=np.int8), "robot": np.zeros(4)}
        recorder.add(observation, np.array([k / 1000, 0.0]), ABOUT | about)


def steps(path):
    return (1000 * load_trial(path).commands[:, 0]).round().astype(int).tolist()


def pieces(recorder):
    return sorted((recorder.folder / "unfinished").rglob("*.npz"))


def test_a_recording_is_joined_from_its_pieces(recorder):
    recorder.start()
    add(recorder, 0, 13)
    path = recorder.save("my-swing_1")
    trial = load_trial(path)
    assert steps(path) == list(range(13))
    assert (trial.cloth, trial.arm, trial.policy, trial.seed) == (*ABOUT.values(),)
    assert not recorder.running
    assert sorted(recorder.folder.rglob("*")) == [path, recorder.folder / "unfinished"]
    recorder.start()  # nothing is left of the first


def test_every_driver_is_named_once(recorder):
    recorder.start()
    for k, policy in enumerate(["control", "hand", "control", "operator", "hand", "control", "random"]):
        add(recorder, k, 1, policy=policy)
    assert load_trial(recorder.save("x")).policy == "control, hand, operator, random"


@pytest.mark.parametrize("name", ["", "../escape", "a/b", "a b", ".hidden", "x.npz", None])
def test_bad_names_lose_nothing(recorder, name, tmp_path):
    recorder.start()
    add(recorder, 0, 1)
    with pytest.raises(ValueError, match="letters, digits"):
        recorder.save(name)
    assert recorder.running
    add(recorder, 1, 1)
    assert steps(recorder.save("good")) == [0, 1]
    assert list(tmp_path.rglob("*.npz")) == [tmp_path / "mine" / "good.npz"]


def test_nothing_is_overwritten(recorder):
    recorder.start()
    add(recorder, 0, 1)
    before = recorder.save("twice").read_bytes()
    recorder.start()
    with pytest.raises(ValueError, match="nothing was recorded"):
        recorder.save("empty")
    add(recorder, 0, 2)
    with pytest.raises(ValueError, match="exists: choose another name"):
        recorder.save("twice")
    assert (recorder.folder / "twice.npz").read_bytes() == before
    recorder.discard()
    with pytest.raises(ValueError, match="nothing was recorded"):
        recorder.save("empty")


def test_a_second_start_drops_nothing(recorder):
    recorder.start()
    add(recorder, 0, 3)
    with pytest.raises(ValueError, match="runs already"):
        recorder.start()
    add(recorder, 3, 3)
    recorder.stop()
    with pytest.raises(FileExistsError, match="save it under a name, or discard it"):
        recorder.start()
    assert steps(recorder.save("x")) == list(range(6))


def test_two_recorders_on_one_folder_do_not_mix(recorder):
    other = Recorder(recorder.folder)
    recorder.start()
    other.start()
    for k in range(0, 12, 2):
        add(recorder, k, 2)
        add(other, 500 + k, 2)
    assert steps(recorder.save("one")) == list(range(12))
    assert steps(other.save("other")) == list(range(500, 512))


def test_a_closed_session_leaves_its_recording_to_the_next(recorder):
    recorder.start()
    add(recorder, 0, 7)
    recorder.close()
    after = Recorder(recorder.folder)
    assert after.waiting
    assert steps(after.save("found")) == list(range(7))


KERNEL = """
import sys
from test_lab_recorder import Recorder, add
recorder = Recorder(sys.argv[1])
recorder.start()
print("recording", flush=True)
for k in range(100_000):
    add(recorder, k, 1)
"""


def kernel(folder):
    """A process that records until it is killed."""
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(clothlab.__file__).parents[1])])
    process = subprocess.Popen(
        [sys.executable, "-c", KERNEL, str(folder)], stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": paths}
    )
    assert process.stdout.readline() == b"recording\n"
    return process


@pytest.mark.slow
def test_a_kernel_killed_at_any_moment_leaves_a_recording_in_order(tmp_path):
    rng = np.random.default_rng(0)
    for k in range(3):
        process = kernel(tmp_path)
        while len(list((tmp_path / "unfinished").rglob("*.npz"))) < 3:
            time.sleep(0.01)
        assert not Recorder(tmp_path).waiting  # it still records
        time.sleep(rng.uniform(0, 0.1))
        process.kill()
        process.communicate()
        after = Recorder(tmp_path)
        assert after.waiting
        with pytest.raises(FileExistsError, match="unfinished recording"):
            after.start()
        found = steps(after.save(f"found-{k}"))
        assert found == list(range(len(found)))
        assert len(found) >= 15
        assert list((tmp_path / "unfinished").iterdir()) == []


def test_a_recording_whose_first_second_was_not_over_is_nothing(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    place = tmp_path / "mine" / "unfinished" / f"{time.time_ns()}-{process.pid}"
    place.mkdir(parents=True)
    (place / ".00000000.npz-abc.part").write_bytes(b"half")
    assert not Recorder(tmp_path / "mine").waiting
    assert not place.exists()


@pytest.mark.parametrize("damage", [lambda piece: piece.write_bytes(b"half"), lambda piece: piece.unlink()])
def test_a_damaged_piece_costs_what_follows_and_no_more(recorder, damage):
    recorder.start()
    add(recorder, 0, 20)
    damage(pieces(recorder)[2])
    assert steps(recorder.save("rest")) == list(range(10))
    assert "first 10 steps" in recorder.remark
    recorder.start()
    add(recorder, 0, 1)
    recorder.save("next")
    assert recorder.remark == ""


def test_a_recording_without_a_beginning_can_be_discarded(recorder):
    recorder.start()
    add(recorder, 0, 6)
    pieces(recorder)[0].write_bytes(b"half")
    with pytest.raises(ValueError, match="damaged: discard it"):
        recorder.save("x")
    recorder.discard()
    recorder.start()


def test_a_folder_that_takes_nothing_is_refused_at_once(tmp_path):
    (tmp_path / "mine").write_text("a file, where a folder should be")
    recorder = Recorder(tmp_path / "mine")
    with pytest.raises(OSError, match="nothing can be written to"):
        recorder.start()
    assert not recorder.running


def test_a_full_disk_stops_the_recording_and_loses_no_step(recorder, monkeypatch):
    recorder.start()
    add(recorder, 0, 4)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("clothlab.lab.recorder.save_trial", full)
    with pytest.raises(OSError, match="No space"):
        add(recorder, 4, 1)
    assert recorder.waiting
    with pytest.raises(OSError, match="No space"):
        recorder.save("x")
    monkeypatch.undo()
    assert steps(recorder.save("x")) == list(range(5))


def test_temporary_files_are_seen_by_no_loader(tmp_path):
    recorder = Recorder(tmp_path / artifacts.OWN_TRIALS)
    recorder.start()
    add(recorder, 0, 5)
    recorder.save("one")
    (recorder.folder / ".two.npz-abc.part").write_bytes(b"half")
    recorder.start()
    add(recorder, 0, 5)
    assert len(artifacts.load_trials("mine", data=tmp_path)) == 1
    assert artifacts.load_trials("mine", data=recorder.folder) == []
