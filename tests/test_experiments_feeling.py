"""The experiment on torques: with and without them all else is the same, and what is done is kept."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from clothlab import artifacts, experiments
from clothlab.experiments import feeling, practice
from clothlab.experiments._record import trained
from clothlab.experiments.feeling import BETWEEN, CHOSEN, Control, Estimate, Readout, Record, Settings, jobs, run
from clothlab.learning.dpmpb import DPMPB, ModelTraining, train_dpmpb
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS
from clothlab.training_configs import RECIPES

CLOTH = "damp0.03-mass0.05"
SMALL = Settings(
    models=(0,), cloths=(CLOTH, "between-light"), repeats=1, steps=14, targets=("target-2",), held=(CLOTH,),
    control_steps=16,
)  # fmt: skip
SENT = np.tile([[0.4, -0.4], [-0.3, -0.9]], (7, 1))


@pytest.fixture(scope="module")
def brief():
    """Weights of a robot that feels, after an epoch on a stretch of the paper's recordings."""
    eyes = trained("torque-0")
    learned = replace(eyes, name="torque-feeling-0", arm=get_arm("torque-feeling"))
    runs = [learned.sequences(trial[:40]) for trial in artifacts.load_trials("train")]
    model, biases, trace = train_dpmpb(runs, ModelTraining(epochs=2, sequence_length=20), progress=False)
    return replace(learned, model=model, biases=biases, losses=trace.losses)


@pytest.fixture(autouse=True)
def tiny(monkeypatch, brief):
    """That, and the first steps of a few recorded trials."""
    whole = artifacts.load_trials
    monkeypatch.setattr(
        artifacts, "load_trials", lambda name: [trial[:20] for trial in whole(name.removesuffix(artifacts.MORE))[::6]]
    )
    monkeypatch.setattr(feeling, "trained", lambda name: brief if name == "torque-feeling-0" else trained(name))
    practice._seen.cache_clear()
    yield
    practice._seen.cache_clear()


def test_a_record_has_all_pieces_for_both_robots_and_survives_the_round_trip(tmp_path, monkeypatch):
    record = run(SMALL, chosen=[SENT], folder=tmp_path)
    assert len(record.readouts) == 2
    assert len(record.estimates) == 2 * 2 * 3
    assert len(record.control) == 2 * 2
    for weights in SMALL.weights:
        assert record.r2(weights).shape == (1, 3)
        assert record.errors(weights).shape == (1, 2)
        assert record.nearest_rate(weights) in (0.0, 1.0)
        assert record.last(weights, "practice", "target-2").shape == (1,)
        assert {each.steps for each in record.select(weights, CHOSEN, between=True)} == {len(SENT)}
    experiments.save("feeling", record, data=tmp_path)
    read = experiments.load("feeling", data=tmp_path)
    assert read.settings == SMALL
    assert np.array_equal(read.estimates[1].error, record.estimates[1].error)
    monkeypatch.setitem(feeling._KINDS, "estimate", (lambda *job: pytest.fail("done again"), Estimate))
    assert np.array_equal(run(SMALL, chosen=[SENT], folder=tmp_path).control[0].best, record.control[0].best)
    with pytest.raises(pytest.fail.Exception, match="done again"):
        run(SMALL, chosen=[-SENT], folder=tmp_path)


def test_both_robots_are_moved_by_the_same_commands(monkeypatch):
    seen = []
    real = feeling.new_trial
    monkeypatch.setattr(feeling, "new_trial", lambda *how: seen.append(real(*how)) or seen[-1])
    for weights in SMALL.weights:
        feeling.estimate_one(SMALL, weights, 0, CLOTH, "random", 0)
    plain, felt = seen
    assert (plain.arm, felt.arm) == ("torque", "torque-feeling")
    assert np.array_equal(plain.commands, felt.commands)
    assert np.array_equal(plain.images, felt.images)
    assert np.array_equal(plain.robot, felt.robot[:, :4])


def test_a_cloth_between_was_never_trained_and_lies_within_the_trained_range():
    assert len(BETWEEN) == 5
    known = np.array([(cloth.damping, cloth.mass) for cloth in CLOTHS.values()])
    for cloth in BETWEEN.values():
        material = np.array([cloth.damping, cloth.mass])
        assert (material > known.min(0)).all()
        assert (material < known.max(0)).all()
        assert np.abs(np.log(known / material)).max(axis=1).min() > 0.1


