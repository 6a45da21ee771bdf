"""The panel without a browser: what its actions do to the session, and what it says when something is wrong."""

import asyncio
import base64
import json
import threading
import time
from threading import get_ident

import cv2
import numpy as np
import pytest

from clothlab.lab import LivePanel, LiveSession, table, views
from clothlab.lab import panel as panel_module
from clothlab.lab.targets import LARGEST_FILE
from clothlab.simulation.env import SimulationError
from clothlab.trials import load_trial


@pytest.fixture
def panel(new_session):
    panel = LivePanel(new_session())
    yield panel
    panel.check()
    panel.close()


def send(panel, do, *buffers, **arguments):
    """What the browser does when a person acts."""
    panel._handle_custom_msg({"do": do, "id": f"id-{do}", **arguments}, list(buffers))


def says(panel):
    return panel.state["message"]["text"]


def draw_every_frame(panel) -> None:
    """What a fast browser does."""
    send(panel, "drawn", frame=panel.frame["number"])
    panel.observe(lambda change: send(panel, "drawn", frame=change["new"]["number"]), "frame")


def run(panel, seconds: float, answer=True) -> None:
    """Let the panel run, with a browser that draws each frame at once, or with none."""

    async def main():
        panel.start()
        if answer:
            draw_every_frame(panel)
        await asyncio.sleep(seconds)

    asyncio.run(main())


@pytest.mark.slow
def test_time_goes_by_until_it_is_paused(panel):
    async def main():
        send(panel, "start")
        send(panel, "start")  # twice is once
        assert panel.state["running"]
        await asyncio.sleep(1.2)
        send(panel, "pause")
        assert not panel.state["running"]
        steps = panel.steps
        await asyncio.sleep(0.5)
        assert panel.steps == steps
        return steps

    assert 3 <= asyncio.run(main()) <= 7
    assert not panel.running


@pytest.mark.slow
def test_a_browser_that_does_not_draw_gets_no_more_frames(panel):
    first = panel.frame["number"]
    run(panel, 1.2, answer=False)
    assert panel.steps >= 3
    assert panel.frame["number"] <= first + 1


@pytest.mark.slow
def test_a_page_that_is_gone_stops_the_clock(panel, monkeypatch):
    monkeypatch.setattr(panel_module, "PATIENCE", 3)

    async def main():
        panel.start()
        await asyncio.sleep(1.6)
        return panel.running

    assert not asyncio.run(main())
    assert "does not answer" in says(panel)
    assert not panel.state["running"]


def test_a_second_panel_closes_the_first(panel):
    other = LivePanel(LiveSession(picture_size=(96, 128)))
    assert not panel.running
    assert LivePanel._active is other
    assert panel.comm is None
    other.close()
    other.close()  # twice is once


@pytest.mark.slow
def test_a_busy_kernel_is_not_a_closed_page(panel, monkeypatch):
    monkeypatch.setattr(panel_module, "PATIENCE", 3)

    async def main():
        panel.start()
        draw_every_frame(panel)
        await asyncio.sleep(0.3)
        time.sleep(1.5)  # a cell that computes: no step, and no answer is heard
        await asyncio.sleep(0.5)
        return panel.running

    assert asyncio.run(main())


@pytest.mark.slow
def test_actions_wait_for_the_end_of_a_step_whatever_thread_brings_them(monkeypatch):
    threads = []

    async def main():
        panel = LivePanel(LiveSession(picture_size=(96, 128)))
        change = panel.session.set_material
        monkeypatch.setattr(
            panel.session, "set_material", lambda *a, **k: threads.append(get_ident()) or change(*a, **k)
        )
        panel.start()
        for damping in (0.03, 0.04, 0.06):
            await asyncio.to_thread(send, panel, "set material", damping=damping, mass=0.1)
            await asyncio.sleep(0.3)
            assert panel.session.env.cloth.damping == pytest.approx(damping)
        panel.check()
        panel.close()

    asyncio.run(main())
    assert threads == [get_ident()] * 3


def test_single_steps_and_reset(panel):
    send(panel, "step")
    send(panel, "step")
    assert panel.session.step_number == 2
    assert panel.frame["clock"] == "0.4 s, step 2"
    assert len(panel.frame["traces"][0]["lines"][0]["values"]) == 2
    send(panel, "reset")
    assert panel.session.step_number == 0
    assert panel.frame["traces"][0]["lines"][0]["values"] == []


