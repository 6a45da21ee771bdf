"""Who drives a live run, and what the controllers say about their commands."""

import numpy as np
import pytest

from clothlab.lab.drivers import DRIVERS, Choice, Drivers
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.data import Run
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import TorqueArm
from clothlab.trials import recorded_plans
from clothlab.weights import ClothCheckpoint


@pytest.fixture
def drivers(trial, square):
    arm, autoencoder = TorqueArm(), Autoencoder().eval()
    trained = ClothCheckpoint(
        name="own",
        arm=arm,
        autoencoder=autoencoder,
        model=DPMPB(7, 2).eval(),
        biases={},
    )
    rng = np.random.default_rng(0)
    commands = rng.uniform(arm.command_lower, arm.command_upper, (40, 2))
    runs = [Run(rng.normal(size=(40, 7)), commands, "own")]
    return Drivers(
        trained, arm, square, np.zeros(2), plans=recorded_plans([trial]), runs=runs
    )


def drive(drivers, env, driver, steps, **options):
    choices, options = (
        [],
        {"hand": np.array([9.0, -0.5]), "solve": True, "exploring": True} | options,
    )
    for _ in range(steps):
        choices.append(drivers.choose(driver, env.observe(), **options))
        env.advance(choices[-1].command)
    return choices


def learned(drivers):
    policy = drivers._controllers["iterative"]
    return policy.controller.attempts


@pytest.mark.parametrize("driver", DRIVERS)
def test_only_controllers_predict_and_have_periods(drivers, env, driver):
    choices = drive(drivers, env, driver, 9)
    controls = driver in ("control", "iterative")
    assert all((each.predicted is not None) == controls for each in choices)
    assert [k for k, each in enumerate(choices) if each.period_ended] == (
        [7] if controls else []
    )
    solved = {"control": list(range(9)), "iterative": [0, 8]}.get(driver, [])
    assert [k for k, each in enumerate(choices) if each.solved] == solved


def test_a_manual_command_is_kept_in_the_range(drivers, env):
    assert drive(drivers, env, "manual", 1)[0].command == pytest.approx(
        [TorqueArm().command_upper[0], -0.5]
    )


@pytest.mark.slow
def test_what_was_learned_outlasts_the_turn_of_another_and_goes_with_a_reset(
    drivers, env
):
    drive(drivers, env, "iterative", 11)
    drivers.resume()
    assert not drive(drivers, env, "manual", 3)[0].solved
    assert drive(drivers, env, "iterative", 8, solve=False)[
        0
    ].solved  # a period begins, and there is no plan for it
    assert len(learned(drivers)) == 1
    drivers.reset(0)
    assert learned(drivers) == []


def periods(drivers, predictions, distances):
    choices = [
        Choice(np.zeros(2), True, each, k % 3 == 2)
        for k, each in enumerate(predictions)
    ]
    return [
        drivers.close_period(*pair) for pair in zip(choices, distances, strict=True)
    ]


def test_what_was_achieved_stands_beside_what_was_predicted_at_the_beginning(
    drivers, square
):
    predictions, distances = (
        [0.5, 0.6, 0.7, 0.1, 0.2, 0.3],
        [2.0, 1.0, 3.0, 4.0, 6.0, 5.0],
    )
    found = periods(drivers, predictions, distances)
    assert found == [None, None, (0.5, 3.0), None, None, (0.1, 5.0)]
    assert periods(drivers, [None] * 3, [1.0] * 3) == [None] * 3
    drivers.close_period(Choice(np.zeros(2), True, 0.5, False), 1.0)
    drivers.set_target(square)  # the prediction was about another target
    found = periods(drivers, [None, None, None, 0.4, 0.4, 0.4], [1.0] * 6)
    assert found[2:] == [None] * 3 + [(0.4, 1.0)]
