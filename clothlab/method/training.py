"""Training W and one p for each material together (paper, eqs. 3 and 4)."""

import ctypes
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor
from tqdm.auto import tqdm

from clothlab._validation import (
    Checked,
    check_array,
    check_seed,
    choose,
    setting,
    settings_or_default,
)
from clothlab.method.data import (
    Run,
    check_runs,
    materials_of,
    set_normalisation,
    windows,
)
from clothlab.method.model import DPMPB

# glibc's parameters for `mallopt`, and their new values [byte].
_TRIM_THRESHOLD, _MMAP_THRESHOLD = (-1, 512 * 2**20), (-3, 32 * 2**20)


def minimise(
    parameters: Iterable[Any],
    loss: Callable[[Tensor], Tensor],
    batches: Callable[[], Sequence[Tensor]],
    epochs: int,
    learning_rate: float,
    *,
    fused: bool = True,
    bar: str | None = None,
) -> Iterator[float]:
    """Minimise a loss by Adam, whose learning rate falls to zero along a cosine; yields
    the mean loss of each epoch.

    `parameters` are tensors, or Adam's groups with learning rates `lr` of their own.
    `batches` draws the batches of one epoch, as many in each, such as `lambda:
    torch.randperm(n).split(64)`; a single update is an epoch of one batch. A `fused`
    update is faster, and rounds differently. `bar` is the title of a progress bar.
    """
    optimizer = torch.optim.Adam(parameters, lr=learning_rate, fused=fused)
    schedule = None
    epoch_bar = tqdm(range(epochs), desc=bar, disable=bar is None, unit="epoch")
    for _ in epoch_bar:
        drawn, total = batches(), 0.0
        schedule = schedule or torch.optim.lr_scheduler.CosineAnnealingLR(
            optimizer, epochs * len(drawn)
        )
        for batch in drawn:
            value = loss(batch)
            optimizer.zero_grad()
            value.backward()
            optimizer.step()
            schedule.step()
            total += value.item() * len(batch)
        mean = total / sum(map(len, drawn))
        epoch_bar.set_postfix(loss=f"{mean:.4f}")
        yield mean


@contextmanager
def training(seed: int) -> Iterator[None]:
    """Random numbers of its own, from a seed; the caller's go on as if nothing had
    happened. Memory is used again.
    """
    check_seed(seed)
    _keep_freed_memory()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        yield


def best_device() -> str:
    """Where to train by default: a GPU where torch sees one."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def _keep_freed_memory() -> None:
    """Let glibc keep up to half a gigabyte that was freed, rather than give it back to
    the system.

    Each training step frees some 40 MB and asks for them again. Left alone, glibc gives
    them back in between, and the system clears thousands of pages anew for each step: a
    sixth of an autoencoder's training time.
    """
    mallopt = (
        getattr(ctypes.CDLL(None), "mallopt", None)
        if sys.platform.startswith("linux")
        else None
    )
    if mallopt:
        mallopt(*_TRIM_THRESHOLD)
        mallopt(*_MMAP_THRESHOLD)


@dataclass(frozen=True)
class ModelTraining(Checked):
    """How W and p are trained together; the defaults are the paper's for the
    simulation.
    """

    epochs: int = setting(300, at_least=1)
    batch_size: int = setting(300, at_least=1)  # sequences
    sequence_length: int = setting(30, "step", at_least=1)  # LSTM expansions
    bias_size: int = setting(2, at_least=0)  # D_p
    # The paper stops here. What follows keeps a large network from learning 4,500 steps
    # by heart (notebook 04).
    # Between the starts of overlapping sequences
    stride: int = setting(5, "step", at_least=1)
    learning_rate: float = setting(2e-3, above=0)  # of W; falls to zero along a cosine
    # Of p, whose few numbers must travel far
    bias_learning_rate: float = setting(6e-3, above=0)


@dataclass(frozen=True, eq=False)
class TrainingTrace:
    """What happened in a training."""

    # Mean squared error of each epoch, in standard deviations, [epochs]
    losses: np.ndarray
    biases: dict[
        str, np.ndarray
        # P of each material before the first epoch and after each, {name: [epochs + 1,
        # D_p]}
    ]


def train_dpmpb(
    runs: Sequence[Run],
    settings: ModelTraining | None = None,
    *,
    known: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
) -> tuple[DPMPB, dict[str, np.ndarray], TrainingTrace]:
    """Train the weights W and one p for each material together (eqs. 3 and 4), p from
    zero.

    With `known`, p of each material `{name: [D_p]}`, only W is trained. The device is a
    GPU by default, where torch sees one. Returns the model on the CPU, p of each
    material, and the trace of losses and p.
    """
    settings = settings_or_default(settings, ModelTraining)
    device = device or best_device()
    runs = check_runs(runs)
    _check_lengths(runs, settings.sequence_length)
    names = materials_of(runs)
    p = (
        _first_biases(names, settings.bias_size, known)
        .to(device)
        .requires_grad_(not known)
    )
    with training(seed):
        model = DPMPB(runs[0].s.shape[1], runs[0].u.shape[1], settings.bias_size)
        set_normalisation(model, runs)
        losses, path = _train(model.to(device), p, runs, settings, device, progress)
    trace = TrainingTrace(
        np.array(losses), dict(zip(names, np.stack(path, axis=1), strict=True))
    )
    return (
        model.cpu().eval(),
        {name: each[-1] for name, each in trace.biases.items()},
        trace,
    )


def _train(
    model: DPMPB,
    p: Tensor,
    runs: Sequence[Run],
    settings: ModelTraining,
    device: str,
    progress: bool,
) -> tuple[list[float], list[np.ndarray]]:
    """Train W and p `[K, D_p]` in place: the loss of each epoch, and p before the first
    and after each.
    """
    s, u, k = (
        part.to(device)
        for part in windows(runs, settings.sequence_length, settings.stride)
    )

    def loss(index: Tensor) -> Tensor:
        predicted, _ = model(s[index, :-1], u[index], p[k[index]])
        return model.loss(predicted, s[index, 1:])

    def batches() -> Sequence[Tensor]:
        return torch.randperm(len(s), device=device).split(settings.batch_size)

    groups: list[dict[str, Any]] = [{"params": model.parameters()}]
    if p.requires_grad:
        groups.append({"params": [p], "lr": settings.bias_learning_rate})
    losses, path, bar = (
        [],
        [p.detach().cpu().numpy().copy()],
        "DPMPB" if progress else None,
    )
    for mean_loss in minimise(
        groups, loss, batches, settings.epochs, settings.learning_rate, bar=bar
    ):
        losses.append(mean_loss)
        path.append(p.detach().cpu().numpy().copy())
    return losses, path


def _first_biases(
    materials: list[str], size: int, known: Mapping[str, ArrayLike] | None
) -> Tensor:
    """Zeros, or what is known, `[K, D_p]`."""
    if not known:
        return torch.zeros(len(materials), size)
    rows = [
        check_array(
            f"p of {name}", choose("material", name, known), (size,), np.float32
        )
        for name in materials
    ]
    return torch.as_tensor(np.array(rows))


def _check_lengths(runs: Sequence[Run], length: int) -> None:
    if not runs:
        raise ValueError("no runs to train on")
    for run in runs:
        if len(run) <= length:
            raise ValueError(
                f"a run needs more steps than the {length} of a sequence, got {len(run)}"
            )
        if run.s.shape[1] != runs[0].s.shape[1] or run.u.shape[1] != runs[0].u.shape[1]:
            raise ValueError(
                "all runs must have states and commands of the same sizes: was each recorded with the same robot?"
            )
