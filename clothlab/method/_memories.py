"""Memories of networks of any kind: tuples of tensors `[layers, B, ...]`."""

from collections.abc import Iterable, Sequence
from typing import Any

import torch
from torch import Tensor

# What a network remembers of the steps before: nothing, `()`, or some tensors, in a
# plain tuple or in a NamedTuple, each `[layers, B, ...]`.
AnyMemory = tuple[Tensor, ...]


def expanded(memory: AnyMemory, batch: int) -> Any:
    """The same memory for each of a batch, from one of batch 1 or B."""
    return like(memory, (_of_batch(part, batch) for part in memory))


def joined(memories: Sequence[AnyMemory]) -> Any:
    """Memories of several batches as that of one."""
    parts = zip(*memories, strict=True)
    return like(memories[0], (torch.cat(part, dim=1) for part in parts))


def _of_batch(part: Tensor, batch: int) -> Tensor:
    return part.expand(-1, batch, *part.shape[2:]).contiguous()


def like(memory: AnyMemory, parts: Iterable[Tensor]) -> Any:
    """A tuple of the same kind: a NamedTuple has names for its parts."""
    make = getattr(type(memory), "_make", tuple)
    return make(parts)
