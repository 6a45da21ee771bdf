"""Can the cloth be named without a network?

Runs that no training has seen are named by what predicts their next images best: the
network with one of nine trained p, or a regression for each of the nine cloths. What
varies is the training, and how a regression is made.
"""

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import torch

from clothlab import data
from clothlab.method.data import Run
from clothlab.weights import ClothCheckpoint
from studies._grid import Case, Experiment, grid
from studies._runs import EVALUATION, RECORDINGS, trained

_LATENT = 3  # numbers of z, which lie first in a state
_WARMED = 10  # [step] until the network's memory has settled
# Of regressions: steps of history, whether products are inputs, and the penalty
REGRESSIONS = (
    (1, False, 1.0),
    (4, False, 3.0),
    (1, True, 3.0),
    (1, True, 30.0),
    (2, True, 30.0),
    (2, True, 300.0),
)
_APART = 10.0  # times the penalty: how near a cloth's regression is to that of all


@cache
def _runs(recordings: str) -> list[Run]:
    """Recorded runs as the models of the paper's amount see them."""
    learned = trained("torque-paper-0")
    return [learned.to_run(trial) for trial in data.load_trials(recordings)]


def _run_one(
    method: str,
    model: int = 0,
    history: int = 1,
    products: bool = False,
    penalty: float = 1.0,
) -> dict[str, Any]:
    """How many of the runs have their own cloth as the best predicting one.

    Args:
        method: "p", or "regression".
        model: seed of the training.
        history: steps that a regression sees.
        products: whether it has the products of its inputs.
        penalty: of its ridge.
    """
    test = _runs(EVALUATION["torque"])
    if method == "p":
        errors = [_errors_of_p(trained(f"torque-paper-{model}"), run) for run in test]
    else:
        maps = _Regressions(_runs(RECORDINGS["torque"]), history, products, penalty)
        errors = [maps.errors(run) for run in test]
    named = [min(each, key=each.__getitem__) for each in errors]
    right = sum(name == run.material for name, run in zip(named, test, strict=True))
    return {"right": right, "runs": len(test)}


def _errors_of_p(learned: ClothCheckpoint, run: Run) -> dict[str, float]:
    """Mean squared error of the next z with each trained p."""
    s = torch.as_tensor(run.s, dtype=torch.float32)
    u = torch.as_tensor(run.u, dtype=torch.float32)
    found = {}
    for material, p in learned.biases.items():
        with torch.no_grad():
            predicted, _ = learned.model(
                s[None, :-1], u[None, :-1], torch.as_tensor(p, dtype=torch.float32)
            )
        error = (predicted[0] - s[1:])[_WARMED:, :_LATENT]
        found[material] = float((error**2).mean())
    return found


class _Regressions:
    """A ridge regression of the next state for each material.

    Each is drawn towards the one of all runs, since a material has two runs of its own.
    """

    def __init__(self, runs: list[Run], history: int, products: bool, penalty: float):
        self._history = history
        self._products = products
        s = np.concatenate([run.s for run in runs])
        u = np.concatenate([run.u for run in runs])
        self._mean = s.mean(axis=0), u.mean(axis=0)
        self._std = s.std(axis=0), u.std(axis=0)
        common = self._fit(runs, penalty, 0)
        self._maps = {}
        for material in dict.fromkeys(run.material for run in runs):
            own = [run for run in runs if run.material == material]
            self._maps[material] = self._fit(own, _APART * penalty, common)

    def _fit(
        self, runs: list[Run], penalty: float, prior: np.ndarray | float
    ) -> np.ndarray:
        pairs = [self._inputs_and_next(run) for run in runs]
        x = np.concatenate([each for each, _ in pairs])
        y = np.concatenate([each for _, each in pairs])
        left = x.T @ (y - x @ prior) if np.ndim(prior) else x.T @ y
        return prior + np.linalg.solve(x.T @ x + penalty * np.eye(x.shape[1]), left)

    def _inputs_and_next(self, run: Run) -> tuple[np.ndarray, np.ndarray]:
        """Inputs `[T, N]` from the last states and commands, and the next state."""
        s = (run.s - self._mean[0]) / self._std[0]
        u = (run.u - self._mean[1]) / self._std[1]
        both = np.concatenate([s, u], axis=1)
        k = self._history
        x = np.concatenate([both[k - 1 - i : len(both) - i] for i in range(k)], axis=1)
        if self._products:
            i, j = np.triu_indices(x.shape[1])
            x = np.concatenate([x, x[:, i] * x[:, j]], axis=1)
        x = np.concatenate([x, np.ones((len(x), 1))], axis=1)
        return x[:-1], s[k:]

    def errors(self, run: Run) -> dict[str, float]:
        """Mean squared error of the next z with the map of each material."""
        x, y = self._inputs_and_next(run)
        return {
            material: float((((x @ each) - y)[:, :_LATENT] ** 2).mean())
            for material, each in self._maps.items()
        }


def _cases(
    method: Iterable[str] = ("p", "regression"), model: int | Iterable[int] = range(5)
) -> list[Case]:
    """The network in each training, and each kind of regression."""
    cases: list[Case] = []
    if "p" in method:
        cases += grid(method="p", model=model)
    if "regression" in method:
        for history, products, penalty in REGRESSIONS:
            how = {"history": history, "products": products, "penalty": penalty}
            cases.append({"method": "regression", **how})
    return cases


EXPERIMENTS = (Experiment("naming", _run_one, _cases),)
