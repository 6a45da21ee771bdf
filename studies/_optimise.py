"""What the trainings of studies share: Adam's loop, and a seed."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.optim import Adam
from torch.optim.lr_scheduler import CosineAnnealingLR


def minimise(
    parameters: Iterable[Any],
    loss: Callable[[Tensor], Tensor],
    batches: Callable[[], Sequence[Tensor]],
    epochs: int,
    learning_rate: float,
    *,
    fused: bool = True,
) -> Iterator[float]:
    """Minimise a loss by Adam, whose learning rate falls to zero along a cosine.

    Args:
        parameters: tensors, or Adam's groups with learning rates `lr` of their own.
        loss: of one batch.
        batches: draws the batches of one epoch, as many in each, such as
            `lambda: torch.randperm(n).split(64)`. A single update is an epoch of one
            batch.
        epochs: how often all batches are gone through.
        learning_rate: at the start.
        fused: a fused update is faster, and rounds differently.

    Yields:
        The mean loss of each epoch.
    """
    optimizer = Adam(parameters, lr=learning_rate, fused=fused)
    schedule = CosineAnnealingLR(optimizer, epochs * _count(batches))
    for _ in range(epochs):
        # One update for each batch.
        drawn = batches()
        total = 0.0
        for batch in drawn:
            value = loss(batch)
            optimizer.zero_grad()
            value.backward()
            optimizer.step()
            schedule.step()
            total += value.item() * len(batch)

        # The mean over all that was drawn, and not over batches of different sizes.
        yield total / sum(map(len, drawn))


def _count(batches: Callable[[], Sequence[Tensor]]) -> int:
    """How many batches an epoch has; random numbers go on as if none were drawn."""
    with torch.random.fork_rng(devices=[]):
        return len(batches())


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Random numbers from a seed; the caller's go on as if nothing had happened."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        yield
