"""Recordings and targets: seeds of their own, written as they are made, targets chosen
by area and place alone.
"""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import clothlab
from clothlab import data
from clothlab.policies import OperatorPolicy
from clothlab.trials import load_trial, rollout
from studies.datasets import (
    _RUNS,
    DATASETS,
    TARGET_SETS,
    Dataset,
    _area_and_centre,
    choose_varied,
    record,
    record_run,
    save_targets,
)

DATA = Path(clothlab.__file__).parents[1] / "data"


def box(top: int, left: int, height: int, width: int) -> np.ndarray:
    mask = np.zeros((96, 128), bool)
    mask[top : top + height, left : left + width] = True
    return mask


def test_no_two_runs_share_a_seed():
    seeds = [
        run["seed"] for dataset in DATASETS.values() for run in dataset.runs().values()
    ]
    seeds += [*range(3000, 3004), 13000]
    for targets in TARGET_SETS:
        seeds += range(
            targets.first_seed, targets.first_seed + _RUNS * len(targets.cloths)
        )
    assert len(set(seeds)) == len(seeds)


def test_every_trial_has_a_file_of_its_own_whose_hash_is_known():
    files = [
        f"trials/{dataset.name}/{name}.npz"
        for dataset in DATASETS.values()
        for name in dataset.runs()
    ]
    assert len(set(files)) == len(files)
    recorded = {line[66:] for line in (DATA / "SHA256SUMS").read_text().splitlines()}
    trials = {name for name in recorded if name.startswith("trials/")}
    assert {re.sub(r"_again[1-4]", "", name) for name in trials} == set(files)


@pytest.mark.slow
def test_a_stored_trial_is_recorded_again_bit_for_bit():
    name, run = list(DATASETS["evaluation"].runs().items())[1]
    (again,) = record_run(replace(DATASETS["evaluation"], steps=5), **run)
    stored = load_trial(DATA / "trials" / "evaluation" / f"{name}.npz")
    assert np.array_equal(again.commands, stored.commands[:5])
    assert np.array_equal(again.images, stored.images[:5])
    assert (again.seed, again.policy, again.cloth) == (
        stored.seed,
        stored.policy,
        stored.cloth,
    )


@pytest.mark.slow
def test_a_throw_is_recorded_with_what_came_of_it_and_repeated_if_it_spread_the_cloth(
    monkeypatch,
):
    throws, run = (
        replace(DATASETS["table-throws"], steps=2),
        {"cloth": "hard-1", "policy": "throw", "seed": 7},
    )
    looked = []
    monkeypatch.setattr(
        "studies.datasets.see_cloth_pose",
        lambda env: looked.append(env.held) or SimpleNamespace(spread=True),
    )
    (held,) = record_run(throws, **run)
    assert (held.arm.name, held.policy, held.commands.shape) == (
        "muscle-hand",
        "operator",
        (2, 4),
    )
    assert looked == []  # a cloth in the hand does not lie

    def thrown(env, policy, steps, seed):
        env.release()
        return replace(held, policy=policy.name, seed=seed)

    monkeypatch.setattr("studies.datasets.rollout", thrown)
    first, *again = record_run(throws, **run)
    assert (first.policy, first.outcome) == ("operator", "spread")
    assert [(each.policy, each.outcome, each.seed) for each in again] == [
        ("replay", "spread", 1_000_007 + 1_000_000 * k) for k in range(4)
    ]
    assert looked == 5 * [()]


@pytest.mark.slow
def test_a_set_is_recorded_anew_whatever_is_there(tmp_path, env):
    short = Dataset("short", "torque", ("damp0.05-mass0.10",), 3, 5)
    (tmp_path / "trials" / "short").mkdir(parents=True)
    (tmp_path / "trials" / "short" / "damp0.05-mass0.10_operator.npz").write_bytes(
        b"half a trial"
    )
    files = record(short, data=tmp_path)
    assert files == [
        f"trials/short/damp0.05-mass0.10_{policy}.npz"
        for policy in ("random", "operator")
    ]
    again, read = (
        rollout(env, OperatorPolicy(env.arm), 3, seed=6),
        load_trial(tmp_path / files[1]),
    )
    assert np.array_equal(read.images, again.images)
    assert np.array_equal(read.commands, again.commands)
    assert (read.seed, read.policy, len(read)) == (6, "operator", 3)


