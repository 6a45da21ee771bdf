"""What p buys: each cell of the table switches what it says, in a world that is known."""

import itertools
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
import toy

from clothlab import data
from clothlab.analysis import best_per_period, target_distance
from clothlab.method.iterative import nearest_plans
from clothlab.method.model import DPMPB
from clothlab.policies import ReplayPolicy
from clothlab.simulation.cloth import CLOTHS
from studies import transfer, what_p_buys
from studies._runs import find_cloth
from studies._without_network import EvolutionPolicy, ProcessPolicy, ProcessSettings
from studies.what_p_buys import (
    BOTH,
    CHOOSES,
    EVOLUTION,
    KNOWLEDGE,
    NEAREST_P,
    NONE,
    PREDICTS,
    PROCESS,
    RECORDED,
    REPLANNED,
)

AIM = np.array([0.25, -0.875, 0.0])
NEW = "damp0.055-mass0.065"
HELD = find_cloth(NEW)
PIXEL = 1.5 / toy.UNIT


class Deaf(toy.Obedient):
    """The same world by a network that knows no p."""

    def forward(self, s, u, p, memory=None):
        return super().forward(s, u, torch.zeros(2), memory)


@pytest.fixture
def world(monkeypatch):
    """A new cloth in the hand, and some recordings of all others."""
    learned = toy.learned("torque")
    recorded = [
        toy.random_trial("torque", name, 60, k) for k, name in enumerate(CLOTHS)
    ]
    runs = [learned.to_run(trial) for trial in recorded]
    excited = learned.to_run(toy.random_trial("torque", HELD, 200, 7))
    replaced = {
        "trained": lambda name: learned,
        "recorded_runs": lambda learned: runs,
        "new_trial": toy.new_trial,
        "random_trial": toy.random_trial,
        "_excited": lambda *_: excited,
        "_estimates": lambda *_: np.tile(toy.bias_of(HELD), (200, 1)),
        "_chance": lambda *_: toy.random_trial("torque", HELD, 248, 9),
        "_without_p": lambda *_: Deaf(learned.arm).eval(),
    }
    for name, instead in replaced.items():
        monkeypatch.setattr(what_p_buys, name, instead)
    monkeypatch.setattr(transfer, "known_aim", lambda *_: toy.image_of(AIM))
    monkeypatch.setattr(data, "load_target", lambda name: toy.image_of(AIM))
    what_p_buys._thrown.cache_clear()
    yield SimpleNamespace(learned=learned, runs=runs)
    what_p_buys._thrown.cache_clear()


def hand(p="estimated", materials=9):
    return what_p_buys._hand(p, "torque", "target-1", NEW, 0, 40, materials)


def first_plan(method, p="estimated"):
    held = hand(p)
    policy = what_p_buys._policy(method, RECORDED, "torque", 0, held)
    return what_p_buys._first_plan(policy, held)


def squared(p, plans):
    """Least squared distance to the aim of each plan, with one p."""
    z = (1 + p) * plans[..., :2]
    return ((z - AIM[:2]) ** 2).sum(-1).min(-1)


# What each method sums: whether p is told to the network, weights of predictions and of
# the distance in p
SUMS = {
    NONE: (False, 1, 0),
    CHOOSES: (False, 0, 0.1),
    PREDICTS: (True, 1, 0),
    BOTH: (True, 1, 0.1),
}


@pytest.mark.parametrize("p", ["estimated", "nearest", "farthest"])
def test_the_chosen_recording_is_that_of_the_least_sum(world, p):
    told = hand(p).p
    plans = nearest_plans(world.runs, AIM)
    biases = world.learned.biases
    spread = np.var([*biases.values()], axis=0).sum()
    gap = [((biases[name] - told) ** 2).sum() / spread for name in plans.material]
    for method, (knows, predicted, difference) in SUMS.items():
        expected = squared(told if knows else 0, plans.u)
        seen = plans.distance**2 + difference * np.array(gap)
        best = plans.u[np.argmin(predicted * expected + seen)]
        assert first_plan(method, p) == pytest.approx(best, abs=1e-5), method


def differ(plan, other):
    return not np.array_equal(plan, other)


