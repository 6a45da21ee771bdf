"""What is trained on a drone's flights: a model with p, and memories without it.

Settings were chosen on the flights of one controller, `DEVELOPMENT`, which no table is
about: predictions over 1 s by models of the other four. So the flights of the tested
controllers had a part in the choice, as recordings, while none was predicted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from clothlab.method.data import Run, set_normalisation, windows
from clothlab.method.estimation import NewtonSettings
from clothlab.method.model import DPMPB, Memory, predict
from clothlab.method.training import ModelTraining, train_dpmpb
from studies._grid import shared
from studies._optimise import minimise, seeded
from studies.neural_fly import CONTROLLERS, WINDS, load_flight
from studies.uncertainty import best_bias

DEVELOPMENT = "L1"  # its flights are among those of every training
TESTED = tuple(name for name in CONTROLLERS if name != DEVELOPMENT)
_BATCH = 50  # windows of 30 steps in an update, or as many steps in longer ones
_PREDICTED = 30 * _BATCH
TRAINING = ModelTraining(epochs=1, batch_size=_BATCH, stride=5, sequence_length=30)
UPDATES = 1200  # of each training: what served it best in the development
P = "p"
LONG_MEMORY = "long memory"
REHEARSED = "kept memory, rehearsed"


@dataclass(frozen=True)
class MemoryTraining:
    """What a network without p learns from, which has its memory alone."""

    length: int  # steps of a window
    uncounted: int = 0  # first steps of a sequence, which only fill the memory
    # Steps of the same wind, drawn from anywhere, that the memory reads before
    stretch: int = 0


_MEMORIES = {
    LONG_MEMORY: MemoryTraining(length=100),
    # Its memory has read another stretch of the same wind before each window
    REHEARSED: MemoryTraining(length=50, uncounted=30, stretch=100),
}


class Trained(NamedTuple):
    """What one training gives."""

    model: DPMPB
    biases: dict[str, np.ndarray]  # of each recorded wind [D_p]


@dataclass(frozen=True)
class Recordings:
    """Which flights a training sees."""

    controllers: tuple[str, ...]
    winds: tuple[str, ...] = tuple(WINDS)
    # Whether flights are said to have other winds, others for each controller
    shuffled: bool = False

    def runs(self) -> list[Run]:
        """The flights, each named by its wind."""
        found = []
        for k, controller in enumerate(self.controllers):
            names = list(self.winds)
            if self.shuffled:
                # One place further for each: a name is that of all winds alike
                names = [*names[k:], *names[:k]]
            for wind, name in zip(self.winds, names, strict=True):
                run = load_flight(controller, wind)
                found.append(replace(run, material=name))
        return found


def without(
    controller: str, wind: str | None = None, *, shuffled: bool = False
) -> Recordings:
    """All flights but those of a controller, and of a wind."""
    controllers = tuple(name for name in CONTROLLERS if name != controller)
    winds = tuple(name for name in WINDS if name != wind)
    return Recordings(controllers, winds, shuffled)


@shared
def train(kind: str, recordings: Recordings, seed: int) -> Trained:
    """Train one kind of model on some flights.

    Args:
        kind: P, or one of those that have no p.
        recordings: which flights.
        seed: of the first weights, and of the order of what is seen.
    """
    runs = recordings.runs()
    if kind in _MEMORIES:
        return train_memory(_MEMORIES[kind], runs, seed)
    settings = with_updates(TRAINING, runs, UPDATES)
    model, biases, _ = train_dpmpb(runs, settings, seed=seed, progress=False)
    return Trained(model.requires_grad_(False), biases)


def train_memory(
    kind: MemoryTraining, runs: Sequence[Run], seed: int, updates: int = UPDATES
) -> Trained:
    """Train a network without p."""
    with seeded(seed):
        model = DPMPB(runs[0].s.shape[1], runs[0].u.shape[1], bias_size=0)
        set_normalisation(model, runs)
        _minimise(model, kind, runs, updates)
    return Trained(model.eval().requires_grad_(False), {})


def _minimise(
    model: DPMPB, kind: MemoryTraining, runs: Sequence[Run], updates: int
) -> None:
    """Train in place."""
    s, u, k = windows(runs, kind.length, TRAINING.stride)
    stretch_of = _stretches(runs, kind.stretch) if kind.stretch else None
    none = torch.zeros(0)

    def loss(index: Tensor) -> Tensor:
        # A window, and perhaps a stretch of the same wind before it
        states = [s[index]]
        commands = [u[index]]
        if stretch_of is not None:
            read, sent = stretch_of(k[index])
            states.insert(0, read)
            commands.insert(0, sent)

        # One sequence of both: where they meet, the drone was reset
        before = torch.cat([each[:, :-1] for each in states], dim=1)
        after = torch.cat([each[:, 1:] for each in states], dim=1)
        predicted, _ = model(before, torch.cat(commands, dim=1), none)
        counted = slice(kind.uncounted, None)
        return model.loss(predicted[:, counted], after[:, counted])

    # As many predicted steps in each update, whatever a sequence's length
    count = max(1, round(_PREDICTED / (kind.length + kind.stretch)))

    def batches() -> Sequence[Tensor]:
        return [torch.randint(len(s), (count,))]

    rate = ModelTraining.learning_rate
    for _ in minimise(model.parameters(), loss, batches, updates, rate):
        pass


def _stretches(
    runs: Sequence[Run], length: int
) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
    """Draws a stretch of each of some winds `[B]`: states and commands.

    States are `[B, length + 1, D_s]`, commands `[B, length, D_u]`.
    """
    s, u, k = windows(runs, length, TRAINING.stride)
    in_order = k.argsort(stable=True)
    counts = k.bincount()
    first = counts.cumsum(0) - counts

    def draw(winds: Tensor) -> tuple[Tensor, Tensor]:
        within = torch.rand(len(winds)) * counts[winds]
        index = in_order[first[winds] + within.long()]
        return s[index], u[index]

    return draw


def with_updates(
    settings: ModelTraining, runs: Sequence[Run], updates: int
) -> ModelTraining:
    """The same settings, with as many epochs as make so many updates."""
    s, _, _ = windows(runs, settings.sequence_length, settings.stride)
    batches = -(-len(s) // settings.batch_size)
    return replace(settings, epochs=max(1, round(updates / batches)))


def estimate_at_once(model: DPMPB, run: Run) -> np.ndarray:
    """p `[D_p]` with the lowest loss of a whole run in motion, from zero."""
    in_motion = NewtonSettings(from_rest=False)
    p, _ = best_bias(model, run, np.zeros(model.bias_size), in_motion, rounds=15)
    return p


@torch.no_grad()
def memory_of(model: DPMPB, run: Run) -> Memory:
    """What a model without p remembers of a run."""
    s = torch.as_tensor(run.s)[None]
    u = torch.as_tensor(run.u)[None]
    _, after = model(s, u, torch.zeros(0))
    return after


class Forecasts(NamedTuple):
    """From where predictions begin, and what was flown after it."""

    start: Tensor  # states [B, D_s]
    commands: Tensor  # from there on [B, T, D_u]
    flown: Tensor  # states after each of them [B, T, D_s]


def forecasts(run: Run, starts: Sequence[int], steps: int) -> Forecasts:
    """Stretches of a flight."""
    s = torch.as_tensor(run.s)
    u = torch.as_tensor(run.u)
    return Forecasts(
        torch.stack([s[t] for t in starts]),
        torch.stack([u[t : t + steps] for t in starts]),
        torch.stack([s[t + 1 : t + steps + 1] for t in starts]),
    )


@torch.no_grad()
def predicted(model: DPMPB, p: Tensor, kept: Memory | None, given: Forecasts) -> Tensor:
    """States `[B, T, D_s]` that a model predicts, each from the prediction before.

    Its memory is empty, or what was kept.
    """
    return predict(model, given.start, given.commands, p, kept)
