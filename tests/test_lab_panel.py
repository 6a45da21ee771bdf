"""The panel without a browser: what its actions do to the session, and what it says
when something is wrong.
"""

import asyncio
import base64
import json
import time
from threading import get_ident

import cv2
import numpy as np
import pytest

from clothlab.lab import LivePanel, panel as panel_module
from clothlab.lab.panel import KNOWN_ERRORS, stick_command
from clothlab.simulation.arm import MuscleArm, TorqueArm
from clothlab.simulation.env import SimulationError
from clothlab.trials import load_trial

pytestmark = pytest.mark.slow  # each panel starts a session


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


def draw_every_frame(panel):
    """What a fast browser does."""
    send(panel, "drawn", frame=panel.frame["number"])
    panel.observe(
        lambda change: send(panel, "drawn", frame=change["new"]["number"]), "frame"
    )


async def until(condition, seconds=20):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


def run_steps(panel, steps, draws=True):
    """Let the panel make steps, with a browser that draws each frame at once, or with
    none.
    """

    async def main():
        panel.start()
        if draws:
            draw_every_frame(panel)
        await until(lambda: panel.steps >= steps or not panel.running)

    asyncio.run(main())


def broken(error):
    def call(*_, **__):
        raise error

    return call


def test_time_goes_by_until_it_is_paused(panel):
    async def main():
        send(panel, "start")
        send(panel, "start")  # twice is once
        assert panel.state["running"]
        await until(lambda: panel.steps >= 3)
        send(panel, "pause")
        steps = panel.steps
        await asyncio.sleep(0.3)
        assert (panel.state["running"], panel.steps) == (False, steps)

    asyncio.run(main())
    assert not panel.running


def test_a_browser_that_does_not_draw_gets_no_more_frames_and_stops_the_clock(
    panel, monkeypatch
):
    monkeypatch.setattr(panel_module, "_PATIENCE", 3)
    first = panel.frame["number"]
    run_steps(panel, 100, draws=False)
    assert (panel.steps, panel.running, panel.state["running"]) == (4, False, False)
    assert panel.frame["number"] <= first + 1
    assert "does not answer" in says(panel)


def test_a_second_panel_closes_the_first(panel, new_session):
    other = LivePanel(new_session())
    assert not panel.running
    assert LivePanel._active is other
    assert panel.comm is None
    other.close()
    other.close()  # twice is once


def test_actions_wait_for_the_end_of_a_step_whatever_thread_brings_them(
    new_session, monkeypatch
):
    threads = []

    async def main():
        panel = LivePanel(new_session())
        monkeypatch.setattr(
            panel.session, "set_p", lambda p: threads.append(get_ident())
        )
        panel.start()
        await asyncio.to_thread(send, panel, "set p", at=[0, 0])
        await until(lambda: threads)
        panel.check()
        panel.close()

    asyncio.run(main())
    assert threads == [get_ident()]


def test_single_steps_and_reset(panel):
    send(panel, "step")
    send(panel, "step")
    assert panel.session.step_number == 2
    assert panel.frame["clock"] == "0.4 s, step 2"
    assert len(panel.frame["traces"][0]["lines"][0]["values"]) == 2
    send(panel, "reset")
    assert panel.session.step_number == 0
    assert panel.frame["traces"][0]["lines"][0]["values"] == []


def test_after_a_reset_the_camera_shows_the_cloth_that_hangs(panel):
    def seen():
        return cv2.imdecode(
            np.frombuffer(panel.frame["seen"], np.uint8), cv2.IMREAD_COLOR
        )

    # Before the first step: white where the cloth is
    hanging = seen()
    white = (hanging == 255).all(axis=2)
    assert white.any()
    assert panel.session.observation["image"][white].all()
    send(panel, "set driver", driver="random")
    for _ in range(3):
        send(panel, "step")
    assert not np.array_equal(seen(), hanging)
    send(panel, "reset")
    assert np.array_equal(seen(), hanging)
    decoded = cv2.imdecode(
        np.frombuffer(panel.frame["decoded"], np.uint8), cv2.IMREAD_GRAYSCALE
    )
    assert (decoded > 127).any()


