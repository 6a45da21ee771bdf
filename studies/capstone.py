"""What a policy of one's own has to beat, and cloths that somebody has hidden.

The rivals of notebook 09: each throws at targets that nothing was tuned on. Then cloths
whose constants are drawn in secret, with what an estimate says of them.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from clothlab import data, plots
from clothlab.analysis import crossed_interval, target_distance
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.data import Run
from clothlab.method.gauss_newton import NewtonEstimator, linearise
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.method.policy import Policy
from clothlab.policies import RandomPolicy
from clothlab.simulation.cloth import Cloth
from clothlab.trials import Trial, recorded_plans
from studies._grid import Case, Experiment, grid, over
from studies._runs import (
    RECORDINGS,
    new_trial,
    own_cloth,
    random_trial,
    replay_nearest,
    trained,
)
from studies.oracle import search_trial

# Mean of one number a task, and the ends of its interval
Interval = tuple[float, float, float]
_ARM = "torque"
_ORACLE_STEPS = 41  # five periods: it is slow, and has found its plan by then
STEPS = 73  # control steps: nine periods of eight, and the look after the last one
TARGETS_OF_A_CLOTH = {"held-out": 3, "development": 2}
_RECORDED_PLANS = 200  # from which a period may start
RANGE = {"damping": (0.03, 0.07), "mass": (0.05, 0.15)}  # of the trained cloths

# A rival is made of the weights, the target's mask [H, W] and the cloth's name.
_Make = Callable[[ClothCheckpoint, np.ndarray, str], Policy]


@cache
def _runs() -> list[Run]:
    """The recordings that a reader has, which are fewer than a training had.

    All trainings share one autoencoder.
    """
    learned = trained(f"{_ARM}-0")
    return [learned.to_run(trial) for trial in data.load_trials(RECORDINGS[_ARM])]


def _plans() -> np.ndarray:
    return recorded_plans(data.load_trials(RECORDINGS[_ARM]), 8, _RECORDED_PLANS)


def _random(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    return RandomPolicy(learned.arm)


def _replay(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    """The recorded plan that came nearest with this very cloth, again and again."""
    runs = [run for run in _runs() if run.material == cloth]
    return replay_nearest(runs, learned.autoencoder, target)


def _last(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    return learned.controller(target, cloth)


def _recorded(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    return learned.controller(target, cloth, plans=_plans())


def _iterative(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    settings = IterativeLearningSettings(trust=0)
    return learned.iterative_controller(target, cloth, _runs(), settings)


_RIVALS: dict[str, _Make] = {
    "random": _random,
    "replay": _replay,
    "last": _last,
    "recorded": _recorded,
    "iterative": _iterative,
}
ORACLE = "oracle"  # searches in the true simulator, which no other may do


def tasks(name: str, count: int | None = None) -> list[tuple[str, str]]:
    """Targets of a set with their own cloths: `count` of each cloth, in order.

    The set is "held-out" or "development".
    """
    count = TARGETS_OF_A_CLOTH[name] if count is None else count
    chosen = []
    taken: dict[str, int] = {}
    for target in data.load_targets(name):
        cloth = own_cloth(target)
        if f"/{_ARM}_" not in target or taken.get(cloth, 0) >= count:
            continue
        taken[cloth] = taken.get(cloth, 0) + 1
        chosen.append((target, cloth))
    return chosen


def _run_one(
    rival: str, target: str, cloth: str, model: int, steps: int = STEPS
) -> dict[str, Any]:
    """Distance at each step `[T]` [s.d. of z], the first of them of the still cloth.

    Args:
        rival: one of `_RIVALS`, or the oracle.
        target, cloth: of the task, by name.
        model: seed of the training; the oracle knows none, and seeds its search so.
        steps: control steps.
    """
    learned = trained(f"{_ARM}-{model}")
    mask = data.load_target(target)
    if rival == ORACLE:
        trial = _oracle_trial(learned, mask, cloth, model, steps)
    else:
        policy = _RIVALS[rival](learned, mask, cloth)
        trial = new_trial(policy, _ARM, cloth, steps, seed=70_000 + model)
    distance = target_distance(learned.autoencoder, trial, mask)
    return {"distance": distance.round(4)}


def _oracle_trial(
    learned: ClothCheckpoint, mask: np.ndarray, cloth: str, seed: int, steps: int
) -> Trial:
    """Search each period in a copy of the scene, and send the best plan."""
    periods = -(-steps // 8)
    trial, _ = search_trial(
        learned.autoencoder, _ARM, cloth, mask, _plans(), periods, seed=seed
    )
    return trial[:steps]


def _cases(model: int | Iterable[int] = range(2), **same: Any) -> list[Case]:
    """Each rival on each task of both sets.

    On the held-out ones with several trainings, on those for development with the first
    alone and without the oracle. A replay and the oracle know no training.
    """
    cases = []
    for rival in _RIVALS:
        models = 0 if rival == "replay" else model
        for target, cloth in tasks("held-out"):
            task = {"rival": rival, "target": target, "cloth": cloth}
            cases += grid(**task, model=models, **same)
    for target, cloth in tasks("held-out"):
        task = {"rival": ORACLE, "target": target, "cloth": cloth}
        cases.append(task | {"model": 0, "steps": _ORACLE_STEPS} | same)
    for rival in _RIVALS:
        for target, cloth in tasks("development"):
            task = {"rival": rival, "target": target, "cloth": cloth}
            cases += grid(**task, model=0, **same)
    return cases


def hidden_cloth(seed: int) -> Cloth:
    """A cloth of which only a seed is known, within the range of the trained ones.

    Logarithms of its constants are uniform.
    """
    rng = np.random.default_rng([9, seed])
    values: dict[str, Any] = {}
    for name, ends in RANGE.items():
        low, high = np.log(ends)
        values[name] = float(np.exp(rng.uniform(low, high)))
    return Cloth(f"hidden-{seed}", **values)


def hidden_trial(seed: int, steps: int = 100) -> Trial:
    """A hidden cloth under random commands, by its seed."""
    return random_trial(_ARM, hidden_cloth(seed), steps, seed=90_000 + seed)


def _run_hidden(seed: int, model: int = 0, steps: int = 100) -> dict[str, Any]:
    """Move a hidden cloth at random, and estimate p by Gauss-Newton from 0.

    Args:
        seed: of the cloth, and of the commands.
        model: seed of the training.
        steps: control steps.

    Returns: C_damp [N s/m] and C_mass [kg], the `estimate` `[D_p]`, and its covariance
        by the curvature of the loss alone `[D_p, D_p]`.
    """
    learned = trained(f"{_ARM}-{model}")
    cloth = hidden_cloth(seed)
    run = learned.to_run(hidden_trial(seed, steps))
    newton = NewtonEstimator(learned.model)
    for s, u in zip(run.s, run.u, strict=True):
        newton.update(s, u)
    seen = linearise(newton)
    assert seen is not None, "steps are too few to estimate from"
    return {
        "damping": cloth.damping,
        "mass": cloth.mass,
        "estimate": newton.p.round(5),
        "bare": seen.covariance().round(8),
    }


def tries_file() -> Path:
    """The table of a reader's tries, beside the own recordings."""
    return data.own_trials() / "tries.csv"


