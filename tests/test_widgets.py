"""The panel without a browser: what its controls do to the session, and what it says when something is wrong."""

import asyncio
import time
from datetime import UTC, datetime
from threading import get_ident

import cv2
import numpy as np
import pytest
from ipywidgets.widgets.widget_controller import Axis, Button

from clothlab.session import LiveSession
from clothlab.trials import load_trial
from clothlab.widgets import LivePanel, TargetCanvas


@pytest.fixture
def panel(tmp_path):
    panel = LivePanel(LiveSession(recordings=tmp_path / "mine", picture_size=(96, 128)))
    yield panel
    panel.check()
    panel.close()


def draw_every_frame(panel) -> None:
    """What a fast browser does."""
    panel.view.acknowledged = panel.view.frame
    panel.view.observe(lambda change: panel.view._handle_custom_msg({"drawn": change["new"]}, []), "frame")


def run(panel, seconds: float, answer=True) -> None:
    """Let the panel run, with a browser that draws each frame at once, or with none."""

    async def main():
        panel.start()
        if answer:
            draw_every_frame(panel)
        await asyncio.sleep(seconds)

    asyncio.run(main())


def test_time_goes_by_until_it_is_paused(panel):
    async def main():
        panel.start()
        panel.start()  # twice is once
        await asyncio.sleep(1.2)
        panel.pause()
        steps = panel.steps
        await asyncio.sleep(0.5)
        assert panel.steps == steps
        return steps

    assert 3 <= asyncio.run(main()) <= 7
    assert not panel.running


def test_a_browser_that_does_not_draw_gets_no_more_frames(panel):
    first = panel.view.frame
    run(panel, 1.2, answer=False)
    assert panel.steps >= 3
    assert panel.view.frame <= first + 1


def test_a_page_that_is_gone_stops_the_clock(panel, monkeypatch):
    monkeypatch.setattr("clothlab.widgets.PATIENCE", 3)

    async def main():
        panel.start()
        await asyncio.sleep(1.6)
        return panel.running

    assert not asyncio.run(main())
    assert "does not answer" in panel.message.value


def test_a_second_panel_closes_the_first(panel):
    other = LivePanel(LiveSession(picture_size=(96, 128)))
    assert not panel.running
    assert LivePanel._active is other
    assert panel.map.comm is panel.view.comm is panel.hands.children[0].comm is None
    other.close()


def test_a_busy_kernel_is_not_a_closed_page(panel, monkeypatch):
    monkeypatch.setattr("clothlab.widgets.PATIENCE", 3)

    async def main():
        panel.start()
        draw_every_frame(panel)
        await asyncio.sleep(0.3)
        time.sleep(1.5)  # a cell that computes: no step, and no answer is heard
        await asyncio.sleep(0.5)
        return panel.running

    assert asyncio.run(main())


def test_controls_act_between_steps_whatever_thread_calls_them(monkeypatch):
    threads = []

    async def main():
        panel = LivePanel(LiveSession(picture_size=(96, 128)))
        change = panel.session.set_material
        monkeypatch.setattr(panel.session, "set_material", lambda *a: threads.append(get_ident()) or change(*a))
        panel.start()
        for damping in (0.03, 0.04, 0.06):
            await asyncio.to_thread(setattr, panel.damping, "value", damping)
            await asyncio.sleep(0.3)
            assert panel.session.env.cloth.damping == pytest.approx(damping)
        panel.check()
        panel.close()

    asyncio.run(main())
    assert threads == [get_ident()] * 3


def test_single_steps_and_reset(panel):
    panel.buttons["step"].click()
    panel.buttons["step"].click()
    assert panel.session.step_number == 2
    assert len(panel.view.traces[0]["lines"][0]["values"]) == 2
    panel.buttons["reset"].click()
    assert panel.session.step_number == 0


def test_a_click_on_the_map_sets_p(panel):
    before = panel.session.p
    panel.map.chosen = [0.1, -0.05]
    assert not np.allclose(panel.session.p, before)
    assert panel._axes.transform(panel.session.p[None])[0] == pytest.approx([0.1, -0.05], abs=1e-6)


def test_a_drawing_becomes_the_target_and_shows_what_the_network_believes(panel, square):
    shown = panel.understood.value
    panel.canvas.drawn = square.astype(np.uint8).tobytes()
    assert np.array_equal(panel.session.target, square)
    assert panel.understood.value != shown
    checkers = np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0
    panel.canvas.drawn = checkers.astype(np.uint8).tobytes()
    assert "It knows no such cloth" in panel.verdict.value
    panel.canvas._handle_custom_msg({"picked": "target-1"}, [])
    assert np.array_equal(panel.session.target, panel.session.gallery["target-1"])
    assert "It knows such cloths" in panel.verdict.value


def test_a_target_that_was_drawn_over_is_shown_again(panel):
    sent = []
    panel.canvas.observe(lambda change: sent.append(change["new"]), "shown")
    for _ in range(2):
        panel.canvas._handle_custom_msg({"picked": "target-1"}, [])
    assert [bool(content) for content in sent] == [False, True, False, True]


def test_an_empty_drawing_says_so_and_keeps_the_target(panel):
    target = panel.session.target
    panel.canvas.drawn = bytes(96 * 128)
    assert "no cloth in the image" in panel.message.value
    assert np.array_equal(panel.session.target, target)
    panel.buttons["step"].click()


def test_a_file_that_is_no_picture_says_so(panel):
    when = {"last_modified": datetime.now(UTC)}
    panel.upload.set_trait("value", ({"content": memoryview(b"text"), "name": "a", "type": "", "size": 4} | when,))
    assert "not a picture" in panel.message.value
    _, small = cv2.imencode(".png", np.full((10, 10), 255, np.uint8))
    file = {"content": memoryview(small.tobytes()), "name": "b", "type": "", "size": 9}
    panel.upload.set_trait("value", (file | when,))
    assert "128×96 pixels, this picture 10×10" in panel.message.value
    assert panel.upload.value == ()


