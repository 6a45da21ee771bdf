"""Iterative learning control where the model alone is wrong: what was learned decides.

Seen from outside: a policy is called with observations, and its commands are looked at.
"""

from dataclasses import replace

import numpy as np
import pytest
import toy

from clothlab.method.data import Run
from clothlab.method.iterative import IterativeLearningSettings

LEARNED = toy.learned()
P = np.zeros(2)
LONG_AGO = [LEARNED.to_run(toy.random_trial("torque", "damp0.05-mass0.10", 80, 0))]
SETTINGS = IterativeLearningSettings(trust=0, lookahead=1)


def outcomes(policy, offset, periods):
    """Commands `[P, 8, 2]` and z `[P, 8, 3]` where z is off the model by `offset`."""
    z = np.zeros(3)
    commands, seen = [], []
    policy.reset()
    for _ in range(8 * periods):
        observation = {"image": toy.image_of(z), "robot": np.zeros(4)}
        commands.append(policy(observation))
        z = np.append(commands[-1], 0.0) + offset
        seen.append(z)
    return np.reshape(commands, (periods, 8, 2)), np.reshape(seen, (periods, 8, 3))


def test_what_the_model_gets_wrong_is_learned_from_outcomes():
    """The model likes a plan that ends 0.6 away; only a learned mean leads on."""
    offset = np.array([0.4, -0.4, 0.2])
    aim = np.array([0.2, -0.8, 0.0]) + offset
    target = toy.image_of(aim)
    policy = LEARNED.iterative_controller(target, P, LONG_AGO, SETTINGS)
    _, seen = outcomes(policy, offset, periods=10)
    nearest = np.linalg.norm(seen - aim, axis=2).min(axis=1)
    assert nearest[0] > 0.2
    assert nearest[-3:].max() < 0.06
    assert policy.predicted_distance == pytest.approx(nearest[-1], abs=0.1)


def constant(command):
    """A recorded run that sends one command all the time."""
    commands = np.tile(np.asarray(command, float), (17, 1))
    states = np.pad(commands, ((0, 0), (0, 5)))
    return Run(states, commands, "toy")


AIM = np.array([-0.3, -1.2, 0.0])
BEST, SECOND = AIM[:2], np.add(AIM[:2], (0.1, 0.0))  # by prediction


@pytest.mark.parametrize(
    ("aim", "sent"),
    [(1.0, BEST), (1e-3, SECOND)],
    ids=["outcomes are good", "outcomes are poor"],
)
def test_a_plan_that_was_tried_is_kept_while_there_is_something_to_lose(aim, sent):
    """The best prediction ends 0.3 away. An untried plan promises 0.1, with a variance
    that counts in full only where outcomes are as good as `aim`.
    """
    settings = replace(SETTINGS, aim=aim, iterations=0, starts=1, plan_scale=0.05)
    runs = [constant(BEST), constant(SECOND)]
    policy = LEARNED.iterative_controller(toy.image_of(AIM), P, runs, settings)
    commands, _ = outcomes(policy, [0.0, 0.3, 0.0], periods=2)
    assert commands[0] == pytest.approx(np.tile(BEST, (8, 1)), abs=1e-5)
    assert commands[1] == pytest.approx(np.tile(sent, (8, 1)), abs=1e-5)


def test_far_from_all_that_was_tried_the_doubt_is_that_of_the_prior():
    """One plan, no outcome: E‖z_ref - z‖² is the prior error in each number of z."""
    settings = replace(SETTINGS, iterations=0, prior_error=0.4, least_caution=0.5)
    runs = [constant(AIM[:2])]
    policy = LEARNED.iterative_controller(toy.image_of(AIM), P, runs, settings)
    policy({"image": toy.image_of(np.zeros(3)), "robot": np.zeros(4)})
    expected = (0.5 * 3 * 0.4**2) ** 0.5
    assert policy.predicted_distance == pytest.approx(expected, abs=2e-3)


def test_looking_ahead_a_plan_must_be_good_from_where_it_ends_too():
    """Of two plans one is at the aim from the first period on, one only in the second.

    Both have their best step in the mean of two periods as root mean square.
    """
    settings = replace(SETTINGS, iterations=0, prior_error=1e-6, lookahead=2)
    runs = [constant(np.add(BEST, (0.5, 0.0))), constant(SECOND)]
    policy = LEARNED.iterative_controller(toy.image_of(AIM), P, runs, settings)
    commands, _ = outcomes(policy, np.zeros(3), periods=1)
    assert commands[0, 0] == pytest.approx(SECOND, abs=1e-5)
    assert policy.predicted_distance == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize(
    ("known", "chosen"),
    [("damp0.05-mass0.15", "known"), ("damp0.03-mass0.10", "unknown")],
)
def test_a_material_that_is_not_known_counts_as_one_spread_away(known, chosen):
    """Of two recordings that are equally good: nearer than a spread, or farther."""
    biases = np.array([*LEARNED.biases.values()])
    gap = np.square(LEARNED.biases[known]).sum() / biases.var(axis=0).sum()
    assert (gap < 1) == (chosen == "known")
    assert gap < 2
    commands = {"known": np.add(BEST, (0.1, 0.0)), "unknown": np.add(BEST, (-0.1, 0.0))}
    runs = [
        replace(constant(commands["known"]), material=known),
        replace(constant(commands["unknown"]), material="never seen"),
    ]
    settings = IterativeLearningSettings(trust=1.0, difference=100.0, lookahead=1)
    policy = LEARNED.iterative_controller(toy.image_of(AIM), P, runs, settings)
    sent, _ = outcomes(policy, np.zeros(3), periods=2)
    assert sent[0, 0] == pytest.approx(commands[chosen], abs=1e-5)
    assert np.array_equal(sent[0], sent[1])  # twice, since the arm swings up at first
