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
from torch.optim import Adam
from torch.optim.lr_scheduler import CosineAnnealingLR
from tqdm.auto import trange

from clothlab._validation import check_array, check_seed, choose, settings_or_default
from clothlab.method._inputs import check_runs, common_step
from clothlab.method._quick_tanh import quicken
from clothlab.method.data import Run, materials_of, set_normalisation, windows
from clothlab.method.model import DPMPB


@dataclass(frozen=True)
class ModelTraining:
    """How W and p are trained together; the defaults are the paper's for simulation."""

    epochs: int = 300
    batch_size: int = 300  # windows
    sequence_length: int = 30  # [step] LSTM expansions
    bias_size: int = 2  # D_p

    # The paper stops here; what follows is ours. Windows overlap, so that an epoch has
    # more updates: without, 300 epochs learn too little (notebook 05). Learning rates
    # fall to zero along a cosine. That of p is larger; it need not be (notebook 04).
    stride: int = 5  # [step] between the starts of two windows
    learning_rate: float = 2e-3
    bias_learning_rate: float = 6e-3


def train_dpmpb(
    runs: Sequence[Run],
    settings: ModelTraining | None = None,
    *,
    known: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
) -> tuple[DPMPB, dict[str, np.ndarray], np.ndarray]:
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
        `{name: [D_p]}`; and the mean squared error of each epoch `[epochs]` [s.d.²].
    """
    settings = settings_or_default(settings, ModelTraining)
    check_seed(seed)
    runs = check_runs(runs)
    _check_lengths(runs, settings.sequence_length)
    step = common_step(runs)
    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    materials = materials_of(runs)
    p = _first_biases(materials, settings.bias_size, known).to(device)
    p.requires_grad_(not known)

    # W from a seed, p beside it; the caller's random numbers go on as they were.
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = DPMPB(runs[0].s.shape[1], runs[0].u.shape[1], settings.bias_size)
        set_normalisation(model, runs)
        quicken(model).to(device)
        losses = _train(model, p, runs, settings, progress)
    model.step = step
    biases = dict(zip(materials, p.detach().cpu().numpy(), strict=True))
    return model.cpu().eval(), biases, losses


def _train(
    model: DPMPB,
    p: Tensor,
    runs: Sequence[Run],
    settings: ModelTraining,
    progress: bool,
) -> np.ndarray:
    """Train W and p `[K, D_p]` in place, where p lies: the mean loss of each epoch."""
    # All windows of all runs, and which material each is of.
    stretches = windows(runs, settings.sequence_length, settings.stride)
    s, u, k = (each.to(p.device) for each in stretches)

    # W and p are moved by the same gradient, each at its own rate.
    groups: list[dict[str, Any]] = [{"params": list(model.parameters())}]
    if p.requires_grad:
        groups.append({"params": [p], "lr": settings.bias_learning_rate})
    optimizer = Adam(groups, lr=settings.learning_rate, fused=True)
    batches = -(-len(s) // settings.batch_size)
    schedule = CosineAnnealingLR(optimizer, settings.epochs * batches)

    losses = []
    epochs = trange(settings.epochs, desc="DPMPB", unit="epoch", disable=not progress)
    for _ in epochs:
        # The order is drawn on the processor, so that every device learns in the same.
        total = 0.0
        for index in torch.randperm(len(s)).split(settings.batch_size):
            # L(W, p) of some windows: each next state, predicted from the true ones.
            predicted, _ = model(s[index, :-1], u[index], p[k[index]])
            loss = model.loss(predicted, s[index, 1:])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item() * len(index)

        # The mean over all windows, and not over batches of different sizes.
        losses.append(total / len(s))
        epochs.set_postfix(loss=f"{losses[-1]:.4f}")
    return np.array(losses)


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
                f"a run needs more steps than the {length} of a sequence, and one of "
                f"{run.material} has {len(run)}: leave it out, or set a shorter "
                "`sequence_length`"
            )
        states_differ = run.s.shape[1] != runs[0].s.shape[1]
        commands_differ = run.u.shape[1] != runs[0].u.shape[1]
        if states_differ or commands_differ:
            raise ValueError(
                "all runs must have states and commands of the same sizes: was each "
                "recorded with the same robot?"
            )
