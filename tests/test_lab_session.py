"""The live session behind the panel: what can be changed while it runs, and what it refuses."""

import numpy as np
import pytest

from clothlab import artifacts
from clothlab.experiments.motion import replay
from clothlab.lab import views
from clothlab.lab.drivers import DRIVERS
from clothlab.lab.session import SETUPS, LiveSession
from clothlab.learning.dpmpb import ModelTraining, to_sequences, train_dpmpb
from clothlab.policies import RandomPolicy
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import SimulationError
from clothlab.trials import load_trial, rollout


@pytest.fixture
def session(new_session):
    session = new_session()
    yield session
    session.recorder.close()


def test_a_step_shows_what_it_saw_and_did(session):
    moment = session.step()
    assert moment.step == 1
    assert moment.solved
    assert moment.image.shape == moment.reconstruction.shape == (96, 128)
    assert moment.command.shape == moment.theta.shape == moment.p.shape == (2,)
    assert moment.distance > 0
    assert moment.seconds > 0
    assert session.picture().shape == (96, 128, 3)


def test_a_late_step_goes_on_with_the_last_plan(session):
    assert session.step(solve=False).solved  # there is no plan yet
    assert not session.step(solve=False).solved


def test_only_arms_that_a_session_has_weights_for_can_be_chosen(session):
    assert views.fixtures(session, views.plane(session))["arms"] == list(SETUPS)
    with pytest.raises(KeyError, match="unknown arm 'muscle-hand'; choose from torque, muscle"):
        session.set_arm("muscle-hand")


@pytest.mark.parametrize("driver", DRIVERS)
def test_everyone_can_drive(session, driver):
    session.set_driver(driver)
    commands = [session.step().command for _ in range(3)]
    if driver == "manual":
        assert np.array_equal(commands[0], session.hand)


def practised(session):
    return len(session._drivers._iterative.attempts)


def drive(session, periods):
    return [session.step() for _ in range(8 * periods)]


def test_practice_learns_from_each_period_and_promises_the_next(session):
    session.set_driver("iterative")
    moments = drive(session, 3)
    assert practised(session) == 2  # the third is seen to its end in the next step
    assert [moment.step for moment in moments if moment.solved] == [1, 9, 17]
    assert [moment.step for moment in moments if moment.period_ended] == [8, 16, 24]
    for k in range(3):
        assert len({moment.predicted for moment in moments[8 * k : 8 * k + 8]}) == 1
    assert len({moment.predicted for moment in moments}) == 3


def test_control_promises_what_its_model_predicts(session):
    promises = [session.step().predicted for _ in range(8)]
    assert all(0 < promise < 10 for promise in promises)
    assert len(set(promises)) == 8
    session.set_driver("random")
    assert session.step().period is None
    assert session.step().predicted is None


def test_a_period_keeps_what_it_promised_at_its_beginning_beside_what_came_of_it(session):
    moments = drive(session, 2)
    assert [moment.step for moment in moments if moment.period] == [8, 16]
    assert moments[15].period == (moments[8].predicted, moments[15].distance)  # control aims at the last step
    session.set_driver("iterative")
    moments = drive(session, 1)
    assert moments[7].period == (moments[0].predicted, min(moment.distance for moment in moments))
    session.step()
    session.set_target(session.gallery["target-1"])
    assert [moment.period for moment in drive(session, 1)] == [None] * 8  # the promise was about another target
    session.reset()
    assert drive(session, 1)[7].period


def test_a_session_knows_what_was_sent_last(session):
    assert np.array_equal(session.command, session.arm.home_command)
    assert np.array_equal(session.step().command, session.command)
    session.reset()
    assert np.array_equal(session.command, session.arm.home_command)


def test_without_new_plans_the_best_known_one_is_repeated(session):
    session.set_driver("iterative")
    drive(session, 1)
    session.exploring = False
    first, second = ([moment.command for moment in drive(session, 1)] for _ in range(2))
    learned = session._drivers._iterative.attempts[0].u.numpy()
    assert np.array(first) == pytest.approx(learned, abs=1e-6)
    assert np.array_equal(first, second)
    session.exploring = True
    assert not np.allclose([moment.command for moment in drive(session, 1)], learned)


def test_what_was_learned_stays_with_another_target_p_or_driver_and_goes_with_a_reset(session):
    session.set_driver("iterative")
    drive(session, 1)
    session.step()
    session.set_target(session.gallery["target-1"])
    assert session.step().predicted is None  # the plan under way was for the target before
    session.set_p(np.array([0.1, 0.2]))
    session.set_driver("manual")
    session.step()
    session.set_driver("iterative")
    assert session.step().predicted is not None
    assert practised(session) == 1
    session.reset()
    assert practised(session) == 0
    session.step()


