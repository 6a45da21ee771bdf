"""The live session behind the panel: what can be changed while it runs, and what it refuses."""

import cv2
import numpy as np
import pytest

from clothlab import artifacts
from clothlab.cloth import get_cloth
from clothlab.dpmpb import ModelTraining, to_sequences, train_dpmpb
from clothlab.session import DRIVERS, LiveSession, mask_from_file
from clothlab.trials import load_trial


@pytest.fixture
def session(tmp_path):
    session = LiveSession(recordings=tmp_path / "mine")
    yield session
    session.close()


def test_a_step_shows_what_it_saw_and_did(session):
    moment = session.step()
    assert moment.step == 1
    assert moment.solved
    assert moment.image.shape == moment.reconstruction.shape == (96, 128)
    assert moment.command.shape == moment.theta.shape == moment.p.shape == (2,)
    assert moment.distance > 0
    assert moment.seconds > 0
    assert session.picture().shape == (288, 384, 3)


def test_a_late_step_goes_on_with_the_last_plan(session):
    assert session.step(solve=False).solved  # there is no plan yet
    assert not session.step(solve=False).solved


@pytest.mark.parametrize("driver", DRIVERS)
def test_everyone_can_drive(session, driver):
    session.set_driver(driver)
    commands = [session.step().command for _ in range(3)]
    if driver == "hand":
        assert np.array_equal(commands[0], session.hand)


def test_the_hand_sends_what_it_is_told(session):
    session.set_driver("hand")
    session.set_hand(np.array([0.1, -0.9]))
    assert session.step().command == pytest.approx([0.1, -0.9])
    with pytest.raises(ValueError, match="outside the torque arm's range"):
        session.set_hand(np.array([5.0, 0.0]))
    assert session.step().command == pytest.approx([0.1, -0.9])


def test_p_moves_only_while_it_is_estimated(session):
    session.set_p(np.array([0.3, -0.2]))
    session.set_driver("random")
    for _ in range(14):
        assert session.step().p == pytest.approx([0.3, -0.2])
    session.estimating = True
    moved = [session.step().p for _ in range(14)][-1]
    assert not np.allclose(moved, [0.3, -0.2])
    with pytest.raises(ValueError, match="finite"):
        session.set_p(np.array([np.nan, 0.0]))
    assert session.p == pytest.approx(moved)


def test_a_cloth_image_is_understood_better_than_an_impossible_one(session):
    _, cloth = session.set_target(artifacts.load_target("target-1"))
    checkers = np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0
    reconstruction, impossible = session.set_target(checkers)
    assert impossible > cloth
    assert reconstruction.shape == (96, 128)
    assert np.array_equal(session.target, checkers)
    with pytest.raises(ValueError, match="no cloth in the image"):
        session.set_target(np.zeros((96, 128)))
    assert np.array_equal(session.target, checkers)
    session.step()


def test_another_arm_brings_its_own_weights_cloth_and_target(session):
    before = session.gallery
    session.set_arm("muscle")
    assert session.step().command.shape == (3,)
    assert set(before) & set(session.gallery) >= {"target-1", "target-2", "muscle", "recorded 1"}
    assert not np.array_equal(before["recorded 1"], session.gallery["recorded 1"])
    assert session.env.cloth.name in session.biases
    with pytest.raises(KeyError, match="unknown arm 'octopus'; choose from torque, muscle"):
        session.set_arm("octopus")
    session.step()


def test_a_fixed_stiffness_is_sent_by_control_and_at_random(session):
    with pytest.raises(ValueError, match="torque arm has no stiffness"):
        session.set_tension(30.0)
    session.set_arm("muscle")
    session.set_tension(55.0)
    for driver in ("control", "random", "operator"):
        session.set_driver(driver)
        assert session.step().command[2] == 55.0
    with pytest.raises(ValueError, match="outside the muscle arm's range"):
        session.set_tension(5.0)
    assert session.step().command[2] == 55.0
    session.set_tension(None)
    session.step()


