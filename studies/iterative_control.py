"""Does learning from outcomes spread the cloth?

Iterative learning control against the paper's controller, replay of the best recording,
and random commands, on both arms. What varies besides is the p that a controller is
told, how much its model has learned from, and whether stiffness is held.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import LATE, best_per_period, late_median, target_distance
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.control import ControlSettings
from clothlab.method.iterative import IterativeLearningSettings, IterativePolicy
from clothlab.method.rollout import Policy
from clothlab.policies import RandomPolicy
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, recorded_plans, rollout
from clothlab.weights import ClothCheckpoint
from studies import ablations
from studies._grid import PAPER, Case, Experiment, grid, over
from studies._runs import (
    HEAVY,
    LIGHT,
    SAMPLES,
    TASKS,
    estimating,
    recorded_runs,
    replay_nearest,
    trained,
)
from studies.motion import MotionWatch

# Cloth whose p is the wrong one
_WRONG = {LIGHT: HEAVY, HEAVY: LIGHT, "hard-1": "soft-1", "soft-1": "hard-1"}
RANDOM = "random"
REPLAY = "replay"
PAPERS = "paper's controller"
STARTS = "paper's controller, recorded starts"
ITERATIVE = "iterative learning control"
_HELD = 10.0  # [N] f_const where it is held


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

    They are drawn from all that the model learned from, among which replay chooses.
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
    f_const: float | None,
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
        p: of the "right" cloth, of the "wrong" one, "zero", "estimated" from the wrong
            one, of a model without p ("none"), or of one that knows C_damp and C_mass
            ("known").
        recordings: that the model learned from, "all" or the "paper's" amount.
        f_const: tension that every command has to send [N]; None: it is free, or the
            arm has none.
        arm, target, cloth: of the task, by name.
        model: seed of the training.
        repeat: number of the run.
        steps: control steps.
    """
    learned = _learned(arm, model, p, recordings)
    if f_const is not None:
        learned = replace(learned, arm=learned.arm.with_stiffness(f_const))
    mask = data.load_target(target)

    # The controller, and what may estimate p beside it
    right = learned.biases[cloth]
    start = _first_p(learned, cloth, p)
    inner = CONTROLLERS[controller](learned, mask, cloth, model, start)
    policy = estimating(inner, learned, start) if p == "estimated" else inner

    seed = 20_000 + 100 * model + repeat
    trial, watch = _watched(policy, arm, cloth, steps, seed, random_start=repeat > 0)

    # Distances are in standard deviations of z
    distance = target_distance(learned.autoencoder, trial, mask)
    expected = inner.controller.expected if isinstance(inner, IterativePolicy) else []
    return {
        "seed": seed,
        "still": float(distance[0]),  # of the hanging cloth
        "best": best_per_period(distance).round(4),  # in each period [P]
        "hand_speed": _fastest(watch, steps).round(3),  # in the next of each [P] [m/s]
        "predicted": np.round(expected, 4),  # of each period, if it learns [P]
        "bias_ratio": _bias_ratio(policy, start, right),
    }


def _watched(
    policy: Policy, arm: str, cloth: str, steps: int, seed: int, *, random_start: bool
) -> tuple[Trial, MotionWatch]:
    """A run on a fresh scene, and how the hand moved in it."""
    with closing(ClothEnv(arm, cloth)) as env:
        watch = MotionWatch(env)
        trial = rollout(
            env,
            policy,
            steps,
            seed=seed,
            options={"random_start": random_start},
            watch=watch,
            samples=SAMPLES,
        )
    return trial, watch


def _learned(arm: str, model: int, p: str, recordings: str) -> ClothCheckpoint:
    """Weights of one training, or of a model with less or more knowledge."""
    if p in ablations.KINDS:
        return ablations.train(p, arm, model)
    ending = PAPER if recordings == "paper" else ""
    return trained(f"{arm}{ending}-{model}")


