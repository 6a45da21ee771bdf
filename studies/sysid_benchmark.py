"""Which method finds C_damp and C_mass of a cloth, and how soon?

p is compared with the simulation fitted by `mujoco.sysid`, once with the true springs
and once with springs 30 % too soft in stretch and 50 % too stiff in bending, and with a
network trained on the constants of the recorded cloths. All get the same runs with
random commands, without the name of the cloth.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pandas as pd

from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias
from clothlab.simulation.cloth import CLOTHS, DAMPINGS, MASSES, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from studies._grid import Case, Experiment, Tables, over, shared
from studies._rows import Row
from studies._runs import random_trial, recorded_runs, trained
from studies.estimation import BETWEEN, MaterialReadout
from studies.identifiability import PREDICTED, QUANTITIES, bounds
from studies.sysid import Regressor, fit_simulation, logs, simulator, train_regressor

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
_ROUGH = Cloth("rough", stiffness=0.7 * Cloth.stiffness, bending=1.5 * Cloth.bending)

_Identify = Callable[[Run], np.ndarray]  # a run → (log C_damp, log C_mass)


def _by_p(model: int, rule: str = "newton") -> _Identify:
    """p, estimated online from 0, and read off by a smooth map fitted to the trained
    cloths.
    """
    learned = trained(f"{_ARM}-{model}")
    readout = MaterialReadout.fit(learned.biases, CLOTHS)
    return lambda run: np.log(
        readout(estimate_bias(learned.model, run, method=rule)[0])
    )


def _by_fit(model: int, cloth: Cloth | None = None) -> _Identify:
    """The simulation, fitted to the same states that the model sees, each in its
    standard deviation.
    """
    learned = trained(f"{_ARM}-{model}")

    def identify(run: Run) -> np.ndarray:
        with simulator(learned.arm, learned.autoencoder, cloth) as simulate:
            return fit_simulation(simulate, run, learned.model.s_std.numpy())

    return identify


@shared
def _network(model: int) -> Regressor:
    """A network trained on the same recordings as the model and the constants of their
    cloths.
    """
    constants = {name: logs(cloth) for name, cloth in CLOTHS.items()}
    return train_regressor(
        recorded_runs(trained(f"{_ARM}-{model}")), constants, seed=model
    )[0]


_METHODS: dict[str, Callable[[int], _Identify]] = {  # by the number of a training
    "p": _by_p,
    "p by momentum": partial(_by_p, rule="sgd"),
    "sysid": _by_fit,
    "sysid-rough": partial(_by_fit, cloth=_ROUGH),
    "network": lambda model: _network(model).identify,
}


@lru_cache(maxsize=2)
def _sensed(cloth: str, model: int, steps: int) -> Run:
    """A run with random commands, the same for all methods, without the name of the
    cloth.
    """
    seed = 31_000 + 100 * model + [*_ALL].index(cloth)
    run = trained(f"{_ARM}-{model}").to_run(
        random_trial(_ARM, _ALL[cloth], steps, seed)
    )
    return replace(run, material="unknown")


def _run_one(method: str, cloth: str, model: int, steps: int = 200) -> dict[str, Any]:
    """Errors of log C_damp and log C_mass after an eighth, a quarter, half and all of a
    run `[4, 2]`.
    """
    identify, run = _METHODS[method](model), _sensed(cloth, model, steps)
    counts = steps // np.array([8, 4, 2, 1])
    return {
        "group": next(group for group, cloths in _GROUPS.items() if cloth in cloths),
        "time": counts * CONTROL_PERIOD,
        "error": np.array(
            [identify(run[:count]) - logs(_ALL[cloth]) for count in counts]
        ).round(5),
    }


def errors(table: pd.DataFrame, quantity: str) -> np.ndarray:
    """Absolute errors of the logarithm of one of `QUANTITIES`, `[rows, times]`."""
    return np.abs(np.stack([*table["error"]]) @ QUANTITIES[quantity])


def over_bound(
    table: pd.DataFrame, identifiability: pd.DataFrame, sensors: str, quantity: str
) -> np.ndarray:
    """Errors in the end over the Cramér-Rao bounds of the same cloths under random
    commands, where there are any.
    """
    known = bounds(identifiability[identifiability.motion == "random"], sensors)
    known = (
        known[known.time == table["time"].iloc[0][-1]]
        .groupby("cloth")[quantity]
        .median()
    )
    ratios = errors(table, quantity)[:, -1] / table.cloth.map(known).to_numpy()
    return ratios[~np.isnan(ratios)]


def _cases(**sizes: Any) -> list[Case]:
    """Every cloth with every training by every method; fitting a simulation takes
    minutes, and has one training.
    """
    every = over(cloth=_ALL, model=range(5), method=_METHODS)(**sizes)
    return [
        case
        for case in every
        if case["model"] == 0 or not case["method"].startswith("sysid")
    ]


def _rows(tables: Tables) -> list[Row]:
    """How far p is from the bound, and how the methods compare."""
    table, ratio, found = tables["sysid_benchmark"], "C_damp / C_mass", []
    start, *_, end = table["time"].iloc[0]
    limits = [
        float(
            np.median(
                over_bound(
                    table[table.method == "p"],
                    tables["identifiability"],
                    sensors,
                    ratio,
                )
            )
        )
        for sensors in (PREDICTED, "z + joints")
    ]
    label = f"p after {end:g} s: error of {ratio} over the Cramér-Rao bound of an observer who predicts as the network"
    note = f"of one who knows the simulator {limits[1]:.2f}"
    found.append(
        Row(
            "sysid_benchmark/over-bound",
            f"{label}, median",
            limits[0],
            at_most=3,
            note=note,
        )
    )
    for method in ("p", "sysid", "network"):
        runs = table[(table.group == "trained") & (table.method == method)]
        early, late = 100 * np.median(errors(runs, ratio)[:, [0, -1]], axis=0)
        label, note = (
            f"{method}: median error of {ratio} after {end:g} s",
            f"{early:.1f} % after {start:g} s",
        )
        found.append(Row(f"sysid_benchmark/{method}", label, late, " %", note=note))
    return found


EXPERIMENTS = (
    Experiment("sysid_benchmark", _run_one, _cases, seconds=30, slow=True, rows=_rows),
)