def test_an_interruption_keeps_what_was_recorded_and_spoils_nothing(
    tmp_path, monkeypatch, trial
):
    def interrupted(dataset, cloth, policy, seed):
        if policy == "operator":
            raise KeyboardInterrupt
        return [trial[: dataset.steps]]

    monkeypatch.setattr("studies.datasets.record_run", interrupted)
    short = Dataset("short", "torque", ("damp0.05-mass0.10",), 3, 5)
    with pytest.raises(KeyboardInterrupt):
        record(short, data=tmp_path)
    there = tmp_path / "trials" / "short"
    random, operator = (
        f"damp0.05-mass0.10_{policy}.npz" for policy in ("random", "operator")
    )
    assert [path.name for path in there.iterdir()] == [random]

    # It goes on with the next trial
    before = (there / random).stat().st_mtime_ns
    monkeypatch.setattr("studies.datasets.record_run", lambda **_: [trial[:3]])
    assert record(short, anew=False, data=tmp_path) == [f"trials/short/{operator}"]
    assert (there / random).stat().st_mtime_ns == before


def test_targets_are_saved_by_their_names(tmp_path, monkeypatch, square):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    found = {"a": square, "set/b": ~square}
    assert save_targets(found) == ["targets/a.png", "targets/set/b.png"]
    assert np.array_equal(data.load_target("set/b"), ~square)


def test_area_and_centre_of_a_rectangle():
    features = _area_and_centre(np.array([box(10, 20, 5, 8), box(0, 0, 1, 1)]))
    assert features.tolist() == [[40, 23.5, 12], [1, 0, 0]]


def test_a_choice_stands_for_every_kind_from_small_to_large():
    rng = np.random.default_rng(0)
    kinds = [(60, 30, 12, 12), (20, 80, 30, 20), (20, 20, 8, 8), (60, 90, 25, 25)]
    masks = np.array(
        [box(*(np.array(kinds[k % 4]) + rng.integers(-2, 3, 4))) for k in range(80)]
    )
    chosen = choose_varied(masks, 4)
    area, column, row = _area_and_centre(chosen).T
    assert sorted(area) == list(area)
    wanted = _area_and_centre(np.array([box(*kinds[k]) for k in (2, 0, 1, 3)]))
    assert np.allclose(np.stack([column, row], axis=1), wanted[:, 1:], atol=3)
    assert all((masks == mask).all(axis=(1, 2)).any() for mask in chosen)
    again = choose_varied(rng.permutation(masks), 4)
    assert np.array_equal(_area_and_centre(chosen), _area_and_centre(again))


def test_held_out_targets_are_of_the_cloths_in_the_tables_and_development_has_others():
    stored = {targets.name: data.load_targets(targets.name) for targets in TARGET_SETS}
    pairs = {
        name: [tuple(each.rpartition("/")[2].split("_")[:2]) for each in masks]
        for name, masks in stored.items()
    }
    assert (
        pairs["held-out"]
        == [("torque", "damp0.03-mass0.05")] * 10
        + [("torque", "damp0.07-mass0.15")] * 10
    )
    for name, found in pairs.items():
        assert set(found) == {
            (each.arm, cloth)
            for each in TARGET_SETS
            if each.name == name
            for cloth in each.cloths
        }
    assert not set(pairs["held-out"]) & set(pairs["development"])


@pytest.mark.parametrize("name", ["held-out", "development", "drawn"])
def test_the_border_of_the_picture_cuts_no_target_off(name):
    for mask in data.load_targets(name).values():
        assert mask.any()
        assert not mask[[0, -1]].any()
        assert not mask[:, [0, -1]].any()
