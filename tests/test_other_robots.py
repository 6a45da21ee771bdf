"""The tasks of *Your own robot* on other robots, in small."""

import itertools
from dataclasses import replace
from pathlib import Path

import gym_robots
import hopper_damping
import messy_logs
import numpy as np
import other_robots
import other_robots_page
import pandas as pd
import pytest
import torch
from gym_robots import CHEETAH, PENDULUM, Size
from hopper_damping import WAYS

import clothlab
import studies
from clothlab.analysis import nearest_material

ROBOTS = {"pendulum": PENDULUM, "cheetah": CHEETAH, "hopper": WAYS["upright"]}
FOUR = replace(PENDULUM, values=((0.4, 1.2), (0.5, 1.2)))
TINY = Size(steps=80, seen=60, attempt=3, epochs=1, window=12)
PAGE = Path(clothlab.__file__).parents[1] / "docs" / "your_own_robot.md"


@pytest.mark.parametrize("name", ROBOTS)
def test_both_properties_move_a_robot_and_no_sensor_says_so(name):
    robot = ROBOTS[name]
    ends = []
    for material in (robot.materials[0], robot.materials[2], robot.materials[6]):
        (run, *_) = gym_robots.record(robot, material, 40, seed=3)
        ends.append(run.s[-1])
        assert run.step == robot.step
        assert run.material == robot.name_of(material)
    first, second_changed, first_changed = ends
    assert not np.allclose(first, second_changed, rtol=1e-4)
    assert not np.allclose(first, first_changed, rtol=1e-4)


@pytest.mark.slow
def test_what_is_learned_of_four_pendula_tells_new_runs_apart():
    runs = gym_robots.record_all(FOUR, 300, seed=0)
    settings = replace(Size(epochs=200).training, sequence_length=20)
    trained = gym_robots.train(runs, settings, 0, "residual")
    right = 0
    for k, material in enumerate(FOUR.materials):
        seen = gym_robots.record(FOUR, material, 100, 90_000 + k)
        p = gym_robots.estimate(trained.model, seen)
        name = FOUR.name_of(material)
        right += nearest_material(p, trained.biases) == name

        # The estimate foresees what its farthest rival doesn't
        biases = gym_robots.four_biases(trained, name, p)
        errors = {
            arm: gym_robots.error_ahead(trained.model, seen, bias)
            for arm, bias in biases.items()
        }
        assert errors["estimated p"] < errors["wrong p"] / 2
        assert gym_robots.least_wrong(trained, seen) == name
    assert right >= 3


def costs_and_rewards(robot):
    """What a step of random commands costs, by the loss and by Gymnasium."""
    env = robot.make(robot.materials[4])
    policy = robot.policy(env)
    policy.reset(0)
    before = robot.start(env, 0)
    costs = []
    rewards = []
    for _ in range(60):
        u = policy(before)
        after, reward, *_ = env.step(u)
        # The pendulum is judged before it moves, the cheetah by how far it got
        judged = before if robot is PENDULUM else after
        states = torch.as_tensor(np.array(judged))
        costs.append(robot.cost(states, torch.as_tensor(u)).item())
        rewards.append(reward)
        before = after
    return np.array(costs), np.array(rewards)


def test_the_costs_are_gymnasiums_rewards():
    costs, rewards = costs_and_rewards(PENDULUM)
    assert costs == pytest.approx(-rewards, abs=1e-5)
    costs, rewards = costs_and_rewards(CHEETAH)
    assert np.corrcoef(costs, -rewards)[0, 1] > 0.8
    assert costs.mean() == pytest.approx(-rewards.mean(), abs=0.2)


def test_a_hopper_stays_up_between_springs():
    with pytest.warns(UserWarning, match="with the task"):
        falling = gym_robots.record(WAYS["it falls"], (1.0, 1.0), 300, seed=0)
    upright = gym_robots.record(WAYS["upright"], (1.0, 1.0), 300, seed=0)
    assert max(map(len, falling)) < 100
    assert list(map(len, upright)) == [300]


@pytest.mark.parametrize("way", ["upright", "upright, longer step"])
def test_the_simulation_of_its_own_material_repeats_a_run(way):
    robot = WAYS[way]
    (run, *_) = gym_robots.record(robot, (2.0, 0.5), 40, seed=1)
    again = hopper_damping.after_one_step(robot, (2.0, 0.5), run)
    assert again == pytest.approx(run.s[1:], abs=1e-3)
    other = hopper_damping.after_one_step(robot, (1.0, 0.5), run)
    assert np.abs(other - run.s[1:]).max() > 0.01


