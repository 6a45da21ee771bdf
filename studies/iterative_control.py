"""Does learning from outcomes spread the cloth?

Iterative learning control against the paper's controller, replay of the best recording,
and random commands, on both arms. What varies besides is the p that a controller is
told, and how much its model has learned from.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import best_per_period, late_median, target_distance
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.method.rollout import Policy
from clothlab.policies import RandomPolicy
from clothlab.simulation.env import ClothEnv
from clothlab.trials import recorded_plans, rollout
from clothlab.weights import ClothCheckpoint
from studies._grid import PAPER, Case, Experiment, grid, over
from studies._runs import HEAVY, LIGHT, TASKS, recorded_runs, replay_nearest, trained

# Cloth whose p is the wrong one
_WRONG = {LIGHT: HEAVY, HEAVY: LIGHT, "hard-1": "soft-1", "soft-1": "hard-1"}
RANDOM = "random"
REPLAY = "replay"
PAPERS = "paper's controller"
STARTS = "paper's controller, recorded starts"
ITERATIVE = "iterative learning control"


# A controller is made of the weights, the target's mask [H, W], the cloth's name, the
# training's number and p [D_p].


def _random(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    return RandomPolicy(learned.arm)


def _replay(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    """The recorded plan that came nearest with this very cloth."""
    runs = [run for run in recorded_runs(learned) if run.material == cloth]
    return replay_nearest(runs, learned.autoencoder, target)


def _papers(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    return learned.controller(target, p)


def _recorded_starts(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    """The paper's controller, whose periods begin with the best of recorded plans.

    They are drawn from all that the model learned from, among which replay chooses. (In
    the stored table `iterative_control` they are drawn from the paper's amount.)
    """
    plans = recorded_plans(recorded_runs(learned), seed=model)
    return learned.controller(target, p, plans=plans)


def _iterative(
    learned: ClothCheckpoint, target: np.ndarray, cloth: str, model: int, p: np.ndarray
) -> Policy:
    settings = IterativeLearningSettings(trust=0)
    return learned.iterative_controller(target, p, recorded_runs(learned), settings)


CONTROLLERS: dict[
    str, Callable[[ClothCheckpoint, np.ndarray, str, int, np.ndarray], Policy]
] = {
    RANDOM: _random,
    REPLAY: _replay,
    PAPERS: _papers,
    STARTS: _recorded_starts,
    ITERATIVE: _iterative,
}


def _run_one(
    controller: str,
    p: str,
    recordings: str,
    arm: str,
    target: str,
    cloth: str,
    model: int,
    repeat: int,
    steps: int = 248,
) -> dict[str, Any]:
    """One run; the first repeat starts from home, the others from random postures.

    Args:
        controller: one of `CONTROLLERS`.
        p: of the "right" cloth, or of the "wrong" one.
        recordings: that the model learned from, "all" or the "paper's" amount.
        arm, target, cloth: of the task, by name.
        model: seed of the training.
        repeat: number of the run.
        steps: control steps.
    """
    ending = PAPER if recordings == "paper" else ""
    learned = trained(f"{arm}{ending}-{model}")
    mask = data.load_target(target)
    told = learned.biases[cloth if p == "right" else _WRONG[cloth]]
    policy = CONTROLLERS[controller](learned, mask, cloth, model, told)

    seed = 20_000 + 100 * model + repeat
    with closing(ClothEnv(arm, cloth)) as env:
        options = {"random_start": repeat > 0}
        trial = rollout(env, policy, steps, seed=seed, options=options)
    distance = target_distance(learned.autoencoder, trial, mask)
    return {
        "seed": seed,
        "still": float(distance[0]),  # of the hanging cloth [s.d. of z]
        "best": best_per_period(distance).round(4),  # in each period [P]
    }


# Controller, p, runs for each training: four where a claim stands on it
_METHODS = (
    (RANDOM, "right", 4),
    (REPLAY, "right", 1),
    (PAPERS, "right", 1),
    (STARTS, "right", 1),
    (ITERATIVE, "right", 4),
    (ITERATIVE, "wrong", 4),
)


def _cases(model: int | Iterable[int] = range(5), **same: Any) -> list[Case]:
    """Every method in every task with every training."""
    cases = []
    for controller, p, repeats in _METHODS:
        for arm, target, cloth in TASKS:
            cases += grid(
                controller=controller,
                p=p,
                recordings="all",
                arm=arm,
                target=target,
                cloth=cloth,
                model=model,
                repeat=range(repeats),
                **same,
            )
    return cases


def over_random(table: pd.DataFrame) -> pd.DataFrame:
    """Add what the rows of the results compare.

    That is the median of the last ten periods (`last`), and the same over random
    commands on the task (`last_ratio`), whose median goes over all periods (`random`).
    """
    table = table.assign(last=table["best"].map(late_median))
    task = ["arm", "target", "cloth", "recordings"]
    at_random = table[table["controller"] == RANDOM]
    medians = at_random.assign(random=at_random["best"].map(np.median))
    random = medians.groupby(task)["random"].median()
    table = table.join(random, on=task)
    return table.assign(last_ratio=table["last"] / table["random"])


def select(table: pd.DataFrame, controller: str, p: str = "right") -> pd.DataFrame:
    """The runs of one method."""
    return table[(table["controller"] == controller) & (table["p"] == p)]


def paired(
    first: pd.DataFrame,
    second: pd.DataFrame,
    compare: Callable[[pd.DataFrame], pd.Series],
) -> np.ndarray:
    """Compare runs that have training and start in common: mean over tasks.

    Args:
        first: runs of one method, such as `select` gives them.
        second: those of another.
        compare: both side by side, with columns such as `last_1` and `last_2` → one
            number a row.

    Returns: `[models, repeats]`.
    """
    keys = ["target", "cloth", "model", "repeat"]
    both = first.merge(second, on=keys, suffixes=("_1", "_2"))
    both = both.assign(value=compare(both))
    by_run = both.groupby(["model", "repeat"])["value"].mean()
    return by_run.unstack().to_numpy()


def late_difference(both: pd.DataFrame) -> pd.Series:
    """How much farther from the target the first of two methods stays.

    In the last ten periods, over random commands.
    """
    return (both["last_1"] - both["last_2"]) / both["random_1"]


EXPERIMENTS = (
    Experiment("iterative_control", _run_one, _cases, slow=True),
    # Few enough to be repeated in other worlds
    Experiment(
        "control_rivals",
        _run_one,
        over(
            controller=CONTROLLERS,
            p="right",
            recordings="all",
            arm="torque",
            target=("target-1", "target-2"),
            cloth=(LIGHT, HEAVY),
            model=range(5),
            repeat=0,
        ),
        paper={"recordings": "paper"},
    ),
)