def estimate(cloth, nearest, error, motion="random"):
    return Estimate("torque", 0, motion, 0, cloth, 14, nearest, None, np.array(error))


def test_what_is_sent_to_learn_from_tells_most(monkeypatch):
    known = SimpleNamespace(plans=[SimpleNamespace(commands=SENT * k) for k in range(3)], order=lambda _: [2, 0, 1])
    monkeypatch.setattr(feeling, "load", {"knowledge": known}.get)
    assert [sent.tolist() for sent in feeling.most_informative(2)] == [(SENT * 2).tolist(), (SENT * 0).tolist()]
    assert feeling.most_informative(0) == []


def test_rates_and_errors_are_of_the_cloths_that_they_are_about():
    estimates = (
        estimate("damp0.03-mass0.05", "damp0.03-mass0.05", [0.1, 0.1]),
        estimate("damp0.07-mass0.05", "damp0.03-mass0.05", [0.1, 0.1]),
        estimate("between-light", "damp0.03-mass0.05", [-0.3, 0.2]),
        estimate("between-light", "damp0.03-mass0.05", [9.0, 9.0], CHOSEN),
    )
    control = tuple(Control("torque", 0, "practice", "target-2", CLOTH, np.full(12, x)) for x in (1.0, 2.0))
    record = Record(replace(SMALL, weights=("torque",)), (Readout("torque", 0, np.ones(2), 0.5),), estimates, control)
    assert record.nearest_rate("torque") == 0.5
    assert record.errors("torque").tolist() == [[0.3, 0.2]]
    assert record.errors("torque", CHOSEN).tolist() == [[9.0, 9.0]]
    assert record.last("torque", "practice", "target-2") == pytest.approx([1.5])
    assert record.r2("torque").tolist() == [[1.0, 1.0, 0.5]]


def test_errors_are_paired_by_training_cloth_and_number_whatever_their_order():
    def estimate(weights, model, number, error):
        return Estimate(weights, model, CHOSEN, number, CLOTH, 14, CLOTH, 0.1, np.array([error, -error]))

    first = [estimate("torque", model, number, 0.1 * model + 0.01 * number) for model in (0, 1) for number in (0, 1)]
    second = [estimate("torque-feeling", *job) for job in ((1, 1, 0.11), (0, 0, 0.0), (1, 0, 0.1), (0, 1, 0.01))]
    record = Record(replace(SMALL, models=(0, 1)), (), (*first, *second), ())
    for weights in SMALL.weights:
        assert record.paired(weights, CHOSEN)[..., 1] == pytest.approx(np.array([[0.0, 0.01], [0.1, 0.11]]))


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        (SENT[:11], "chosen commands 0 are too short for an estimation: 11 steps"),
        (SENT[:, :1], r"chosen commands 0 is \[T, 2\] and finite"),
        (SENT * np.nan, "finite"),
    ],
)
def test_commands_that_nobody_can_send_are_refused_before_the_work_begins(commands, message):
    with pytest.raises(ValueError, match=message):
        jobs(SMALL, [commands])


def test_settings_that_name_nothing_are_refused():
    with pytest.raises(KeyError, match=r"unknown cloth 'silk'; choose from damp0.03"):
        Settings(cloths=("silk",))
    with pytest.raises(KeyError, match="unknown method 'magic'; choose from random"):
        Settings(methods=("magic",))


def test_weights_that_are_not_trained_yet_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(feeling, "trained", artifacts.load)
    with pytest.raises(KeyError, match="unknown dpmpb weights 'torque-tail-0'"):
        run(replace(SMALL, weights=("torque-tail",)), chosen=(), folder=tmp_path)


def test_the_torque_weighs_more_in_the_loss_than_the_angle_that_it_follows_from(brief):
    """What the arm's docstring says: an error of 1 rad in the angle, as standard deviations of angle and of torque."""
    stiffness = torch.tensor(brief.arm.servo_stiffness)
    angle, torque = brief.model.s_std[3:5], brief.model.s_std[7:9]
    louder = stiffness / torque * angle
    assert isinstance(brief.model, DPMPB)
    assert ((louder > 15) & (louder < 60)).all(), louder


def test_recipes_are_the_weights_that_are_compared():
    assert set(Settings().weights) <= set(RECIPES)