@pytest.mark.slow
def test_the_simulation_finds_mass_and_damping(monkeypatch):
    robot = WAYS["upright, longer step"]
    runs = gym_robots.record(robot, (0.5, 2.0), 60, seed=1)
    scale = np.concatenate([run.s for run in runs]).std(0)
    monkeypatch.setattr(hopper_damping, "NOISE", 0.0)
    assert hopper_damping.fitted(robot, runs, scale, 0) == (0.5, 2.0)


def test_damping_moves_a_step_less_than_mass():
    robot = WAYS["upright"]
    (run,) = gym_robots.record(robot, (1.0, 1.0), 60, seed=1)
    few = replace(TINY, window=30).training
    trained = gym_robots.train([run], few, 0, "residual")
    shares = hopper_damping.shares_of_error(robot, trained, 1.0, run)
    assert 0 < shares["damping"] < shares["mass"] / 5
    doubled = hopper_damping.shares_of_error(robot, trained, 0.25, run)
    assert doubled["damping"] == pytest.approx(2 * shares["damping"])


def test_messy_logs_are_uneven_and_have_gaps(monkeypatch):
    load = messy_logs.LOADS[0]
    table = messy_logs.log(load, 0, messy=True)
    between = np.diff(table[messy_logs.TIME])
    assert np.median(between) == pytest.approx(0.02, abs=0.001)
    assert between.std() > 0.001
    assert (between > 0.25).sum() in (1, 2)
    assert table.drop(columns=messy_logs.TIME).isna().any(axis=None)
    even = messy_logs.log(load, 0, messy=False)
    assert np.diff(even[messy_logs.TIME]) == pytest.approx(0.02)
    assert even.notna().all(axis=None)


@pytest.mark.slow
def test_forty_messy_logs_are_read_as_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(messy_logs, "SECONDS", 6.0)
    messy_logs.write_logs(tmp_path, 0, messy=True)
    assert len(list(tmp_path.rglob("*.csv"))) == 40
    with pytest.warns(UserWarning, match="fewer than 31 steps and are left out"):
        runs = messy_logs.read(f"{tmp_path}/*/*.csv")
    assert {run.material for run in runs} == set(
        map(messy_logs.name_of, messy_logs.LOADS)
    )
    for run in runs:
        assert np.hypot(run.s[:, 0], run.s[:, 1]) == pytest.approx(1, abs=0.1)
        assert np.abs(run.u).max() <= 2
        assert (run.s[:, 3] == 24).all()


def test_a_network_is_told_its_margin():
    assert other_robots_page.found(0.7, 0.9) == "**found**"
    assert other_robots_page.found(0.6, 0.9) == other_robots_page.OPEN
    assert other_robots_page.found(0.2, 0.6) == "**not found**"
    assert other_robots_page.worth(0.11, 0.3) == "**p pays**"
    assert other_robots_page.worth(-0.09, 0.09) == "**no difference**"
    assert other_robots_page.worth(0.05, 0.3) == other_robots_page.OPEN
    assert other_robots_page.beside(0.2, 0.3) == "**better**"
    assert other_robots_page.beside(-0.05, 0.3) == "**as good**"
    assert other_robots_page.beside(-0.3, 0.05) == other_robots_page.OPEN
    assert other_robots_page.beside(-0.3, -0.2) == "**worse**"


def rewards(wrong):
    """Rows of two robots in which the wrong p loses so much of 10."""
    rows = []
    arms = {"right p": 0.0, "estimated p": 0.0, "p = 0": -1.0, "wrong p": -wrong}
    for task, seed, case in itertools.product(
        other_robots_page.ROBOTS, range(3), "abcd"
    ):
        shift = 0.1 * seed + 0.2 * "abcd".index(case)
        same = {"task": task, "seed": seed, "case": case}
        for feedback in other_robots_page.FEEDBACK:
            for arm, value in arms.items():
                measure = f"reward, {feedback}"
                rows.append(
                    same | {"measure": measure, "arm": arm, "value": value + shift}
                )
        drawn = {"measure": "reward, random commands", "arm": "", "value": -10 + shift}
        rows.append(same | drawn)
    return pd.DataFrame(rows)


def test_where_control_gains_nothing_p_can_lose_nothing():
    rows = rewards(3.0)
    rows.loc[rows["measure"] == "reward, random commands", "value"] = 2.0
    for line in other_robots_page.controlling(rows):
        assert line["verdict"].startswith("**no control**")


