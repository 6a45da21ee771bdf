"""What is p worth?

Throws with cloths that were never recorded, and towards targets that were not chosen by
their results. p is estimated from 40 s of random commands before the first throw.
Distances are the best of a period over that of random commands; in the first period,
which is left out, the arm swings up.
"""

from collections.abc import Callable, Iterable
from functools import cache
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import (
    best_per_period,
    difference_interval,
    late_median,
    target_distance,
)
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.autoencoder import encode, known_target
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias
from clothlab.method.iterative import IterativeLearningSettings, nearest_plans
from clothlab.method.policy import Policy
from clothlab.policies import ReplayPolicy
from studies import ablations
from studies._grid import Case, Experiment, Tables, grid, shared
from studies._rows import Row
from studies._runs import (
    HEAVY,
    LIGHT,
    NEW,
    best_iou,
    config_of,
    find_cloth,
    new_trial,
    own_cloth,
    random_trial,
    recorded_runs,
    trained,
)
from studies.oracle import best_possible

_EXCITED = 200  # [step] of random commands from which p is estimated
NEW_NAMES = {cloth.name for cloths in NEW.values() for cloth in cloths}
# Its figures on control have these
PAPERS_CLOTHS = {"torque": (LIGHT, HEAVY), "muscle": ("soft-1", "hard-1")}
TARGETS = {"torque": ("target-1", "target-2"), "muscle": ("muscle",)}
# Which recordings are asked for the nearest one: (their cloths' p, this one's name, its
# p) → whether
REPLAYS = {
    "replay, this cloth": lambda biases, cloth, p: {cloth},
    "replay, any other cloth": lambda biases, cloth, p: {*biases} - {cloth},
    "replay, nearest p": lambda biases, cloth, p: {_by_distance(biases, cloth, p)[0]},
}
AS_ENCODED = "iterative learning control, target as encoded"
PAPERS, PERIODIC, PREDICTED = (
    "paper's controller",
    "periodic warm start",
    "best predicted recording",
)
ALONE, CHOSEN = "iterative learning control alone", "iterative learning control"
_CONTROLLERS: dict[str, Callable[[ClothCheckpoint, np.ndarray, np.ndarray], Policy]] = {
    PAPERS: lambda learned, mask, p: learned.controller(mask, p),
    PERIODIC: lambda learned, mask, p: learned.controller(
        mask, p, ControlSettings(warm_start="periodic")
    ),
    PREDICTED: lambda learned, mask, p: _iterative(learned, mask, p, trust=1e-9),
    ALONE: lambda learned, mask, p: _iterative(learned, mask, p, trust=0),
    **dict.fromkeys(
        (AS_ENCODED, CHOSEN), lambda learned, mask, p: _iterative(learned, mask, p)
    ),
}


def _iterative(
    learned: ClothCheckpoint, mask: np.ndarray, p: np.ndarray, trust: float = 1.0
) -> Policy:
    return learned.iterative_controller(
        mask, p, recorded_runs(learned), IterativeLearningSettings(trust=trust)
    )


@cache
def _aim(arm: str, target: str) -> np.ndarray:
    """The target, or of every fourth recorded image the most similar one, where that is
    `known_target`.
    """
    learned = trained(f"{arm}-0")
    recorded = [
        trial
        for name in config_of(learned).recordings
        for trial in data.load_trials(name)
    ]
    images = np.concatenate([trial.images[::4] for trial in recorded])
    return known_target(learned.autoencoder, data.load_target(target), images)


def _replay(learned: ClothCheckpoint, mask: np.ndarray, among: set[str]) -> Policy:
    """The recorded plan that came nearest with these cloths, again and again."""
    runs: list[Run] = [run for run in recorded_runs(learned) if run.material in among]
    return ReplayPolicy(
        np.tile(
            nearest_plans(runs, encode(learned.autoencoder, mask), count=1).u[0],
            (31, 1),
        )
    )


def _by_distance(biases: dict[str, np.ndarray], cloth: str, p: np.ndarray) -> list[str]:
    """Names of the other cloths, the one of the nearest p first."""
    return sorted(
        {*biases} - {cloth}, key=lambda name: float(np.linalg.norm(biases[name] - p))
    )