def test_all_that_is_shown_comes_from_python(panel):
    """The names, ranges and sizes that the browser needs; JSON has no word for NumPy's numbers."""
    plain = {key: value for key, value in panel.about.items() if key != "gallery"}
    assert json.loads(json.dumps(plain))["period"] == 0.2
    assert panel.about["cloths"][0]["label"] == "(0.03, 0.05)"
    assert [name for name, _ in panel.about["hands"]] == list(panel.session.arm.command_names)
    json.dumps(panel.state)
    send(panel, "set arm", name="muscle")
    assert panel.about["tension"] == (10.0, 70.0, views.TENSION_STEP)
    assert len(panel.state["hand"]) == len(panel.about["hands"]) == 3
    json.dumps({key: value for key, value in panel.about.items() if key != "gallery"})


def test_every_action_is_answered_even_when_it_is_refused(panel):
    send(panel, "set material", damping=0.05, mass=1e-4)
    assert panel.state["answered"] == "id-set material"
    assert "Cloth.mass must be at least" in says(panel)
    assert panel.state["message"]["kind"] == "mistake"
    assert panel.state["cloth"]["material"] == (0.05, 0.1)
    send(panel, "step")
    assert (says(panel), panel.state["answered"]) == ("", "id-step")
    send(panel, "dance")
    assert "unknown action 'dance'; choose from start, pause" in says(panel)


def test_a_click_on_the_map_sets_p(panel):
    send(panel, "set p", at=[0.1, -0.05])
    assert panel.frame["at"] == pytest.approx([0.1, -0.05], abs=1e-6)
    before = panel.session.p
    send(panel, "set p", at=[1e300, 0])
    assert "p is [2] and finite" in says(panel)
    assert np.array_equal(panel.session.p, before)


def test_a_drawing_becomes_the_target_and_shows_what_the_network_believes(panel, square):
    before = panel.target
    send(panel, "draw", memoryview(square.astype(np.uint8).tobytes()))
    assert np.array_equal(panel.session.target, square)
    assert panel.target["reconstruction"] != before["reconstruction"]
    assert panel.target["version"] == before["version"]  # it stands on the canvas already
    checkers = np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0
    send(panel, "draw", checkers.astype(np.uint8).tobytes())
    assert panel.target["verdict"] == "The autoencoder does not reproduce it."
    send(panel, "pick", name="target-1")
    assert np.array_equal(panel.session.target, panel.session.gallery["target-1"])
    assert panel.target["verdict"] == "The autoencoder reproduces it."


def test_a_target_that_was_drawn_over_is_shown_again(panel):
    versions = []
    for _ in range(2):
        send(panel, "pick", name="target-1")
        versions.append(panel.target["version"])
    assert versions[1] == versions[0] + 1


@pytest.mark.parametrize("content", [bytes(96 * 128), b"short"])
def test_an_impossible_drawing_says_so_and_keeps_the_target(panel, content):
    target = panel.session.target
    send(panel, "draw", content)
    assert panel.state["message"]["kind"] == "mistake"
    assert np.array_equal(panel.session.target, target)
    send(panel, "step")


def test_the_present_image_becomes_the_target(panel):
    send(panel, "step")
    send(panel, "take")
    assert np.array_equal(panel.session.target, panel.session.observation["image"])
    send(panel, "clear")
    assert "draw a target" in says(panel)


def test_a_file_becomes_the_target_or_says_why_not(panel, square):
    _, png = cv2.imencode(".png", square.astype(np.uint8) * 255)
    send(panel, "upload", memoryview(png.tobytes()), size=900)
    assert np.array_equal(panel.session.target, square)
    send(panel, "upload", memoryview(b"text"), size=4)
    assert "not a picture" in says(panel)
    _, small = cv2.imencode(".png", np.full((10, 10), 255, np.uint8))
    send(panel, "upload", memoryview(small.tobytes()), size=80)
    assert "128×96 pixels, this picture 10×10" in says(panel)
    send(panel, "upload", size=LARGEST_FILE + 1)
    assert "larger than 1 MB" in says(panel)


