"""What a policy of one's own has to beat, and cloths that somebody has hidden.

The rivals of notebook 09: each throws at targets that nothing was tuned on. Then cloths
whose constants are drawn in secret, with what an estimate says of them.
"""

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

import numpy as np

from clothlab import data
from clothlab.analysis import target_distance
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


_HIDDEN_CASES = over(seed=range(40), model=0)
EXPERIMENTS = (
    Experiment("capstone", _run_one, _cases, seconds=8),
    Experiment("hidden_cloth", _run_hidden, _HIDDEN_CASES, seconds=4),
)