def test_material_sliders_and_the_gallery_follow_each_other(panel):
    panel.damping.value = 0.03
    assert panel.session.env.cloth.damping == pytest.approx(0.03)
    panel.cloth.value = "damp0.07-mass0.15"
    assert (panel.damping.value, panel.mass.value) == pytest.approx((0.07, 0.15))
    assert panel.map.held == "damp0.07-mass0.15"


def test_a_moved_slider_takes_over(panel):
    assert panel.driver.value == "control"
    panel.hands.children[0].value = 0.2
    assert panel.session.driver == panel.driver.value == "hand"
    panel.buttons["step"].click()
    assert panel._history[-1].command[0] == pytest.approx(0.2)


def test_the_browser_may_round_a_slider(panel):
    slider = panel.hands.children[0]
    panel._say("a message")
    slider.value += 0.4 * slider.step
    assert panel.session.driver == "control"
    assert panel.message.value == "a message"
    slider.value += slider.step
    assert panel.session.driver == "hand"


def move_gamepad(panel, axes, trigger) -> None:
    """What the browser does when a gamepad moves."""
    for name, numbers, kind in (("axes", axes, Axis), ("buttons", [0.0] * 7 + trigger, Button)):
        widgets = [kind() for _ in numbers]
        for widget, number in zip(widgets, numbers, strict=True):
            widget.set_trait("value", number)
        panel.gamepad.set_trait(name, tuple(widgets))
    panel.gamepad.set_trait("connected", True)


def test_a_gamepad_takes_over_when_it_moves(panel):
    panel.arm.value = "muscle"
    move_gamepad(panel, [0.0, 0.0, 0.0, 0.0], [0.0])
    panel.buttons["step"].click()
    move_gamepad(panel, [0.0, 0.01, 0.0, 0.0], [0.0])
    panel.buttons["step"].click()
    assert panel.session.driver == "control"  # a stick that trembles does not take over
    move_gamepad(panel, [0.0, 1.0, 0.0, -1.0], [0.5])
    panel.buttons["step"].click()
    arm = panel.session.arm
    assert panel.session.driver == "hand"
    assert panel._history[-1].command == pytest.approx([arm.upper[0], arm.lower[1], 40.0])
    assert panel.hands.children[2].value == pytest.approx(40.0)


def test_a_gamepad_without_sticks_is_no_hand(panel):
    move_gamepad(panel, [0.0], [])
    assert "needs two sticks" in panel.message.value
    panel.buttons["step"].click()
    assert panel.session.driver == "control"


def test_stiffness_is_the_muscle_arms(panel):
    assert panel.tension.disabled
    panel.arm.value = "muscle"
    assert not panel.tension.disabled
    panel.fixed.value = True
    panel.tension.value = 50.0
    panel.buttons["step"].click()
    assert panel._history[-1].command[2] == 50.0
    assert len(panel.ellipse.value) > 1000


def test_another_arm_moves_the_controls_and_not_the_session(panel, monkeypatch):
    panel.arm.value = "muscle"
    panel.fixed.value = True
    called = []
    for name in ("set_tension", "set_cloth", "set_material", "set_driver"):
        monkeypatch.setattr(panel.session, name, lambda *_, name=name: called.append(name))
    monkeypatch.setattr(panel.session, "set_arm", lambda name: None)
    panel._set_arm("torque")
    assert called == []
    assert not panel.fixed.value


def test_recordings_are_saved_once_under_a_good_name(panel, tmp_path):
    panel.record.value = True
    run(panel, 0.7)
    panel.name.value = "../escape"
    panel._guarded(panel._save)()
    assert "letters, digits" in panel.message.value
    panel.name.value = "swing"
    panel._guarded(panel._save)()
    assert "saved as swing.npz" in panel.message.value
    panel.record.value = True
    panel.buttons["step"].click()
    panel._guarded(panel._save)()
    assert "exists" in panel.message.value
    assert [path.name for path in (tmp_path / "mine").glob("*.npz")] == ["swing.npz"]


def test_a_recording_can_be_stopped_before_it_is_named(panel, tmp_path):
    panel.record.value = True
    panel.buttons["step"].click()
    panel.cloth.value = "damp0.07-mass0.15"
    assert "cannot change during a recording" in panel.message.value
    assert panel.cloth.value == panel.session.env.cloth.name != "damp0.07-mass0.15"
    panel.record.value = False
    assert not panel.session.recording
    panel.buttons["step"].click()
    panel.name.value = "one-step"
    panel._guarded(panel._save)()
    assert len(load_trial(tmp_path / "mine" / "one-step.npz")) == 1


def test_a_fault_in_a_callback_is_kept_and_raised(panel):
    def broken(_):
        raise ZeroDivisionError("on purpose")

    panel._guarded(broken)(None)
    assert "fault" in panel.message.value
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on purpose"):
        panel.check()
    panel.errors.clear()


def test_missing_weights_are_a_message(panel, monkeypatch):
    def missing(*_):
        raise KeyError("unknown dpmpb weights 'muscle-0'; choose from (none yet: run `make data train`)")

    monkeypatch.setattr("clothlab.artifacts.load_dpmpb", missing)
    panel.arm.value = "muscle"
    assert "make data train" in panel.message.value
    panel.buttons["step"].click()
    assert panel.session.arm.name == panel.arm.value == "torque"


def test_nothing_drawn_yet_is_an_empty_mask():
    assert not TargetCanvas().mask.any()
