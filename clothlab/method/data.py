"""Runs of a robot as the model sees them, windows of them, and their normalisation."""

import warnings
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, check_kind, check_names, check_number
from clothlab.method.model import DPMPB


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a robot, as the model sees it; runs of one material share one p."""

    s: np.ndarray  # states [T, D_s]; of a cloth, z first
    u: np.ndarray  # commands [T, D_u]; u[t] is sent in state s[t]
    material: str
    _: KW_ONLY
    step: float | None = None  # [s] between two states, where it is known
    state_names: tuple[str, ...] = ()  # what each number of s is, with its unit
    command_names: tuple[str, ...] = ()  # what each number of u is, with its unit

    def __post_init__(self) -> None:
        s = _record(f"s of a run of {self.material}", self.s, ("T", "D_s"))
        u = _record(f"u of a run of {self.material}", self.u, ("T", "D_u"))
        if not len(s) == len(u) > 0:
            raise ValueError(
                "a run has as many states as commands, and some, got "
                f"{len(s)} and {len(u)}"
            )
        object.__setattr__(self, "s", s)
        object.__setattr__(self, "u", u)
        check_kind("material of a run", self.material, str)

        # What may be left out
        if self.step is not None:
            step = check_number("step of a run", self.step, above=0)
            object.__setattr__(self, "step", step)
        check_names("states", self.state_names, s.shape[1])
        check_names("commands", self.command_names, u.shape[1])
        object.__setattr__(self, "state_names", tuple(self.state_names))
        object.__setattr__(self, "command_names", tuple(self.command_names))

    def __len__(self) -> int:
        """Return the number of steps T."""
        return len(self.s)

    def __getitem__(self, steps: slice) -> "Run":
        """Return a stretch of the run, `run[:100]`."""
        if not isinstance(steps, slice) or steps.step not in (None, 1):
            raise ValueError(
                "a run is cut with run[first:last], of steps one after the other, got "
                f"{steps!r}"
            )
        return replace(self, s=self.s[steps], u=self.u[steps])


def _record(what: str, value: ArrayLike, shape: tuple[str, str]) -> np.ndarray:
    """Return numbers `[T, D]` in single precision.

    A ValueError as of `check_array`, and where a number is missing, if one is.
    """
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind == "f":
        holes = ~np.isfinite(value)
        if holes.any():
            step, number = np.argwhere(holes)[0]
            raise ValueError(
                f"{what} is {value[step, number]} in step {step}, number {number} "
                "(both counted from 0): `runs_from_table` makes runs of a log"
            )
    return check_array(what, value, shape, np.float32)


def count_windows(run: Run, length: int, stride: int) -> int:
    """How many windows of so many predicted steps a run has."""
    return (len(run) - length - 1) // stride + 1


def windows(
    runs: Sequence[Run], length: int, stride: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Overlapping windows of runs, from which a training learns.

    Args:
        runs: all of the same robot.
        length: steps that are predicted in a window.
        stride: steps between the starts of two windows of a run.

    Returns:
        States `[N, length + 1, D_s]`, commands `[N, length, D_u]`, and which of
        `materials_of(runs)` each window belongs to, `[N]`.
    """
    materials = materials_of(runs)
    states = []
    commands = []
    which = []
    for run in runs:
        s = torch.tensor(run.s).unfold(0, length + 1, stride).transpose(1, 2)
        u = torch.tensor(run.u[:-1]).unfold(0, length, stride).transpose(1, 2)
        states.append(s)
        commands.append(u)
        which.append(torch.full((len(s),), materials.index(run.material)))
    return torch.cat(states), torch.cat(commands), torch.cat(which)


def materials_of(runs: Sequence[Run]) -> list[str]:
    """Each material once, in the order in which they first occur."""
    return list(dict.fromkeys(run.material for run in runs))


# A sensor counts as constant where it varies by no more than single precision rounds,
# relative to its size.
_ROUNDING = 1e-6
# The standard deviation that such a sensor gets, in units of its size: so large that no
# reading of it means anything.
_UNHEARD = 1e6


def set_normalisation(model: DPMPB, runs: Sequence[Run]) -> None:
    """Set the model's means and standard deviations from all the data.

    What never varies in the data teaches nothing, and dividing by its deviation would
    turn the first other reading into the largest signal of all. So a constant sensor or
    command is left out, with a warning: it gets a deviation that nothing reaches, and
    the model is deaf to it (`DPMPB.leave_out`). Source: the paper, "Network
    Structure of DPMPB".
    """
    constant_s = _measure([run.s for run in runs], model.s_mean, model.s_std)
    constant_u = _measure([run.u for run in runs], model.u_mean, model.u_std)

    if constant_s.any() or constant_u.any():
        model.leave_out(constant_s, constant_u)
    _warn_of_constants("state", constant_s, runs[0].state_names)
    _warn_of_constants("command", constant_u, runs[0].command_names)


def _measure(records: Sequence[np.ndarray], mean: Tensor, std: Tensor) -> Tensor:
    """Write mean and deviation `[D]` of records `[T, D]`; which are constant `[D]`."""
    values = torch.as_tensor(np.concatenate(records))
    low = values.amin(0)
    high = values.amax(0)
    size = torch.maximum(low.abs(), high.abs())
    constant = high - low <= _ROUNDING * size
    # Of a constant the value itself: its mean may be off by a last digit, of which Adam
    # would make a signal.
    mean.copy_(torch.where(constant, values[0], values.mean(0)))
    std.copy_(torch.where(constant, _UNHEARD * size.clamp_min(1), values.std(0)))
    return constant


def _warn_of_constants(kind: str, constant: Tensor, names: tuple[str, ...]) -> None:
    if not constant.any():
        return
    places = constant.nonzero().flatten().tolist()
    listed = f"{', '.join(map(str, places))} (counted from 0)"
    if names:
        listed = ", ".join(names[k] for k in places)
    warnings.warn(
        f"{kind} {listed} never changes in these runs: the model leaves it out",
        stacklevel=4,
    )
