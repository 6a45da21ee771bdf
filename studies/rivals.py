"""Rivals beside p: what else could know what is in the hand?

One table and one figure over three robots: the cloth, an arm with a payload and
friction (notebook 16), and a real drone in wind (notebook 17). What stands beside the
estimated p is

* a network without p, trained on windows as short as those with p;
* the same with a long memory, trained on longer windows;
* a context encoder, which makes two numbers of the last steps (as in RMA);
* a last layer that is fitted to the last seconds (as Neural-Fly does with its own);
* a network that is told the true constants in place of p;
* dynamic mode decomposition with control and delays: the next state is a linear, or a
  quadratic, function of the last three states and commands, fitted by least squares.

**What was measured here** is the table `predictions`: how far a prediction of the cloth
is off after some steps of its own, with the paper's amount of recordings. The unit is a
cloth, crossed with trainings. The two decompositions know no material, and come beside
a p that is the trained one of the cloth.

**What 0.4 measured** is read from the tables `rivals`, `another_robot_rivals` and
`drone_prediction`, which were made by the code of commit 97b3ae0d, and from
`another_robot_control`.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure

from clothlab import plots
from clothlab.analysis import crossed_interval
from clothlab.data import load_table, load_trials
from clothlab.method.data import Run
from clothlab.weights import ClothCheckpoint
from studies import drone
from studies._grid import Experiment, over
from studies._runs import EVALUATION, errors_ahead, recorded_runs, trained

AHEAD = 8  # steps after which a prediction of the cloth is compared
HORIZON = 16  # steps that are predicted
_DELAYS = 3  # states and commands from which a decomposition predicts
_RIDGE = 3.0  # price of its squared weights
_FARTHEST = 6.0  # standard deviations, within which its states are kept
_EVERY = 16  # steps between starts
_FIRST = 32  # steps of memory before the first start
_WEIGHTS = "torque-paper"
# Rivals, from above
P = "estimated p"
NO_P = "no p"
MEMORY = "long memory"
ENCODER = "context encoder (RMA)"
LAST_LAYER = "last layer (Neural-Fly)"
LINEAR = "linear DMD"
QUADRATIC = "quadratic DMD"
CONSTANTS = "true constants"
RIVALS = (NO_P, MEMORY, ENCODER, LAST_LAYER, LINEAR, QUADRATIC, CONSTANTS)


# Predictions of the cloth


class Decomposition:
    """Dynamic mode decomposition with control and delays.

    The next state is linear in features of the last states and commands; their weights
    are fitted by ridge regression. All are in standard deviations of the recordings.

    Args:
        runs: recordings.
        degree: 1 for the values themselves, 2 for their products in pairs, too.
    """

    def __init__(self, runs: Sequence[Run], degree: int):
        self.degree = degree
        s = np.concatenate([run.s for run in runs])
        u = np.concatenate([run.u for run in runs])
        self.mean = s.mean(axis=0), u.mean(axis=0)
        self.std = s.std(axis=0), u.std(axis=0)

        # Each step behind the first ones is an equation
        known = []
        wanted = []
        for run in runs:
            states, commands = self._scaled(run)
            known.append(self._features(states, commands)[:-1])
            wanted.append(states[_DELAYS:])
        x = np.concatenate(known)
        square = x.T @ x + _RIDGE * np.eye(x.shape[1])
        self.weights = np.linalg.solve(square, x.T @ np.concatenate(wanted))

    def predict(self, run: Run, start: int, steps: int) -> np.ndarray:
        """States `[steps, D_s]` after a start of a run, by its commands."""
        states, commands = self._scaled(run)
        states = states[start + 1 - _DELAYS : start + 1]
        for t in range(start, start + steps):
            last = slice(t + 1 - _DELAYS, t + 1)
            features = self._features(states[-_DELAYS:], commands[last])
            following = np.clip(features @ self.weights, -_FARTHEST, _FARTHEST)
            states = np.concatenate([states, following])
        return states[_DELAYS:] * self.std[0] + self.mean[0]

    def _scaled(self, run: Run) -> tuple[np.ndarray, np.ndarray]:
        states = (run.s - self.mean[0]) / self.std[0]
        commands = (run.u - self.mean[1]) / self.std[1]
        return states, commands

    def _features(self, states: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Those of each step that has enough others before it, `[N, F]`."""
        both = np.concatenate([states, commands], axis=1)
        count = len(both) - _DELAYS + 1
        x = np.concatenate([both[k : k + count] for k in range(_DELAYS)], axis=1)
        columns = [np.ones((count, 1)), x]
        if self.degree == 2:
            first, second = np.triu_indices(x.shape[1])
            columns.append(x[:, first] * x[:, second])
        return np.concatenate(columns, axis=1)


