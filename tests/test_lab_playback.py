"""A recorded run of the panel: what is kept, what is refused, and how it is shown and left."""

import asyncio
import lzma

import numpy as np
import pytest

from clothlab import artifacts
from clothlab.lab import LivePanel
from clothlab.lab.playback import RECORDING, SHOWN, Playback, SessionRecording, load_recording


@pytest.fixture
def panel(new_session):
    panel = LivePanel(new_session())
    yield panel
    panel.check()
    panel.close()


@pytest.fixture
def reel(panel, tmp_path):
    """Three steps: the first, one with a frame that is new, and one in which all stays as it is."""
    reel = SessionRecording(panel)
    reel.take("the beginning")
    panel.step()
    reel.take("a step")
    reel.take("nothing new")
    reel.save(tmp_path / "reel.json.xz")
    return tmp_path / "reel.json.xz"


def send(panel, do, *buffers, **arguments):
    panel._handle_custom_msg({"do": do, "id": f"id-{do}", **arguments}, list(buffers))


def test_a_reel_keeps_what_is_new_at_each_step(panel, reel):
    first, second, third = load_recording(reel)
    assert first.keys() == {*SHOWN, "caption"}
    assert first["target"]["image"] == panel.target["image"]  # bytes stay bytes
    assert first["about"]["gallery"][0]["image"] == panel.about["gallery"][0]["image"]
    assert second["frame"]["clock"] == panel.frame["clock"] == "0.2 s, step 1"
    assert second.keys() < first.keys()
    assert third == {"caption": "nothing new"}


def test_pictures_are_kept_in_fewer_bytes(panel, reel):
    assert len(load_recording(reel)[1]["frame"]["scene"]) < len(panel.frame["scene"])


def test_the_stored_run_shows_what_todays_panel_shows(panel):
    shots = load_recording()
    shots[0].pop("caption")
    for name in ("about", "state", "target", "frame"):
        assert shots[0][name].keys() == getattr(panel, name).keys(), "make demonstration records it anew"
    drivers = [shot["state"]["driver"] for shot in shots if "state" in shot]
    assert list(dict.fromkeys(drivers)) == ["manual", "random", "control", "iterative"]
    assert (artifacts.data_folder() / RECORDING).stat().st_size < 4e6


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no archive",
        lzma.compress(b"no json"),
        lzma.compress(b"[1, 2]"),
        lzma.compress(b'{"format": 2, "shots": [{}]}'),
        lzma.compress(b'{"format": 1, "shots": []}'),
        lzma.compress(b'{"format": 1, "shots": [{"about": {}}]}'),
        lzma.compress(b'{"format": 1, "shots": [{"about": {"bytes": "#"}}]}'),
    ],
)
def test_what_is_no_reel_is_refused_in_a_sentence(tmp_path, content):
    (tmp_path / "reel").write_bytes(content)
    with pytest.raises(ValueError, match="reel is damaged or holds no recorded run"):
        load_recording(tmp_path / "reel")


def test_a_reel_cut_short_is_refused(reel):
    reel.write_bytes(reel.read_bytes()[:-40])
    with pytest.raises(ValueError, match="damaged"):
        load_recording(reel)


def test_without_a_reel_the_panel_says_how_to_get_one(panel, tmp_path):
    panel._playback = Playback(panel, lambda: load_recording(tmp_path / "none"))
    send(panel, "play")
    assert "make demonstration" in panel.state["message"]["text"]
    assert panel.state["status"] == "paused"


def test_it_plays_to_its_end_and_the_live_robot_is_back(panel, reel):
    panel._playback = Playback(panel, lambda: load_recording(reel))
    panel.step()
    told, clocks = [], []
    panel.observe(lambda change: told.append((change["new"]["status"], change["new"]["message"]["text"])), "state")

    def draw(change):
        clocks.append(change["new"]["clock"])
        send(panel, "drawn", frame=change["new"]["number"])

    async def main():
        send(panel, "drawn", frame=panel.frame["number"])
        panel.observe(draw, "frame")
        send(panel, "play")
        while panel._playback.running:
            await asyncio.sleep(0.05)

    steps = panel.steps
    asyncio.run(main())
    assert ("recorded", "recorded run, 0:00 of 0:00: the beginning") in told
    assert told[-1][0] == "paused"
    assert "0.0 s, step 0" in clocks
    assert clocks[-1] == panel.frame["clock"] == "0.4 s, step 2"  # of the session, which did not move
    assert panel.steps == steps


@pytest.mark.parametrize("do", ["live", "step", "start"])
def test_whatever_a_person_does_ends_it(panel, reel, do):
    panel._playback = Playback(panel, lambda: 100 * load_recording(reel))

    async def main():
        panel.start()
        send(panel, "play")
        assert not panel.running
        await asyncio.sleep(0.01)
        assert panel.state["status"] == "recorded"
        send(panel, do)
        assert not panel._playback.running
        assert panel.state["answered"] == f"id-{do}"
        assert panel.state["status"] == ("running" if do == "start" else "paused")

    asyncio.run(main())


def test_a_browser_that_does_not_draw_gets_no_frames_but_is_told_how_things_stand(panel, reel):
    panel._playback = Playback(panel, lambda: load_recording(reel))

    async def main():
        send(panel, "play")
        number = panel.frame["number"]
        await asyncio.sleep(0.3)
        assert panel.frame["number"] == number
        assert "a step" in panel.state["message"]["text"]
        panel._playback.stop()

    asyncio.run(main())


def test_a_panel_that_closes_is_not_shown_again(panel, reel):
    playback = Playback(panel, lambda: 100 * load_recording(reel))

    async def main():
        playback.start()
        await asyncio.sleep(0.01)
        playback.close()
        state = panel.state
        await asyncio.sleep(0.3)
        assert panel.state is state

    asyncio.run(main())
    assert panel.state["status"] == "recorded"


def test_a_panel_shows_no_objects(panel):
    panel.state = panel.state | {"odd": np.zeros(2)}
    with pytest.raises(TypeError, match="ndarray"):
        SessionRecording(panel).take("")
