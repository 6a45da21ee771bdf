"""Training W and one p for each material together (paper, eqs. 3 and 4).

There is one model for all materials, and nobody tells it what a material is like. p of
each material starts at zero and follows the gradient of the same loss as W: what
the weights can't explain, since it differs between materials, goes into p. The paper
has a p for each trial; here all runs of one material share one. Each window of a run is
predicted from an empty memory, each next state from the true ones.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.optim import Adam
from torch.optim.lr_scheduler import CosineAnnealingLR
from tqdm.auto import trange

from clothlab.method.data import (
    Run,
    check_fits,
    check_run,
    materials_of,
    set_normalisation,
    windows,
)
from clothlab.method.model import DPMPB, usual_torch


@dataclass(frozen=True)
class ModelTraining:
    """How W and p are trained together; the defaults are the paper's for simulation."""

    epochs: int = 300
    batch_size: int = 300  # windows
    sequence_length: int = 30  # steps, LSTM expansions
    bias_size: int = 2  # D_p, smaller than the number of materials

    # The paper says no more; what follows is ours. Windows overlap, so that an epoch
    # has more updates: side by side, 300 epochs learn too little. Learning rates fall
    # to zero along a cosine.
    stride: int = 5  # steps between the starts of two windows
    learning_rate: float = 2e-3
    bias_learning_rate: float = 6e-3


@usual_torch()
def train_dpmpb(
    runs: Sequence[Run],
    settings: ModelTraining = ModelTraining(),
    *,
    known: Mapping[str, np.ndarray] | None = None,
    seed: int = 0,
    progress: bool = True,
) -> tuple[DPMPB, dict[str, np.ndarray], np.ndarray]:
    """Train the weights W and one p for each material together, p from zero.

    Args:
        runs: recordings of one robot, each longer than a window; runs of one material
            share one p.
        settings: of the training.
        known: p of each material, `{name: [D_p]}`, if only W is to be trained.
        seed: of the first weights and of the order of the windows.
        progress: show a progress bar.

    Returns:
        The model, in evaluation mode; p of each material, `{name: [D_p]}`; and the
        mean loss of each epoch.

    Raises:
        ValueError: there is no run, one is too short, or they are of different robots.
        KeyError: `known` lacks a material.
    """
    if not runs:
        raise ValueError("there are no runs to train on")
    for run in runs:
        check_run(run)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    materials = materials_of(runs)
    p = torch.zeros(len(materials), settings.bias_size)
    if known is not None:
        p = torch.tensor(np.stack([known[name] for name in materials]))
    p = p.float().to(device).requires_grad_(known is None)

    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = _model_of(runs, settings.bias_size)
        s, u, k = windows(runs, settings.sequence_length, settings.stride)
        set_normalisation(model, runs)
        model.to(device)
        data = (s.to(device), u.to(device), k.to(device))
        losses = _descend(model, p, data, settings, progress)
    biases = dict(zip(materials, p.detach().cpu().numpy(), strict=True))
    return model.cpu().eval(), biases, losses


def _model_of(runs: Sequence[Run], bias_size: int) -> DPMPB:
    """A new network that knows the step and the names of these runs."""
    first = runs[0]
    model = DPMPB(first.s.shape[1], first.u.shape[1], bias_size)
    for name in ("step", "state_names", "command_names"):
        known = [getattr(run, name) for run in runs if getattr(run, name)]
        if known:
            setattr(model, name, known[0])
    for run in runs:
        check_fits(model, run)
    return model


def _descend(
    model: DPMPB,
    p: Tensor,
    data: tuple[Tensor, Tensor, Tensor],
    settings: ModelTraining,
    progress: bool,
) -> np.ndarray:
    """Move W and p `[K, D_p]` by the same gradient: the mean loss of each epoch."""
    s, u, k = data
    batches = math.ceil(len(s) / settings.batch_size)
    groups: list[dict[str, Any]] = [{"params": list(model.parameters())}]
    if p.requires_grad:
        groups.append({"params": [p], "lr": settings.bias_learning_rate})
    optimizer = Adam(groups, lr=settings.learning_rate, fused=True)
    schedule = CosineAnnealingLR(optimizer, settings.epochs * batches)

    losses = []
    bar = trange(settings.epochs, unit="epoch", disable=not progress)
    for _ in bar:
        total = 0.0
        for index in torch.randperm(len(s)).split(settings.batch_size):
            # Each window gets the row of p of its material, and gives it its gradient.
            predicted, _ = model(s[index, :-1], u[index], p[k[index]])
            loss = model.loss(predicted, s[index, 1:])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item() * len(index)
        losses.append(total / len(s))
        bar.set_postfix(loss=f"{losses[-1]:.4f}")
    return np.array(losses)