def test_an_own_material_has_a_label(panel):
    send(panel, "set material", damping=0.055, mass=0.1)
    assert panel.state["cloth"]["label"] == "(0.055, 0.100)"
    send(panel, "set cloth", cloth="damp0.07-mass0.15")
    assert panel.state["cloth"] == {"name": "damp0.07-mass0.15", "label": "(0.07, 0.15)", "material": (0.07, 0.15)}


def test_a_moved_slider_takes_over(panel):
    send(panel, "set hand", u=[0.2, -0.4])
    assert panel.session.driver == panel.state["driver"] == "manual"
    send(panel, "step")
    assert panel.history[-1].command[0] == pytest.approx(0.2)
    send(panel, "set driver", driver="control")
    send(panel, "set hand", u=[5.0, 0.0])
    assert "outside the torque arm's range" in says(panel)
    assert panel.session.driver == "control"


def test_practice_is_switched_on_and_told_to_repeat(panel):
    send(panel, "set driver", driver="iterative")
    assert (panel.state["driver"], panel.state["exploring"]) == ("iterative", True)
    send(panel, "step")
    assert [line["name"] for line in panel.frame["traces"][0]["lines"]] == ["distance", "predicted at each step"]
    send(panel, "explore", on=False)
    assert panel.session.exploring is panel.state["exploring"] is False
    send(panel, "step")


def test_sticks_take_over(panel):
    send(panel, "set arm", name="muscle")
    send(panel, "greet gamepad", enough=True)
    assert "left stick: shoulder, right stick: elbow, right trigger: stiffness" in says(panel)
    assert panel.session.driver == "control"
    send(panel, "move sticks", places=[1.0, 0.0, 0.5])
    send(panel, "step")
    arm = panel.session.arm
    assert panel.session.driver == "manual"
    assert panel.history[-1].command == pytest.approx([arm.upper[0], arm.lower[1], 40.0])
    send(panel, "greet gamepad", enough=False)
    assert "needs two sticks" in says(panel)


def test_stiffness_is_the_muscle_arms(panel):
    assert panel.about["tension"] is None
    assert panel.ellipse == b""
    send(panel, "set arm", name="muscle")
    send(panel, "set tension", f_const=50.0)
    assert (panel.state["fixed"], panel.state["tension"]) == (True, [50.0])
    send(panel, "step")
    assert panel.history[-1].command[2] == 50.0
    assert len(panel.ellipse) > 1000
    send(panel, "set tension", f_const=None)
    assert not panel.state["fixed"]


def test_recordings_are_saved_once_under_a_good_name(panel, tmp_path):
    send(panel, "record")
    run(panel, 0.7)
    send(panel, "save", name="../escape")
    assert "letters, digits" in says(panel)
    assert panel.state["recording"]
    send(panel, "save", name="swing")
    assert "saved as swing.npz" in says(panel)
    send(panel, "record")
    send(panel, "step")
    send(panel, "save", name="swing")
    assert "exists" in says(panel)
    assert [path.name for path in (tmp_path / "mine").glob("*.npz")] == ["swing.npz"]
    send(panel, "discard")
    assert (panel.state["recording"], panel.state["waiting"]) == (False, False)


def test_a_recording_can_be_stopped_before_it_is_named(panel, tmp_path):
    send(panel, "record")
    send(panel, "step")
    send(panel, "set cloth", cloth="damp0.07-mass0.15")
    assert "cannot change during a recording" in says(panel)
    assert panel.state["cloth"]["name"] == panel.session.env.cloth.name != "damp0.07-mass0.15"
    send(panel, "stop")
    assert panel.state["waiting"]
    send(panel, "step")
    send(panel, "save", name="one-step")
    assert len(load_trial(tmp_path / "mine" / "one-step.npz")) == 1


def test_a_fault_in_an_action_is_kept_and_raised(panel, monkeypatch):
    def broken(_):
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(panel.session, "set_p", broken)
    send(panel, "set p", at=[0, 0])
    assert "fault" in says(panel)
    assert panel.state["message"]["kind"] == "fault"
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        panel.check()
    panel.errors.clear()
    send(panel, "step")


