"""Laws of the search: no plan worse than its best start, and a scene that is looked at
is not moved.
"""

import mujoco
import numpy as np
import pytest

from clothlab.method.autoencoder import Autoencoder
from clothlab.trials import rollout
from studies import oracle
from studies._runs import NEW
from studies.oracle import SearchSettings, SimulatorMPC, cross_entropy

LOWER, UPPER = np.array([-1.0, 0.0, 30.0]), np.array([1.0, 2.0, 30.0])
TINY = SearchSettings(starts=3, remembered=1, rounds=2, tries=2, elite=2)


def rugged(plans):
    return np.sin(7 * plans[..., :2]).sum(axis=(1, 2))


def from_half(plans):
    """Smallest where the first two commands are 0.5 at every step."""
    return np.square(plans[..., :2] - 0.5).sum(axis=(1, 2))


@pytest.fixture
def starts():
    return np.random.default_rng(1).uniform([-1, 0, 0], [1, 2, 60], (20, 4, 3))


@pytest.fixture
def policy(square):
    """Makes a search on a scene: periods of two steps, an autoencoder that has not
    learned anything.
    """
    made = []

    def make(env, settings=TINY, arm=None):
        rng = np.random.default_rng(2)
        plans = rng.uniform(
            env.arm.command_lower,
            env.arm.command_upper,
            (6, 2, len(env.arm.command_names)),
        )
        made.append(
            SimulatorMPC(
                env, Autoencoder().eval(), square, plans, settings, arm or env.arm
            )
        )
        return made[-1]

    yield make
    for each in made:
        each.close()


def state(env):
    """All that the next step depends on, and what was derived from it."""
    size = mujoco.mj_stateSize(env.model, mujoco.mjtState.mjSTATE_INTEGRATION)
    numbers = np.empty(size)
    mujoco.mj_getState(
        env.model, env.data, numbers, mujoco.mjtState.mjSTATE_INTEGRATION
    )
    parts = (env.data.qpos, env.data.qvel, env.data.act, env.data.xpos, [env.data.time])
    return np.concatenate([numbers, *(np.ravel(part) for part in parts)])


def test_a_search_is_never_worse_than_its_best_start(starts):
    settings = SearchSettings(rounds=3, tries=5, elite=4)
    rng = np.random.default_rng(0)
    plans, trace = cross_entropy(rugged, starts, LOWER, UPPER, settings, rng=rng)
    assert trace[0] == rugged(np.clip(starts, LOWER, UPPER)).min()
    assert trace.shape == (4,)
    assert (np.diff(trace) <= 0).all()
    assert trace[-1] == rugged(plans)[0]
    assert (np.diff(rugged(plans)) >= 0).all()
    assert plans.shape == (4, 4, 3)
    assert ((plans >= LOWER) & (plans <= UPPER)).all()


def test_a_search_finds_an_optimum_that_is_known(starts):
    plans, trace = cross_entropy(
        from_half,
        starts,
        LOWER,
        UPPER,
        SearchSettings(rounds=40),
        rng=np.random.default_rng(0),
    )
    assert np.abs(plans[0, :, :2] - 0.5).max() < 0.05
    assert trace[-1] < 0.01 < trace[0]


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["env", "muscle_env"])
def test_predicted_distances_are_achieved(arm, policy, square, request):
    env = request.getfixturevalue(arm)
    search = policy(env)
    env.start()
    for _ in range(3):
        plan = search.search()
        for u in plan:
            env.advance(u)
        # No command is sent: how far it is from here
        here = search.distances(np.empty((1, 0, len(u))))
        assert here == pytest.approx([search.trace[-1][-1]], abs=1e-5)
    # Not always the same distance, whose prediction would say nothing
    assert len({float(trace[-1]) for trace in search.trace}) > 1
    assert (np.diff(search.trace, axis=1) <= 0).all()


@pytest.mark.slow
def test_the_policy_sends_its_plans_whole_and_the_same_seed_sends_the_same(env, policy):
    search = policy(env)
    first = rollout(env, search, 5, seed=1)
    assert len(search.trace) == 3
    assert np.array_equal(rollout(env, search, 5, seed=1).commands, first.commands)
    assert not np.array_equal(rollout(env, search, 5, seed=2).commands, first.commands)
    assert first.policy == "simulator MPC"


@pytest.mark.parametrize("remembered", [0, 2])
def test_a_search_begins_with_what_the_last_one_found(
    env, policy, monkeypatch, remembered
):
    search, asked = (
        policy(env, SearchSettings(starts=3, remembered=remembered, rounds=0, elite=2)),
        [],
    )
    monkeypatch.setattr(
        search, "distances", lambda plans: (asked.append(plans), rugged(plans))[1]
    )
    search.search()
    search.search()
    first, second = asked
    assert first.shape == second.shape == (3, 2, 2)
    assert np.array_equal(
        second[:remembered], first[rugged(first).argsort()][:remembered]
    )
    known = {plan.tobytes() for plan in search.plans}
    assert all(plan.tobytes() in known for plan in second)
    assert len({plan.tobytes() for plan in first}) == 3


@pytest.mark.slow
def test_a_fixed_stiffness_stays_fixed_in_every_command(
    muscle_env, policy, monkeypatch
):
    search, tried = policy(muscle_env, arm=muscle_env.arm.with_stiffness(50.0)), []
    distances = search.distances
    monkeypatch.setattr(
        search, "distances", lambda plans: (tried.append(plans), distances(plans))[1]
    )
    trial = rollout(muscle_env, search, 3)
    assert (trial.commands[:, 2] == 50).all()
    assert (np.concatenate(tried)[..., 2] == 50).all()
    assert np.ptp(np.concatenate(tried)[..., 0]) > 0


@pytest.mark.slow
def test_a_plan_may_be_searched_by_overlap():
    light = NEW["torque"][-2].name
    by_distance, by_overlap = (
        oracle._run_transfer(
            "torque", "target-2", light, overlap, periods=2, search=TINY
        )
        for overlap in (False, True)
    )
    assert by_distance["best"].shape == by_distance["iou"].shape == (1,)
    assert by_distance["best"] != by_overlap["best"]


@pytest.mark.slow
def test_free_stiffness_is_at_least_as_fast_as_any_that_is_held():
    few = SearchSettings(starts=3, rounds=1, tries=3, elite=2)
    row = oracle._run_speed(0, steps=3, search=few)
    assert row["peak"][-1] >= row["peak"][:-1].max() > 0
