"""Which method finds C_damp and C_mass of a cloth, and how soon?

What varies is the method and the cloth: p read off by a smooth map, a fitted simulation
with the true springs and with rough ones, as a whole or in windows, or a trained
network.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from clothlab.method.data import Run
from clothlab.method.gauss_newton import estimate_bias
from clothlab.simulation.cloth import CLOTHS, DAMPINGS, MASSES, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from studies._grid import Case, Experiment, Tables, over, shared
from studies._rows import Row
from studies._runs import random_trial, recorded_runs, trained
from studies.estimation import BETWEEN, MaterialReadout
from studies.identifiability import PREDICTED, QUANTITIES, bounds
from studies.sysid import (
    Regressor,
    fit_simulation,
    logs,
    simulator,
    train_regressor,
    windowed_simulator,
)

_ARM = "torque"
_OUTSIDE = {  # the trained range, by a factor of 1.5
    "outside-light": Cloth(
        "outside-light", damping=DAMPINGS[0] / 1.5, mass=MASSES[0] / 1.5
    ),
    "outside-heavy": Cloth(
        "outside-heavy", damping=DAMPINGS[-1] * 1.5, mass=MASSES[-1] * 1.5
    ),
}
_GROUPS = {"trained": CLOTHS, "between": BETWEEN, "outside": _OUTSIDE}
_ALL = CLOTHS | BETWEEN | _OUTSIDE
# Too soft in stretch and too stiff in bending
_ROUGH = Cloth("rough", stiffness=0.7 * Cloth.stiffness, bending=1.5 * Cloth.bending)

# Cloths on which windows are tried, the slowest method: the middle one, those with the
# least and the largest ratio, and both outside
_WINDOWED = ("damp0.05-mass0.10", "damp0.03-mass0.15", "damp0.07-mass0.05", *_OUTSIDE)

_Identify = Callable[[Run], np.ndarray]  # a run → (log C_damp, log C_mass)


def _by_p(model: int, method: str = "newton") -> _Identify:
    """p, estimated online from 0, and read off by a smooth map."""
    learned = trained(f"{_ARM}-{model}")
    readout = MaterialReadout.fit(learned.biases, CLOTHS)

    def identify(run: Run) -> np.ndarray:
        p, _ = estimate_bias(learned.model, run, method=method)
        return np.log(readout(p))

    return identify


def _by_momentum(model: int) -> _Identify:
    """The same with the paper's gradient descent."""
    return _by_p(model, "sgd")


def _by_fit(model: int, cloth: Cloth | None = None) -> _Identify:
    """The simulation, fitted to the same states that the model sees.

    Each state counts in its standard deviation.
    """
    learned = trained(f"{_ARM}-{model}")

    def identify(run: Run) -> np.ndarray:
        with simulator(learned.arm, learned.autoencoder, cloth) as simulate:
            return fit_simulation(simulate, run, learned.model.s_std.numpy())

    return identify


def _by_rough_fit(model: int) -> _Identify:
    """The same with springs that are wrong."""
    return _by_fit(model, _ROUGH)


def _by_windows(model: int) -> _Identify:
    """The simulation with the true springs, fitted to windows of a run.

    The coarse search sees the same start of a run each time, and is made once.
    """
    learned = trained(f"{_ARM}-{model}")
    known: dict[tuple[bytes, bytes], np.ndarray] = {}

    def identify(run: Run) -> np.ndarray:
        with windowed_simulator(learned.arm, learned.autoencoder) as simulate:

            def simulate_once(constants: np.ndarray, part: Run) -> np.ndarray:
                key = (constants.tobytes(), part.s.tobytes())
                if key not in known:
                    known[key] = simulate(constants, part)
                return known[key]

            return fit_simulation(simulate_once, run, learned.model.s_std.numpy())

    return identify


def _by_network(model: int) -> _Identify:
    return _network(model).identify


@shared
def _network(model: int) -> Regressor:
    """A network trained on the constants of the cloths, and the model's recordings."""
    runs = recorded_runs(trained(f"{_ARM}-{model}"))
    constants = {name: logs(cloth) for name, cloth in CLOTHS.items()}
    network, _ = train_regressor(runs, constants, seed=model)
    return network


_METHODS: dict[str, Callable[[int], _Identify]] = {  # by the number of a training
    "p": _by_p,
    "p by momentum": _by_momentum,
    "sysid": _by_fit,
    "sysid-rough": _by_rough_fit,
    "sysid-windows": _by_windows,
    "network": _by_network,
}


@lru_cache(maxsize=2)
def _sensed(cloth: str, model: int, steps: int) -> Run:
    """A run with random commands, the same for all methods, without a cloth's name."""
    seed = 31_000 + 100 * model + [*_ALL].index(cloth)
    trial = random_trial(_ARM, _ALL[cloth], steps, seed)
    run = trained(f"{_ARM}-{model}").to_run(trial)
    return replace(run, material="unknown")