def test_every_action_is_answered_even_when_it_is_refused(panel):
    send(panel, "set material", damping=0.05, mass=1e-4)
    assert panel.state["answered"] == "id-set material"
    assert "Cloth.mass must be at least" in says(panel)
    assert panel.state["message"]["kind"] == "mistake"
    assert panel.state["cloth"]["material"] == (0.05, 0.1)
    send(panel, "step")
    assert (says(panel), panel.state["answered"]) == ("", "id-step")


def test_a_click_on_the_map_sets_p(panel):
    send(panel, "set p", at=[0.1, -0.05])
    assert panel.frame["at"] == pytest.approx([0.1, -0.05], abs=1e-6)


def test_a_drawing_becomes_the_target_and_shows_its_reconstruction(panel, square):
    before = panel.target
    send(panel, "draw", memoryview(square.astype(np.uint8).tobytes()))
    assert np.array_equal(panel.session.target, square)
    assert panel.target["reconstruction"] != before["reconstruction"]
    # It stands on the canvas already
    assert panel.target["version"] == before["version"]
    send(panel, "draw", bytes(96 * 128))
    assert "no cloth in the image" in says(panel)
    assert np.array_equal(panel.session.target, square)


def test_an_image_becomes_the_target_and_is_shown_even_if_it_was_before(panel):
    versions = []
    for _ in range(2):
        send(panel, "pick", name="target-1")
        versions.append(panel.target["version"])
    assert versions[1] == versions[0] + 1
    assert np.array_equal(panel.session.target, panel.session.gallery["target-1"])
    send(panel, "step")
    send(panel, "take")
    assert np.array_equal(panel.session.target, panel.session.observation["image"])
    send(panel, "clear")
    assert "draw a target" in says(panel)


def test_a_file_becomes_the_target_or_says_why_not(panel, square):
    _, png = cv2.imencode(".png", square.astype(np.uint8) * 255)
    send(panel, "upload", memoryview(png.tobytes()))
    assert np.array_equal(panel.session.target, square)
    send(panel, "upload", memoryview(b"text"))
    assert "not a picture" in says(panel)


def test_a_moved_slider_takes_over(panel):
    send(panel, "set hand", u=[0.2, -0.4])
    assert panel.session.driver == panel.state["driver"] == "manual"
    send(panel, "step")
    assert panel.history[-1].command[0] == pytest.approx(0.2)
    send(panel, "set driver", driver="control")
    send(panel, "set hand", u=[5.0, 0.0])
    assert "outside the torque arm's range" in says(panel)
    assert panel.session.driver == "control"


def test_sticks_and_trigger_span_the_range():
    for arm in (TorqueArm(), MuscleArm()):
        assert stick_command(arm, [0, -1, 0]) == pytest.approx(arm.command_lower)
        assert stick_command(arm, [1, 2, 1]) == pytest.approx(arm.command_upper)
        assert stick_command(arm, [0.5] * 3) == pytest.approx(
            (arm.command_lower + arm.command_upper) / 2
        )


def test_another_arm_brings_its_controls_its_sticks_and_its_stiffness(panel):
    assert (panel.about["tension"], panel.ellipse) == (None, b"")
    send(panel, "set arm", name="muscle")
    assert len(panel.state["hand"]) == len(panel.about["hands"]) == 3
    json.dumps({key: value for key, value in panel.about.items() if key != "gallery"})
    send(panel, "greet gamepad", enough=True)
    assert "left stick: shoulder, right stick: elbow, right trigger: stiffness" in says(
        panel
    )
    send(panel, "greet gamepad", enough=False)
    assert "needs two sticks" in says(panel)
    send(panel, "move sticks", places=[1.0, 0.0, 0.5])
    send(panel, "step")
    arm = panel.session.arm
    assert panel.session.driver == "manual"
    assert panel.history[-1].command == pytest.approx(
        [arm.upper[0], arm.lower[1], 40.0]
    )
    send(panel, "set tension", f_const=50.0)
    assert (panel.state["fixed"], panel.state["tension"]) == (True, [50.0])
    send(panel, "step")
    assert panel.history[-1].command[2] == 50.0
    assert len(panel.ellipse) > 1000
    send(panel, "set tension", f_const=None)
    assert not panel.state["fixed"]


