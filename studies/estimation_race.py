"""How soon does each rule find p? Momentum SGD and Gauss-Newton, both tuned.

Both see the same runs and start at p = 0. `estimation_tuning` tries their settings on
development runs that no other table uses; `estimation_race` shows the chosen ones on
other runs, and what the curvature alone says of how sure the estimate is.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from clothlab.analysis import spread
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.data import Run
from clothlab.method.estimation import EstimationSettings
from clothlab.method.gauss_newton import (
    Linearisation,
    NewtonEstimator,
    NewtonSettings,
    best_bias,
)
from clothlab.method.model import PredictiveModel
from clothlab.simulation.cloth import CLOTHS
from studies._grid import Experiment, grid, over
from studies._runs import random_trial, trained

MOMENTS = (25, 50)  # steps after which settings are judged: 5 s and 10 s
LOOKS = (25, 50, 100)  # steps after which an estimate says how sure it is
_LOST = 99.0  # spreads; a rule that diverges is so far away
SGD_GRID = grid(
    rate=(0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0),
    momentum=(0.0, 0.5, 0.7, 0.9),
    warmup=(0, 10),
)
NEWTON_GRID = grid(freedom=(3.0, 10.0, 1e6), longest=(0.5, 1.0), warmup=(0, 10))

# "as in 06" is what the package has. Each other rule has the settings of its grid, with
# this warm-up, whose median distances at both moments have the lowest sum over the
# development runs.
RULES: dict[str, dict[str, Any]] = {
    "sgd, as in 06": {"rate": 0.1, "momentum": 0.9, "warmup": 10},
    "sgd, tuned, warm-up 10": {"rate": 16.0, "momentum": 0.0, "warmup": 10},
    "sgd, tuned": {"rate": 16.0, "momentum": 0.7, "warmup": 0},
    "newton, warm-up 10": {"freedom": 3.0, "longest": 0.5, "warmup": 10},
    "newton": {"freedom": 10.0, "longest": 0.5, "warmup": 0},
    "newton, all errors alike": {"freedom": 1e6, "longest": 0.5, "warmup": 0},
}


def _recorded(learned: ClothCheckpoint, cloth: str, steps: int, seed: int) -> Run:
    """A run with random commands, as the model sees it."""
    return learned.to_run(random_trial(learned.arm.name, cloth, steps, seed))


def descend(
    model: PredictiveModel, run: Run, settings: Sequence[EstimationSettings]
) -> np.ndarray:
    """Momentum SGD with many settings at once: p after each step `[C, T, D_p]`."""
    s = torch.as_tensor(run.s)
    u = torch.as_tensor(run.u)
    rate = torch.tensor([[each.rate] for each in settings])
    momentum = torch.tensor([[each.momentum] for each in settings])
    warmup = torch.tensor([[each.warmup] for each in settings])

    p = torch.zeros(len(settings), model.bias_size)
    buffer = torch.zeros_like(p)
    path = []
    for t in range(len(run)):
        if t > 0:
            buffer = momentum * buffer + _gradient(model, s[: t + 1], u, p, warmup)
            p = p - rate * buffer
        path.append(p.numpy())
    return np.stack(path, axis=1)


def _gradient(
    model: PredictiveModel, s: Tensor, u: Tensor, p: Tensor, warmup: Tensor
) -> Tensor:
    """The gradient of each loss by its own p, `[C, D_p]`; zero within its warm-up."""
    # Which predictions count, and how much each `[C, T]`
    steps = torch.arange(len(s) - 1)
    counted = (steps >= warmup) / (len(steps) - warmup).clamp(min=1)

    p = p.clone().requires_grad_()
    before = s[:-1].expand(len(p), -1, -1)
    sent = u[: len(s) - 1].expand(len(p), -1, -1)
    predicted, _ = model(before, sent, p)
    squared = ((predicted - s[1:]) / model.s_std).square().mean(dim=2)
    (gradient,) = torch.autograd.grad((counted * squared).sum(), p)
    return gradient


def _newton_path(
    model: PredictiveModel, run: Run, freedom: float, longest: float, warmup: int
) -> np.ndarray:
    """Gauss-Newton: p after each step `[T, D_p]`."""
    settings = NewtonSettings(freedom=freedom, longest=longest, warmup=int(warmup))
    estimator = NewtonEstimator(model, settings=settings, from_rest=warmup == 0)
    path = [estimator.update(s, u) for s, u in zip(run.s, run.u, strict=True)]
    return np.stack(path)


def _distance(path: np.ndarray, learned: ClothCheckpoint, cloth: str) -> np.ndarray:
    """Distance of p `[..., D_p]` to the trained one [spreads]."""
    gap = np.linalg.norm(path - learned.biases[cloth], axis=-1)
    return np.nan_to_num(gap / spread(learned.biases), nan=_LOST).clip(max=_LOST)


def _tune_one(
    cloth: str, model: int, weights: str = "torque", steps: int = MOMENTS[-1]
) -> dict[str, Any]:
    """All settings of both rules on one development run.

    Args:
        cloth: in the hand, by name.
        model: seed of the training.
        weights: name of the training.
        steps: control steps.

    Returns: the settings, each `[C]`, and the distance of p to the trained one
        [spreads] after each of `MOMENTS`, `[C, 2]`; those of Gauss-Newton are called
        `newton_...`.
    """
    learned = trained(f"{weights}-{model}")
    seed = 47_000 + 20 * model + [*CLOTHS].index(cloth)
    run = _recorded(learned, cloth, steps, seed)
    moments = [min(moment, steps) - 1 for moment in MOMENTS]

    paths = descend(
        learned.model, run, [EstimationSettings(**each) for each in SGD_GRID]
    )
    row = {key: np.array([each[key] for each in SGD_GRID]) for key in SGD_GRID[0]}
    row["distance"] = _distance(paths[:, moments], learned, cloth).round(3)

    paths = np.stack([_newton_path(learned.model, run, **each) for each in NEWTON_GRID])
    for key in NEWTON_GRID[0]:
        row[f"newton_{key}"] = np.array([each[key] for each in NEWTON_GRID])
    row["newton_distance"] = _distance(paths[:, moments], learned, cloth).round(3)
    return row


def _race_one(
    cloth: str,
    model: int,
    repeat: int = 0,
    weights: str = "torque",
    steps: int = LOOKS[-1],
) -> dict[str, Any]:
    """The rules of `RULES` on one test run.

    Args:
        cloth: in the hand, by name.
        model: seed of the training.
        repeat: number of the run; each has other random commands.
        weights: name of the training.
        steps: control steps.

    Returns: for each rule the distance of p to the trained one after each step `[T]`
        [spreads]; after each of `LOOKS`, the p of the lowest loss as `estimate`
        `[N, D_p]` and, if all errors were independent and equally large, its
        `covariance`.
    """
    learned = trained(f"{weights}-{model}")
    seed = 48_000 + 100 * model + 20 * repeat + [*CLOTHS].index(cloth)
    run = _recorded(learned, cloth, steps, seed)

    # How far away each rule is, until the last of `MOMENTS`
    start = run[: MOMENTS[-1]]
    row: dict[str, Any] = {}
    for name, settings in RULES.items():
        if name.startswith("sgd"):
            (path,) = descend(learned.model, start, [EstimationSettings(**settings)])
        else:
            path = _newton_path(learned.model, start, **settings)
        row[name] = _distance(path, learned, cloth).round(3)

    # How sure the curvature is
    looks = [
        best_bias(learned.model, run[:count], learned.biases[cloth])
        for count in LOOKS
        if count <= steps
    ]
    row["estimate"] = np.array([p for p, _ in looks]).round(4)
    row["covariance"] = np.array([_plain_covariance(fit) for _, fit in looks]).round(8)
    return row


def _plain_covariance(fit: Linearisation) -> np.ndarray:
    """Variance of the errors times the inverse of JᵀJ, `[D_p, D_p]`."""
    jacobian = fit.jacobian.reshape(-1, fit.jacobian.shape[-1])
    return fit.loss * np.linalg.inv(jacobian.T @ jacobian)


EXPERIMENTS = (
    Experiment(
        "estimation_tuning", _tune_one, over(cloth=CLOTHS, model=range(3)), seconds=3
    ),
    Experiment(
        "estimation_race",
        _race_one,
        over(cloth=CLOTHS, model=range(5), repeat=range(1)),
        seconds=5,
    ),
)