def _run_one(method: str, cloth: str, model: int, steps: int = 200) -> dict[str, Any]:
    """Errors of log C_damp and log C_mass `[4, 2]`.

    After an eighth, a quarter, half and all of a run.
    """
    identify = _METHODS[method](model)
    run = _sensed(cloth, model, steps)
    right = logs(_ALL[cloth])
    counts = steps // np.array([8, 4, 2, 1])
    missed = np.array([identify(run[:count]) - right for count in counts])
    return {
        "group": next(group for group, cloths in _GROUPS.items() if cloth in cloths),
        "time": counts * CONTROL_PERIOD,
        "error": missed.round(5),
    }


def errors(table: pd.DataFrame, quantity: str) -> np.ndarray:
    """Absolute errors of the logarithm of one of `QUANTITIES`, `[rows, times]`."""
    return np.abs(np.stack([*table["error"]]) @ QUANTITIES[quantity])


def error_gaps(
    table: pd.DataFrame, first: tuple[str, int], second: tuple[str, int], quantity: str
) -> np.ndarray:
    """How much larger one error of a logarithm is than another, `[cloths, trainings]`.

    Args:
        table: rows of `sysid_benchmark`, of the cloths that count.
        first: a method, and the place of its time in `time`.
        second: another one; cloths that one of them lacks are left out.
        quantity: one of `QUANTITIES`.
    """

    def missed(method: str, time: int) -> pd.DataFrame:
        runs = table[table["method"] == method]
        of_time = runs.assign(missed=errors(runs, quantity)[:, time])
        return of_time.pivot(index="cloth", columns="model", values="missed")

    mine = missed(*first)
    other = missed(*second)

    # A fitted simulation has one training, with which all others are compared
    alone = other.shape[1] == 1
    gaps = mine.sub(other.iloc[:, 0], axis=0) if alone else mine - other
    return gaps.dropna().to_numpy()


def over_bound(
    table: pd.DataFrame, identifiability: pd.DataFrame, sensors: str, quantity: str
) -> np.ndarray:
    """Errors in the end over the Cramér-Rao bounds of the same cloths.

    The bounds are those under random commands; cloths that have none are left out.

    Args:
        table: rows of one method.
        identifiability: the stored table.
        sensors: that an observer has.
        quantity: one of `QUANTITIES`.
    """
    at_random = identifiability[identifiability.motion == "random"]
    known = bounds(at_random, sensors)
    end = table["time"].iloc[0][-1]
    by_cloth = known[known.time == end].groupby("cloth")[quantity].median()
    ratios = errors(table, quantity)[:, -1] / table.cloth.map(by_cloth).to_numpy()
    return ratios[~np.isnan(ratios)]


def _cases(**sizes: Any) -> list[Case]:
    """Every cloth with every training by every method.

    Fitting a simulation takes minutes, and has one training; in windows, a few cloths.
    """
    cases = []
    for case in over(cloth=_ALL, model=range(5), method=_METHODS)(**sizes):
        if case["method"] == "sysid-windows" and case["cloth"] not in _WINDOWED:
            continue
        if case["model"] == 0 or not case["method"].startswith("sysid"):
            cases.append(case)
    return cases


_RATIO = "C_damp / C_mass"  # on which alone the motion of a free point in air depends


def _rows(tables: Tables) -> list[Row]:
    """How far p is from the bound, and how the methods compare."""
    table = tables["sysid_benchmark"]
    rows = [_bound_row(table, tables["identifiability"])]
    for method in ("p", "sysid", "sysid-windows", "network"):
        rows.append(_method_row(table, method))
    return rows


def _bound_row(table: pd.DataFrame, identifiability: pd.DataFrame) -> Row:
    """Errors of p over what an observer could know at best."""
    by_p = table[table.method == "p"]
    over_network = over_bound(by_p, identifiability, PREDICTED, _RATIO)
    end = table["time"].iloc[0][-1]
    return Row(
        "sysid_benchmark/over-bound",
        f"p after {end:g} s: error of {_RATIO} over the Cramér-Rao bound of an "
        "observer who predicts as the network, median",
        float(np.median(over_network)),
        at_most=3,
    )


def _method_row(table: pd.DataFrame, method: str) -> Row:
    """Errors of a method on trained cloths after the longest time."""
    runs = table[(table.group == "trained") & (table.method == method)]
    end = table["time"].iloc[0][-1]
    return Row(
        f"sysid_benchmark/{method}",
        f"{method}: median error of {_RATIO} after {end:g} s, "
        f"{runs['cloth'].nunique()} cloths",
        100 * float(np.median(errors(runs, _RATIO)[:, -1])),
        " %",
    )


_ABOUT = """
Which method finds C_damp and C_mass of a cloth, and how soon?

p is compared with the simulation fitted by `mujoco.sysid`, with the true springs, with
springs 30 % too soft in stretch and 50 % too stiff in bending, and in windows of 2 s
(multiple shooting, five cloths), and with a network trained on the constants of the
recorded cloths. All get the same runs with random commands, without the name of the
cloth.
"""
EXPERIMENTS = (
    Experiment(
        "sysid_benchmark",
        _run_one,
        _cases,
        seconds=30,
        slow=True,
        rows=_rows,
        about=_ABOUT,
    ),
)