def test_a_fault_in_a_step_pauses_and_the_panel_lives_on(panel, monkeypatch):
    def broken(**_):
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(panel.session, "step", broken)
    run(panel, 0.5)
    assert not panel.running
    assert (len(panel.errors), panel.state["message"]["kind"]) == (1, "fault")
    panel.errors.clear()
    monkeypatch.undo()
    send(panel, "step")


def test_a_sign_says_how_it_goes(panel, monkeypatch):
    def broken(**_):
        raise SimulationError("the physics diverged")

    assert panel.state["status"] == "paused"
    signs = []
    panel.observe(lambda change: signs.append(change["new"]["status"]), "state")
    run(panel, 0.5)
    assert "running" in signs
    send(panel, "pause")
    assert panel.state["status"] == "paused"
    monkeypatch.setattr(panel.session, "step", broken)
    run(panel, 0.3)
    assert (panel.state["status"], panel.state["running"], panel.errors) == ("fault", False, [])
    assert "diverged" in says(panel)
    monkeypatch.undo()
    send(panel, "set driver", driver="random")
    assert panel.state["status"] == "fault"  # time still stands
    send(panel, "reset")
    assert panel.state["status"] == "paused"


@pytest.mark.slow
def test_who_is_too_slow_is_late(panel, monkeypatch):
    step, signs = panel.session.step, []

    def slow(**how):
        time.sleep(0.35)
        return step(**how)

    monkeypatch.setattr(panel.session, "step", slow)
    panel.observe(lambda change: signs.append(change["new"]["status"]), "state")
    run(panel, 1.2)
    assert "late" in signs
    assert "fault" not in signs


def test_a_fault_stays_on_the_sign_until_the_next_action(panel):
    panel._messages.say("✗ a fault", "fault")
    panel._refresh()
    assert panel.state["status"] == "fault"
    send(panel, "step")
    assert panel.state["status"] == "paused"


def test_missing_weights_are_a_message(panel, monkeypatch):
    def missing(*_):
        raise KeyError("unknown dpmpb weights 'muscle-0'; choose from (none yet: run `make data train`)")

    monkeypatch.setattr("clothlab.artifacts.load", missing)
    send(panel, "set arm", name="muscle")
    assert "make data train" in says(panel)
    send(panel, "step")
    assert panel.session.arm.name == panel.state["arm"] == "torque"


def test_the_table_is_set_beside_the_session_until_the_panel_closes(panel, new_session, monkeypatch):
    def play(how, seed, watch, progress):
        progress("fetch cloth")
        while True:
            watch(lambda: np.zeros((6, 8, 3), np.uint8))

    def robots():
        return [thread for thread in threading.enumerate() if thread.name == "setting the table"]

    async def main():
        panel.observe(lambda change: send(panel, "table drawn", frame=change["new"]["number"]), "table")
        send(panel, "table drawn", frame=panel.table["number"])
        send(panel, "set the table", method="lay it slowly")
        while panel.table["phases"][0][1] != "running":
            await asyncio.sleep(0.01)
        send(panel, "set the table", method="lay it slowly")
        assert "already: stop it first" in says(panel)
        assert not panel.running  # the live session has a time of its own
        send(panel, "stop the task")
        while panel.table["running"]:
            await asyncio.sleep(0.01)
        assert panel.table["phases"][0][1] == "stopped"
        send(panel, "set the table", method="lay it slowly")
        assert len(robots()) == 1
        other = LivePanel(new_session())  # as running the cell again
        assert not robots()
        other.close()

    monkeypatch.setattr(table, "play", play)
    asyncio.run(main())


def test_a_page_without_a_kernel_gets_a_picture_of_the_last_frame(panel):
    data, metadata = panel._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in data
    assert cv2.imdecode(np.frombuffer(base64.b64decode(data["image/png"]), np.uint8), 1) is not None
    target = panel.session.target
    words = metadata["image/png"]
    assert words["alt"].endswith("the scene, 0.0 s, step 0; what the camera sees; the target")
    assert f"White in {100 * target.mean():.0f} % of it" in words["details"][2]
    send(panel, "step")
    assert panel._repr_mimebundle_()[1]["image/png"]["details"][0].startswith("Panel 1, the scene, 0.2 s, step 1.")
