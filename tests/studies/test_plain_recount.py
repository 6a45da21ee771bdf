"""Ten numbers of the results, counted again from stored tables in plain pandas.

Nothing of this project makes them: it only says what they should be. A hostile reader
would write the same.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from studies import claims

RESULTS = Path(__file__).parents[2] / "data" / "results"


def read(name):
    """A table, arrays in it as arrays."""
    table = pd.read_csv(RESULTS / f"{name}.csv")
    for column in table:
        if table[column].astype(str).str.startswith("[").any():
            table[column] = [
                np.array(json.loads(each)) if isinstance(each, str) else each
                for each in table[column]
            ]
    return table


def students(numbers):
    """Mean and the ends of the 95 % interval."""
    half = stats.sem(numbers) * stats.t.ppf(0.975, len(numbers) - 1)
    return np.mean(numbers) + np.array([0, -half, half])


def named_right():
    runs = read("worlds-estimation-paper").dropna(subset="distance")
    return (runs["nearest"] == runs["cloth"]).groupby(runs["world"]).mean() - 1 / 9


def on_the_way():
    runs = read("worlds-estimation-paper")
    names = ["damp0.05-mass0.05", "damp0.07-mass0.10", "damp0.03-mass0.15"]
    runs = runs[runs["cloth"].isin(names)]
    return (1 - runs["distance"] / runs["start"]).groupby(runs["world"]).mean()


def errors_of_mass_beyond_those_of_damping():
    runs = read("worlds-estimation-paper").dropna(subset="distance")
    sizes = np.abs(np.stack(runs["error"]))
    table = pd.DataFrame(sizes, runs.index).groupby(runs["world"]).median()
    return table[1] - table[0]


def first_axis_with_drag():
    table = read("worlds-trained_p-paper")
    found = []
    for _, row in table[table["weights"] == "torque-paper"].iterrows():
        cloths = [name.split("-") for name in row["materials"].split()]
        drag = np.array([float(a.removeprefix("damp")) for a, _ in cloths])
        mass = np.array([float(b.removeprefix("mass")) for _, b in cloths])
        p = row["p"] - row["p"].mean(axis=0)
        _, directions = np.linalg.eigh(p.T @ p)
        along = p @ directions[:, -1]
        ranks = [abs(stats.spearmanr(along, each)[0]) for each in (drag, mass)]
        ratio = abs(stats.spearmanr(along, drag / mass)[0])
        found.append(ranks[0] - max(ranks[1], ratio))
    return found


def near(distance):
    return np.clip(1 - distance[1:] / (distance[0] / 2), 0, None).mean()


def nearer_than_random_on_the_easy_target():
    runs = read("worlds-control-paper").query("target == 'target-2'")
    gained = runs["control"].map(near) - runs["random"].map(near)
    return gained.groupby(runs["world"]).mean()


def best_of_each_period(distance):
    whole = len(distance[1:]) // 8 * 8
    return distance[1 : whole + 1].reshape(-1, 8).min(axis=1)


def nearer_than_the_hanging_cloth_on_the_hard_target():
    runs = read("worlds-control-paper").query("target == 'target-1'")
    best = runs["control"].map(lambda d: np.median(best_of_each_period(d)) / d[0])
    return (1 - best).groupby(runs["world"]).mean()


def right_over_wrong():
    runs = read("worlds-joint_arms-paper")
    runs = runs.query("starts == 0 and target == 'target-1'")
    best = runs["distance"].map(lambda d: np.median(best_of_each_period(d)))
    table = runs.assign(best=best).pivot_table("best", "world", "knowledge")
    return table["wrong"] - table["right"]


def found_while_controlling():
    runs = read("worlds-joint_estimation_control-paper")
    return 1 - runs.groupby("world")["ratio"].mean()


def gain_of_speed_beyond_the_papers():
    runs = read("worlds-foam_control-paper")
    runs = runs[runs["condition"].isin(["Correct", "Correct w/o stiffness"])]
    table = runs.assign(speed=runs["peak_hand_speed"].str[0])
    table = table.pivot_table("speed", "world", "condition")
    return table["Correct"] / table["Correct w/o stiffness"] - 1.12


def as_published_within_the_papers_threshold():
    runs = read("worlds-foam_control-paper")
    limit = 0.5 / 0.86
    share = runs["distance"].map(lambda d: (d[1:] < limit * d[0]).mean())
    table = runs.assign(share=share).pivot_table("share", "world", "condition")
    return table["Correct, warm start only"] - table["Random"]


COUNTED = {
    "estimate_finds": named_right,
    "estimate_approaches": on_the_way,
    "mass_less_exact": errors_of_mass_beyond_those_of_damping,
    "pc1_is_damping": first_axis_with_drag,
    "control_2": nearer_than_random_on_the_easy_target,
    "nearer_than_still_1": nearer_than_the_hanging_cloth_on_the_hard_target,
    "right_p_nearer": right_over_wrong,
    "found_in_control": found_while_controlling,
    "stiffness_speed": gain_of_speed_beyond_the_papers,
    "foam_rate_as_published": as_published_within_the_papers_threshold,
}


@pytest.mark.parametrize("name", COUNTED)
def test_a_plain_count_gives_the_same_mean_and_interval(name):
    judged = claims.judge(name)
    theirs = (judged.mean, judged.low, judged.high)
    assert students(list(COUNTED[name]())) == pytest.approx(theirs, abs=1e-9)