def test_what_p_is_counts_where_a_method_asks_for_it(world, monkeypatch):
    """Of several targets some are chosen otherwise; else the test above says nothing."""
    changes = dict.fromkeys(KNOWLEDGE, 0)
    pairs = dict.fromkeys(itertools.combinations(KNOWLEDGE, 2), 0)
    for aim in itertools.product((-0.5, 0.25, 0.75), (-1.25, -0.5, 0.5)):
        shown = toy.image_of([*aim, 0.0])
        monkeypatch.setattr(transfer, "known_aim", lambda *_, image=shown: image)
        chosen = {}
        for p in ("estimated", "farthest"):
            chosen[p] = {method: first_plan(method, p) for method in KNOWLEDGE}
            for one, other in pairs:
                pairs[one, other] += differ(chosen[p][one], chosen[p][other])
        for method in changes:
            changes[method] += differ(*(plans[method] for plans in chosen.values()))
    assert changes.pop(NONE) == 0
    assert min(changes.values()) > 0
    assert min(pairs.values()) > 0


def test_p_is_the_estimate_or_that_of_a_recorded_cloth(world):
    biases = np.array([*world.learned.biases.values()])
    right = toy.bias_of(HELD)
    gaps = np.linalg.norm(biases - right, axis=1)
    assert np.array_equal(hand().p, right)
    assert np.array_equal(hand("nearest").p, biases[gaps.argmin()])
    assert np.array_equal(hand("farthest").p, biases[gaps.argmax()])


def test_a_plan_is_sent_again_or_replanned(world):
    held = hand()
    replay = what_p_buys._policy(BOTH, RECORDED, "torque", 0, held)
    assert isinstance(replay, ReplayPolicy)
    sent = {}
    for sending in (RECORDED, REPLANNED):
        policy = what_p_buys._policy(BOTH, sending, "torque", 0, held)
        trial = toy.new_trial(policy, "torque", HELD, 33, 0)
        sent[sending] = trial.commands[:32].reshape(4, 8, -1)
    assert np.ptp(sent[RECORDED], axis=0).max() == 0
    again = sent[REPLANNED]
    assert again[:2] == pytest.approx(sent[RECORDED][:2], abs=1e-6)
    assert np.abs(again[2] - again[0]).max() > 1e-3


def test_a_row_has_the_distance_of_the_throw_over_that_of_chance(world):
    task = ("torque", "target-1", NEW, 0)
    row = what_p_buys._run_one(BOTH, "estimated", RECORDED, *task)
    least = np.sqrt(squared(toy.bias_of(HELD), first_plan(BOTH)))
    assert row["best"] == pytest.approx([least], abs=PIXEL)
    chance = toy.random_trial("torque", HELD, 248, 9)
    mask = toy.image_of(AIM)
    by_chance = target_distance(world.learned.autoencoder, chance, mask)
    assert row["random"] == pytest.approx(np.median(best_per_period(by_chance)))
    longer = what_p_buys._run_one(BOTH, "estimated", REPLANNED, *task, periods=3)
    assert longer["best"][0] == pytest.approx(row["best"][0], abs=PIXEL)
    assert len(longer["best"]) == 3


def test_fewer_materials_are_among_more_and_say_whose_recordings_are_used(world):
    names = [*world.learned.biases]
    drawn = [{*what_p_buys._in_use(names, NEW, 0, count)} for count in (3, 5, 9, 99)]
    assert [len(each) for each in drawn] == [3, 5, 9, 9]
    assert drawn[0] < drawn[1] < drawn[2]
    other = {*what_p_buys._in_use(names, NEW, 1, 3)}
    assert other != drawn[0]
    held = hand(materials=3)
    assert {*held.learned.biases} == drawn[0] == {run.material for run in held.runs}


def test_replays_and_refinements_begin_with_the_recording_that_they_say(world):
    nearest = {run.material: run for run in world.runs}
    biases = world.learned.biases
    right = toy.bias_of(HELD)
    name = min(biases, key=lambda each: np.linalg.norm(biases[each] - right))
    best = nearest_plans([nearest[name]], AIM, count=1).u[0]
    for method in (NEAREST_P, EVOLUTION, PROCESS):
        assert first_plan(method) == pytest.approx(best)
    any_cloth = nearest_plans(world.runs, AIM, count=1).u[0]
    assert first_plan(what_p_buys.ANY_OTHER) == pytest.approx(any_cloth)


def refined(policy, periods=12):
    trial = toy.new_trial(policy, "torque", HELD, 8 * periods + 1, 3)
    mask = toy.image_of(AIM)
    best = best_per_period(target_distance(toy.camera(), trial, mask))
    return trial.commands[: 8 * periods].reshape(periods, 8, -1), best


