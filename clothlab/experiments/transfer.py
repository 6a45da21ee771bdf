"""What is p worth?

First throws with cloths that were never recorded, and with recorded ones. A plan is chosen from the recordings before
the cloth was ever thrown, and sent again and again. Distances are the best of a period in standard deviations of z,
over the median of random commands; the arm swings up in the first period, which is left out.
"""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from numpy.lib.stride_tricks import sliding_window_view
from torch import Tensor

from clothlab import artifacts
from clothlab.analysis import best_per_period, difference_interval, spread, target_distance
from clothlab.experiments import ablations
from clothlab.experiments._grid import Case, Experiment, Tables, grid
from clothlab.experiments._rows import Row
from clothlab.experiments._runs import new_trial, random_trial, recorded_runs, trained
from clothlab.learning.autoencoder import encode, iou
from clothlab.learning.control import ControlSettings
from clothlab.learning.dpmpb import observe
from clothlab.learning.estimation import NewtonSettings, estimate_bias
from clothlab.learning.fast_rollout import FastDPMPB
from clothlab.learning.trained import Trained
from clothlab.policies import Policy, ReplayPolicy
from clothlab.simulation.cloth import CLOTHS, FOAMS, SHEETS, Cloth, foam, get_cloth
from clothlab.simulation.env import ClothEnv

_PERIOD, _AHEAD = ControlSettings.period, 3  # [step] of a throw; [period] that the model looks ahead
_EXCITED = 200  # [step] of random commands from which p is estimated
_GAP = 0.3  # weight of the squared distance in p, over the spread of the trained p, from development cloths
_MATERIALS = (  # C_damp [N s/m], C_mass [kg] of cloths that no training saw: six between the trained ones, two beyond
    *((0.045, 0.07), (0.06, 0.13), (0.036, 0.11), (0.055, 0.065), (0.065, 0.085), (0.04, 0.125)),
    *((0.026, 0.055), (0.075, 0.16)),
)
_SHEETS = (("soft", 1, 7), ("soft", 2, 4), ("soft", 3, 5), ("hard", 1, 3), ("hard", 2, 1.5), ("hard", 2, 2.5))
_SHEETS = (*_SHEETS, ("hard", 3, 1.5), ("hard", 4, 2))  # kind, number, thickness [mm]
NEW = {
    "torque": [Cloth(f"damp{c}-mass{m}", damping=c, mass=m) for c, m in _MATERIALS],
    "muscle": [
        replace(foam(kind, n, replace(SHEETS[kind], thickness=t / 1e3)), name=f"{kind}-{n}-{t}mm")
        for kind, n, t in _SHEETS
    ],
}
_BY_NAME = {cloth.name: cloth for cloths in NEW.values() for cloth in cloths}
TARGETS = {"torque": ("target-1", "target-2"), "muscle": ("muscle",)}
BIASES = ("right", "estimated", "nearest", "farthest", "zero", "none")
METHODS = (
    *("replay, this cloth", "replay, any other cloth", "replay, nearest p", "predicted", "anchored"),
    *(f"both, {p}" for p in BIASES),
    *("paper's controller", "periodic warm start"),
)


class Throws(NamedTuple):
    """Recorded stretches of commands, and what came of them."""

    u: Tensor  # [N, T, D_u]
    seen: np.ndarray  # the nearest that the cloth came to the target [N] [s.d. of z]
    z: Tensor  # what was seen after each command [N, T, D_z]
    material: np.ndarray  # names [N]


