"""Recordings and targets: seeds of their own, written as they are made, targets chosen by area and place alone."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from make_data import say_what_repeats

from clothlab import artifacts
from clothlab.datasets import (
    DRAWN,
    RECORDINGS,
    RUNS,
    VIEWS,
    Recording,
    area_and_place,
    choose_varied,
    draw,
    is_whole,
    jobs,
    median,
    record_all,
)
from clothlab.lab.views import BRUSH
from clothlab.policies import OperatorPolicy
from clothlab.trials import load_trial, rollout, save_trial

DATA = Path(artifacts.__file__).parents[1] / "data"
SHORT = Recording("torque", ("damp0.05-mass0.10",), 3, 5)
TODO = [
    (Path("short/random.npz"), SHORT, "damp0.05-mass0.10", "random", 5),
    (Path("short/operator.npz"), SHORT, "damp0.05-mass0.10", "operator", 6),
]


def box(top: int, left: int, height: int, width: int) -> np.ndarray:
    mask = np.zeros((96, 128), bool)
    mask[top : top + height, left : left + width] = True
    return mask


def test_no_two_runs_share_a_seed():
    seeds = [seed for *_, seed in jobs()] + [*range(3000, 3004), 13000]
    for views in (views for parts in VIEWS.values() for views in parts):
        seeds += range(views.first_seed, views.first_seed + RUNS * len(views.cloths))
    assert len(set(seeds)) == len(seeds)


def test_every_trial_has_a_file_of_its_own_whose_hash_is_known():
    files = [f"trials/{path.as_posix()}" for path, *_ in jobs()]
    assert len(set(files)) == len(files)
    assert jobs(["train"]) == [job for job in jobs() if job[0].parts[0] == "train"]
    recorded = {line[66:] for line in (DATA / "SHA256SUMS").read_text().splitlines()}
    trials = {name for name in recorded if name.startswith("trials/")}
    assert {name for name in trials if "_again" not in name} == set(files)
    assert {re.sub(r"_again[1-4]", "", name) for name in trials} == set(files)


def test_only_long_repeats_are_left_out_of_the_repository():
    left_out = {name for name, recording in RECORDINGS.items() if Path(f"trials/{name}/x").match(artifacts.LEFT_OUT)}
    assert left_out == {name for name, each in RECORDINGS.items() if each.repeats > 1 and each.steps > 100}


def test_a_throw_is_recorded_with_what_came_of_it(tmp_path, monkeypatch):
    throws = replace(RECORDINGS["table-throws"], steps=2)
    verdicts = []
    monkeypatch.setattr(
        "clothlab.datasets.see_cloth_pose", lambda env: verdicts.append(env.held) or SimpleNamespace(spread=True)
    )
    record_all([(Path("held.npz"), throws, "hard-1", "throw", 7)], tmp_path, workers=1, progress=False)
    held = load_trial(tmp_path / "held.npz")
    assert (held.arm, held.policy, held.commands.shape) == ("muscle-hand", "operator", (2, 4))
    assert verdicts == []  # a cloth in the hand does not lie
    thrown = lambda env, policy, steps, seed: env.release() or replace(held, policy=policy.name, seed=seed)  # noqa: E731
    monkeypatch.setattr("clothlab.datasets.rollout", thrown)
    record_all([(Path("thrown.npz"), throws, "hard-1", "throw", 7)], tmp_path, workers=1, progress=False)
    assert load_trial(tmp_path / "thrown.npz").policy == "operator, spread"
    again = [load_trial(tmp_path / f"thrown_again{k}.npz") for k in range(1, throws.again + 1)]  # was it luck?
    assert [(each.policy, each.seed) for each in again] == [
        ("replay, spread", 1_000_007 + 1_000_000 * k) for k in range(4)
    ]
    assert verdicts == 5 * [()]


def test_trials_are_recorded_anew_whatever_is_there(tmp_path, env):
    (tmp_path / "short").mkdir()
    (tmp_path / "short" / "operator.npz").write_bytes(b"half a trial")
    record_all(TODO[1:], tmp_path, workers=1, progress=False)
    again = rollout(env, OperatorPolicy(env.arm), 3, seed=6)
    read = load_trial(tmp_path / "short" / "operator.npz")
    assert np.array_equal(read.images, again.images)
    assert np.array_equal(read.commands, again.commands)
    assert (read.seed, read.policy, len(read)) == (6, "operator", 3)


def test_an_interruption_keeps_what_was_recorded_and_spoils_nothing(tmp_path, monkeypatch, trial):
    def interrupted(env, policy, steps, seed):
        if policy.name == "operator":
            raise KeyboardInterrupt
        return trial[:steps]

    monkeypatch.setattr("clothlab.datasets.rollout", interrupted)
    monkeypatch.setattr("clothlab.datasets.ClothEnv", lambda *_: SimpleNamespace(arm="torque", close=lambda: None))
    save_trial(trial, tmp_path / "short" / "operator.npz")
    before = (tmp_path / "short" / "operator.npz").read_bytes()
    with pytest.raises(KeyboardInterrupt):
        record_all(TODO, tmp_path, workers=1, progress=False)
    assert len(load_trial(tmp_path / "short" / "random.npz")) == 3
    assert (tmp_path / "short" / "operator.npz").read_bytes() == before
    assert sorted(path.name for path in (tmp_path / "short").iterdir()) == ["operator.npz", "random.npz"]


def test_it_says_how_many_files_repeat_bit_for_bit(tmp_path, square, monkeypatch, capsys):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    for name in ("a", "b", "c"):
        artifacts.save_target(square, name)
    artifacts.write_checksums()
    artifacts.save_target(~square, "b")
    artifacts.save_target(square, "new")
    before = (tmp_path / "SHA256SUMS").read_text()
    say_what_repeats([f"targets/{name}.png" for name in ("a", "b", "new")])
    assert capsys.readouterr().out.startswith("1 of the 2 whose hash was recorded are the same bit for bit")
    assert (tmp_path / "SHA256SUMS").read_text() == before


def test_a_whole_cloth_touches_no_border():
    assert is_whole(box(1, 1, 94, 126))
    assert not any(map(is_whole, [box(0, 9, 5, 5), box(91, 9, 5, 5), box(9, 0, 5, 5), box(9, 123, 5, 5)]))
    assert not is_whole(np.zeros((96, 128), bool))


def test_area_and_place_of_a_rectangle():
    features = area_and_place(np.array([box(10, 20, 5, 8), box(0, 0, 1, 1)]))
    assert features.tolist() == [[40, 23.5, 12], [1, 0, 0]]


def test_a_choice_stands_for_every_kind_from_small_to_large():
    rng = np.random.default_rng(0)
    kinds = [(60, 30, 12, 12), (20, 80, 30, 20), (20, 20, 8, 8), (60, 90, 25, 25)]
    masks = np.array([box(*(np.array(kinds[k % 4]) + rng.integers(-2, 3, 4))) for k in range(80)])
    chosen = choose_varied(masks, 4)
    area, column, row = area_and_place(chosen).T
    assert sorted(area) == list(area)
    wanted = area_and_place(np.array([box(*kinds[k]) for k in (2, 0, 1, 3)]))
    assert np.allclose(np.stack([column, row], axis=1), wanted[:, 1:], atol=3)
    assert all((masks == mask).all(axis=(1, 2)).any() for mask in chosen)
    again = choose_varied(rng.permutation(masks), 4)
    assert np.array_equal(area_and_place(chosen), area_and_place(again))


def test_the_median_moment_is_not_the_widest():
    assert median([(0.5, "c"), (0.3, "a"), (0.4, "b"), (0.9, "d"), (0.31, "x")]) == (0.4, "b")


def test_strokes_are_discs_along_lines():
    rows, columns = np.mgrid[:96, :128]
    dot = draw(4, (((60, 40),),))
    assert np.array_equal(dot, (columns - 60) ** 2 + (rows - 40) ** 2 <= 16)
    line = draw(3, (((10, 50), (30, 50)), ((80, 20), (80, 20))))
    assert line[48:53, 10:31].all()
    assert not line[:47, :60].any()
    assert np.array_equal(line[:, 60:], draw(3, (((80, 20),),))[:, 60:])
    assert draw(5, (((0, 0), (-3, 0)),))[:6, 0].all()  # a stroke may leave the canvas


def test_drawn_targets_are_what_the_strokes_draw():
    stored = artifacts.load_targets("drawn", data=DATA)
    assert len(stored) == len(DRAWN) == 10
    for name, (brush, strokes) in DRAWN.items():
        assert np.array_equal(stored[f"drawn/{name}"], draw(brush, strokes))
        assert is_whole(stored[f"drawn/{name}"])
        assert BRUSH["range"][0] <= brush <= BRUSH["range"][1]


def test_held_out_targets_are_of_the_cloths_in_the_tables_and_development_has_others():
    stored = {name: artifacts.load_targets(name, data=DATA) for name in VIEWS}
    assert all(is_whole(mask) for masks in stored.values() for mask in masks.values())
    pairs = {name: [artifacts.recorded_with(each) for each in masks] for name, masks in stored.items()}
    assert pairs["held-out"] == [("torque", "damp0.03-mass0.05")] * 10 + [("torque", "damp0.07-mass0.15")] * 10
    for name, parts in VIEWS.items():
        assert set(pairs[name]) == {(views.arm, cloth) for views in parts for cloth in views.cloths}
    assert not set(pairs["held-out"]) & set(pairs["development"])
