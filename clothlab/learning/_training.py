"""What the trainings of all networks share."""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import torch

# glibc's parameters for `mallopt`, and their new values [byte].
TRIM_THRESHOLD, MMAP_THRESHOLD = (-1, 512 * 2**20), (-3, 32 * 2**20)


@contextmanager
def training(seed: int) -> Iterator[None]:
    """Random numbers of its own, from a seed; the caller's go on as if nothing had happened. Memory is used again."""
    _keep_freed_memory()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        yield


def best_device() -> str:
    """Where to train unless told otherwise: a GPU where torch sees one."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def _keep_freed_memory() -> None:
    """Let glibc keep up to half a gigabyte that was freed, rather than give it back to the system.

    Each training step frees some 40 MB and asks for them again. Left alone, glibc gives them back in between, and the
    system clears thousands of pages anew for each step: a sixth of an autoencoder's training time.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform.startswith("linux") else None
    if mallopt:
        mallopt(*TRIM_THRESHOLD)
        mallopt(*MMAP_THRESHOLD)
