"""Rivals of parametric bias: each knows what it says it knows, in a world that is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
import toy

from clothlab import data
from clothlab.method._rollouts import rollout_of
from clothlab.method.data import Run
from clothlab.method.fast_rollout import FastDPMPB
from clothlab.method.model import DPMPB
from clothlab.simulation.cloth import CLOTHS
from studies import _rival_models, ablations, rivals, transfer
from studies._rival_models import (
    KINDS,
    Kind,
    Remembering,
    _stretches,
    memory_of,
    train_hindsight,
    train_kind,
)
from studies._rival_policies import Belief, EnsemblePolicy
from studies._runs import DEVELOPMENT, NEW, errors_ahead

LIGHT, HEAVY = "damp0.03-mass0.05", "damp0.07-mass0.15"
PIXEL = 1.5 / toy.UNIT  # to which a camera that counts pixels sees z


def obedient_run(name, steps=260, seed=0):
    """z[t+1] = ((1 + p) u[t], 0), in numbers alone."""
    u = np.random.default_rng(seed).uniform(-1, 1, (steps, 2))
    z = np.pad((1 + toy.bias_of(name)) * u[:-1], ((1, 0), (0, 1)))
    still = np.random.default_rng(seed + 100).normal(size=(steps, 4)) * 1e-3
    z[:, 2] += still[:, 0]
    return Run(np.hstack([z, still]), u, name)


@pytest.fixture(scope="module")
def runs():
    return [obedient_run(name, seed=k) for k, name in enumerate((LIGHT, HEAVY))]


@pytest.fixture
def world(monkeypatch):
    """A toy in place of the simulation; the aim of every target is z = (0.3, -0.6, 0)."""
    learned = replace(toy.learned(), name="torque-paper-0")
    aim = toy.image_of([0.3, -0.6, 0.0])
    known = [
        learned.to_run(toy.random_trial("torque", name, 60, k))
        for k, name in enumerate(CLOTHS)
    ]
    for name, instead in {
        "trained": lambda name: learned,
        "new_trial": toy.new_trial,
        "random_trial": toy.random_trial,
        "recorded_runs": lambda learned: known,
        "find_cloth": lambda name: CLOTHS[name],
    }.items():
        monkeypatch.setattr(rivals, name, instead)
    monkeypatch.setattr(transfer, "known_aim", lambda weights, target: aim)
    monkeypatch.setattr(data, "load_target", lambda name: aim)
    rivals._excited.cache_clear()
    return learned


# What is trained


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_model_knows_what_it_says_of_each_material(name, runs, monkeypatch):
    monkeypatch.setattr(_rival_models, "_STEPS", 100)
    kind = replace(KINDS[name], length=20, uncounted=min(KINDS[name].uncounted, 10))
    learned = train_kind(kind, runs, seed=0, updates=2)
    assert learned.model.bias_size == kind.bias_size
    assert [*learned.biases] == [LIGHT, HEAVY]
    for run in runs:
        p = learned.biases[run.material]
        assert p.shape == (kind.bias_size,)
        if kind.encoder:
            assert p == pytest.approx(learned.read(run))
        elif kind.told:
            assert p == pytest.approx(ablations.constants(run.material, [LIGHT, HEAVY]))
        else:
            assert kind.bias_size == 0 or np.abs(p).min() > 0


@pytest.mark.slow
def test_a_training_lowers_the_error_and_is_repeated_by_its_seed(runs, monkeypatch):
    monkeypatch.setattr(_rival_models, "_STEPS", 100)
    kind = Kind(length=10)
    before, after, again = (train_kind(kind, runs, 3, n) for n in (1, 40, 40))
    s, u = (torch.as_tensor(part)[None] for part in (runs[0].s, runs[0].u))

    def loss(learned):
        predicted, _ = learned.model(s[:, :-1], u[:, :-1], torch.zeros(0))
        return learned.model.loss(predicted, s[:, 1:]).item()

    assert loss(after) < 0.9 * loss(before)
    assert loss(after) == loss(again)


def test_stretches_are_of_the_material_that_is_asked_for(runs):
    marked = [
        Run(np.full_like(run.s, k), run.u, run.material)
        for k, run in enumerate([*runs, *runs])
    ]
    s, u = _stretches(marked, 30)(torch.tensor([0, 1, 0, 1, 1] * 20))
    assert s.shape == (100, 31, 7)
    assert u.shape == (100, 30, 2)
    found = s[:, 0, 0].reshape(20, 5) % 2
    assert (found == torch.tensor([0, 1, 0, 1, 1])).all()
    assert set(s[:, 0, 0].tolist()) == {0, 1, 2, 3}


def test_a_remembering_model_goes_on_where_it_has_read(runs):
    torch.manual_seed(0)
    model = DPMPB(7, 2, 0).eval()
    s, u = (torch.as_tensor(part)[None] for part in (runs[0].s, runs[0].u))
    nothing = torch.zeros(0)
    whole, _ = model(s, u, nothing)
    remembering = Remembering(model, memory_of(model, runs[0][:200]))
    first = remembering.initial_memory()
    rest, _ = remembering(s[:, 200:], u[:, 200:], nothing, first)
    assert torch.allclose(rest, whole[:, 200:], atol=1e-6)
    assert rollout_of(remembering) is FastDPMPB


@pytest.mark.slow
def test_plans_in_hindsight_differ_with_what_is_known_of_the_material():
    """Of a plan of one command, u = z / (1 + p)."""
    many = [obedient_run(name, seed=k) for k, name in enumerate(CLOTHS)]
    codes = {name: toy.bias_of(name) for name in CLOTHS}
    settings = {"from_state": False, "components": 1, "updates": 300, "seed": 0}
    network = train_hindsight(
        many, codes, DPMPB(7, 2, 2), latent=3, period=1, **settings
    )
    goal = torch.tensor([0.4, -0.3, 0.0])
    for name in (LIGHT, HEAVY):  # 0.68 and 0.32
        p = torch.as_tensor(toy.bias_of(name))
        plan = network.likeliest(torch.cat([goal, p]))
        assert plan[0, 0].item() == pytest.approx(float(0.4 / (1 + p[0])), abs=0.1)


# How they throw


def test_each_cloth_has_the_p_of_its_own_random_commands(world):
    for name in (LIGHT, HEAVY):
        task = rivals.task_of("torque", "target-1", name, 0)
        assert rivals._stored(task).p == pytest.approx(toy.bias_of(name), abs=0.02)
        assert rivals._nearest_trained(task).p == pytest.approx(toy.bias_of(name))


def test_an_ensemble_is_charged_for_where_its_models_disagree(world):
    task = rivals.task_of("torque", "target-1", LIGHT, 0)
    p = np.float32([[0.1, 0.2], [0.3, -0.2]])
    beliefs = [Belief(world.model, world.biases, each) for each in p]
    policy = EnsemblePolicy(task, beliefs, penalty=2.0, recorded_first=False)
    u = np.float32([0.2, -0.5])
    plans = torch.as_tensor(np.tile(u, (1, 8, 1)))
    z = np.pad((1 + p) * u, ((0, 0), (0, 1)))
    z_ref = policy._z_ref.numpy()
    square = np.square(z.mean(0) - z_ref).sum() + 2.0 * z.var(0).sum()
    cost = policy.costs(torch.zeros(world.model.state_size), plans)
    assert cost.item() == pytest.approx(np.sqrt(square), abs=1e-5)


@pytest.mark.parametrize("method", ["p", "p, nearest trained", "p without difference"])
def test_in_a_known_world_p_throws_to_the_target(world, method):
    row = rivals._run_one(method, "torque", "target-1", LIGHT, 0, periods=5)
    assert row["best"].shape == (4,)
    assert row["best"].min() < 0.05 < row["random"]


@pytest.mark.parametrize("first", [True, False])
def test_in_a_known_world_an_ensemble_throws_to_the_target(world, first, monkeypatch):
    monkeypatch.setattr(rivals, "_MEMBERS", {"p": 2})
    task = rivals.task_of("torque", "target-1", LIGHT, 0)
    policy = rivals._ensemble("p", "p", first, 1.0, task)
    trial = toy.new_trial(policy, "torque", LIGHT, 24, 0)
    if first:  # the first plan is one that was recorded
        stretches = [run.u[t : t + 8] for run in task.runs for t in range(52)]
        gaps = [np.abs(each - trial.commands[:8]).max() for each in stretches]
        assert min(gaps) < 1e-6
    z = rivals.target_distance(world.autoencoder, trial, task.target)
    assert z[9:].min() < 0.1


def test_replays_are_of_the_cloths_that_their_names_say(world):
    task = rivals.task_of("torque", "target-1", LIGHT, 0)

    def recorded(policy, names):
        sent = [policy({}) for _ in range(8)]
        for run in task.runs:
            for t in range(52):
                if run.material in names and np.allclose(run.u[t : t + 8], sent):
                    return True
        return False

    assert recorded(rivals._replay_nearest_p(task), {LIGHT})
    assert recorded(rivals._replay_any(task), {*CLOTHS} - {LIGHT})


def test_a_perfect_model_foresees_all_and_another_p_does_not():
    learned = toy.learned()
    run = learned.to_run(toy.random_trial("torque", LIGHT, 60, 0))
    right, wrong = (torch.as_tensor(toy.bias_of(name)) for name in (LIGHT, HEAVY))
    errors = errors_ahead(learned.model, run, right, (0, 20), 5)
    assert errors.shape == (2, 5)
    assert errors.max() < PIXEL
    assert errors_ahead(learned.model, run, wrong, (0, 20), 5).min() > 0.05


# What follows


def table_of(distances):
    """First throws of methods, `{method: distance of (cloth, model)}`."""
    rows = []
    for method, distance in distances.items():
        for cloth in range(6):
            for model in range(3):
                rows.append(
                    {
                        "method": method,
                        "arm": "torque",
                        "target": "target-1",
                        "cloth": str(cloth),
                        "model": model,
                        "best": np.array([distance(cloth, model)]),
                        "random": 2.0,
                    }
                )
    return pd.DataFrame(rows)


def test_effects_are_differences_to_p_and_verdicts_follow_the_margin():
    table = table_of(
        {
            "p": lambda cloth, model: 0.4 + 0.1 * cloth,
            "near": lambda cloth, model: 0.44 + 0.1 * cloth,
            "worse": lambda cloth, model: 0.7 + 0.1 * cloth,
            "noisy": lambda cloth, model: 0.6 + 0.1 * cloth + 0.6 * (model - 1),
        }
    )
    found = rivals.effects(table)
    assert [*found.index] == ["p", "near", "noisy", "worse"]
    assert found.loc["near", "difference"] == pytest.approx(0.02)
    assert found["verdict"].tolist() == ["no worse", "no worse", "open", "worse"]
    assert found.loc["worse", ["low", "high"]].tolist() == pytest.approx([0.15, 0.15])


def test_what_settings_are_chosen_on_is_in_no_table_of_results():
    shown = pd.DataFrame(rivals._cases())
    chosen_on = pd.DataFrame(rivals._development_cases())
    assert not {*shown["cloth"]} & {*chosen_on["cloth"]}
    assert not {*shown["target"]} & {*chosen_on["target"]}
    assert {*shown["cloth"]} == {cloth.name for cloth in NEW["torque"]}
    assert {*shown["method"]} <= {*rivals.RIVALS}
    assert {*rivals.CHOSEN.values()} <= {*shown["method"]}
    assert not shown.duplicated().any()


def test_beliefs_are_chosen_by_what_they_foresee_with_cloths_of_the_development():
    ours = DEVELOPMENT["torque"][0].name
    theirs = NEW["torque"][0].name
    without, other = (
        "without p, windows of 100, kept",
        "without p, windows of 200, kept",
    )
    rows = [
        (without, ours, np.r_[np.full(8, 0.2), np.full(8, 9.0)]),
        (other, ours, np.r_[np.full(8, 0.3), np.full(8, 0.1)]),
        (other, theirs, np.zeros(16)),
        ("context of 30", ours, np.ones(16)),
        ("p", ours, np.zeros(16)),
    ]
    table = pd.DataFrame(rows, columns=["belief", "cloth", "rest"])
    found = rivals.best_beliefs(table)
    assert found == {"without p": without, "context": "context of 30"}


def test_cloths_of_the_development_are_neither_recorded_nor_new():
    held = {(cloth.damping, cloth.mass) for cloth in DEVELOPMENT["torque"]}
    others = [*CLOTHS.values(), *NEW["torque"]]
    assert len(held) == 4
    assert not held & {(cloth.damping, cloth.mass) for cloth in others}


def test_constants_are_standardised_by_the_recorded_cloths():
    table = np.array([ablations.constants(name, [*CLOTHS]) for name in CLOTHS])
    assert table.mean(0) == pytest.approx([0, 0], abs=1e-12)
    assert table.std(0) == pytest.approx([1, 1])
    assert (ablations.constants(NEW["torque"][-1].name, [*CLOTHS]) > table.max(0)).all()