@cache
def _throws(weights: str, target: str, from_each: int = 4) -> Throws:
    """The best stretches of each recorded run, hardly overlapping."""
    learned, found = trained(weights), []
    z_ref = encode(learned.autoencoder, artifacts.load_target(target))
    for run in recorded_runs(learned):
        z = sliding_window_view(run.s[1:, : len(z_ref)], _PERIOD, axis=0).transpose(0, 2, 1)
        distance = np.linalg.norm(z - z_ref, axis=2).min(axis=1)
        left = distance.copy()
        for _ in range(from_each):
            k = int(left.argmin())
            found.append((run.u[k : k + _PERIOD], distance[k], z[k], run.material))
            left[max(0, k - _PERIOD // 2) : k + _PERIOD // 2] = np.inf
    u, seen, z, material = (np.array(column) for column in zip(*found, strict=True))
    limits = (torch.as_tensor(each) for each in (learned.arm.command_lower, learned.arm.command_upper))
    return Throws(torch.as_tensor(u).clamp(*limits).float(), seen, torch.as_tensor(z), material)


@cache
def _hanging(weights: str, cloth: str) -> Tensor:
    """The state of a cloth that hangs still."""
    learned = trained(weights)
    with closing(ClothEnv(learned.arm, _cloth(cloth))) as env:
        env.start()
        return torch.as_tensor(observe(learned.autoencoder, env.observe()))


@torch.no_grad()
def _predicted(learned: Trained, s: Tensor, u: Tensor, p: np.ndarray) -> Tensor:
    """z after each command of plans that are sent again and again, `[N, periods, T, D_z]`."""
    predict = FastDPMPB(learned.model, torch.as_tensor(p, dtype=torch.float32))
    states = predict(s, u.repeat(1, _AHEAD, 1), learned.model.initial_memory())
    return states[..., learned.layout.z].unflatten(1, (_AHEAD, _PERIOD))


def _cost(z: Tensor, z_ref: Tensor) -> np.ndarray:
    """Mean over periods of the squared distance of the best step `[N]`, of z `[N, periods, T, D_z]`."""
    return (z - z_ref).square().sum(-1).amin(2).mean(1).numpy()


def _gaps(throws: Throws, p: np.ndarray, biases: dict[str, np.ndarray]) -> np.ndarray:
    """Squared distance of `p` to that of each throw's material, over the spread of all `[N]`."""
    own = np.array([biases[name] for name in throws.material])
    return np.square(own - p).sum(1) / spread(biases) ** 2 if own.shape[1] else np.zeros(len(own))


def choose_throw(learned: Trained, throws: Throws, s: Tensor, z_ref: Tensor, p: np.ndarray) -> int:
    """The throw that came near with a material like this one, and that the model says comes near from here."""
    cost = _cost(_predicted(learned, s, throws.u, p), z_ref)
    return int((cost + throws.seen**2 + _GAP * _gaps(throws, p, learned.biases)).argmin())


def _anchored(learned: Trained, throws: Throws, s: Tensor, z_ref: Tensor, p: np.ndarray) -> int:
    """Chosen by what was seen, and by how the prediction changes with p: errors common to both cancel."""
    change = _predicted(learned, s, throws.u, p)
    for name, own in learned.biases.items():
        chosen = np.flatnonzero(throws.material == name)
        change[chosen] -= _predicted(learned, s, throws.u[chosen], own)
    return int((_cost(throws.z[:, None] + change, z_ref) + _GAP * _gaps(throws, p, learned.biases)).argmin())


@cache
def _estimate(weights: str, cloth: str, seed: int) -> np.ndarray:
    """p from 40 s of random commands."""
    learned = trained(weights)
    run = learned.sequences(random_trial(learned.arm.name, _cloth(cloth), _EXCITED, seed))
    return estimate_bias(learned.model, run, settings=NewtonSettings())[0]


@cache
def _without_p(arm: str, model: int) -> Trained:
    return ablations.train("none", arm, model)


def _cloth(name: str) -> Cloth:
    return _BY_NAME[name] if name in _BY_NAME else get_cloth(name)


def _biases(learned: Trained, cloth: str, seed: int) -> dict[str, np.ndarray]:
    """The p to try, by kind; a cloth that was never recorded has no right one."""
    right = learned.biases.get(cloth)
    estimated = _estimate(learned.name, cloth, seed)
    centre = estimated if right is None else right
    others = {name: p for name, p in learned.biases.items() if name != cloth}
    by_distance = sorted(others.values(), key=lambda p: float(np.linalg.norm(p - centre)))
    found = {"estimated": estimated, "nearest": by_distance[0], "farthest": by_distance[-1], "zero": 0 * estimated}
    return found if right is None else {"right": right} | found


def _run_first(arm: str, target: str, cloth: str, model: int, repeat: int, steps: int = 32) -> dict[str, Any]:
    """Distance [s.d. of z] and IoU of the best step of each period but the first, `[METHODS, P]`."""
    weights, seed = f"{arm}-{model}", 50_000 + 100 * model + repeat
    learned, mask = trained(weights), artifacts.load_target(target)
    z_ref, throws, s = (
        torch.as_tensor(encode(learned.autoencoder, mask)),
        _throws(weights, target),
        _hanging(weights, cloth),
    )
    tried, chosen = _biases(learned, cloth, seed), {}
    pick = {"this cloth": throws.material == cloth, "any other cloth": throws.material != cloth}
    gaps = _gaps(throws, tried["estimated"], learned.biases) + 1e9 * (throws.material == cloth)
    pick["nearest p"] = gaps <= gaps.min() + 1e-9
    for name, among in pick.items():
        if among.any():
            chosen[f"replay, {name}"] = int(np.where(among, throws.seen, np.inf).argmin())
    chosen["predicted"] = int(_cost(_predicted(learned, s, throws.u, tried["estimated"]), z_ref).argmin())
    chosen["anchored"] = _anchored(learned, throws, s, z_ref, tried["estimated"])
    chosen |= {f"both, {kind}": choose_throw(learned, throws, s, z_ref, p) for kind, p in tried.items()}
    blind = _without_p(arm, model)
    chosen["both, none"] = choose_throw(blind, throws, s, z_ref, np.zeros(blind.model.bias_size))
    policies: dict[str, Policy] = {
        name: ReplayPolicy(np.tile(throws.u[k].double().numpy(), (-(-steps // _PERIOD), 1)))
        for name, k in chosen.items()
    }
    p, periodic = tried.get("right", tried["estimated"]), ControlSettings(warm_start="periodic")
    policies |= {METHODS[-2]: learned.controller(mask, p), METHODS[-1]: learned.controller(mask, p, periodic)}
    found = {"distance": np.full((len(METHODS), steps // _PERIOD - 1), np.nan)}
    found["iou"] = found["distance"].copy()
    thrown: dict[Any, Any] = {}
    for k, name in enumerate(METHODS):
        if name in policies:
            key = chosen.get(name, name)
            if key not in thrown:
                trial = new_trial(policies[name], learned.arm, _cloth(cloth), steps, seed)
                best = 1 - best_per_period(1 - iou(trial.images, mask))
                thrown[key] = best_per_period(target_distance(learned.autoencoder, trial, mask)), best
            found["distance"][k], found["iou"][k] = (each.round(4) for each in thrown[key])
    return found | {"random": _by_chance(weights, target, cloth, seed)}


@cache
def _by_chance(weights: str, target: str, cloth: str, seed: int, steps: int = 248) -> float:
    """Median of the best distance of a period under random commands."""
    learned = trained(weights)
    trial = _random_run(learned.arm.name, cloth, seed, steps)
    return float(np.median(best_per_period(target_distance(learned.autoencoder, trial, artifacts.load_target(target)))))


@cache
def _random_run(arm: str, cloth: str, seed: int, steps: int) -> Any:
    return random_trial(arm, _cloth(cloth), steps, seed)


def _cases(model: Iterable[int] = range(5), repeat: Iterable[int] = range(4), **same: Any) -> list[Case]:
    """New and recorded cloths of both arms."""
    found = []
    for arm, cloths in {"torque": CLOTHS, "muscle": FOAMS}.items():
        names = [*(cloth.name for cloth in NEW[arm]), *cloths]
        found += grid(arm=arm, target=TARGETS[arm], cloth=names, model=model, repeat=repeat, **same)
    return found


def over_random(table: pd.DataFrame, method: str, period: int = 0) -> pd.Series:
    """Distance in a period over that of random commands; the first one is 0."""
    return table["distance"].map(lambda distance: distance[METHODS.index(method)][period]) / table["random"]


def difference(table: pd.DataFrame, first: str, second: str) -> tuple[float, float, float]:
    """First throws of one method minus another's, over random commands: mean over cloths and targets, 95 % interval."""
    gap = table.assign(gap=over_random(table, first) - over_random(table, second))
    return difference_interval(gap.groupby(["model", "repeat"])["gap"].mean().unstack().to_numpy())


def _rows(tables: Tables) -> list[Row]:
    """Means over cloths, targets, trainings and runs."""
    table, found, best = tables["transfer"], [], "both, estimated"
    for arm, runs in table.groupby("arm", sort=False):
        new = runs[runs["cloth"].isin(_BY_NAME)]
        where = f"{arm} arm, {new['cloth'].nunique()} new cloths, first throw"
        mean = {method: float(over_random(new, method).mean()) for method in METHODS[1:]}
        label = f"{where}: distance over random commands', recorded throw that is near and predicted to be near"
        note = "; ".join(f"{name} {mean[name]:.2f}" for name in ("predicted", "anchored", *METHODS[-2:]))
        found.append(Row(f"transfer/{arm}/first", label, mean[best], at_most=0.25, note=note))
        for p, bounds in {"farthest": {"at_most": -0.25}, "nearest": {}, "zero": {}, "none": {}}.items():
            value, low, high = difference(new, best, f"both, {p}")
            label, key = f"{where}: estimated p minus {_NAMES[p]}", f"transfer/{arm}/{p}"
            found.append(Row(key, label, value, interval=(low, high), paper="Correct better", below=0.0, **bounds))
        over = mean[best] / mean["replay, any other cloth"]
        label = f"{where}: over replay of the nearest recording of another cloth"
        found.append(Row(f"transfer/{arm}/replay", label, over, at_most=0.5))
        known = over_random(runs[~runs["cloth"].isin(_BY_NAME)], "both, right").mean()
        label = f"{arm} arm, recorded cloths, first throw: distance over random commands'"
        found.append(Row(f"transfer/{arm}/recorded", label, float(known), at_most=0.06))
    return found


_NAMES = {"farthest": "the farthest", "nearest": "the nearest trained", "zero": "p = 0", "none": "a model without p"}
EXPERIMENTS = (Experiment("transfer", _run_first, _cases, seconds=6, slow=True, rows=_rows),)