def test_another_cloth_starts_from_rest_and_keeps_p(session):
    session.set_p(np.array([0.1, 0.2]))
    session.step()
    session.set_cloth(get_cloth("damp0.03-mass0.15"))
    assert session.step().step == 1
    assert session.p == pytest.approx([0.1, 0.2])


def test_a_recording_becomes_a_trial(session):
    session.record()
    commands = [session.step().command for _ in range(12)]
    path = session.save_recording("my-swing_1")
    trial = load_trial(path)
    assert trial.commands == pytest.approx(np.array(commands))
    assert trial.cloth == session.env.cloth
    assert trial.policy == "control"
    assert not session.recording
    session.record()  # nothing is left of the first


def test_recordings_are_found_by_name(tmp_path):
    session = LiveSession(recordings=tmp_path / artifacts.OWN_TRIALS)
    session.record()
    session.step()
    session.save_recording("one")
    session.close()
    assert len(artifacts.load_trials("mine", data=tmp_path)) == 1
    assert artifacts.load_trials("mine", data=tmp_path / "nothing recorded") == []
    assert artifacts.check_data(tmp_path) == {}


def test_a_recording_survives_a_kernel_that_dies(session, tmp_path):
    session.record()
    for _ in range(13):
        session.step()
    after = LiveSession(recordings=tmp_path / "mine")  # the first one never came to its end
    with pytest.raises(FileExistsError, match="unfinished recording"):
        after.record()
    trial = load_trial(after.save_recording("saved"))
    assert len(trial) == 10  # all but what the last second had not written yet
    after.close()


def test_training_can_include_a_recording(session, tmp_path):
    session.set_material(0.04, 0.12)
    session.record()
    for _ in range(12):
        session.step()
    trials = [artifacts.load_trials("train")[0], load_trial(session.save_recording("mine"))]
    runs = [to_sequences(session.autoencoder, trial) for trial in trials]
    _, biases, _ = train_dpmpb(runs, ModelTraining(epochs=1, sequence_length=5), progress=False)
    assert list(biases) == [trials[0].cloth.name, "damp0.040-mass0.120"]


@pytest.mark.parametrize("name", ["", "../escape", "a/b", "a b", ".hidden"])
def test_bad_names_lose_nothing(session, name, tmp_path):
    session.record()
    session.step()
    with pytest.raises(ValueError, match="letters, digits"):
        session.save_recording(name)
    assert session.recording
    session.step()
    assert len(load_trial(session.save_recording("good"))) == 2
    assert list(tmp_path.rglob("*.npz")) == [tmp_path / "mine" / "good.npz"]


def test_nothing_is_overwritten(session):
    for _ in range(2):
        session.record()
        session.step()
        if not session.recorder.folder.joinpath("twice.npz").exists():
            before = session.save_recording("twice").read_bytes()
    with pytest.raises(ValueError, match="exists: choose another name"):
        session.save_recording("twice")
    assert session.recorder.folder.joinpath("twice.npz").read_bytes() == before
    session.discard_recording()
    with pytest.raises(ValueError, match="nothing was recorded"):
        session.save_recording("empty")


@pytest.mark.parametrize("change", ["set_arm", "set_cloth", "reset"])
def test_a_recording_is_of_one_run(session, change):
    session.record()
    arguments = {"set_arm": ("muscle",), "set_cloth": ("damp0.03-mass0.05",), "reset": ()}[change]
    with pytest.raises(ValueError, match="cannot change during a recording"):
        getattr(session, change)(*arguments)
    session.step()


def test_targets_come_from_picture_files(square):
    _, png = cv2.imencode(".png", square.astype(np.uint8) * 255)
    assert np.array_equal(mask_from_file(png.tobytes()), square)
    _, small = cv2.imencode(".png", np.full((10, 10), 255, np.uint8))
    for content, message in ((b"no picture", "not a picture"), (b"", "not a picture"), (small.tobytes(), "10×10")):
        with pytest.raises(ValueError, match=message):
            mask_from_file(content)
