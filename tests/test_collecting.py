"""Runs of episodes that end, of one robot and of several side by side."""

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import ClipAction, RescaleAction, TimeLimit

from clothlab.method.collecting import collect_runs
from clothlab.method.rollout import EpisodeEnded, rollout


class Walker(gymnasium.Env):
    """A place that a command moves, and a count of steps since the reset.

    It falls where the place passes 3. Each reset begins at a place of its seed, below.
    """

    action_space = Box(-1, 1, (1,), np.float64)
    observation_space = Box(-np.inf, np.inf, (2,), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at = (options or {}).get("at", self.np_random.uniform(-1, 0))
        self.count = 0
        return self.see(), {}

    def step(self, u):
        self.at += 0.1 * u[0]
        self.count += 1
        return self.see(), 0.0, bool(self.at > 3), False, {}

    def see(self):
        return np.array([self.at, self.count])


class Lively:
    """Random commands, which drift to the right."""

    def reset(self, seed):
        self.rng = np.random.default_rng(seed)

    def __call__(self, s):
        return self.rng.uniform(0, 1, 1)


def limited(steps=40):
    return TimeLimit(Walker(), steps)


def several(mode, count=3, steps=40, make=SyncVectorEnv):
    return make([lambda: limited(steps)] * count, autoreset_mode=mode)


def assert_whole(run):
    """One episode from its reset on: counted from 0, and each state follows."""
    assert np.array_equal(run.s[:, 1], np.arange(len(run)))
    assert np.diff(run.s[:, 0]) == pytest.approx(0.1 * run.u[:-1, 0], abs=1e-5)


def test_each_episode_is_a_run_with_its_own_seed():
    runs = collect_runs(limited(), Lively(), 120, material="heavy", progress=False)
    assert [len(run) for run in runs] == [40, 40, 40]
    for seed, run in enumerate(runs):
        assert_whole(run)
        alone = rollout(Walker(), Lively(), 40, seed=seed, material="heavy")
        assert np.array_equal(run.s, alone.s)
        assert np.array_equal(run.u, alone.u)


@pytest.mark.parametrize("make", [SyncVectorEnv, AsyncVectorEnv])
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_no_reset_of_several_robots_leaks_into_a_run(mode, make):
    if make is AsyncVectorEnv and mode is not AutoresetMode.SAME_STEP:
        pytest.skip("one mode in processes is enough")
    env = several(mode, make=make)
    runs = collect_runs(
        env, Lively(), 360, material=["a", "b", "c"], progress=False, step=0.1
    )
    env.close()
    # In one mode, a step in each episode is only its reset.
    assert [len(run) for run in runs] == [40] * 9
    assert [run.material for run in runs] == list("abc") * 3
    for run in runs:
        assert_whole(run)
        assert run.step == 0.1
    assert len({run.u[0, 0] for run in runs}) == 9, "each has commands of its own"


def test_robots_that_are_reset_here_begin_as_one_alone_with_that_seed():
    env = several(AutoresetMode.DISABLED)
    runs = collect_runs(env, Lively(), 240, material="a", progress=False, seed=5)
    for seed, run in enumerate(runs, 5):
        alone = rollout(Walker(), Lively(), 40, seed=seed, material="a")
        assert np.array_equal(run.s, alone.s)


def test_only_an_environment_that_is_reset_here_takes_options():
    env = several(AutoresetMode.DISABLED)
    more = {"material": "a", "progress": False, "options": {"at": -2.0}}
    runs = collect_runs(env, Lively(), 240, **more)
    assert {run.s[0, 0] for run in runs} == {-2.0}
    with pytest.raises(ValueError, match="resets its robots itself does so without"):
        collect_runs(several(AutoresetMode.NEXT_STEP), Lively(), 240, **more)


def test_an_environment_that_does_not_say_when_it_resets_is_refused():
    env = several(AutoresetMode.NEXT_STEP)
    env.metadata = {}
    with pytest.raises(ValueError, match="does not say when it resets one"):
        collect_runs(env, Lively(), 60, material="a")


def test_short_runs_are_left_out_with_a_count():
    message = (
        r"1 of 3 runs have fewer than 31 steps and are left out, 20 of 100 steps\. "
        r"They ended thus: 1 with the recording"
    )
    with pytest.warns(UserWarning, match=message) as told:
        runs = collect_runs(limited(), Lively(), 100, material="a", progress=False)
    assert [len(run) for run in runs] == [40, 40]
    assert told[0].filename == __file__


@pytest.mark.filterwarnings("ignore:command 0")  # is beyond the limits
@pytest.mark.parametrize(
    ("env", "push", "ended"),
    [
        (limited(20), 0.5, r"2 at a time limit \(truncated\); 1 with the"),
        (limited(200), 30.0, r"\d+ with the task \(terminated\)"),
    ],
)
def test_a_fall_is_told_from_a_time_limit(env, push, ended):
    with pytest.raises(ValueError, match=rf"none of \d+ runs has 31 .*: {ended}"):
        collect_runs(env, lambda s: [push], 60, material="a", progress=False)


@pytest.mark.filterwarnings("ignore:command 0")  # is beyond the limits
def test_a_rollout_tells_them_apart_too():
    with pytest.raises(
        EpisodeEnded, match=r"task was over after 2 of .*`collect_runs`"
    ):
        rollout(limited(), lambda s: [30.0], 50, material="a", seed=3)
    with pytest.raises(EpisodeEnded, match=r"time limit .* 40 of 50.*`collect_runs`"):
        rollout(limited(), lambda s: [0.0], 50, material="a")


@pytest.mark.parametrize(
    "wrap", [lambda env: RescaleAction(env, -10.0, 10.0), lambda env: ClipAction(env)]
)
def test_a_command_is_recorded_as_the_policy_sent_it(wrap):
    runs = collect_runs(
        wrap(limited()), lambda s: [-4.0], 40, material="a", progress=False
    )
    assert (runs[0].u == -4.0).all()


class Chooser(Walker):
    action_space = Discrete(2)


class InParts(Walker):
    action_space = Dict({"arm": Box(-1, 1, (1,)), "hand": Box(-1, 1, (1,))})


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Chooser, r"discrete actions, Discrete\(2\): the model needs commands that"),
        (InParts, r"actions of several parts, Dict\(.*one vector"),
    ],
)
def test_actions_that_are_no_vector_are_refused(kind, message):
    several_of_them = SyncVectorEnv([kind, kind])
    for collect in (
        lambda: collect_runs(kind(), Lively(), 40, material="a"),
        lambda: collect_runs(several_of_them, Lively(), 40, material="a"),
        lambda: rollout(kind(), Lively(), 40, material="a"),
    ):
        with pytest.raises(ValueError, match=message):
            collect()


