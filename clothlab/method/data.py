"""Runs of a robot as the model sees them, windows of them, and their normalisation."""

import warnings
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
import torch
from torch import Tensor

from clothlab.method.model import DPMPB

_JITTER = 0.02  # share of a step by which two may differ and count as the same
# A sensor counts as constant where it varies by no more than single precision rounds,
# relative to its size.
_ROUNDING = 1e-6
_CONSTANT = 1e6  # the deviation of such a sensor, in units of its size
_COARSE = 0.01  # share of a sensor's deviation that such rounding may be
_NOISE = 1e-9  # relative change of a number that double precision alone may explain
# So many standard deviations of the training are another unit, not another material.
_OTHER_UNIT = 10.0


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a robot, as the model sees it; runs of one material share one p."""

    s: np.ndarray  # states [T, D_s], float32; of a cloth, z first
    u: np.ndarray  # commands [T, D_u], float32; u[t] is sent in state s[t]
    material: str
    _: KW_ONLY
    step: float | None = None  # between two states [s], where it is known
    state_names: tuple[str, ...] = ()  # what each number of s is, with its unit
    command_names: tuple[str, ...] = ()  # what each number of u is, with its unit

    def __post_init__(self) -> None:
        for name in ("s", "u"):
            what = f"{name} of a run of {self.material}"
            given = np.asarray(getattr(self, name))
            array = given.astype(np.float32)
            if array.ndim != 2:
                raise ValueError(f"{what} is [T, D_{name}], got {list(array.shape)}")
            missing = np.argwhere(~np.isfinite(array))
            if len(missing):
                t, k = missing[0]
                raise ValueError(
                    f"{what} is {array[t, k]} in step {t}, number {k} (both counted "
                    "from 0): `runs_from_table` makes runs of a log"
                )
            _warn_of_rounding(what, given)
            object.__setattr__(self, name, array)
        if not len(self.s) == len(self.u) > 0:
            raise ValueError(
                "a run has as many states as commands, at least one, got "
                f"{len(self.s)} and {len(self.u)}"
            )
        if self.step is not None and not self.step > 0:
            raise ValueError(f"step of a run must be above 0, got {self.step}")
        _check_names("states", self.state_names, self.s.shape[1])
        _check_names("commands", self.command_names, self.u.shape[1])

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

    def __repr__(self) -> str:
        """Return one line, such as "Run of cotton: 200 steps, 7 states, 2 commands"."""
        of = f" of {self.step:g} s" if self.step else ""
        sizes = f"{self.s.shape[1]} states, {self.u.shape[1]} commands"
        return f"Run of {self.material}: {len(self)} steps{of}, {sizes}"


def _check_names(what: str, names: tuple[str, ...], size: int) -> None:
    listed = ", ".join(names)
    if names and len(names) != size:
        raise ValueError(
            f"{size} {what} need as many names, or none, got {len(names)}: {listed}"
        )
    if len(set(names)) < len(names):
        raise ValueError(f"{what} of a run need different names, got {listed}")


def too_far_from_zero(values: np.ndarray) -> np.ndarray:
    """Whether single precision loses how each column of numbers `[T, D]` varies, `[D]`.

    A position of 3,948,996 m, for one, has steps of 0.25 m there.
    """
    if not len(values) or values.dtype != np.float64:
        return np.zeros(values.shape[1], bool)
    size = np.abs(values).max(axis=0)
    rounding = np.spacing(size.astype(np.float32))
    varies = np.ptp(values, axis=0) > _NOISE * size
    return varies & (rounding > _COARSE * values.std(axis=0))


def _warn_of_rounding(what: str, values: np.ndarray) -> None:
    lost = too_far_from_zero(values)
    if lost.any():
        k = int(lost.argmax())
        warnings.warn(
            f"{what}, number {k} (counted from 0), is around {values[:, k].mean():.10g}"
            f" and varies by {values[:, k].std():.3g}, of which single precision keeps "
            "too little: subtract a constant from it",
            stacklevel=5,
        )


def materials_of(runs: Sequence[Run]) -> list[str]:
    """Each material once, in the order in which they first occur."""
    return list(dict.fromkeys(run.material for run in runs))


def check_run(run: Run) -> None:
    """Refuse anything but a run, such as a recorded trial."""
    if not isinstance(run, Run):
        raise ValueError(
            f"a run is a Run, got a {type(run).__name__}: `learned.to_run(trial)` "
            "makes one of a trial"
        )


def check_fits(model: DPMPB, run: Run) -> None:
    """Refuse a run of another robot, in another order or at another rate.

    Raises:
        ValueError: sizes, names or steps differ from those that the model knows.
    """
    check_run(run)
    sizes = (run.s.shape[1], run.u.shape[1])
    if sizes != (model.state_size, model.command_size):
        raise ValueError(
            f"the model has {model.state_size} states and {model.command_size} "
            f"commands, a run of {run.material} has {sizes[0]} and {sizes[1]}: it is "
            "of another robot"
        )
    for kind in ("state_names", "command_names"):
        known = getattr(model, kind)
        given = getattr(run, kind)
        if known and given and known != given:
            raise ValueError(
                f"a run of {run.material} has the {kind} ({', '.join(given)}), the "
                f"model ({', '.join(known)}): give the same numbers in the same order"
            )
    if run.step and model.step and abs(run.step / model.step - 1) > _JITTER:
        raise ValueError(
            f"a run of {run.material} has steps of {run.step:g} s, the model has "
            f"{model.step:g} s: resample it (`runs_from_table(..., "
            f"step={model.step:g})`), or record it at that rate"
        )


def warn_of_units(model: DPMPB, run: Run) -> None:
    """Warn of a run that is far from all that the model was trained on."""
    values = (run.s - model.s_mean.numpy()) / model.s_std.numpy()
    size = np.sqrt(np.square(values).mean(axis=0))
    k = int(size.argmax())
    if size[k] > _OTHER_UNIT:
        name = run.state_names[k] if run.state_names else f"{k} (counted from 0)"
        warnings.warn(
            f"state {name} of a run of {run.material} is {size[k]:.0f} standard "
            "deviations from what the model was trained on: is it in the same unit?",
            stacklevel=3,
        )


def windows(
    runs: Sequence[Run], length: int, stride: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Overlapping windows of runs, from which a training learns.

    Args:
        runs: all of the same robot, each longer than a window.
        length: steps that are predicted in a window.
        stride: steps between the starts of two windows of a run.

    Returns:
        States `[N, length + 1, D_s]`, commands `[N, length, D_u]`, and which of
        `materials_of(runs)` each window belongs to, `[N]`.

    Raises:
        ValueError: a run is too short.
    """
    shortest = min(len(run) for run in runs)
    if shortest <= length:
        raise ValueError(
            f"a window predicts {length} steps, and the shortest run has only "
            f"{shortest}: leave it out, or set a smaller `sequence_length`"
        )
    materials = materials_of(runs)
    states = []
    commands = []
    which = []
    for run in runs:
        # `unfold` puts the steps of a window last: [N, D, steps]
        s = torch.tensor(run.s).unfold(0, length + 1, stride).transpose(1, 2)
        u = torch.tensor(run.u[:-1]).unfold(0, length, stride).transpose(1, 2)
        states.append(s)
        commands.append(u)
        which.append(torch.full((len(s),), materials.index(run.material)))
    return torch.cat(states), torch.cat(commands), torch.cat(which)


