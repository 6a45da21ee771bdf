"""A recorded run of the panel: what is kept, and how notebook 00 plays it."""

import pytest

from clothlab import _store
from clothlab.lab import LivePanel, RecordedRun
from clothlab.lab._playback import _SHOWN, RECORDING, SessionRecording, load_recording

pytestmark = pytest.mark.slow  # a panel starts a session


@pytest.fixture
def recording(new_session, tmp_path):
    """Three steps: the first, one with a frame that is new, and one in which all stays
    as it is.
    """
    panel = LivePanel(new_session())
    recording = SessionRecording(panel)
    recording.take("the beginning")
    panel.step()
    recording.take("a step")
    recording.take("nothing new")
    recording.save(tmp_path / "run.json.xz")
    panel.check()
    panel.close()
    return tmp_path / "run.json.xz"


def test_a_recording_keeps_what_is_new_at_each_step(recording):
    first, second, third = load_recording(recording)
    assert first.keys() == {*_SHOWN, "caption"}
    assert isinstance(first["target"]["image"], bytes)
    assert second["frame"]["clock"] == "0.2 s, step 1"
    assert second.keys() < first.keys()
    assert third == {"caption": "nothing new"}


def test_the_stored_run_begins_with_random_commands_and_ends_with_learning():
    drivers = [shot["state"]["driver"] for shot in load_recording() if "state" in shot]
    assert list(dict.fromkeys(drivers)) == ["manual", "random", "control", "iterative"]
    assert (_store.data_folder() / RECORDING).stat().st_size < 4e6


def test_a_damaged_or_missing_recording_is_refused_in_a_sentence(recording):
    recording.write_bytes(recording.read_bytes()[:-40])
    with pytest.raises(ValueError, match="damaged"):
        load_recording(recording)
    recording.unlink()
    with pytest.raises(FileNotFoundError, match="make demonstration"):
        load_recording(recording)


def test_the_slider_of_notebook_00_shows_each_step():
    run = RecordedRun(90, shown=20)
    before = run.slider.max, run._pictures[0].value, run._caption.value
    run.slider.value = 86
    assert before[0] == len(run.images) == 90
    assert run._pictures[0].value != before[1]
    assert run._caption.value.startswith("0:17") != before[2].startswith("0:17")
    run.check()
