"""Who drives a live run, and what the controllers say about their commands."""

import numpy as np
import pytest

from clothlab.lab.drivers import DRIVERS, Choice, Drivers, PredictionLog, stick_command
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import recorded_plans
from clothlab.learning.dpmpb import DPMPB, Sequences
from clothlab.learning.trained import Trained
from clothlab.simulation.arm import MuscleArm, TorqueArm


@pytest.fixture
def drivers(trial, square):
    arm, autoencoder = TorqueArm(), Autoencoder().eval()
    trained = Trained("own", arm, autoencoder, DPMPB(7, 2).eval(), {}, np.zeros(1), "own")
    rng = np.random.default_rng(0)
    commands = rng.uniform(arm.command_lower, arm.command_upper, (40, 2))
    about = {"plans": recorded_plans([trial]), "runs": [Sequences(rng.normal(size=(40, 7)), commands, "own")]}
    return Drivers(trained, arm, square, np.zeros(2), arm.home_command, **about)


def drive(drivers, env, driver, steps, **how):
    choices = []
    for _ in range(steps):
        choices.append(drivers.choose(driver, env.observe(), **({"solve": True, "exploring": True} | how)))
        env.advance(choices[-1].command)
    return choices


@pytest.mark.parametrize("driver", DRIVERS)
def test_only_controllers_promise_and_have_periods(drivers, env, driver):
    choices = drive(drivers, env, driver, 9)
    controls = driver in ("control", "iterative")
    assert all((each.predicted is not None) == controls for each in choices)
    assert [k for k, each in enumerate(choices) if each.period_ended] == ([7] if controls else [])
    solved = {"control": list(range(9)), "iterative": [0, 8]}.get(driver, [])
    assert [k for k, each in enumerate(choices) if each.solved] == solved


def test_what_was_learned_outlasts_the_turn_of_another_and_goes_with_a_reset(drivers, env):
    drive(drivers, env, "iterative", 11)
    drivers.resume()
    assert not drive(drivers, env, "manual", 3)[0].solved
    assert drive(drivers, env, "iterative", 8, solve=False)[0].solved  # a period begins, and there is no plan for it
    assert len(drivers._iterative.attempts) == 1
    drivers.reset(0)
    assert drivers._iterative.attempts == []


def test_who_does_not_practise_repeats(drivers, env):
    drive(drivers, env, "iterative", 8)
    again = drive(drivers, env, "iterative", 8, exploring=False)
    assert np.array([each.command for each in again]) == pytest.approx(
        drivers._iterative.attempts[0].u.numpy(), abs=1e-6
    )


def test_sticks_and_trigger_span_the_range():
    for arm in (TorqueArm(), MuscleArm()):
        count = len(arm.command_names)
        assert stick_command(arm, [0, -1, 0]) == pytest.approx(arm.command_lower)
        assert stick_command(arm, [1, 2, 1]) == pytest.approx(arm.command_upper)
        assert stick_command(arm, [0.5] * 3) == pytest.approx((arm.command_lower + arm.command_upper) / 2)
        assert len(stick_command(arm, [0.5] * 3)) == count


def account_for(account, driver, promises, distances, length=3):
    choices = (Choice(np.zeros(2), True, promise, k % length == length - 1) for k, promise in enumerate(promises))
    pairs = zip(choices, distances, strict=True)
    return [account.add(driver, choice, distance) for choice, distance in pairs]


def test_an_outcome_stands_beside_what_its_period_had_promised_at_its_beginning():
    promises, distances = [0.5, 0.6, 0.7, 0.1, 0.2, 0.3], [2.0, 1.0, 3.0, 4.0, 6.0, 5.0]
    assert account_for(PredictionLog(), "control", promises, distances) == [
        None,
        None,
        (0.5, 3.0),
        None,
        None,
        (0.1, 5.0),
    ]
    assert account_for(PredictionLog(), "iterative", promises, distances) == [
        None,
        None,
        (0.5, 1.0),
        None,
        None,
        (0.1, 4.0),
    ]


def test_a_promise_about_another_target_is_not_held_against_anybody():
    account = PredictionLog()
    account.add("control", Choice(np.zeros(2), True, 0.5, False), 1.0)
    account.interrupt()
    assert account_for(account, "control", [0.4, 0.3], [1.0, 1.0], length=2) == [None, None]
    assert account_for(account, "control", [0.4, 0.3], [1.0, 2.0], length=2) == [None, (0.4, 2.0)]


def test_who_promises_nothing_has_no_account():
    assert account_for(PredictionLog(), "random", [None] * 3, [1.0] * 3) == [None] * 3
    assert account_for(PredictionLog(), "iterative", [None] * 3, [1.0] * 3) == [None] * 3
