"""Recordings of a live session: named when they stop, written every five seconds,
refused in a sentence.
"""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from clothlab.lab import _recorder as recorder
from clothlab.lab._recorder import Recorder
from clothlab.simulation.cloth import get_cloth
from clothlab.trials import load_trial

ABOUT = {
    "cloth": get_cloth("damp0.03-mass0.05"),
    "arm": "torque",
    "policy": "control",
    "seed": 3,
}


def add(recorder, steps, **changes):
    for k in range(steps):
        observation = {"image": np.eye(96, 128, k) > 0, "robot": np.full(4, k, float)}
        recorder.add(observation, np.array([0.1, k]), ABOUT | changes)


def test_what_was_recorded_is_read_again(tmp_path):
    recording = Recorder(tmp_path)
    recording.start()
    add(recording, 3)
    add(recording, 2, policy="manual")
    trial = load_trial(recording.save("mine"))
    assert len(trial) == 5
    assert trial.policy == "control, manual"
    assert trial.seed == 3
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]
    assert not recording.running
    assert not recording.waiting


def test_a_stopped_recording_waits_for_its_name_and_can_be_discarded(tmp_path):
    recording = Recorder(tmp_path)
    recording.start()
    add(recording, 2)
    recording.stop()
    assert recording.waiting
    with pytest.raises(ValueError, match="save it under a name, or discard it"):
        recording.start()
    recording.discard()
    assert not recording.waiting
    assert not list(tmp_path.iterdir())


DYING = """
import os, sys
import numpy as np
from pathlib import Path
from clothlab.lab._recorder import Recorder
from clothlab.simulation.cloth import get_cloth

about = {"cloth": get_cloth("damp0.03-mass0.05"), "arm": "torque", "seed": 3}
recorder = Recorder(Path(sys.argv[1]))
recorder.start()
for k in range(100_000):
    observation = {"image": np.eye(96, 128, k % 96) > 0, "robot": np.full(4, k, float)}
    recorder.add(observation, np.array([0.1, k]), about | {"policy": "manual" if k > 30 else "control"})
    print(k + 1, flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("steps", [26, 305])
def test_a_killed_process_loses_less_than_five_seconds(tmp_path, steps):
    command = [sys.executable, "-c", DYING, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        recorded = next(int(line) for line in process.stdout if int(line) >= steps)
        process.send_signal(signal.SIGKILL)
        # Until the signal came
        recorded = max([recorded, *map(int, process.stdout.read().split())])
    assert [
        path.suffix for path in tmp_path.iterdir() if path.suffix != ".pieces"
    ] == []  # nothing half-written
    Recorder(tmp_path)
    trials = [load_trial(path) for path in tmp_path.glob("*.npz")]
    kept = sum(map(len, trials))
    # The step may be on the disk that was not yet reported
    assert recorded - 25 < kept <= recorded + 1
    assert not list(tmp_path.glob("*.pieces"))
    for trial in trials:
        assert trial.commands[:, 1] == pytest.approx(np.arange(kept))
        assert trial.policy == ("control, manual" if kept > 31 else "control")


def test_pieces_of_a_kernel_that_lives_are_left_to_it(tmp_path):
    recording = Recorder(tmp_path)
    recording.start()
    add(recording, 60)
    Recorder(tmp_path)
    (pieces,) = tmp_path.iterdir()
    assert sorted(path.name for path in pieces.iterdir()) == [
        "000000.npz",
        "000025.npz",
    ]
    assert len(load_trial(recording.save("mine"))) == 60
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]


def test_pieces_that_come_after_they_were_joined_are_joined_to_them(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(recorder, "_abandoned", lambda pieces: True)
    recording = Recorder(tmp_path)
    recording.start()
    add(recording, 50)
    (file,) = recorder.join_pieces(tmp_path)
    add(recording, 25)
    assert recorder.join_pieces(tmp_path) == [file]
    assert len(load_trial(file)) == 75
    recording.discard()
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_step_costs_as_much_at_the_end_as_at_the_beginning(tmp_path):
    recording, seconds = Recorder(tmp_path), []
    recording.start()
    for _ in range(60):
        start = time.thread_time()
        add(recording, 25)
        seconds.append((time.thread_time() - start) / 25)
    print(
        f"recording costs {1e3 * np.median(seconds):.2f} ms a step, {1e3 * np.median(seconds[-10:]):.2f} at the end"
    )
    assert np.median(seconds[-10:]) < 2 * np.median(seconds[:10])
    recording.discard()


def test_a_closed_recording_keeps_its_file(tmp_path):
    recording = Recorder(tmp_path)
    recording.start()
    add(recording, 2)
    recording.close()
    (left,) = tmp_path.iterdir()
    assert len(load_trial(left)) == 2


def test_names_that_exist_or_lead_elsewhere_are_refused_and_the_recording_goes_on(
    tmp_path,
):
    recording = Recorder(tmp_path)
    recording.start()
    with pytest.raises(ValueError, match="nothing was recorded"):
        recording.save("mine")
    add(recording, 1)
    (tmp_path / "there.npz").touch()
    with pytest.raises(ValueError, match="exists: choose another name"):
        recording.save("there")
    with pytest.raises(ValueError, match="recording"):
        recording.save("../elsewhere")
    assert recording.running


def test_a_disk_that_is_full_stops_the_recording_and_keeps_its_steps(
    tmp_path, monkeypatch
):
    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(recorder, "_EVERY", 2)
    recording = Recorder(tmp_path)
    recording.start()
    with monkeypatch.context() as patch:
        patch.setattr(recorder, "save_trial", full)
        with pytest.raises(OSError, match="No space"):
            add(recording, 2)
    assert recording.waiting
    assert len(load_trial(recording.save("mine"))) == 2


def test_an_hour_is_the_longest(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "_EVERY", 2)
    monkeypatch.setattr(recorder, "_LONGEST", 4)
    recording = Recorder(tmp_path)
    recording.start()
    with pytest.raises(OSError, match="4 steps at most"):
        add(recording, 6)
    assert len(load_trial(recording.save("mine"))) == 4
