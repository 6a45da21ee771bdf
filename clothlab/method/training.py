"""Training W and one p for each material together (paper, eqs. 3 and 4).

There is one model for all materials, and nobody tells it what a material is like. p of
each material starts at zero and is moved by the same gradient as the weights W: what
the weights can't explain, since it differs between materials, goes into p. Each window
of a run is predicted from an empty memory, each next state from the true ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
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
from clothlab.method._batches import Windows
from clothlab.method._inputs import check_runs, common_step
from clothlab.method._networks import MakeModel, made
from clothlab.method._optimise import best_device, minimise, seeded
from clothlab.method._quick_tanh import quicken
from clothlab.method._watch import HeldOut, TrainingTrace, Watch
from clothlab.method.data import Run, materials_of, set_normalisation
from clothlab.method.model import DPMPB, PredictiveModel
from clothlab.method.training_options import TrainingOptions


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
    # First steps of a window, which only fill the memory and are not in the loss.
    burn_in: int = setting(0, "step", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.burn_in >= self.sequence_length:
            raise ValueError(
                f"ModelTraining.burn_in must be below the {self.sequence_length} steps "
                f"of sequence_length, got {self.burn_in}"
            )


def train_dpmpb(
    runs: Sequence[Run],
    settings: ModelTraining | None = None,
    *,
    model: MakeModel = DPMPB,
    known: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
    options: TrainingOptions | None = None,
) -> tuple[PredictiveModel, dict[str, np.ndarray], TrainingTrace]:
    """Train the weights W and one p for each material together, p from zero.

    Args:
        runs: recordings of one robot, each longer than a window; runs of one material
            share one p.
        settings: of the training.
        model: which network: a subclass of `PredictiveModel`, or a function that makes
            one of D_s, D_u and D_p.
        known: p of each material, `{name: [D_p]}`, if only W is to be trained.
        seed: of the first weights and of the order of the windows.
        device: by default a GPU, where torch sees one.
        progress: show a progress bar.
        options: held-out runs, the best epoch, a callback, a file to go on from.

    Returns:
        The model, on the processor and in evaluation mode; p of each material,
        `{name: [D_p]}`; and the trace of losses and p.
    """
    settings = settings_or_default(settings, ModelTraining)
    options = settings_or_default(options, TrainingOptions)
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
        network = made(model, states, commands, settings.bias_size)
        set_normalisation(network, runs)
        if isinstance(network, DPMPB):
            quicken(network)
        network.to(device)
        held_out = _held_out(options.held_out, runs, settings, device)
        about = _which(network, materials, settings, known, seed)
        watch = Watch(network, p, materials, held_out, options, about)
        _train(network, p, runs, settings, watch, progress)
        trace = watch.finish()
    network.step = step

    # p of the epoch that is returned.
    biases = {name: path[trace.epoch] for name, path in trace.biases.items()}
    return network.cpu().eval(), biases, trace


def _train(
    model: PredictiveModel,
    p: Tensor,
    runs: Sequence[Run],
    settings: ModelTraining,
    watch: Watch,
    progress: bool,
) -> None:
    """Train W and p `[K, D_p]` in place, where p lies."""
    length = settings.sequence_length
    first = settings.burn_in
    windows = Windows(runs, materials_of(runs), length, settings.stride, p.device)

    def loss(index: Tensor) -> Tensor:
        """L(W, p) of some windows: each next state, predicted from the true ones."""
        s, u, k = windows[index]
        predicted, _ = model(s[:, :-1], u, p[k])
        return model.loss(predicted[:, first:], s[:, 1 + first :])

    def batches() -> Sequence[Tensor]:
        # Drawn on the processor, so that every device learns in the same order
        return torch.randperm(len(windows)).split(settings.batch_size)

    # W and p are moved by the same gradient, each at its own rate.
    groups: list[dict[str, Any]] = [{"params": model.parameters()}]
    if p.requires_grad:
        groups.append({"params": [p], "lr": settings.bias_learning_rate})

    # The loop; what else goes on is in `_watch`.
    epochs = settings.epochs
    rate = settings.learning_rate
    bar = type(model).__name__ if progress else None
    with watch:
        for mean_loss in minimise(
            groups, loss, batches, epochs, rate, begin=watch.begin, bar=bar
        ):
            if watch.note(mean_loss):
                break


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


def _held_out(
    held_out: Sequence[Run], runs: Sequence[Run], settings: ModelTraining, device: str
) -> HeldOut | None:
    """Windows of held-out runs, side by side; None if there are no such runs."""
    if not held_out:
        return None
    materials = materials_of(runs)
    for run in held_out:
        choose("material of a held-out run", run.material, dict.fromkeys(materials))
    length = settings.sequence_length
    _check_lengths([runs[0], *held_out], length)
    windows = Windows(held_out, materials, length, length, device)
    return HeldOut(windows, settings.burn_in)


def _which(
    model: PredictiveModel,
    materials: list[str],
    settings: ModelTraining,
    known: Mapping[str, ArrayLike] | None,
    seed: int,
) -> dict[str, Any]:
    """What says which training this is, so that no file of another goes on in it."""
    return {
        **asdict(settings),
        "seed": seed,
        "network": type(model).__name__,
        "materials": materials,
        "known": bool(known),
    }


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