@shared
def _estimated(arm: str, cloth: str, model: int, repeat: int) -> np.ndarray:
    """p from 40 s of random commands."""
    learned, seed = trained(f"{arm}-{model}"), 50_000 + 100 * model + repeat
    run = learned.to_run(random_trial(arm, find_cloth(cloth), _EXCITED, seed))
    return estimate_bias(learned.model, run, method="newton")[0]


@shared
def _random_z(arm: str, cloth: str, repeat: int) -> np.ndarray:
    """z of 31 periods of random commands `[T, D_z]`."""
    return encode(
        trained(f"{arm}-0").autoencoder,
        random_trial(arm, find_cloth(cloth), 248, 58_000 + repeat).images,
    )


def bias(p: str, arm: str, cloth: str, model: int, repeat: int) -> np.ndarray:
    """p of a kind: "right" of a recorded cloth, "estimated", trained p of the "nearest"
    or "farthest" other, "zero".
    """
    biases = trained(f"{arm}-{model}").biases
    if p == "zero":
        return np.zeros_like(next(iter(biases.values())))
    known = p != "estimated" and cloth in biases
    centre = biases[cloth] if known else _estimated(arm, cloth, model, repeat)
    others = _by_distance(biases, cloth, centre)
    return {"nearest": biases[others[0]], "farthest": biases[others[-1]]}.get(p, centre)


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
    """Best distance and best IoU in each period but the first `[P]`."""
    learned, mask = trained(f"{arm}-{model}"), data.load_target(target)
    if p == "none":
        learned, value = ablations.train("none", arm, model), np.zeros(0)
    else:
        value = bias(p, arm, cloth, model, repeat)
    if method in REPLAYS:
        policy = _replay(learned, mask, REPLAYS[method](learned.biases, cloth, value))
    else:
        policy = _CONTROLLERS[method](
            learned, _aim(arm, target) if method == CHOSEN else mask, value
        )
    trial = new_trial(
        policy,
        arm,
        find_cloth(cloth),
        periods * ControlSettings.period,
        51_000 + 100 * model + repeat,
    )
    by_chance = np.linalg.norm(
        _random_z(arm, cloth, repeat) - encode(learned.autoencoder, mask), axis=1
    )
    return {
        "best": best_per_period(
            target_distance(learned.autoencoder, trial, mask)
        ).round(4),
        "iou": best_iou(trial, mask).round(4),
        "random": float(np.median(best_per_period(by_chance))),
    }


_FIRST_OTHERS = ("replay, any other cloth", "replay, nearest p")
_FIRST = (  # methods of first throws, p: on new cloths
    *((method, "estimated") for method in (*_FIRST_OTHERS, PREDICTED)),
    *((CHOSEN, p) for p in ("estimated", "nearest", "farthest", "zero", "none")),
    *((PAPERS, "estimated"), (PERIODIC, "estimated")),
)
_FIRST_RECORDED = (
    ("replay, this cloth", "right"),
    (CHOSEN, "right"),
    (CHOSEN, "farthest"),
)
_LONG = {
    (CHOSEN, "estimated"): 31,
    (ALONE, "estimated"): 11,
    (PAPERS, "estimated"): 11,
    (PERIODIC, "estimated"): 11,
}