@pytest.mark.parametrize("change", ["set_arm", "set_cloth", "set_tension"])
def test_practice_begins_anew_with_another_arm_or_cloth(session, change):
    session.set_driver("iterative")
    drive(session, 1)
    session.step()
    assert practised(session) == 1
    if change == "set_tension":
        with pytest.raises(ValueError, match="no stiffness"):
            session.set_tension(30.0)
        assert practised(session) == 1
        session.set_tension(None)
    else:
        getattr(session, change)({"set_arm": "muscle", "set_cloth": "damp0.03-mass0.15"}[change])
    assert practised(session) == 0
    assert session.step().solved


def test_practice_uses_the_p_that_is_estimated(session):
    session.set_driver("iterative")
    session.set_p(np.array([0.3, -0.2]))
    session.estimating = True
    moments = drive(session, 2)
    assert not np.allclose(moments[-1].p, [0.3, -0.2])
    assert session._drivers._iterative.p == pytest.approx(moments[-1].p)
    assert practised(session) == 1


def test_a_late_period_repeats_the_plan(session):
    session.set_driver("iterative")
    first = [session.step().command for _ in range(8)]
    late = [session.step(solve=False) for _ in range(8)]
    assert not any(moment.solved for moment in late)
    assert np.array_equal(first, [moment.command for moment in late])
    assert session.step().solved
    assert practised(session) == 2


def test_the_hand_sends_what_it_is_told(session):
    session.set_driver("manual")
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
    moved = [session.step().p for _ in range(18)][-1]  # the warm-up of a cloth in motion, and some to judge
    assert not np.allclose(moved, [0.3, -0.2])
    with pytest.raises(ValueError, match="finite"):
        session.set_p(np.array([np.nan, 0.0]))
    assert session.p == pytest.approx(moved)


def test_a_cloth_image_is_understood_better_than_an_impossible_one(session):
    session.set_target(artifacts.load_target("target-1"))
    cloth = session.reconstruction_distance
    checkers = np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0
    session.set_target(checkers)
    assert session.reconstruction_distance > cloth
    assert session.reconstruction.shape == (96, 128)
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
    assert session.env.cloth.name in session.trained.biases
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
    path = session.recorder.save("my-swing_1")
    trial = load_trial(path)
    assert trial.commands == pytest.approx(np.array(commands))
    assert trial.cloth == session.env.cloth
    assert trial.policy == "control"
    assert not session.recording
    session.record()  # nothing is left of the first


def test_training_can_include_a_recording(session, tmp_path):
    session.set_material(0.04, 0.12)
    session.record()
    for _ in range(12):
        session.step()
    trials = [artifacts.load_trials("train")[0], load_trial(session.recorder.save("mine"))]
    runs = [to_sequences(session.trained.autoencoder, trial) for trial in trials]
    _, biases, _ = train_dpmpb(runs, ModelTraining(epochs=1, sequence_length=5), progress=False)
    assert list(biases) == [trials[0].cloth.name, "damp0.040-mass0.120"]


@pytest.mark.parametrize("change", ["set_arm", "set_cloth", "reset"])
def test_a_recording_is_of_one_run(session, change):
    session.record()
    arguments = {"set_arm": ("muscle",), "set_cloth": ("damp0.03-mass0.05",), "reset": ()}[change]
    with pytest.raises(ValueError, match="cannot change during a recording"):
        getattr(session, change)(*arguments)
    session.step()


LIGHTEST = views.MASS[0]


@pytest.mark.parametrize("damping", np.arange(*views.DAMPING[:2], 0.015))
def test_the_lightest_cloth_of_the_sliders_can_be_swung(session, damping):
    session.set_material(damping, LIGHTEST)
    rng, arm = np.random.default_rng(0), session.arm
    session.set_driver("manual")
    for _ in range(25):
        session.set_hand(np.where(rng.random(2) < 0.5, arm.command_lower, arm.command_upper))
        session.step()


def test_a_cloth_that_cannot_be_simulated_is_refused_and_the_one_before_goes_on(session):
    session.step()
    before, state = session.env.cloth, session.env.data.qpos.copy()
    with pytest.raises(SimulationError, match=r"too light or too stiff .* \(0.05, 0.10\) stays in the hand"):
        session.set_material(0.05, 2e-3)
    assert session.env.cloth == before
    assert np.array_equal(session.env.data.qpos, state)
    assert session.step().step == 2
    session.reset()
    session.step()