@cache
def _decomposition(degree: int) -> Decomposition:
    return Decomposition(recorded_runs(trained(f"{_WEIGHTS}-0")), degree)


def _errors(method: str, learned: ClothCheckpoint, run: Run) -> np.ndarray:
    """Distance in z of predictions to the truth `[starts, HORIZON]`."""
    starts = range(_FIRST, len(run.s) - HORIZON - 1, _EVERY)
    if method in (LINEAR, QUADRATIC):
        model = _decomposition(2 if method == QUADRATIC else 1)
        found = []
        for start in starts:
            gap = model.predict(run, start, HORIZON)
            gap -= run.s[start + 1 : start + 1 + HORIZON]
            found.append(np.linalg.norm(gap[:, :3], axis=1))
        return np.stack(found)
    p = torch.as_tensor(learned.biases[run.material], dtype=torch.float32)
    return errors_ahead(learned.model, run, p, starts, HORIZON)


def _predict(method: str, model: int) -> dict[str, Any]:
    """Root mean square error of predictions of z, by cloth and step.

    Args:
        method: `P`, with the trained p of each cloth, `LINEAR` or `QUADRATIC`.
        model: seed of the training; 0 for the last two, which have none.
    """
    learned = trained(f"{_WEIGHTS}-{model}")
    squares: dict[str, list[np.ndarray]] = {}
    for trial in load_trials(EVALUATION["torque"]):
        run = learned.to_run(trial)
        errors = _errors(method, learned, run)
        squares.setdefault(run.material, []).append((errors**2).mean(axis=0))
    means = [np.mean(each, axis=0) for each in squares.values()]
    return {"error": np.sqrt(means).round(4)}  # [cloths, HORIZON] [s.d. of z]


def _cases(**sizes: Any) -> list[dict[str, Any]]:
    networks = over(method=P, model=range(5))(**sizes)
    if "method" in sizes:
        return networks
    return networks + over(method=(LINEAR, QUADRATIC), model=0)()


# All of them beside p


class _Question(NamedTuple):
    """How a robot was asked."""

    name: str
    unit: str
    p: np.ndarray  # errors with p [units, trainings]
    gaps: dict[str, np.ndarray]  # a rival's minus those [units, trainings]


def _minus_p(wide: pd.DataFrame, p: str, names: Mapping[str, str]) -> dict:
    """Gaps of rivals, in those trainings that they have in common with p.

    `wide` has methods and units down, and trainings across.
    """
    gaps = {}
    for rival, name in names.items():
        gap = (wide.loc[name] - wide.loc[p]).dropna(axis=1)
        gaps[rival] = gap.to_numpy()
    return gaps


def _predictions() -> _Question:
    """Predictions of the cloth."""
    table = load_table("predictions")
    errors = {}
    for method, rows in table.groupby("method", sort=False):
        found = np.stack(rows["error"])  # [trainings, cloths, horizon]
        errors[method] = found[:, :, AHEAD - 1].T
    p = errors.pop(P)
    gaps = {rival: each - p for rival, each in errors.items()}
    return _Question("cloth: prediction, 1.6 s ahead", "s.d. of z", p, gaps)


def _throws() -> _Question:
    """First throws of new cloths; memory and encoder are those of the development."""
    names = {NO_P: "without p", MEMORY: "without p, another run first, settled"}
    names |= {ENCODER: "context of 100", CONSTANTS: "told constants"}
    table = load_table("rivals")
    first = table["best"].str[0] / table["random"]
    wide = table.assign(first=first).pivot_table(
        "first", ["method", "target", "cloth"], "model"
    )
    unit = "over random commands'"
    gaps = _minus_p(wide, "p", names)
    return _Question("cloth: first throw", unit, wide.loc["p"].to_numpy(), gaps)


