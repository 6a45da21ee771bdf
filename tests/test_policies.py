"""Policies that need no model: that they repeat, stay in range, and pass on what they
are given.
"""

import numpy as np
import pytest

from clothlab.policies import OperatorPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import ARMS, get_arm
from clothlab.trials import rollout

POLICIES = {"random": RandomPolicy, "operator": OperatorPolicy}


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("arm", ARMS)
def test_policies_stay_in_range_and_repeat_with_their_seed(policy, arm):
    arm = get_arm(arm)
    chosen, runs = POLICIES[policy](arm), []
    for seed in (3, 3, 4):
        chosen.reset(seed)
        runs.append(np.array([chosen({}) for _ in range(300)]))
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    assert (runs[0] >= arm.command_lower).all()
    assert (runs[0] <= arm.command_upper).all()
    assert runs[0].std(axis=0).min() > 0.1


def test_random_commands_are_held_for_one_to_so_many_steps():
    policy = RandomPolicy("torque", longest_hold=3)
    commands = np.array([policy({}) for _ in range(600)])
    changes = np.flatnonzero((np.diff(commands, axis=0) != 0).any(axis=1))
    assert set(np.diff(changes)) == {1, 2, 3}
    with pytest.raises(ValueError, match=r"longest_hold"):
        RandomPolicy("torque", longest_hold=0)


def test_the_operator_lifts_slowly_and_throws_down_fast():
    policy = OperatorPolicy("torque")
    speed = np.diff([policy({})[0] for _ in range(400)])  # positive is downwards
    assert speed[speed > 1e-6].mean() > 1.5 * -speed[speed < -1e-6].mean()


def test_what_cannot_be_called_with_an_observation_is_no_policy(env):
    with pytest.raises(
        TypeError,
        match=r"a policy is called with an observation and returns a command, got",
    ):
        rollout(env, RandomPolicy, 1)


@pytest.mark.slow
def test_recorded_commands_are_sent_again_and_no_more(env, trial):
    policy = ReplayPolicy(trial.commands)
    for _ in range(2):
        assert np.array_equal(rollout(env, policy, 12).robot, trial.robot)
    with pytest.raises(ValueError, match=r"only 12 commands were recorded"):
        rollout(env, policy, 13)