@pytest.mark.parametrize("values", [(-1, 0.1), (np.nan, 0.1), (0.05, 0.0), ("much", 0.1), (None, None)])
def test_values_that_no_cloth_has_change_nothing(session, values):
    before = session.env.cloth
    with pytest.raises(ValueError, match="Cloth"):
        session.set_material(*values)
    assert session.env.cloth == before
    session.step()


def test_a_material_of_the_menu_is_recognised(session):
    session.set_material(np.float32(0.03).round(2), 0.15)
    session.set_material(0.03, 0.15)
    assert session.env.cloth == get_cloth("damp0.03-mass0.15")
    session.set_material(0.055, 0.1)
    assert session.env.cloth.label == "(0.055, 0.100)"


@pytest.mark.parametrize("p", [[1e39] * 2, [np.nan, 0], [0.1] * 3, [], "p", None])
def test_a_p_that_the_model_cannot_use_changes_nothing(session, p):
    session.set_p([0.1, 0.2])
    with pytest.raises(ValueError, match="p is"):
        session.set_p(p)
    assert session.p == pytest.approx([0.1, 0.2])
    session.estimating = True
    for _ in range(14):
        assert np.isfinite(session.step().p).all()


@pytest.mark.parametrize("f_const", [5.0, np.nan, "much"])
def test_a_stiffness_out_of_range_changes_nothing(session, f_const):
    session.set_arm("muscle")
    session.set_tension(40.0)
    with pytest.raises(ValueError, match=r"f_const|outside"):
        session.set_tension(f_const)
    assert session.tension == 40.0
    assert session.step().command[2] == 40.0


def test_a_fixed_stiffness_holds_for_the_hand_too(session):
    session.set_arm("muscle")
    session.set_driver("manual")
    session.set_tension(55.0)
    session.set_hand([0.1, -0.5, 20.0])
    assert session.step().command == pytest.approx([0.1, -0.5, 55.0])


def test_an_arm_that_cannot_be_loaded_changes_nothing(session, monkeypatch):
    before = {name: id(value) for name, value in vars(session).items()}
    monkeypatch.setattr("clothlab.artifacts.load_targets", lambda: {})
    with pytest.raises(KeyError, match="unknown target 'muscle'"):
        session.set_arm("muscle")
    assert {name: id(value) for name, value in vars(session).items()} == before
    session.step()


def test_unknown_names_list_the_choices(session):
    for call, message in (
        (lambda: session.set_driver("nobody"), "unknown driver 'nobody'; choose from control, iterative, manual"),
        (lambda: session.set_driver(["manual"]), "unknown driver"),
        (lambda: session.set_cloth("felt"), "unknown cloth 'felt'; choose from"),
        (lambda: LiveSession("octopus"), "unknown arm 'octopus'; choose from torque, muscle"),
    ):
        with pytest.raises(KeyError, match=message):
            call()
    assert session.driver == "control"


def test_an_interrupted_step_has_not_happened(session, monkeypatch):
    session.set_driver("random")
    session.record()
    session.step()

    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(session.env, "observe", interrupted)
    with pytest.raises(KeyboardInterrupt):
        session.step()
    monkeypatch.undo()
    assert session.step().step == 2
    trial = load_trial(session.recorder.save("interrupted"))
    assert len(trial) == 2
    replay(trial)


def test_a_recording_of_random_commands_is_the_trial_of_its_seed(session):
    for _ in range(3):
        session.step()
    session.set_driver("random")
    session.record()
    for _ in range(7):
        session.step()
    trial = load_trial(session.recorder.save("random"))
    again = rollout(session.env, RandomPolicy(session.arm), 7, seed=trial.seed)
    assert trial.seed != 0
    assert np.array_equal(trial.commands, again.commands)
    assert np.array_equal(trial.images, again.images)


@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_every_recording_can_be_replayed(session, arm):
    session.set_arm(arm)
    for _ in range(3):
        session.step()  # a recording that began here, in the middle of a swing, could not
    session.record()
    for driver in ("control", "manual", "control", "operator"):
        session.set_driver(driver)
        for _ in range(3):
            session.step()
    trial = load_trial(session.recorder.save("swing"))
    assert (len(trial), trial.policy, trial.seed) == (12, "control, manual, operator", session.seed)
    assert len(replay(trial).time) == 12 * 50