def _reacher(replan: bool) -> _Question:
    """Ten attempts of the arm; those of the long memory are with other materials."""
    wide = _missed("another_robot_control", replan, "method", "seed")
    names = {NO_P: "without p", ENCODER: "context encoder", CONSTANTS: "told both"}
    gaps = _minus_p(wide, "estimated p", names)
    other = _missed("another_robot_rivals", replan, "model", "goals")
    gaps |= _minus_p(other, "p", {MEMORY: "long memory"})
    how = "each step planned anew" if replan else "plan sent as it is"
    return _Question(f"arm: {how}", "cm", wide.loc["estimated p"].to_numpy(), gaps)


def _missed(name: str, replan: bool, method: str, repeat: str) -> pd.DataFrame:
    """Mean distance to the goals [cm], materials down and repeats across."""
    table = load_table(name)
    table = table[table["replan"] == replan]
    mean = 100 * table["distance"].map(np.mean)
    rows = [method, "payload", "friction"]
    return table.assign(mean=mean).pivot(index=rows, columns=repeat, values="mean")


def _drone(history: int, name: str) -> _Question:
    """Velocity of the drone, 1 s ahead; a unit is a controller."""
    names = {NO_P: drone.NO_P, MEMORY: drone.LONG_MEMORY, ENCODER: drone.CONTEXT}
    names |= {LAST_LAYER: drone.LAST_LAYER, CONSTANTS: drone.TOLD}
    table = load_table("drone_prediction")
    cell = drone.HISTORY.index(history), drone.HORIZONS.index(10)
    errors = table.assign(error=[each[cell] for each in table["velocity"]])
    wide = errors.groupby(["method", "controller"])[["error"]].mean()
    gaps = _minus_p(wide, drone.ESTIMATED, names)
    p = wide.loc[drone.ESTIMATED].to_numpy()
    return _Question(f"drone: {name}", "m/s", p, gaps)


def beside_p() -> pd.DataFrame:
    """Rivals' errors minus those with p, by question and rival.

    Columns are the unit, the mean error with p, that of the rival over the same tasks
    minus p's (positive where p is nearer), and the ends of its 95 % interval over units
    and trainings.
    """
    questions = [_predictions(), _throws(), _reacher(False), _reacher(True)]
    questions += [_drone(20, "after 2 s of memory"), _drone(0, "after a pause")]
    rows = []
    for question in questions:
        for rival in RIVALS:
            if rival not in question.gaps:
                continue
            gap, low, high = crossed_interval(question.gaps[rival])
            named = {"question": question.name, "rival": rival, "unit": question.unit}
            found = {"p": question.p.mean(), "difference": gap, "low": low}
            rows.append(named | found | {"high": high})
    return pd.DataFrame(rows).set_index(["question", "rival"])


def draw(found: pd.DataFrame) -> Figure:
    """`beside_p`, a panel for each question: right of the line, p is nearer."""
    questions = found.index.unique("question")
    figure, axes = plots.new_axes(2, 3, size=(4.4, 3.4), sharey=True)
    for ax, question in zip(axes.flat, questions, strict=True):
        rows = found.loc[question].reindex(RIVALS)
        for y, row in enumerate(rows.itertuples()):
            if np.isnan(row.difference):
                ax.text(0, y, "not measured", fontsize=9, color="0.5", va="center")
                continue
            ax.plot([row.low, row.high], [y, y], lw=2.5, color=plots.COLOURS[0])
            ax.plot(row.difference, y, "o", color=plots.COLOURS[0])
        ax.axvline(0, color="0.5", lw=0.8)
        unit = rows["unit"].dropna().iloc[0]
        ax.set_xlabel(f"error minus p's [{unit}]")
        ax.set_title(f"{question}\nwith p: {rows['p'].mean():.2f}", fontsize=11)
    axes[0, 0].set_yticks(range(len(RIVALS)), RIVALS)
    axes[0, 0].invert_yaxis()
    return figure


EXPERIMENTS = (Experiment("predictions", _predict, _cases, slow=True),)
