"""What the trainings of all networks share: Adam along a cosine, seeds, and where to train."""

import ctypes
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from tqdm.auto import tqdm

from clothlab._validation import check_seed

# glibc's parameters for `mallopt`, and their new values [byte].
_TRIM_THRESHOLD, _MMAP_THRESHOLD = (-1, 512 * 2**20), (-3, 32 * 2**20)


def fit(
    parameters: Iterable[Any],
    loss: Callable[[Tensor], Tensor],
    batches: Callable[[], Sequence[Tensor]],
    epochs: int,
    learning_rate: float,
    *,
    fused: bool = True,
    bar: str | None = None,
) -> Iterator[float]:
    """Minimise a loss by Adam, whose learning rate falls to zero along a cosine; yields the mean loss of each epoch.

    `parameters` are tensors, or Adam's groups with learning rates `lr` of their own. `batches` draws the batches of one
    epoch, as many in each, such as `lambda: torch.randperm(n).split(64)`; a single update is an epoch of one batch. A
    `fused` update is faster, and rounds differently. `bar` is the title of a progress bar.
    """
    optimizer = torch.optim.Adam(parameters, lr=learning_rate, fused=fused)
    schedule = None
    epoch_bar = tqdm(range(epochs), desc=bar, disable=bar is None, unit="epoch")
    for _ in epoch_bar:
        drawn, total = batches(), 0.0
        schedule = schedule or torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs * len(drawn))
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
    """Random numbers of its own, from a seed; the caller's go on as if nothing had happened. Memory is used again."""
    check_seed(seed)
    _keep_freed_memory()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        yield


def best_device() -> str:
    """Where to train by default: a GPU where torch sees one."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def _keep_freed_memory() -> None:
    """Let glibc keep up to half a gigabyte that was freed, rather than give it back to the system.

    Each training step frees some 40 MB and asks for them again. Left alone, glibc gives them back in between, and the
    system clears thousands of pages anew for each step: a sixth of an autoencoder's training time.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform.startswith("linux") else None
    if mallopt:
        mallopt(*_TRIM_THRESHOLD)
        mallopt(*_MMAP_THRESHOLD)
