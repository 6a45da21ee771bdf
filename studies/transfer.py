"""What is p worth?

Throws with cloths that were never recorded, and towards targets that were not chosen by
their results. What varies is the controller, and which p it is told: the right one, one
that was estimated from 40 s of random commands, that of another cloth, zero, or none.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import best_per_period, target_distance
from clothlab.lab.targets import known_target
from clothlab.method.autoencoder import encode
from clothlab.method.control import ControlSettings
from clothlab.method.estimation import estimate_bias
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.method.rollout import Policy
from clothlab.weights import ClothCheckpoint
from studies import ablations
from studies._grid import Case, Experiment, grid, shared
from studies._runs import (
    NEW,
    best_iou,
    config_of,
    find_cloth,
    new_trial,
    own_cloth,
    random_trial,
    recorded_runs,
    replay_nearest,
    trained,
)

_EXCITED = 200  # [step] of random commands from which p is estimated
_CHANCE_PERIODS = 31  # of random commands with which throws are compared
NEW_NAMES = {cloth.name for cloths in NEW.values() for cloth in cloths}
TARGETS = {"torque": ("target-1", "target-2"), "muscle": ("muscle",)}

# Methods: replay of a recording of some cloths, and controllers
THIS_CLOTH = "replay, this cloth"
ANY_OTHER = "replay, any other cloth"
NEAREST_P = "replay, nearest p"
PAPERS = "paper's controller"
PERIODIC = "periodic warm start"
PREDICTED = "best predicted recording"
ALONE = "iterative learning control alone"
AS_ENCODED = "iterative learning control, target as encoded"
CHOSEN = "iterative learning control"


def _this_cloth(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> set[str]:
    return {cloth}


def _any_other(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> set[str]:
    return {*biases} - {cloth}


def _nearest_p(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> set[str]:
    return {_by_distance(biases, cloth, p)[0]}


# Whose recordings are asked for the nearest one: (trained p of all cloths, name of the
# one in the hand, its p) → names
REPLAYS = {THIS_CLOTH: _this_cloth, ANY_OTHER: _any_other, NEAREST_P: _nearest_p}


def _papers(learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray) -> Policy:
    return learned.controller(mask, p)


def _periodic(learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray) -> Policy:
    return learned.controller(mask, p, ControlSettings(warm_start="earlier"))


def _iterative(
    learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray, trust: float = 1.0
) -> Policy:
    settings = IterativeLearningSettings(trust=trust)
    return learned.iterative_controller(mask, p, recorded_runs(learned), settings)


def _predicted(learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray) -> Policy:
    """So little trust that a plan stays what was recorded."""
    return _iterative(learned, mask, p, trust=1e-9)


def _alone(learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray) -> Policy:
    return _iterative(learned, mask, p, trust=0)


_CONTROLLERS: dict[str, Callable[[ClothCheckpoint, np.ndarray, np.ndarray], Policy]] = {
    PAPERS: _papers,
    PERIODIC: _periodic,
    PREDICTED: _predicted,
    ALONE: _alone,
    AS_ENCODED: _iterative,
    CHOSEN: _iterative,
}


@cache
def known_aim(arm: str, target: str) -> np.ndarray:
    """The target as the autoencoder knows it (`known_target`), `[H, W]`.

    That is the target itself, or the most similar one of every fourth recorded image.
    """
    learned = trained(f"{arm}-0")
    images = []
    for name in config_of(learned).recordings:
        images += [trial.images[::4] for trial in data.load_trials(name)]
    target_image = data.load_target(target)
    return known_target(learned.autoencoder, target_image, np.concatenate(images))


def _replay(learned: ClothCheckpoint, mask: np.ndarray, among: set[str]) -> Policy:
    """The recorded plan that came nearest with these cloths."""
    runs = [run for run in recorded_runs(learned) if run.material in among]
    return replay_nearest(runs, learned.autoencoder, mask)


def _by_distance(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> list[str]:
    """Names of the other cloths, the one of the nearest p first."""

    def distance(name: str) -> float:
        return float(np.linalg.norm(biases[name] - p))

    return sorted({*biases} - {cloth}, key=distance)


@shared
def _estimated(arm: str, cloth: str, model: int, repeat: int) -> np.ndarray:
    """p from 40 s of random commands."""
    learned = trained(f"{arm}-{model}")
    seed = 50_000 + 100 * model + repeat
    run = learned.to_run(random_trial(arm, find_cloth(cloth), _EXCITED, seed))
    p, _ = estimate_bias(learned.model, run, method="newton")
    return p


@shared
def _random_z(arm: str, cloth: str, repeat: int) -> np.ndarray:
    """z of 31 periods of random commands `[T, D_z]`."""
    steps = _CHANCE_PERIODS * ControlSettings.period
    trial = random_trial(arm, find_cloth(cloth), steps, 58_000 + repeat)
    return encode(trained(f"{arm}-0").autoencoder, trial.images)


def bias(p: str, arm: str, cloth: str, model: int, repeat: int) -> np.ndarray:
    """p of a kind, `[D_p]`.

    Args:
        p: "right" of a recorded cloth, "estimated", the trained p of another cloth that
            is "nearest" or "farthest", or "zero".
        arm, cloth: what is held by what, by name.
        model: seed of the training.
        repeat: number of the run.
    """
    biases = trained(f"{arm}-{model}").biases
    if p == "zero":
        return np.zeros_like(next(iter(biases.values())))

    # A cloth that was never recorded has no right p: its estimate stands for it
    if p == "estimated" or cloth not in biases:
        centre = _estimated(arm, cloth, model, repeat)
    else:
        centre = biases[cloth]

    others = _by_distance(biases, cloth, centre)
    if p == "nearest":
        return biases[others[0]]
    if p == "farthest":
        return biases[others[-1]]
    return centre


def _run_one(
    method: str,
    p: str,
    arm: str,
    target: str,
    cloth: str,
    model: int,
    repeat: int,
    periods: int = 2,
) -> dict[str, Any]:
    """Best distance and best IoU in each period whose end is seen `[P]`.

    Args:
        method: one of `REPLAYS` or of the controllers.
        p: as `bias` has it, or "none": a model that was trained without p.
        arm, target, cloth: of the task, by name.
        model: seed of the training.
        repeat: number of the run.
        periods: of the run, the first one included.
    """
    # The model, and the p that it is told
    learned = trained(f"{arm}-{model}")
    mask = data.load_target(target)
    if p == "none":
        learned = ablations.train("none", arm, model)
        value = np.zeros(0)
    else:
        value = bias(p, arm, cloth, model, repeat)

    # Throw, or replay what was thrown
    if method in REPLAYS:
        among = REPLAYS[method](learned.biases, cloth, value)
        policy = _replay(learned, mask, among)
    else:
        aim = known_aim(arm, target) if method == CHOSEN else mask
        policy = _CONTROLLERS[method](learned, aim, value)
    steps = periods * ControlSettings.period
    seed = 51_000 + 100 * model + repeat
    trial = new_trial(policy, arm, find_cloth(cloth), steps, seed)

    # What random commands with this cloth reach
    z_ref = encode(learned.autoencoder, mask)
    by_chance = np.linalg.norm(_random_z(arm, cloth, repeat) - z_ref, axis=1)

    distance = target_distance(learned.autoencoder, trial, mask)
    return {
        "best": best_per_period(distance).round(4),
        "iou": best_iou(trial, mask).round(4),
        "random": float(np.median(best_per_period(by_chance))),
    }


# Methods and p of first throws with new cloths, and with recorded ones
_FIRST = (
    (ANY_OTHER, "estimated"),
    (NEAREST_P, "estimated"),
    (PREDICTED, "estimated"),
    (CHOSEN, "estimated"),
    (CHOSEN, "nearest"),
    (CHOSEN, "farthest"),
    (CHOSEN, "zero"),
    (CHOSEN, "none"),
    (PAPERS, "estimated"),
    (PERIODIC, "estimated"),
)
_FIRST_RECORDED = ((THIS_CLOTH, "right"), (CHOSEN, "right"), (CHOSEN, "farthest"))
# Periods of longer runs with new cloths, whose p is estimated
_LONG = {CHOSEN: 31, ALONE: 11, PAPERS: 11, PERIODIC: 11}


def _cases(
    model: Iterable[int] = range(5),
    repeat: Iterable[int] = range(4),
    periods: int | None = None,
) -> list[Case]:
    """First throws of all cloths, and longer runs.

    In longer runs cloths and new targets take turns over trainings and repeats.
    """
    cases: list[Case] = []
    for arm in TARGETS:
        cases += _first_throws(arm, model, repeat)
        cases += _longer_runs(arm, model, repeat)
    cases += _throws_at_new_targets(model)
    cases += _longer_runs_to_new_targets(model, repeat)
    if periods is not None:
        cases = [case | {"periods": periods} for case in cases]
    return cases


def _first_throws(
    arm: str, model: Iterable[int], repeat: Iterable[int]
) -> Iterator[Case]:
    """All targets and cloths of an arm."""
    new = [cloth.name for cloth in NEW[arm]]
    recorded = [*trained(f"{arm}-0").biases]
    task = {"arm": arm, "target": TARGETS[arm]}
    for method, p in _FIRST:
        run = {"cloth": new, "model": model, "repeat": repeat, "periods": 2}
        yield from grid(method=method, p=p, **task, **run)
    for method, p in _FIRST_RECORDED:  # nothing is drawn where p is known
        run = {"cloth": recorded, "model": model, "repeat": 0, "periods": 2}
        yield from grid(method=method, p=p, **task, **run)


def _longer_runs(
    arm: str, model: Iterable[int], repeat: Iterable[int]
) -> Iterator[Case]:
    """For each training and repeat one target, and one new and one recorded cloth."""
    new = [cloth.name for cloth in NEW[arm]]
    recorded = [*trained(f"{arm}-0").biases]
    targets = TARGETS[arm]
    for number, turn in _turns(model, repeat):
        target = targets[number // len(new) % len(targets)]
        task = {"arm": arm, "target": target}
        new_cloth = new[number % len(new)]
        for method, periods in _LONG.items():
            run = {"cloth": new_cloth, **turn, "periods": periods}
            yield {"method": method, "p": "estimated", **task, **run}
        known_cloth = recorded[number % len(recorded)]
        run = {"cloth": known_cloth, **turn, "periods": 31}
        yield {"method": CHOSEN, "p": "right", **task, **run}


def _throws_at_new_targets(model: Iterable[int]) -> list[Case]:
    """First throws with the cloths that `oracle_transfer` has for these targets."""
    held_out = data.load_targets("held-out")
    drawn = data.load_targets("drawn")
    return grid(
        method=CHOSEN,
        p=("estimated", "farthest"),
        arm="torque",
        target=[*held_out, *drawn],
        cloth=[cloth.name for cloth in NEW["torque"][-2:]],
        model=model,
        repeat=0,
        periods=2,
    )


def _longer_runs_to_new_targets(
    model: Iterable[int], repeat: Iterable[int]
) -> Iterator[Case]:
    """For each training and repeat a held-out and a drawn target.

    With the cloth that belongs to it, whose p is known, and with a new one.
    """
    held_out = list(data.load_targets("held-out"))
    drawn = list(data.load_targets("drawn"))
    new = [cloth.name for cloth in NEW["torque"]]
    for number, turn in _turns(model, repeat):
        new_cloth = new[number % len(new)]
        for names in (held_out, drawn):
            target = names[number % len(names)]
            task = {"arm": "torque", "target": target}
            for method in (CHOSEN, AS_ENCODED):
                run = {"cloth": own_cloth(target), **turn, "periods": 11}
                yield {"method": method, "p": "right", **task, **run}
                run = {"cloth": new_cloth, **turn, "periods": 11}
                yield {"method": method, "p": "estimated", **task, **run}


def _turns(
    model: Iterable[int], repeat: Iterable[int]
) -> Iterator[tuple[int, dict[str, int]]]:
    """Each training and repeat, and its number."""
    for turn in grid(model=model, repeat=repeat):
        yield 4 * turn["model"] + turn["repeat"], turn


def over_random(table: pd.DataFrame, period: int = 0) -> pd.Series:
    """Distance in a period over that of random commands; the first one is 0."""
    return table["best"].map(lambda best: best[period]) / table["random"]


def select(
    table: pd.DataFrame, method: str, p: str, *, new: bool = True, least: int = 2
) -> pd.DataFrame:
    """Runs of a method towards recorded targets.

    Args:
        table: stored rows of `transfer`.
        method: one of `REPLAYS` or of the controllers.
        p: its kind, as in the table.
        new: whether the cloths are new ones, or recorded ones.
        least: periods of the runs at the least.
    """
    by_method = (table["method"] == method) & (table["p"] == p)
    long_enough = table["periods"] >= least
    by_cloth = table["cloth"].isin(NEW_NAMES) == new
    recorded_target = ~table["target"].str.contains("/")
    return table[by_method & long_enough & by_cloth & recorded_target]


EXPERIMENTS = (Experiment("transfer", _run_one, _cases, slow=True),)
