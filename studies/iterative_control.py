"""Does learning from outcomes spread the cloth?

Iterative learning control against the paper's controller, replay of the best recording,
and random commands, on both arms. All have the same time for each command. A run has 31
periods of 8 steps; the arm swings up in the first, which is left out. Distances are in
standard deviations of z, and most rows give them over the median of random commands.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import (
    LATE,
    best_per_period,
    difference_interval,
    late_median,
    target_distance,
)
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.autoencoder import encode
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.control import ControlSettings
from clothlab.method.estimation import BiasEstimator
from clothlab.method.iterative import IterativeLearningSettings, nearest_plans
from clothlab.method.policy import Policy
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.env import ClothEnv
from clothlab.trials import recorded_plans, rollout
from studies import ablations
from studies._grid import PAPER, Case, Experiment, Tables, grid
from studies._rows import Row
from studies._runs import (
    HEAVY,
    LIGHT,
    RECORDINGS,
    SAMPLES,
    TASKS,
    recorded_runs,
    trained,
)
from studies.motion import MotionWatch
from studies.oracle import best_possible

# Cloth whose p is the wrong one
_WRONG = {LIGHT: HEAVY, HEAVY: LIGHT, "hard-1": "soft-1", "soft-1": "hard-1"}
RANDOM, REPLAY, PAPERS = "random", "replay", "paper's controller"
STARTS, ITERATIVE = "paper's controller, recorded starts", "iterative learning control"


def _replay(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    """The recorded plan that came nearest with this very cloth, again and again."""
    runs = [run for run in recorded_runs(learned) if run.material == cloth]
    plan = nearest_plans(runs, encode(learned.autoencoder, target), count=1).u[0]
    return ReplayPolicy(np.tile(plan, (100, 1)))


def _recorded_starts(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    trials = data.load_trials(RECORDINGS[learned.autoencoder_name.removesuffix(PAPER)])
    return learned.controller(target, p, plans=recorded_plans(trials, seed=model))


CONTROLLERS: dict[
    str, Callable[[ClothCheckpoint, np.ndarray, str, int, np.ndarray], Policy]
] = {
    RANDOM: lambda learned, target, cloth, model, p: RandomPolicy(learned.arm),
    REPLAY: _replay,
    PAPERS: lambda learned, target, cloth, model, p: learned.controller(target, p),
    STARTS: _recorded_starts,
    ITERATIVE: lambda learned, target, cloth, model, p: learned.iterative_controller(
        target, p, recorded_runs(learned), IterativeLearningSettings(trust=0)
    ),
}


def _run_one(
    controller: str,
    p: str,
    recordings: str,
    f_const: float | None,
    arm: str,
    target: str,
    cloth: str,
    model: int,
    repeat: int,
    steps: int = 248,
) -> dict[str, Any]:
    """One run; the first repeat starts from the arm's home, the others from random
    postures.

    Args:
        controller: one of `CONTROLLERS`.
        p: of the "right" cloth, of the "wrong" one, "zero", "estimated" from the wrong
            one, of a model without p ("none"), or of one that knows C_damp and C_mass
            ("known").
        recordings: that the model learned from, "all" or the "paper's" amount.
        f_const: tension that every command has to send [N]; None: it is free, or the
            arm has none.
        arm, target, cloth, model, repeat, steps: names, seed of the training, number of
            the run, control steps.
    """
    learned, mask = _learned(arm, model, p, recordings), data.load_target(target)
    if f_const is not None:
        learned = replace(learned, arm=learned.arm.with_stiffness(f_const))
    right = learned.biases[cloth]
    start = learned.biases[_WRONG[cloth]] if p in ("wrong", "estimated") else right
    start = np.zeros_like(right) if p == "zero" else start
    policy = inner = CONTROLLERS[controller](learned, mask, cloth, model, start)
    if p == "estimated":
        policy = EstimatingPolicy(
            inner, BiasEstimator(learned.model, start), learned.autoencoder
        )
    seed = 20_000 + 100 * model + repeat
    with closing(ClothEnv(arm, cloth)) as env:
        watch = MotionWatch(env)
        trial = rollout(
            env,
            policy,
            steps,
            seed=seed,
            options={"random_start": repeat > 0},
            watch=watch,
            samples=SAMPLES,
        )
    distance, period = (
        target_distance(learned.autoencoder, trial, mask),
        ControlSettings.period * SAMPLES,
    )
    speed = (
        watch.hand_speed[: steps * SAMPLES // period * period]
        .reshape(-1, period)
        .max(axis=1)
    )
    ratio = None
    if isinstance(policy, EstimatingPolicy):
        ratio = float(
            np.linalg.norm(policy.trace[-1] - right) / np.linalg.norm(start - right)
        )
    return {
        "seed": seed,
        "still": float(
            distance[0]
        ),  # of the hanging cloth [s.d. of z], as all distances
        "best": best_per_period(distance).round(4),  # in each period but the first [P]
        "hand_speed": speed[1:].round(3),  # the highest in each of these [m/s]
        "predicted": np.array(
            getattr(inner, "predicted_distances", []), dtype=np.float64
        ).round(4),
        # Distance of an estimated p to the right one, over that at the start
        "bias_ratio": ratio,
    }


def _learned(arm: str, model: int, p: str, recordings: str) -> ClothCheckpoint:
    if p in ablations.KINDS:
        return ablations.train(p, arm, model)
    return trained(f"{arm}{PAPER if recordings == 'paper' else ''}-{model}")


# Controller, p, recordings, f_const, runs for each training: four where a claim stands
# on it
_METHODS = (
    (RANDOM, "right", "all", None, 4),
    (RANDOM, "right", "paper", None, 1),
    (REPLAY, "right", "all", None, 1),
    *(
        (PAPERS, p, "all", None, repeats)
        for p, repeats in {"right": 4, "zero": 1, "wrong": 4, "none": 1}.items()
    ),
    (PAPERS, "known", "all", None, 1),
    (PAPERS, "right", "paper", None, 1),
    (STARTS, "right", "all", None, 1),
    *(
        (ITERATIVE, p, "all", None, n)
        for p, n in {
            "right": 4,
            "zero": 1,
            "wrong": 4,
            "estimated": 4,
            "none": 1,
        }.items()
    ),
    (ITERATIVE, "right", "paper", None, 1),
    (PAPERS, "right", "all", 10.0, 4),
    (ITERATIVE, "right", "all", 10.0, 4),
)


def _cases(model: int | Iterable[int] = range(5), **same: Any) -> list[Case]:
    """Every method in every task with every training; foams have no C_damp and C_mass,
    the torque arm no stiffness.
    """
    found = []
    for (controller, p, recordings, f_const, repeats), (arm, target, cloth) in product(
        _METHODS, TASKS
    ):
        if (p == "known" and arm == "muscle") or (
            f_const is not None and arm == "torque"
        ):
            continue
        method = {
            "controller": controller,
            "p": p,
            "recordings": recordings,
            "f_const": f_const,
        }
        task = {"arm": arm, "target": target, "cloth": cloth}
        found += grid(**method, **task, model=model, repeat=range(repeats), **same)
    return found


def over_random(table: pd.DataFrame) -> pd.DataFrame:
    """Add medians of the last ten periods (`last`) and of all (`all`), and both over
    random commands on the task.
    """
    table = table.assign(
        last=table["best"].map(late_median),
        all=table["best"].map(np.median),
        speed=[speed[LATE].max() for speed in table["hand_speed"]],
    )
    keys = ["arm", "target", "cloth", "recordings"]
    random = (
        table[table["controller"] == RANDOM]
        .groupby(keys)["all"]
        .median()
        .rename("random")
    )
    table = table.join(random, on=keys)
    return table.assign(
        last_ratio=table["last"] / table["random"],
        all_ratio=table["all"] / table["random"],
    )


def select(
    table: pd.DataFrame, controller: str, p: str = "right", f_const: float | None = None
) -> pd.DataFrame:
    """The runs of one method with what was learned from all recordings."""
    chosen = (
        (table["controller"] == controller)
        & (table["p"] == p)
        & (table["recordings"] == "all")
    )
    return table[
        chosen
        & (table["f_const"].isna() if f_const is None else table["f_const"] == f_const)
    ]


def paired(
    first: pd.DataFrame,
    second: pd.DataFrame,
    compare: Callable[[pd.DataFrame], pd.Series],
) -> np.ndarray:
    """Compare runs that have training and start in common: mean over tasks, `[models,
    repeats]`.

    Args:
        first: runs of one method, such as `select` gives them.
        second: those of another.
        compare: both side by side, with columns such as `last_1` and `last_2` → one
            number a row.
    """
    both = first.merge(
        second, on=["target", "cloth", "model", "repeat"], suffixes=("_1", "_2")
    )
    return (
        both.assign(value=compare(both))
        .groupby(["model", "repeat"])["value"]
        .mean()
        .unstack()
        .to_numpy()
    )


def late_difference(both: pd.DataFrame) -> pd.Series:
    """How much farther from the target the first of two methods stays, last ten
    periods, over random commands.
    """
    return (both["last_1"] - both["last_2"]) / both["random_1"]


def speed_gain(both: pd.DataFrame) -> pd.Series:
    """Highest hand speed in the last ten periods under the first of two methods over
    the second's, minus one.
    """
    return both["speed_1"] / both["speed_2"] - 1


def _rows(tables: Tables) -> list[Row]:
    """Distances of each method, and differences between methods with their intervals."""
    table = over_random(tables["iterative_control"])
    return [*_by_method(table), *_differences(table), _over_oracle(table, tables)]


_VARIANTS = {
    "zero": "p = 0",
    "wrong": "wrong p",
    "estimated": "estimated p",
    "none": "without p",
    "known": "C_damp and C_mass known, torque arm only",
}


def _by_method(table: pd.DataFrame) -> list[Row]:
    def ratio(controller: str, p: str) -> float:
        runs = select(table, controller, p)
        return float(
            runs.groupby(["target", "cloth", "model"])["last_ratio"].mean().median()
        )

    found = []
    for controller in (REPLAY, PAPERS, STARTS, ITERATIVE):
        tried = {p for name, p, *_ in _METHODS if name == controller}
        others = [
            f"{label} {ratio(controller, p):.2f}"
            for p, label in _VARIANTS.items()
            if p in tried
        ]
        label = f"{controller}, all tasks: distance, last ten periods, over random commands', median"
        value = ratio(controller, "right")
        found.append(
            Row(f"iterative_control/{controller}", label, value, note="; ".join(others))
        )
    return found


def _differences(table: pd.DataFrame) -> list[Row]:
    paper, held = select(table, PAPERS), select(table, PAPERS, f_const=10.0)
    says: dict[str, Any] = {"paper": "Correct better", "below": 0.0}
    pairs = [
        (
            f"{PAPERS} minus the same with a wrong p",
            paper,
            select(table, PAPERS, "wrong"),
            says,
        ),
        (f"{PAPERS} minus the same held at 10 N", paper, held, says),
    ]
    found = []
    for name, first, second, said in pairs:
        for arm in second["arm"].unique():
            mean, *ends = difference_interval(
                paired(first[first["arm"] == arm], second, late_difference)
            )
            label = (
                f"{name}, {arm} arm: distance, last ten periods, over random commands'"
            )
            found.append(
                Row(
                    f"iterative_control/{name}/{arm}",
                    label,
                    mean,
                    interval=(ends[0], ends[1]),
                    **said,
                )
            )
    gains = paired(paper[paper["arm"] == "muscle"], held, speed_gain)
    mean, low, high = (100 * each for each in difference_interval(gains))
    label = f"{PAPERS}: gain in peak hand speed by free stiffness over 10 N"
    speed = Row(
        "iterative_control/speed",
        label,
        mean,
        " %",
        interval=(low, high),
        paper="+12 %",
        above=0.0,
    )
    return [*found, speed]


def _over_oracle(table: pd.DataFrame, tables: Tables) -> Row:
    last = select(table, ITERATIVE).groupby(["target", "cloth", "model"])["last"].mean()
    ratio = last / last.index.droplevel("model").map(best_possible(tables["oracle"]))
    label = "iterative learning control: last ten periods over the oracle's, median"
    return Row("iterative_control/oracle", label, float(ratio.median()), at_most=1.5)


EXPERIMENTS = (
    Experiment(
        "iterative_control", _run_one, _cases, seconds=90, slow=True, rows=_rows
    ),
)