# Of two rows of tries that agree in these, the later one is no new try
_SAME_TRY = ["set", "name", "seed", "steps", "points"]


def kept_tries(steps: int) -> pd.DataFrame:
    """All tries of runs of so many steps, in the order in which they were kept."""
    if not tries_file().exists():
        return pd.DataFrame({"set": []})
    tries = pd.read_csv(tries_file())
    return tries[tries.steps == steps].fillna({"note": ""})


def keep(
    name: str, score: Interval, of: str, *, tasks: int, steps: int, note: str = ""
) -> pd.DataFrame:
    """Add a try to the table; all tries of runs as long as this one.

    Args:
        name: of the policy.
        score: its mean points, and the ends of their interval.
        of: the set of targets, "development" or "held-out".
        tasks, steps: how many were played, and the control steps of a run.
        note: what was changed and expected.
    """
    row: dict[str, Any] = {"set": of, "name": name, "seed": 0, "steps": steps}
    row |= dict(zip(("points", "low", "high"), np.round(score, 1), strict=True))
    tries = pd.DataFrame([row | {"tasks": tasks, "note": note}])
    file = tries_file()
    if file.exists():
        tries = pd.concat([pd.read_csv(file), tries], ignore_index=True)
    tries = tries.drop_duplicates(_SAME_TRY, ignore_index=True)
    file.parent.mkdir(parents=True, exist_ok=True)
    tries.to_csv(file, index=False)
    return kept_tries(steps)


def draw_contest(
    ax: Axes,
    scores: Mapping[str, np.ndarray],
    interval: Callable[[np.ndarray], Interval],
    title: str,
) -> None:
    """Each task's mean as a stroke; the mean of all, with its interval.

    Args:
        ax: to draw on.
        scores: points `[task, throw]` by the names of the policies.
        interval: the mean of one number a task, and its two ends.
        title: what stands above, before the legend in words.
    """
    # From the lowest mean up
    each = {name: score.mean(axis=1) for name, score in scores.items()}
    names = sorted(each, key=lambda name: each[name].mean())

    # A row each; what would lie beyond 100 is cut
    ax.axvline(each["random"].mean(), color="0.6", ls=":")
    for k, name in enumerate(names):
        mean, low, high = interval(each[name])
        theirs = name in _RIVALS or name == ORACLE
        colour = plots.COLOURS[0] if theirs else plots.COLOURS[1]
        ax.plot([low, min(high, 100)], [k, k], lw=5, alpha=0.45, color=colour)
        if high > 100:
            ax.plot(100, k, ">", ms=9, color=colour)
        ax.plot(mean, k, "o" if theirs else "D", ms=11, mec="black", color=colour)
        ax.plot(each[name], np.full(len(each[name]), k), "|k", ms=9)

    # Its words
    ax.set_yticks(range(len(names)), names, fontsize=12)
    ax.set(xlim=(0, 104), xlabel="points (0: hanging still, 100: the target)")
    ax.set_title(f"{title}: mean, 95 % interval; stroke: a task", fontsize=12)


def share_of_way(own: np.ndarray, bottom: np.ndarray, top: np.ndarray) -> Interval:
    """How far from the bottom to the top, with its 95 % interval over the tasks.

    Each is one number a task; more tasks than `own` has are left out.
    """
    bottom = bottom[: len(own)]
    top = top[: len(own)]
    way = (top - bottom).mean()
    share = (own - bottom).mean() / way
    misses = (own - bottom - share * (top - bottom)) / way  # 0 in the mean
    _, low, high = crossed_interval(misses[:, None])
    return share, share + low, share + high


def between_sets(one: np.ndarray, other: np.ndarray) -> Interval:
    """Difference of two means over different tasks, with its 95 % interval (Welch)."""
    from scipy import stats  # slow to import

    both = stats.ttest_ind(one, other, equal_var=False).confidence_interval()
    return one.mean() - other.mean(), both.low, both.high


_HIDDEN_CASES = over(seed=range(40), model=0)
EXPERIMENTS = (
    Experiment("capstone", _run_one, _cases, seconds=8),
    Experiment("hidden_cloth", _run_hidden, _HIDDEN_CASES, seconds=4),
)