def test_an_evolution_strategy_steps_from_the_best_plan(world):
    sent, best = refined(
        EvolutionPolicy(world.learned, toy.image_of(AIM), world.runs[:1], 0.2)
    )
    assert np.array_equal(sent[0], sent[1])
    assert best.min() < best[0]
    # Later plans are around the best one before: within a few of the largest steps
    for k in range(2, len(sent)):
        parent = sent[1 + np.argmin(best[1:k])]
        assert np.abs(sent[k] - parent).max() < 0.5 * 4 * 0.2 * 1.5 ** (k - 2) + 1e-9


def test_a_process_learns_where_plans_lead(world):
    settings = ProcessSettings(scale=2.0, caution=0.05)
    policy = ProcessPolicy(world.learned, toy.image_of(AIM), world.runs[:1], settings)
    sent, best = refined(policy)
    assert np.array_equal(sent[0], sent[1])
    assert best[-3:].min() < 0.7 * best[0]


def test_a_deaf_network_predicts_the_same_whatever_p_is():
    torch.manual_seed(0)
    model = DPMPB(5, 2, bias_size=0)
    deaf = what_p_buys._deaf(model)
    s, u = torch.randn(1, 6, 5), torch.randn(1, 6, 2)
    expected, _ = model(s, u, torch.zeros(0))
    for p in ([0.0, 0.0], [3.0, -2.0]):
        predicted, _ = deaf(s, u, torch.tensor(p))
        assert torch.allclose(predicted, expected, atol=1e-6)


def rows_of(distances):
    """First throws and ten periods of ways: distance over random commands'."""
    rows = []
    for (method, p, sending), distance in distances.items():
        for arm in ("torque", "muscle"):
            for cloth in "abcd":
                for model in range(3):
                    row = {"method": method, "p": p, "sending": sending, "arm": arm}
                    row |= {"target": "target-1", "cloth": cloth, "model": model}
                    row |= {"seconds": 40, "materials": 9, "random": 2.0}
                    for periods in (1, 10):
                        best = np.full(periods, 2 * distance + 0.01 * model)
                        rows.append(row | {"periods": periods, "best": best})
    return pd.DataFrame(rows)


def test_effects_are_paired_differences_of_each_group():
    ways = {way for pair in what_p_buys.QUESTIONS.values() for way in pair}
    ways |= {way for pair in what_p_buys.MORE.values() for way in pair}
    ways |= {way for pair in what_p_buys.LATER.values() for way in pair}
    distances = dict.fromkeys(ways, 0.3)
    distances[(NONE, "estimated", RECORDED)] = 0.5
    distances[(BOTH, "nearest", RECORDED)] = 0.28
    distances[(EVOLUTION, "estimated", REPLANNED)] = 0.1
    found = what_p_buys.effects(rows_of(distances))
    assert found.loc[("p at all, over none", "all"), "difference"] == pytest.approx(
        -0.2
    )
    assert found.loc[("p at all, over none", "muscle"), "high"] < 0
    nearest = found.loc[("continuous p, over the nearest trained", "torque")]
    assert 0 < nearest["low"] <= nearest["high"] < 0.05
    assert nearest["rival"] == pytest.approx(0.285)
    assert found.loc[("network with p, over evolution strategy", "all"), "low"] > 0
    assert {*found.index.get_level_values("group")} == {"all", "torque", "muscle"}


def test_less_known_compares_the_same_tasks_and_trainings():
    rows = rows_of({(BOTH, "estimated", RECORDED): 0.3})
    few = rows[(rows["periods"] == 1) & (rows["model"] < 2) & (rows["arm"] == "torque")]
    best = few["best"].map(lambda best: best + 0.2)
    for less in what_p_buys.LESS:
        table = pd.concat([rows, few.assign(**less, best=best)])
        gaps = what_p_buys.less_known(table, **less)
        assert gaps.shape == (4, 2)
        assert gaps == pytest.approx(0.1)


def test_cases_are_of_new_cloths_and_hold_no_way_twice():
    cases = pd.DataFrame(what_p_buys._cases(model=[0]))
    assert not cases.duplicated().any()
    new = {cloth.name for cloths in transfer.NEW.values() for cloth in cloths}
    assert {*cases["cloth"]} == new
    held_out = cases[cases["target"].str.contains("/")]
    assert held_out["cloth"].nunique() == 2
    assert held_out["target"].nunique() == 4
