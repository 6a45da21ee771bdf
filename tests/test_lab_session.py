"""The live session behind the panel: what can be changed while it runs, and what it
refuses.
"""

import numpy as np
import pytest

from clothlab import data
from clothlab.lab.drivers import DRIVERS
from clothlab.lab.session import LiveSession
from clothlab.lab.views import MATERIAL
from clothlab.method.cloth_task import observe
from clothlab.method.estimation import NewtonEstimator, NewtonSettings
from clothlab.policies import RandomPolicy
from clothlab.simulation.cloth import get_cloth
from clothlab.trials import load_trial, rollout
from studies.motion import replay

pytestmark = pytest.mark.slow  # each session starts a scene

CHECKERS = np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0


@pytest.fixture
def session(new_session):
    session = new_session()
    yield session
    session.recorder.discard()


@pytest.fixture(scope="module")
def muscle(tmp_path_factory):
    session = LiveSession(
        "muscle", recordings=tmp_path_factory.mktemp("mine"), picture_size=(96, 128)
    )
    yield session
    session.close()


def drive(session, periods):
    return [session.step() for _ in range(8 * periods)]


def learned(session):
    policy = session._drivers._controllers["iterative"]
    return policy.controller.attempts


@pytest.mark.parametrize("driver", DRIVERS)
def test_every_driver_drives(session, driver):
    assert np.array_equal(session.command, session.arm.home_command)
    session.set_driver(driver)
    moments = [session.step() for _ in range(3)]
    assert [moment.step for moment in moments] == [1, 2, 3]
    assert np.array_equal(moments[-1].command, session.command)
    assert all(
        moment.command.shape == moment.theta.shape == moment.p.shape == (2,)
        for moment in moments
    )
    if driver == "manual":
        assert np.array_equal(moments[0].command, session.hand)


def test_a_late_step_goes_on_with_the_last_plan(session):
    assert session.step(solve=False).solved  # there is no plan yet
    assert not session.step(solve=False).solved
    session.set_driver("iterative")
    first, late = drive(session, 1), [session.step(solve=False) for _ in range(8)]
    assert not any(moment.solved for moment in late)
    assert np.array_equal(
        [moment.command for moment in first], [moment.command for moment in late]
    )
    assert session.step().solved
    assert len(learned(session)) == 2


def test_iterative_learning_learns_from_each_period_and_predicts_the_next(session):
    session.set_driver("iterative")
    moments = drive(session, 3)
    assert len(learned(session)) == 2  # the third is seen to its end in the next step
    # The first plan is sent twice
    assert [moment.step for moment in moments if moment.solved] == [1, 17]
    assert [moment.step for moment in moments if moment.period_ended] == [8, 16, 24]
    assert [
        len({moment.predicted for moment in moments[8 * k : 8 * k + 8]})
        for k in range(3)
    ] == [1, 1, 1]


def test_without_new_plans_the_best_known_one_is_repeated(session):
    session.set_driver("iterative")
    drive(session, 1)
    session.exploring = False
    first, second = ([moment.command for moment in drive(session, 1)] for _ in range(2))
    assert np.array(first) == pytest.approx(learned(session)[0].u.numpy(), abs=1e-6)
    assert np.array_equal(first, second)
    session.exploring = True
    assert not np.allclose([moment.command for moment in drive(session, 1)], first)


def test_the_manual_command_is_sent_and_stays_in_range(session):
    session.set_driver("manual")
    session.set_hand(np.array([0.1, -0.9]))
    assert session.step().command == pytest.approx([0.1, -0.9])


def test_p_moves_only_while_it_is_estimated(session):
    session.set_p(np.array([0.3, -0.2]))
    session.set_driver("random")
    for _ in range(14):
        assert session.step().p == pytest.approx([0.3, -0.2])
    session.estimating = True
    # The warm-up of a cloth in motion, and some to judge
    moved = [session.step().p for _ in range(18)][-1]
    assert not np.allclose(moved, [0.3, -0.2])
    assert session.p == pytest.approx(moved)


def follow(session, steps):
    """The covariances of an estimate that begins now."""
    session.estimating = True
    covariances = []
    for _ in range(steps):
        session.step()
        covariances.append(session.covariance)
    return covariances


def test_it_estimates_as_the_package_does(session):
    session.set_driver("random")
    before = session.observation
    start = NewtonSettings(from_rest=True)
    estimator = NewtonEstimator(session.trained.model, session.p, start)
    assert session.covariance is None
    covariances = []
    session.estimating = True
    for _ in range(60):
        moment = session.step()
        s = observe(session.trained.autoencoder, before)
        assert np.array_equal(moment.p, estimator.update(s, moment.command))
        covariances.append(session.covariance)
        before = session.observation
    assert np.array_equal(covariances[-1], estimator.linearisation().covariance())
    first = next(k for k, each in enumerate(covariances) if each is not None)
    assert first < 10