def _cases(
    model: Iterable[int] = range(5), repeat: Iterable[int] = range(4), **same: Any
) -> list[Case]:
    """First throws of all cloths; in longer runs, cloths and new targets take turns
    over trainings and repeats.
    """
    found, turns = (
        [],
        [
            (4 * each["model"] + each["repeat"], each)
            for each in grid(model=model, repeat=repeat)
        ],
    )

    def add(method: tuple[str, str], periods: int, arm: str, **axes: Any) -> None:
        found.extend(
            grid(
                method=method[0],
                p=method[1],
                arm=arm,
                **axes,
                **({"periods": periods} | same),
            )
        )

    for arm, targets in TARGETS.items():
        new, recorded = (
            [cloth.name for cloth in NEW[arm]],
            [*trained(f"{arm}-0").biases],
        )
        for method in _FIRST:
            add(method, 2, arm, target=targets, cloth=new, model=model, repeat=repeat)
        for method in _FIRST_RECORDED:  # nothing is drawn where p is known
            add(method, 2, arm, target=targets, cloth=recorded, model=model, repeat=0)
        for k, turn in turns:
            for method, periods in _LONG.items():
                add(
                    method,
                    periods,
                    arm,
                    target=targets[k // len(new) % len(targets)],
                    cloth=new[k % len(new)],
                    **turn,
                )
            add(
                (CHOSEN, "right"),
                31,
                arm,
                target=targets[k // len(new) % len(targets)],
                cloth=recorded[k % len(recorded)],
                **turn,
            )
    pair = [cloth.name for cloth in NEW["torque"][-2:]]  # as oracle_transfer has them
    new_targets = [*data.load_targets("held-out"), *data.load_targets("drawn")]
    for p in ("estimated", "farthest"):
        add(
            (CHOSEN, p),
            2,
            "torque",
            target=new_targets,
            cloth=pair,
            model=model,
            repeat=0,
        )
    for k, turn in turns:
        names = [list(data.load_targets(name)) for name in ("held-out", "drawn")]
        for target in (each[k % len(each)] for each in names):
            for name in (CHOSEN, AS_ENCODED):
                add(
                    (name, "right"),
                    11,
                    "torque",
                    target=target,
                    cloth=own_cloth(target),
                    **turn,
                )
                add(
                    (name, "estimated"),
                    11,
                    "torque",
                    target=target,
                    cloth=NEW["torque"][k % 8].name,
                    **turn,
                )
    return found


def over_random(table: pd.DataFrame, period: int = 0) -> pd.Series:
    """Distance in a period over that of random commands; the first one is 0."""
    return table["best"].map(lambda best: best[period]) / table["random"]


def select(
    table: pd.DataFrame, method: str, p: str, *, new: bool = True, least: int = 2
) -> pd.DataFrame:
    """Runs of a method towards recorded targets, with new or recorded cloths, at least
    so many periods long.
    """
    about = (
        (table["method"] == method) & (table["p"] == p) & (table["periods"] >= least)
    )
    return table[
        about
        & (table["cloth"].isin(NEW_NAMES) == new)
        & ~table["target"].str.contains("/")
    ]


def difference(first: pd.DataFrame, second: pd.DataFrame) -> tuple[float, float, float]:
    """First throws of one method minus another's, over random commands: mean, and the
    ends of its 95 % interval.
    """
    keys = ["target", "cloth", "model", "repeat"]
    both = [
        each.query("periods == 2").set_index(keys).pipe(over_random)
        for each in (first, second)
    ]
    return difference_interval(
        (both[0] - both[1]).groupby(["model", "repeat"]).mean().unstack().to_numpy()
    )


_WRONG = {"farthest": "the farthest p", "zero": "p = 0", "none": "no p at all"}


def _rows(tables: Tables) -> list[Row]:
    """Means over cloths, targets, trainings and runs."""
    table = tables["transfer"]
    of_arms = (_arm_rows(arm, runs) for arm, runs in table.groupby("arm", sort=False))
    return [*chain(*of_arms), *_new_targets(table), *_over_oracle(tables)]


def _arm_rows(arm: str, table: pd.DataFrame) -> list[Row]:
    def mean(
        method: str, p: str = "estimated", period: int = 1, **chosen: bool
    ) -> float:
        runs = select(table, method, p, least=3 if period > 1 else 2, **chosen)
        return float(
            over_random(
                runs if period > 1 else runs.query("periods == 2"), period - 1
            ).mean()
        )

    where, best = f"{arm} arm, new cloths, first throw", mean(CHOSEN)
    others = [
        f"{name} {mean(name):.2f}"
        for name in (*_FIRST_OTHERS, PREDICTED, PAPERS, PERIODIC)
    ]
    others += [f"nearest trained p {mean(CHOSEN, 'nearest'):.2f}"]
    later = [f"period {k}: {mean(CHOSEN, period=k):.2f}" for k in (3, 10, 30)]
    later += [
        f"{name}, period 10: {mean(name, period=10):.2f}"
        for name in (ALONE, PAPERS, PERIODIC)
    ]
    label, note = f"{where}: distance over random commands'", "; ".join(others + later)
    found = [Row(f"transfer/{arm}/first", label, best, at_most=0.25, note=note)]
    for p, name in _WRONG.items():
        gap, low, high = difference(
            select(table, CHOSEN, "estimated"), select(table, CHOSEN, p)
        )
        label, aim = (
            f"{where}: estimated p minus {name}",
            -0.25 if p == "farthest" else None,
        )
        key, says = f"transfer/{arm}/{p}", "Correct better"
        found.append(
            Row(
                key,
                label,
                gap,
                interval=(low, high),
                paper=says,
                below=0.0,
                at_most=aim,
            )
        )
    label = f"{where}: over the nearest recording of another cloth"
    found.append(
        Row(f"transfer/{arm}/replay", label, best / mean(_FIRST_OTHERS[0]), at_most=0.5)
    )
    label = f"{arm} arm, recorded cloths, first throw: distance over random commands'"
    known = ((CHOSEN, "right"), ("replay, this cloth", "right"))
    value, replay = (mean(*method, new=False) for method in known)
    of_paper = table[table["cloth"].isin(PAPERS_CLOTHS[arm])]
    theirs = (
        float(
            over_random(select(of_paper, *each, new=False).query("periods == 2")).mean()
        )
        for each in known
    )
    note = "replay {:.2f}; the paper's two cloths {:.2f}, replay {:.2f}; ".format(
        replay, *theirs
    )
    note += "; ".join(
        f"period {k}: {mean(CHOSEN, 'right', period=k, new=False):.2f}"
        for k in (10, 30)
    )
    found.append(Row(f"transfer/{arm}/recorded", label, value, at_most=0.06, note=note))
    return found


def _new_targets(table: pd.DataFrame) -> list[Row]:
    runs = table[
        table["target"].str.contains("/")
        & (table["periods"] > 2)
        & (table["method"] == CHOSEN)
    ]
    new, drawn = runs["cloth"].isin(NEW_NAMES), runs["target"].str.startswith("drawn/")
    first, tenth = (over_random(runs[~drawn], k).groupby(new).mean() for k in (0, 9))
    label = "held-out targets, new cloths, after ten periods: distance over random commands'"
    note = f"first throw {first[True]:.2f}; recorded cloths {tenth[False]:.2f}, first throw {first[False]:.2f}"
    return [Row("transfer/held-out", label, float(tenth[True]), at_most=0.1, note=note)]


def _over_oracle(tables: Tables) -> list[Row]:
    """How near the search on the true simulator is, which knows the cloth."""
    table, search, keys = (
        tables["transfer"],
        tables["oracle_transfer"],
        ["target", "cloth"],
    )
    short = search[~search["overlap"]].set_index(keys)["best"].map(np.min)
    ratios = []
    for runs, least in (
        (
            select(table, CHOSEN, "right", new=False, least=31),
            best_possible(tables["oracle"]),
        ),
        (select(table, CHOSEN, "estimated", least=31), short),
    ):
        over = (
            runs["best"].map(late_median)
            / runs.join(least.rename("least"), on=keys)["least"]
        )
        ratios.append(over.groupby([runs["target"], runs["cloth"]]).mean().median())
    label = "the paper's cloths and targets, last ten of thirty periods: distance over the oracle's, median of them"
    note = f"new cloths over a search of three periods {ratios[1]:.2f}"
    found = Row("transfer/oracle", label, float(ratios[0]), at_most=2, note=note)
    largest = (
        search[search["overlap"]].set_index(keys)["iou"].map(np.max).rename("largest")
    )
    shapes = table[(table["method"] == CHOSEN) & (table["periods"] > 2)].join(
        largest, on=keys
    )
    share = shapes["iou"].map(np.max) / shapes["largest"]
    drawn = float(share[shapes["target"].str.startswith("drawn/")].median())
    label = "drawn and held-out targets, ten periods: best IoU over that of an oracle which searches for IoU, median"
    note = f"drawn shapes {drawn:.2f}"
    return [
        found,
        Row("transfer/iou", label, float(share.median()), at_least=0.9, note=note),
    ]


EXPERIMENTS = (
    Experiment("transfer", _run_one, _cases, seconds=6, slow=True, rows=_rows),
)
