"""What is p worth?

Throws with cloths that were never recorded, and towards targets that were not chosen by
their results. What varies is the controller, and which p it is told: the right one, one
that was estimated from 40 s of random commands, that of another cloth, zero, or none.
"""

from collections.abc import Iterable, Iterator
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
    config_of,
    find_cloth,
    new_trial,
    random_trial,
    recorded_runs,
    replay_nearest,
    trained,
)

_EXCITED = 200  # [step] of random commands from which p is estimated
_CHANCE_PERIODS = 31  # of random commands with which throws are compared
TARGETS = {"torque": ("target-1", "target-2"), "muscle": ("muscle",)}

# Methods: replay of a recording of some cloths, and a controller
ANY_OTHER = "replay, any other cloth"
NEAREST_P = "replay, nearest p"
CHOSEN = "iterative learning control"


def _any_other(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> set[str]:
    return {*biases} - {cloth}


def _nearest_p(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> set[str]:
    return {_by_distance(biases, cloth, p)[0]}


# Whose recordings are asked for the nearest one: (trained p of all cloths, name of the
# one in the hand, its p) → names
REPLAYS = {ANY_OTHER: _any_other, NEAREST_P: _nearest_p}


def _iterative(learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray) -> Policy:
    settings = IterativeLearningSettings(trust=1)
    return learned.iterative_controller(mask, p, recorded_runs(learned), settings)


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
            is "nearest" or "farthest".
        arm, cloth: what is held by what, by name.
        model: seed of the training.
        repeat: number of the run.
    """
    biases = trained(f"{arm}-{model}").biases
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
    """Best distance in each period whose end is seen `[P]`.

    Args:
        method: one of `REPLAYS`, or `CHOSEN`.
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
        policy = _iterative(learned, known_aim(arm, target), value)
    steps = periods * ControlSettings.period
    seed = 51_000 + 100 * model + repeat
    trial = new_trial(policy, arm, find_cloth(cloth), steps, seed)

    # What random commands with this cloth reach
    z_ref = encode(learned.autoencoder, mask)
    by_chance = np.linalg.norm(_random_z(arm, cloth, repeat) - z_ref, axis=1)

    distance = target_distance(learned.autoencoder, trial, mask)
    return {
        "best": best_per_period(distance).round(4),
        "random": float(np.median(best_per_period(by_chance))),
    }


# Methods and p of first throws with new cloths, and with recorded ones
_FIRST = (
    (ANY_OTHER, "estimated"),
    (NEAREST_P, "estimated"),
    (CHOSEN, "estimated"),
    (CHOSEN, "nearest"),
    (CHOSEN, "farthest"),
    (CHOSEN, "none"),
)


def _cases(
    model: Iterable[int] = range(5),
    repeat: Iterable[int] = range(4),
    periods: int | None = None,
) -> list[Case]:
    """First throws of new cloths, and longer runs towards new targets.

    In longer runs cloths and new targets take turns over trainings and repeats.
    """
    cases: list[Case] = []
    for arm in TARGETS:
        cases += _first_throws(arm, model, repeat)
    cases += _throws_at_new_targets(model)
    cases += _longer_runs_to_new_targets(model, repeat)
    if periods is not None:
        cases = [case | {"periods": periods} for case in cases]
    return cases


def _first_throws(
    arm: str, model: Iterable[int], repeat: Iterable[int]
) -> Iterator[Case]:
    """All targets and new cloths of an arm."""
    new = [cloth.name for cloth in NEW[arm]]
    task = {"arm": arm, "target": TARGETS[arm]}
    for method, p in _FIRST:
        run = {"cloth": new, "model": model, "repeat": repeat, "periods": 2}
        yield from grid(method=method, p=p, **task, **run)


def _throws_at_new_targets(model: Iterable[int]) -> list[Case]:
    """First throws with the cloths at both ends of the range."""
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
    """For each training and repeat a held-out and a drawn target, with a new cloth."""
    held_out = list(data.load_targets("held-out"))
    drawn = list(data.load_targets("drawn"))
    new = [cloth.name for cloth in NEW["torque"]]
    for turn in grid(model=model, repeat=repeat):
        number = 4 * turn["model"] + turn["repeat"]
        for names in (held_out, drawn):
            task = {"arm": "torque", "target": names[number % len(names)]}
            run = {"cloth": new[number % len(new)], **turn, "periods": 11}
            yield {"method": CHOSEN, "p": "estimated", **task, **run}


def over_random(table: pd.DataFrame, period: int = 0) -> pd.Series:
    """Distance in a period over that of random commands; the first one is 0."""
    return table["best"].map(lambda best: best[period]) / table["random"]


def select(table: pd.DataFrame, method: str, p: str) -> pd.DataFrame:
    """Runs of a method towards recorded targets.

    Args:
        table: stored rows of `transfer`.
        method: one of `REPLAYS`, or `CHOSEN`.
        p: its kind, as in the table.
    """
    by_method = (table["method"] == method) & (table["p"] == p)
    return table[by_method & ~table["target"].str.contains("/")]


EXPERIMENTS = (Experiment("transfer", _run_one, _cases, slow=True),)