def test_recordings_are_saved_once_under_a_good_name(panel, tmp_path):
    send(panel, "record")
    send(panel, "step")
    send(panel, "save", name="../escape")
    assert "letters, digits" in says(panel)
    assert panel.state["recording"]
    send(panel, "save", name="swing")
    assert "saved as swing.npz" in says(panel)
    send(panel, "record")
    send(panel, "step")
    send(panel, "set cloth", cloth="damp0.07-mass0.15")
    assert "cannot change during a recording" in says(panel)
    send(panel, "stop")
    assert panel.state["waiting"]
    send(panel, "step")
    send(panel, "save", name="swing")
    assert "exists" in says(panel)
    send(panel, "save", name="one-step")
    assert len(load_trial(tmp_path / "mine" / "one-step.npz")) == 1
    send(panel, "record")
    send(panel, "discard")
    assert (panel.state["recording"], panel.state["waiting"]) == (False, False)


@pytest.mark.parametrize("kind", KNOWN_ERRORS)
def test_a_mistake_is_a_message_without_quotes(panel, monkeypatch, kind):
    error = kind("unknown arm 'octopus'")
    monkeypatch.setattr(panel.session, "set_p", broken(error))
    send(panel, "set p", at=[0, 0])
    message = {"text": "⚠ unknown arm 'octopus'", "kind": "mistake"}
    assert panel.state["message"] == message
    assert panel.errors == []


def test_a_fault_in_an_action_is_kept_and_raised(panel, monkeypatch):
    monkeypatch.setattr(panel.session, "set_p", broken(ZeroDivisionError("on purpose")))
    send(panel, "set p", at=[0, 0])
    assert panel.state["message"] == {
        "text": "✗ a fault in the panel: ZeroDivisionError: on purpose",
        "kind": "fault",
    }
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        panel.check()
    panel.errors.clear()


@pytest.mark.parametrize(
    ("error", "faults"),
    [(ZeroDivisionError("oh"), 1), (SimulationError("diverged"), 0)],
)
def test_a_step_that_fails_pauses_and_says_why(panel, monkeypatch, error, faults):
    signs = []
    panel.observe(lambda change: signs.append(change["new"]["status"]), "state")
    run_steps(panel, 2)
    assert "running" in signs
    send(panel, "pause")
    assert panel.state["status"] == "paused"
    monkeypatch.setattr(panel.session, "step", broken(error))
    run_steps(panel, 100)
    assert (panel.state["status"], panel.state["running"]) == ("paused", False)
    assert len(panel.errors) == faults
    assert str(error) in says(panel)
    panel.errors.clear()


def test_a_panel_that_is_too_slow_is_late(panel, monkeypatch):
    step, signs = panel.session.step, []
    monkeypatch.setattr(
        panel.session, "step", lambda **options: time.sleep(0.35) or step(**options)
    )
    panel.observe(lambda change: signs.append(change["new"]["status"]), "state")
    run_steps(panel, 3)
    assert "late" in signs


def test_a_page_without_a_kernel_gets_a_picture_of_the_last_frame(panel):
    send(panel, "step")
    data, metadata = panel._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in data
    assert (
        cv2.imdecode(np.frombuffer(base64.b64decode(data["image/png"]), np.uint8), 1)
        is not None
    )
    words = metadata["image/png"]
    assert words["alt"] == (
        "Pictures; the scene, 0.2 s, step 1, what the camera sees, the target"
    )