def test_an_estimate_of_a_recorded_run_grows_surer(session):
    run = session.trained.to_run(
        next(
            t
            for t in data.load_trials("evaluation")
            if t.policy == "random" and t.cloth.name == "damp0.07-mass0.10"
        )
    )
    estimator = NewtonEstimator(session.trained.model)
    variances = []
    for s, u in zip(run.s[:60], run.u[:60], strict=True):
        estimator.update(s, u)
        seen = estimator.linearisation()
        variances.append(None if seen is None else np.trace(seen.covariance()))
    first = next(each for each in variances if each is not None)
    assert variances[-1] < first


def test_only_an_estimate_that_begins_at_rest_has_no_warm_up(session):
    session.set_driver("random")
    assert follow(session, 10)[-1] is not None
    session.estimating = False
    session.step()
    assert session.covariance is None
    assert follow(session, 10)[-1] is None


def test_a_cloth_unlike_the_trained_ones_is_called_unfamiliar(session):
    session.set_driver("random")
    session.estimating = True
    for material, unfamiliar in (((0.05, 0.10), False), ((0.015, 0.15), True)):
        session.set_material(*material)
        session.set_p(session.trained.biases["damp0.05-mass0.10"])
        session.reset(seed=1)
        found = []
        for _ in range(100):
            session.step()
            found.append(session.unfamiliar)
        assert not any(found[:49])
        assert found[-1] == unfamiliar
    session.estimating = False
    session.step()
    assert not session.unfamiliar


def test_another_arm_brings_its_own_weights_cloth_and_target(session):
    before = session.gallery
    session.set_arm("muscle")
    assert session.step().command.shape == (3,)
    assert set(before) & set(session.gallery) >= {
        "target-1",
        "target-2",
        "muscle",
        "recorded 1",
    }
    assert not np.array_equal(before["recorded 1"], session.gallery["recorded 1"])
    assert session.env.cloth.name in session.trained.biases


def test_a_fixed_stiffness_is_sent_by_every_driver(session, muscle):
    with pytest.raises(ValueError, match="torque arm has no stiffness"):
        session.set_tension(30.0)
    muscle.set_tension(55.0)
    muscle.set_hand([0.1, -0.5, 20.0])
    for driver in DRIVERS:
        muscle.set_driver(driver)
        assert muscle.step().command[2] == 55.0
    muscle.set_tension(None)
    assert learned(muscle) == []  # another arm


def test_a_fixed_stiffness_leaves_the_aim_of_the_control_as_it_is(session, monkeypatch):
    monkeypatch.setattr("secrets.randbits", lambda count: 7)
    session.set_target(CHECKERS)
    assert not np.array_equal(session.aim.known, CHECKERS)
    predicted = []
    for aim_again in (True, False):
        session.reset()
        session.set_tension(None)
        if aim_again:
            session.set_target(CHECKERS)
        predicted.append(session.step().predicted)
    assert predicted[0] == predicted[1]


def test_another_cloth_starts_from_rest_and_keeps_p(session):
    session.set_p(np.array([0.1, 0.2]))
    session.step()
    session.set_cloth(get_cloth("damp0.03-mass0.15"))
    assert session.step().step == 1
    assert session.p == pytest.approx([0.1, 0.2])


@pytest.mark.parametrize("damping", [0.01, 0.10])
def test_the_lightest_cloth_of_the_sliders_can_be_swung(session, damping):
    session.set_material(damping, MATERIAL["C_mass [kg]"][0])
    rng, arm = np.random.default_rng(0), session.arm
    session.set_driver("manual")
    for _ in range(25):
        session.set_hand(
            np.where(rng.random(2) < 0.5, arm.command_lower, arm.command_upper)
        )
        session.step()


def test_a_material_of_the_menu_is_recognised(session):
    session.set_material(0.03, 0.15)
    assert session.env.cloth == get_cloth("damp0.03-mass0.15")
    session.set_material(0.055, 0.1)
    assert session.env.cloth.label == "(0.055, 0.10)"


@pytest.mark.parametrize(
    ("change", "arguments"),
    [("set_arm", ["muscle"]), ("set_cloth", ["soft-1"]), ("reset", [])],
)
def test_a_recording_is_of_one_run(session, change, arguments):
    session.record()
    with pytest.raises(ValueError, match="cannot change during a recording"):
        getattr(session, change)(*arguments)
    session.step()


def test_a_recording_of_random_commands_is_the_trial_of_its_seed(session):
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
def test_every_recording_can_be_replayed(session, muscle, arm):
    session = muscle if arm == "muscle" else session
    for _ in range(3):
        # A recording that began here, in the middle of a swing, could not
        session.step()
    session.record()
    for driver in ("control", "manual", "control", "operator"):
        session.set_driver(driver)
        for _ in range(3):
            session.step()
    trial = load_trial(session.recorder.save("swing"))
    assert (len(trial), trial.policy, trial.seed) == (
        12,
        "control, manual, operator",
        session.seed,
    )
    assert trial.cloth == session.env.cloth
    assert len(replay(trial).time) == 12 * 50
