"""Windows of runs by their number, gathered where and when a batch needs them.

Windows overlap, so copies of them would take many times the room of the runs.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from clothlab.method._on_disk import give_back, is_on_disk
from clothlab.method.data import Run, count_windows

Batch = tuple[Tensor, Tensor, Tensor]


class Windows:
    """The windows that `data.windows` would copy, in the same order.

    Args:
        runs: each longer than a window; those on the disk stay there.
        materials: names in the order of p.
        length: steps that are predicted in a window.
        stride: steps between the starts of two windows of a run.
        device: where batches are wanted.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        materials: Sequence[str],
        length: int,
        stride: int,
        device: torch.device | str = "cpu",
    ):
        # Which window is the first of each run, and where in all the rows it begins
        counts = [count_windows(run, length, stride) for run in runs]
        numbers = np.cumsum([0, *counts])
        self._count = int(numbers[-1])
        self._first = torch.as_tensor(numbers[:-1])
        rows = np.cumsum([0, *map(len, runs)])
        self._row = torch.as_tensor(rows[:-1])
        which = [materials.index(run.material) for run in runs]
        self._material = torch.tensor(which)
        self._stride = stride
        self._steps = torch.arange(length + 1)

        # All rows in one place, unless they stay on the disk
        self._runs = runs
        self._device = device
        self._on_disk = any(is_on_disk(run.s) or is_on_disk(run.u) for run in runs)
        if not self._on_disk:
            self._s = _one_after_the_other([run.s for run in runs]).to(device)
            self._u = _one_after_the_other([run.u for run in runs]).to(device)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Tensor) -> Batch:
        """Windows with these numbers `[B]`.

        States `[B, length + 1, D_s]`, commands `[B, length, D_u]`, and which material
        each belongs to, `[B]`.
        """
        run = torch.searchsorted(self._first, index, right=True) - 1
        start = self._stride * (index - self._first[run])
        material = self._material[run].to(self._device)
        if self._on_disk:
            s, u = self._read(run, start)
            return s.to(self._device), u.to(self._device), material
        rows = (self._row[run] + start)[:, None] + self._steps
        rows = rows.to(self._device)
        return self._s[rows], self._u[rows[:, :-1]], material

    def _read(self, run: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        """One window after the other, of these runs from these steps on."""
        pairs = list(zip(run.tolist(), start.tolist(), strict=True))
        length = len(self._steps) - 1
        s = [self._runs[k].s[t : t + length + 1] for k, t in pairs]
        u = [self._runs[k].u[t : t + length] for k, t in pairs]
        found = (torch.as_tensor(np.stack(s)), torch.as_tensor(np.stack(u)))
        for k in set(run.tolist()):
            give_back(self._runs[k].s)
            give_back(self._runs[k].u)
        return found


def _one_after_the_other(arrays: Sequence[np.ndarray]) -> Tensor:
    return torch.as_tensor(np.concatenate(arrays))
