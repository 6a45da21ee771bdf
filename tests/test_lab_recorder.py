"""Recordings of a live session: named when they stop, refused in a sentence."""

import numpy as np
import pytest

from clothlab.lab.recorder import Recorder
from clothlab.simulation.arm import TorqueArm
from clothlab.simulation.cloth import get_cloth
from clothlab.trials import load_trial

CLOTH = get_cloth("damp0.03-mass0.05")


@pytest.fixture
def recording(tmp_path):
    recording = Recorder(tmp_path)
    recording.start(CLOTH, TorqueArm(), seed=3)
    return recording


def add(recorder, steps, driver="control"):
    for k in range(steps):
        observation = {"image": np.eye(96, 128, k) > 0, "robot": np.full(4, k, float)}
        recorder.add(observation, np.array([0.1, k]), driver)


def test_what_was_recorded_is_read_again(recording, tmp_path):
    add(recording, 3)
    add(recording, 2, "manual")
    trial = load_trial(recording.save("mine"))
    assert len(trial) == 5
    assert trial.commands[:, 1] == pytest.approx([0, 1, 2, 0, 1])
    assert trial.policy == "control, manual"
    assert trial.seed == 3
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]
    assert not recording.running
    assert not recording.waiting


def test_a_stopped_recording_waits_for_its_name_and_can_be_discarded(
    recording, tmp_path
):
    add(recording, 2)
    recording.stop()
    assert recording.waiting
    with pytest.raises(ValueError, match="save it under a name, or discard it"):
        recording.start(CLOTH, TorqueArm(), seed=3)
    recording.discard()
    assert not recording.waiting
    assert not list(tmp_path.iterdir())


def test_names_that_exist_or_lead_elsewhere_are_refused_and_the_recording_goes_on(
    recording, tmp_path
):
    with pytest.raises(ValueError, match="nothing was recorded"):
        recording.save("mine")
    add(recording, 1)
    (tmp_path / "there.npz").write_bytes(b"another's")
    with pytest.raises(ValueError, match="exists: choose another name"):
        recording.save("there")
    assert (tmp_path / "there.npz").read_bytes() == b"another's"
    with pytest.raises(ValueError, match="recording"):
        recording.save("../elsewhere")
    assert recording.running


def test_where_nothing_can_be_written_the_variable_is_named_and_nothing_lost(tmp_path):
    (tmp_path / "file").touch()
    recording = Recorder(tmp_path / "file" / "mine")
    recording.start(CLOTH, TorqueArm(), seed=3)
    add(recording, 1)
    with pytest.raises(OSError, match="set CLOTHLAB_RECORDINGS to a folder of yours"):
        recording.save("mine")
    recording.stop()
    assert recording.waiting