def _first_p(learned: ClothCheckpoint, cloth: str, p: str) -> np.ndarray:
    """The p that a run begins with, by what is known of it."""
    if p in ("wrong", "estimated"):
        return learned.biases[_WRONG[cloth]]
    if p == "zero":
        return np.zeros_like(learned.biases[cloth])
    return learned.biases[cloth]


def _fastest(watch: MotionWatch, steps: int) -> np.ndarray:
    """Highest speed of the hand in each whole period but the first, `[P]` [m/s]."""
    samples = ControlSettings.period * SAMPLES
    whole = steps * SAMPLES // samples * samples
    return watch.hand_speed[:whole].reshape(-1, samples).max(axis=1)[1:]


def _bias_ratio(policy: Policy, start: np.ndarray, right: np.ndarray) -> float | None:
    """Distance of an estimated p to the right one, over that at the start."""
    if not isinstance(policy, EstimatingPolicy):
        return None
    left = np.linalg.norm(policy.trace[-1] - right)
    return float(left / np.linalg.norm(start - right))


# Controller, p, recordings, f_const, runs for each training: four where a claim stands
# on it
_METHODS = (
    (RANDOM, "right", "all", None, 4),
    (RANDOM, "right", "paper", None, 1),
    (REPLAY, "right", "all", None, 1),
    (PAPERS, "right", "all", None, 4),
    (PAPERS, "zero", "all", None, 1),
    (PAPERS, "wrong", "all", None, 4),
    (PAPERS, "none", "all", None, 1),
    (PAPERS, "known", "all", None, 1),
    (PAPERS, "right", "paper", None, 1),
    (STARTS, "right", "all", None, 1),
    (ITERATIVE, "right", "all", None, 4),
    (ITERATIVE, "zero", "all", None, 1),
    (ITERATIVE, "wrong", "all", None, 4),
    (ITERATIVE, "estimated", "all", None, 4),
    (ITERATIVE, "none", "all", None, 1),
    (ITERATIVE, "right", "paper", None, 1),
    (PAPERS, "right", "all", _HELD, 4),
    (ITERATIVE, "right", "all", _HELD, 4),
)


def _cases(model: int | Iterable[int] = range(5), **same: Any) -> list[Case]:
    """Every method in every task with every training.

    Foams have no C_damp and C_mass, the torque arm no stiffness.
    """
    cases = []
    for controller, p, recordings, f_const, repeats in _METHODS:
        for arm, target, cloth in TASKS:
            # What there is not on this arm
            if p == "known" and arm == "muscle":
                continue
            if f_const is not None and arm == "torque":
                continue

            cases += grid(
                controller=controller,
                p=p,
                recordings=recordings,
                f_const=f_const,
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

    That is the median of the last ten periods (`last`) and of all (`all`), both over
    random commands on the task (`last_ratio`, `all_ratio`), and the highest speed of
    the hand in the last ten periods (`speed`).
    """
    table = table.assign(
        last=table["best"].map(late_median),
        all=table["best"].map(np.median),
        speed=[speed[LATE].max() for speed in table["hand_speed"]],
    )
    task = ["arm", "target", "cloth", "recordings"]
    at_random = table[table["controller"] == RANDOM]
    random = at_random.groupby(task)["all"].median().rename("random")
    table = table.join(random, on=task)
    return table.assign(
        last_ratio=table["last"] / table["random"],
        all_ratio=table["all"] / table["random"],
    )


def select(
    table: pd.DataFrame, controller: str, p: str = "right", f_const: float | None = None
) -> pd.DataFrame:
    """The runs of one method with what was learned from all recordings."""
    by_method = (table["controller"] == controller) & (table["p"] == p)
    if f_const is None:
        by_tension = table["f_const"].isna()
    else:
        by_tension = table["f_const"] == f_const
    return table[by_method & (table["recordings"] == "all") & by_tension]


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
            f_const=None,
            arm="torque",
            target=("target-1", "target-2"),
            cloth=(LIGHT, HEAVY),
            model=range(5),
            repeat=0,
        ),
        paper={"recordings": "paper"},
    ),
)