@torch.no_grad()
def set_normalisation(model: DPMPB, runs: Sequence[Run]) -> None:
    """Set the model's means and standard deviations from all the data.

    What never varies teaches nothing, and dividing by its deviation would make the
    first other reading the largest signal of all. So it is left out, with a warning.
    Its deviation becomes huge, so that no error of it counts and its weights have no
    gradient; these start at zero, and stay there. What is predicted is its mean.
    """
    constant = {}
    for kind, word in (("s", "state"), ("u", "command")):
        values = torch.tensor(np.concatenate([getattr(run, kind) for run in runs]))
        size = values.abs().amax(0)
        constant[kind] = values.amax(0) - values.amin(0) <= _ROUNDING * size
        mean = torch.where(constant[kind], values[0], values.mean(0))
        huge = _CONSTANT * size.clamp_min(1)
        std = torch.where(constant[kind], huge, values.std(0))
        getattr(model, f"{kind}_mean").copy_(mean)
        getattr(model, f"{kind}_std").copy_(std)
        _warn_of_constants(word, constant[kind], getattr(runs[0], f"{word}_names"))

    # The first layer takes commands, then states; the last one gives states.
    unused = torch.cat([constant["u"], constant["s"]]).nonzero().flatten()
    model.fc_in.get_parameter("0.weight")[:, unused] = 0
    for values in model.fc_out[-1].parameters():
        values[constant["s"]] = 0


def _warn_of_constants(kind: str, constant: Tensor, names: tuple[str, ...]) -> None:
    if not constant.any():
        return
    places = constant.nonzero().flatten().tolist()
    listed = ", ".join(names[k] if names else str(k) for k in places)
    counted = "" if names else " (counted from 0)"
    warnings.warn(
        f"{kind} {listed}{counted} never changes in these runs, in single precision: "
        "the model leaves it out",
        stacklevel=4,
    )
