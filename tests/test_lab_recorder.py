"""Recordings of a live session: named when they stop, written every five seconds,
refused in a sentence.
"""

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
    assert trial.commands[:, 1] == pytest.approx([0, 1, 2, 0, 1])
    assert trial.policy == "control, manual"
    assert trial.seed == 3
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]
    assert not recording.running
    assert not recording.waiting


def test_while_it_runs_its_file_has_all_but_the_last_five_seconds(tmp_path):
    recording = Recorder(tmp_path)
    recording.start()
    add(recording, 2 * recorder._EVERY + 3)
    (left,) = tmp_path.iterdir()
    assert len(load_trial(left)) == 2 * recorder._EVERY
    recording.close()
    assert len(load_trial(left)) == 2 * recorder._EVERY + 3


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
