"""Runs of a robot as the model sees them, windows of them, and what their numbers are
divided by.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from clothlab._validation import Checked, check_array, check_each, check_kind
from clothlab.method.model import DPMPB


@dataclass(frozen=True, eq=False)
class Run(Checked):
    """One run as the model sees it; runs of one material share one p."""

    s: np.ndarray  # states [T, D_s]; of a cloth, z first
    u: np.ndarray  # commands [T, D_u]
    material: str

    def __post_init__(self) -> None:
        for name in ("s", "u"):
            what = f"{name} of a run of {self.material}"
            array = check_array(
                what, getattr(self, name), ("T", f"D_{name}"), np.float32
            )
            object.__setattr__(self, name, array)
        if not len(self.s) == len(self.u) > 0:
            raise ValueError(
                f"a run has as many states as commands, and some, got {len(self.s)} and {len(self.u)}"
            )
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.s)

    def __getitem__(self, steps: slice) -> "Run":
        """Return a stretch of the run, `run[:100]`."""
        return Run(self.s[steps], self.u[steps], self.material)


RUNS_ADVICE = ": `learned.to_run(trial)` makes one of a trial"


def check_run(run: Any) -> Run:
    """Return one run; a ValueError for anything else, such as a trial."""
    return check_kind("run", run, Run, RUNS_ADVICE)


def check_runs(runs: Any) -> list[Run]:
    """Return runs as a list; a ValueError says which is none."""
    return check_each("runs", runs, Run, RUNS_ADVICE)


def windows(
    runs: Sequence[Run], length: int, stride: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Overlapping stretches of runs, whose starts are `stride` steps apart.

    States `[N, length + 1, D_s]`, commands `[N, length, D_u]`, and each material's
    place in `_materials` `[N]`.
    """
    materials = materials_of(runs)
    s = [
        torch.as_tensor(run.s).unfold(0, length + 1, stride).transpose(1, 2)
        for run in runs
    ]
    u = [
        torch.as_tensor(run.u[:-1]).unfold(0, length, stride).transpose(1, 2)
        for run in runs
    ]
    k = [
        torch.full((len(part),), materials.index(run.material))
        for part, run in zip(s, runs, strict=True)
    ]
    return torch.cat(s), torch.cat(u), torch.cat(k)


def materials_of(runs: Sequence[Run]) -> list[str]:
    """Each once, in the order in which they first occur."""
    return list(dict.fromkeys(run.material for run in runs))


# A sensor counts as constant where it varies by no more than single precision rounds,
# relative to its size.
_ROUNDING = 1e-6

# The standard deviation that such a sensor gets, in units of its size: so large that no
# reading of it means anything.
_UNHEARD = 1e6


def set_normalisation(model: DPMPB, runs: Sequence[Run]) -> None:
    """Set the model's means and standard deviations from all the data (paper, "Network
    Structure of DPMPB").

    What never varies in the data teaches nothing, and dividing by its deviation would
    turn the first other reading into the largest signal of all. So a constant sensor or
    command is left out, with a warning: it gets a deviation that nothing reaches, and
    weights of zero, which stay zero in the training since their gradient is.
    """
    for name in ("s", "u"):
        values = torch.as_tensor(
            np.concatenate([getattr(run, name) for run in runs]), dtype=torch.float32
        )
        size = values.abs().amax(0)
        constant = values.amax(0) - values.amin(0) <= _ROUNDING * size
        deviation = torch.where(constant, _UNHEARD * size.clamp_min(1), values.std(0))
        getattr(model, f"{name}_mean").copy_(values.mean(0))
        getattr(model, f"{name}_std").copy_(deviation)
        if constant.any():
            _leave_out(model, name, constant)
            places = ", ".join(str(k) for k in constant.nonzero().flatten().tolist())
            kind = "state" if name == "s" else "command"
            warnings.warn(
                f"{kind} {places} (counted from 0) never changes in these runs: the model leaves it out",
                stacklevel=3,
            )


@torch.no_grad()
def _leave_out(model: DPMPB, name: str, constant: Tensor) -> None:
    """Make the model deaf to some states or commands `[D]`, bool, and let it predict
    their mean.
    """
    first_layer = cast(nn.Linear, model.fc_in[0])
    last_layer = cast(nn.Linear, model.fc_out[-1])
    offset = 0 if name == "u" else model.command_size
    columns = offset + constant.nonzero().flatten()
    first_layer.weight[:, columns] = 0
    if name == "s":
        last_layer.weight[constant] = 0
        last_layer.bias[constant] = 0
