"""A recorded run of the panel: what is kept, and how it is shown and left."""

import asyncio

import pytest

from clothlab import artifacts
from clothlab.lab import LivePanel
from clothlab.lab.playback import _SHOWN, RECORDING, Playback, SessionRecording, load_recording

pytestmark = pytest.mark.slow  # each panel starts a session


@pytest.fixture
def panel(new_session):
    panel = LivePanel(new_session())
    yield panel
    panel.check()
    panel.close()


@pytest.fixture
def recording(panel, tmp_path):
    """Three steps: the first, one with a frame that is new, and one in which all stays as it is."""
    recording = SessionRecording(panel)
    recording.take("the beginning")
    panel.step()
    recording.take("a step")
    recording.take("nothing new")
    recording.save(tmp_path / "run.json.xz")
    return tmp_path / "run.json.xz"


def send(panel, do, *buffers, **arguments):
    panel._handle_custom_msg({"do": do, "id": f"id-{do}", **arguments}, list(buffers))


def test_a_recording_keeps_what_is_new_at_each_step_in_fewer_bytes(panel, recording):
    first, second, third = load_recording(recording)
    assert first.keys() == {*_SHOWN, "caption"}
    assert first["target"]["image"] == panel.target["image"]  # bytes stay bytes
    assert second["frame"]["clock"] == panel.frame["clock"] == "0.2 s, step 1"
    assert len(second["frame"]["scene"]) < len(panel.frame["scene"])
    assert second.keys() < first.keys()
    assert third == {"caption": "nothing new"}


def test_the_stored_run_shows_what_todays_panel_shows(panel):
    shots = load_recording()
    for name in ("about", "state", "target", "frame"):
        assert shots[0][name].keys() == getattr(panel, name).keys(), "make demonstration records it anew"
    drivers = [shot["state"]["driver"] for shot in shots if "state" in shot]
    assert list(dict.fromkeys(drivers)) == ["manual", "random", "control", "iterative"]
    assert (artifacts.data_folder() / RECORDING).stat().st_size < 4e6


def test_a_damaged_or_missing_recording_is_refused_in_a_sentence(panel, recording):
    recording.write_bytes(recording.read_bytes()[:-40])
    with pytest.raises(ValueError, match="damaged"):
        load_recording(recording)
    recording.unlink()
    panel._playback = Playback(panel, lambda: load_recording(recording))
    send(panel, "play")
    assert "make demonstration" in panel.state["message"]["text"]
    assert panel.state["status"] == "paused"


def test_it_plays_to_its_end_and_the_live_robot_is_back(panel, recording):
    panel._playback = Playback(panel, lambda: load_recording(recording))
    panel.step()
    said, clocks, steps = [], [], panel.steps
    panel.observe(lambda change: said.append((change["new"]["status"], change["new"]["message"]["text"])), "state")

    def draw(change):
        clocks.append(change["new"]["clock"])
        send(panel, "drawn", frame=change["new"]["number"])

    async def main():
        send(panel, "drawn", frame=panel.frame["number"])
        panel.observe(draw, "frame")
        send(panel, "play")
        while panel._playback.running:
            await asyncio.sleep(0.05)

    asyncio.run(main())
    assert ("recorded", "recorded run, 0:00 of 0:00: the beginning") in said
    assert said[-1][0] == "paused"
    assert "0.0 s, step 0" in clocks
    assert clocks[-1] == panel.frame["clock"] == "0.4 s, step 2"  # of the session, which did not move
    assert panel.steps == steps


@pytest.mark.parametrize("do", ["live", "step", "start"])
def test_any_action_ends_it(panel, recording, do):
    panel._playback = Playback(panel, lambda: 100 * load_recording(recording))

    async def main():
        panel.start()
        send(panel, "play")
        assert not panel.running
        number = panel.frame["number"]
        await asyncio.sleep(0.3)
        assert panel.frame["number"] <= number + 1  # the browser has not drawn it
        assert panel.state["status"] == "recorded"
        send(panel, do)
        assert not panel._playback.running
        assert panel.state["answered"] == f"id-{do}"
        assert panel.state["status"] == ("running" if do == "start" else "paused")

    asyncio.run(main())
