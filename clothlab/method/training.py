"""Training W and one p for each material together (paper, eqs. 3 and 4).

There is one model for all materials, and nobody tells it what a material is like. p of
each material starts at zero and is moved by the same gradient as the weights W: what
the weights can't explain, since it differs between materials, goes into p. Each window
of a run is predicted from an empty memory, each next state from the true ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import (
    Checked,
    check_array,
    choose,
    setting,
    settings_or_default,
)
from clothlab.method._inputs import check_runs, common_step
from clothlab.method._optimise import best_device, minimise, seeded
from clothlab.method._quick_tanh import quicken
from clothlab.method.data import Run, materials_of, set_normalisation, windows
from clothlab.method.model import DPMPB


@dataclass(frozen=True)
class ModelTraining(Checked):
    """How W and p are trained together; the defaults are the paper's for simulation."""

    epochs: int = setting(300, at_least=1)
    batch_size: int = setting(300, at_least=1)  # windows
    sequence_length: int = setting(30, "step", at_least=1)  # LSTM expansions
    bias_size: int = setting(2, at_least=0)  # D_p

    # The paper stops here; what follows is ours. Windows overlap, so that an epoch has
    # more updates: without, 300 epochs learn too little (notebook 05). Learning rates
    # fall to zero along a cosine. That of p is larger; it need not be (notebook 04).
    stride: int = setting(5, "step", at_least=1)  # between the starts of two windows
    learning_rate: float = setting(2e-3, above=0)
    bias_learning_rate: float = setting(6e-3, above=0)


@dataclass(frozen=True, eq=False)
class _TrainingTrace:
    """What happened in a training."""

    losses: np.ndarray  # mean squared error of each epoch [epochs] [s.d.²]
    # p of each material before the first epoch and after each,
    # {name: [epochs + 1, D_p]}.
    biases: dict[str, np.ndarray]


def train_dpmpb(
    runs: Sequence[Run],
    settings: ModelTraining | None = None,
    *,
    known: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
) -> tuple[DPMPB, dict[str, np.ndarray], _TrainingTrace]:
    """Train the weights W and one p for each material together, p from zero.

    Args:
        runs: recordings of one robot, each longer than a window; runs of one material
            share one p.
        settings: of the training.
        known: p of each material, `{name: [D_p]}`, if only W is to be trained.
        seed: of the first weights and of the order of the windows.
        device: by default a GPU, where torch sees one.
        progress: show a progress bar.

    Returns:
        The model, on the processor and in evaluation mode; p of each material,
        `{name: [D_p]}`; and the trace of losses and p.
    """
    settings = settings_or_default(settings, ModelTraining)
    device = device or best_device()
    runs = check_runs(runs)
    _check_lengths(runs, settings.sequence_length)
    step = common_step(runs)
    materials = materials_of(runs)
    p = _first_biases(materials, settings.bias_size, known).to(device)
    p.requires_grad_(not known)

    # W from a seed, p beside it.
    with seeded(seed):
        states = runs[0].s.shape[1]
        commands = runs[0].u.shape[1]
        model = DPMPB(states, commands, settings.bias_size)
        set_normalisation(model, runs)
        model = quicken(model).to(device)
        losses, path = _train(model, p, runs, settings, progress)
    model.step = step

    # Name what the rows of p are.
    paths = {name: path[:, k] for k, name in enumerate(materials)}
    biases = {name: each[-1] for name, each in paths.items()}
    return model.cpu().eval(), biases, _TrainingTrace(np.array(losses), paths)


def _train(
    model: DPMPB,
    p: Tensor,
    runs: Sequence[Run],
    settings: ModelTraining,
    progress: bool,
) -> tuple[list[float], np.ndarray]:
    """Train W and p `[K, D_p]` in place, where p lies.

    Returns the loss of each epoch, and p before the first epoch and after each,
    `[epochs + 1, K, D_p]`.
    """
    s, u, k = windows(runs, settings.sequence_length, settings.stride)
    s = s.to(p.device)
    u = u.to(p.device)
    k = k.to(p.device)

    def loss(index: Tensor) -> Tensor:
        """L(W, p) of some windows: each next state, predicted from the true ones."""
        predicted, _ = model(s[index, :-1], u[index], p[k[index]])
        return model.loss(predicted, s[index, 1:])

    def batches() -> Sequence[Tensor]:
        order = torch.randperm(len(s), device=p.device)
        return order.split(settings.batch_size)

    # W and p are moved by the same gradient, each at its own rate.
    groups: list[dict[str, Any]] = [{"params": model.parameters()}]
    if p.requires_grad:
        groups.append({"params": [p], "lr": settings.bias_learning_rate})

    # The loop, and where p goes in it.
    losses = []
    path = [p.detach().cpu().numpy().copy()]
    bar = "DPMPB" if progress else None
    for mean_loss in minimise(
        groups, loss, batches, settings.epochs, settings.learning_rate, bar=bar
    ):
        losses.append(mean_loss)
        path.append(p.detach().cpu().numpy().copy())
    return losses, np.stack(path)


def _first_biases(
    materials: list[str], size: int, known: Mapping[str, ArrayLike] | None
) -> Tensor:
    """Zeros, or what is known, `[K, D_p]`."""
    biases = torch.zeros(len(materials), size)
    for k, name in enumerate(materials if known else ()):
        p = choose("material", name, known or {})
        p = check_array(f"p of {name}", p, (size,), np.float32)
        biases[k] = torch.as_tensor(p)
    return biases


def _check_lengths(runs: Sequence[Run], length: int) -> None:
    """A ValueError if runs are too short, or not of one robot."""
    if not runs:
        raise ValueError("no runs to train on")
    for run in runs:
        if len(run) <= length:
            raise ValueError(
                f"a run needs more steps than the {length} of a sequence, got "
                f"{len(run)}"
            )
        states_differ = run.s.shape[1] != runs[0].s.shape[1]
        commands_differ = run.u.shape[1] != runs[0].u.shape[1]
        if states_differ or commands_differ:
            raise ValueError(
                "all runs must have states and commands of the same sizes: was each "
                "recorded with the same robot?"
            )