@pytest.mark.parametrize(
    ("wrong", "verdict"), [(3.0, "**p pays**"), (0.2, "**no difference**")]
)
def test_p_pays_where_the_wrong_one_loses_more_than_a_tenth(wrong, verdict):
    told = other_robots_page.controlling(rewards(wrong))
    assert len(told) == 4
    for line in told:
        assert line["verdict"] == verdict
        assert line["lost with the wrong p"].startswith(f"{10 * wrong:.0f} %")


def test_a_network_is_judged_by_what_it_gains_and_how_fast_it_is():
    rewards = {"DPMPB": -2.0, "GRU": -3.0, "residual": -2.1, "residual, as long": -1.9}
    times = {"DPMPB": 30, "GRU": 29, "residual": 20}
    rows = []
    for seed, case in itertools.product(range(3), "abc"):
        noise = 0.01 * seed + 0.02 * "abc".index(case)
        for task, measure, values in (
            ("networks", "reward", rewards | {"without control": -8.0}),
            ("networks", "training [s]", dict.fromkeys(rewards, 9.0)),
            ("speed", "act [ms]", times),
        ):
            same = {"task": task, "measure": measure, "seed": seed, "case": case}
            rows += [
                same | {"arm": arm, "value": value * (1 + noise)}
                for arm, value in values.items()
            ]
    told = other_robots_page.own_networks(pd.DataFrame(rows))
    assert {line["network"]: line["verdict"] for line in told} == {
        "DPMPB": "",
        "GRU": "**worse**",
        "residual": "**as good**, **faster**",
        "residual, as long": "**as good**, **faster**",
    }


def test_what_is_measured_again_takes_the_place_of_the_same(monkeypatch):
    saved = {}
    rows = [("pendulum", 0, 1.0), ("pendulum", 1, 2.0), ("logs", 0, 3.0)]
    columns = ["task", "seed", "value"]
    monkeypatch.setattr(
        studies, "load", lambda name: pd.DataFrame(rows, columns=columns)
    )
    monkeypatch.setattr(
        studies, "save", lambda table, name: saved.update({name: table})
    )
    monkeypatch.setattr(other_robots, "write_checksums", lambda: None)
    again = pd.DataFrame([("pendulum", 1, 5.0)], columns=columns)
    other_robots.keep(again)
    kept = saved[other_robots.TABLE]
    assert kept["value"].tolist() == [1.0, 5.0, 3.0]


@pytest.mark.slow
def test_a_hopper_is_looked_for_small(monkeypatch):
    monkeypatch.setattr(other_robots, "WAYS", {"upright": WAYS["upright"]})
    monkeypatch.setattr(hopper_damping, "NOISE", 0.0)
    rows = pd.DataFrame(other_robots.hopper(0, TINY))
    arms = rows[rows["measure"] == "damping"]["arm"].value_counts()
    assert arms.to_dict() == {"nearest p": 9, "least error": 9, "simulation": 9}
    (line,) = other_robots_page.hopping(rows.assign(task="hopper", seed=0))
    assert line["by simulation"] == "9 of 9"
    assert float(line["damping moves a step by"]) < float(line["mass moves a step by"])


@pytest.mark.slow
def test_a_robot_goes_through_all_four_calls_small():
    rows = pd.DataFrame(other_robots.find_and_control(FOUR, 0, TINY))
    counts = rows["measure"].value_counts()
    assert counts["R²"] == 2
    assert counts["right"] == 4
    assert counts["error ahead"] == 16
    assert counts["reward, every step"] == 4
    assert counts["reward, every 8 steps"] == 4
    rewarded = rows[rows["measure"].str.startswith("reward")]["value"]
    assert rewarded.between(-20, 0).all()


@pytest.mark.slow
def test_other_tasks_are_measured_small(monkeypatch):
    two = replace(PENDULUM, values=((0.5,), (0.5, 1.0)))
    monkeypatch.setattr(other_robots, "PENDULUM", two)
    monkeypatch.setattr(messy_logs, "LOADS", messy_logs.LOADS[:2])
    networks = pd.DataFrame(other_robots.networks(0, TINY))
    arms = set(networks["arm"]) - {"without control"}
    assert len(arms) == 5
    with pytest.warns(UserWarning, match="never changes|left out"):
        found = pd.DataFrame(other_robots.logs(0, TINY))
    assert found[found["measure"] == "right"]["arm"].value_counts().to_dict() == {
        "even logs": 2,
        "messy logs": 2,
    }


def test_the_page_says_what_is_stored():
    rows = studies.load(other_robots.TABLE)
    assert set(rows["task"]) == set(other_robots.TASKS)
    assert other_robots_page.tell(rows) in PAGE.read_text("utf-8")