def test_a_rollout_moves_one_robot():
    env = several(AutoresetMode.NEXT_STEP)
    with pytest.raises(ValueError, match="moves one robot: `collect_runs` takes"):
        rollout(env, Lively(), 40, material="a")


@pytest.mark.parametrize("material", [["a", "b"], [1, 2, 3], 7])
def test_each_robot_has_a_material(material):
    with pytest.raises(ValueError, match="material"):
        collect_runs(several(AutoresetMode.NEXT_STEP), Lively(), 40, material=material)


def test_observations_in_parts_are_seen_one_robot_at_a_time():
    class Seen(Walker):
        observation_space = Dict({"all": Walker.observation_space})

        def see(self):
            return {"all": super().see()}

    env = SyncVectorEnv([lambda: TimeLimit(Seen(), 40)] * 2)
    see = lambda observation: observation["all"]  # noqa: E731
    runs = collect_runs(env, Lively(), 80, material="a", observe=see, progress=False)
    assert len(runs) == 2
    for run in runs:
        assert_whole(run)


def test_a_command_of_another_size_is_refused_before_it_is_sent():
    env = gymnasium.make("Pendulum-v1")
    with pytest.raises(ValueError, match=r"the command of <lambda> is \[1\]"):
        collect_runs(env, lambda s: np.ones(2), 60, material="a", progress=False)
    with pytest.raises(ValueError, match=r"the command of <lambda> is \[1\]"):
        rollout(env, lambda s: np.ones(2), 60, material="a")


def test_a_command_beyond_the_limits_is_told_once():
    env = gymnasium.make("Pendulum-v1")
    with pytest.warns(match=r"command 0 .* is 9, beyond the limits") as told:
        (run,) = collect_runs(
            env, lambda s: np.array([9.0]), 60, material="a", progress=False
        )
    assert len(told) == 1
    assert (run.u == 9).all()
