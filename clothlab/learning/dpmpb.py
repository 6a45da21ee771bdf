"""DPMPB, the deep predictive model with parametric bias: s[t+1] = h(s[t], u[t], p) (paper, eqs. 1, 3 and 4)."""

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from tqdm.auto import tqdm

from clothlab._validation import (
    Checked,
    check_array,
    check_each,
    check_kind,
    check_number,
    check_seed,
    choose,
    setting,
    settings_or_default,
)
from clothlab.learning._training import best_device, fit, training


class Memory(NamedTuple):
    """Hidden and cell state of the two LSTM layers, each `[2, B, 30]`."""

    h: Tensor
    c: Tensor


class DPMPB(nn.Module):
    """Ten layers: input → 300 → 100 → 30 → LSTM 30 → LSTM 30 → 30 → 100 → 300 → D_s, with tanh between them.

    In and out are physical units: means and standard deviations of `s` and `u` are buffers (`fit_normalisation`).
    """

    s_mean: Tensor
    s_std: Tensor
    u_mean: Tensor
    u_std: Tensor

    def __init__(self, state_size: int, command_size: int, bias_size: int = 2):
        super().__init__()
        self.state_size = check_number("state_size", state_size, int, at_least=1)
        self.command_size = check_number("command_size", command_size, int, at_least=1)
        self.bias_size = check_number("bias_size", bias_size, int, at_least=0)
        self.fc_in = _tanh_layers(command_size + state_size + bias_size, 300, 100, 30)
        self.lstm = nn.LSTM(30, 30, num_layers=2, batch_first=True)
        self.fc_out = nn.Sequential(*_tanh_layers(30, 30, 100, 300), nn.Linear(300, state_size))
        for name, size in (("s", state_size), ("u", command_size)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))

    def forward(self, s: Tensor, u: Tensor, p: Tensor, memory: Memory | None = None) -> tuple[Tensor, Memory]:
        """Predict each next state `[B, T, D_s]`, and the memory after the last step (eq. 1).

        From states `[B, T, D_s]`, commands `[B, T, D_u]`, the parametric bias `[B, D_p]` or `[D_p]`, and the memory
        before the first step, zeros by default.
        """
        s, u = (s - self.s_mean) / self.s_std, (u - self.u_mean) / self.u_std
        p = p.expand(len(s), self.bias_size).unsqueeze(1).expand(-1, s.shape[1], -1)
        x = self.fc_in(torch.cat([u, s, p], dim=-1))
        x, memory = self.lstm(x, memory)
        return self.fc_out(x) * self.s_std + self.s_mean, Memory(*memory)

    def initial_memory(self) -> Memory:
        """The recurrent state before the first step of one run: zeros."""
        zeros = torch.zeros(self.lstm.num_layers, 1, self.lstm.hidden_size)
        return Memory(zeros, zeros)

    def loss(self, predicted: Tensor, s: Tensor) -> Tensor:
        """Mean squared error of states `[..., D_s]` in standard deviations, so that every sensor counts alike."""
        return nn.functional.mse_loss(predicted / self.s_std, s / self.s_std)


def _tanh_layers(*sizes: int) -> nn.Sequential:
    pairs = itertools.pairwise(sizes)
    return nn.Sequential(*[layer for a, b in pairs for layer in (nn.Linear(a, b), _Tanh())])


class _Tanh(nn.Module):
    """tanh(a) = 2σ(2a) - 1: on a processor σ takes a tenth of tanh's time, which was a fifth of a training's."""

    def forward(self, a: Tensor) -> Tensor:
        return 2 * torch.sigmoid(2 * a) - 1


def predict(model: DPMPB, s: Tensor, u: Tensor, p: Tensor, memory: Memory | None = None) -> Tensor:
    """Predict states `[B, T, D_s]` from one state `[D_s]` and commands `[B, T, D_u]`, each from the prediction before.

    The state may be one for each sequence, `[B, D_s]`; p is `[D_p]`, and `memory` of batch 1 or B. This is the plain
    version of `FastDPMPB`, to test and time it against, and what controllers use where that does not fit.
    """
    batch = len(u)
    if memory is not None:
        memory = Memory(*(part.expand(-1, batch, -1).contiguous() for part in memory))
    s = s.unsqueeze(-2).expand(batch, 1, -1)
    states = []
    for t in range(u.shape[1]):
        s, memory = model(s, u[:, t : t + 1], p, memory)
        states.append(s)
    return torch.cat(states, dim=1)


@dataclass(frozen=True)
class ModelTraining(Checked):
    """How W and p are trained together; the defaults are the paper's for the simulation."""

    epochs: int = setting(300, at_least=1)
    batch_size: int = setting(300, at_least=1)  # sequences
    sequence_length: int = setting(30, "step", at_least=1)  # LSTM expansions
    bias_size: int = setting(2, at_least=0)  # D_p
    # The paper stops here. What follows keeps a large network from learning 4,500 steps by heart (notebook 04).
    stride: int = setting(5, "step", at_least=1)  # between the starts of overlapping sequences
    learning_rate: float = setting(2e-3, above=0)  # of W; falls to zero along a cosine
    bias_learning_rate: float = setting(6e-3, above=0)  # of p, whose few numbers must travel far


@dataclass(frozen=True, eq=False)
class TrainingTrace:
    """What happened in a training."""

    losses: np.ndarray  # mean squared error of each epoch, in standard deviations, [epochs]
    biases: dict[str, np.ndarray]  # p of each material before the first epoch and after each, {name: [epochs + 1, D_p]}


@dataclass(frozen=True, eq=False)
class Sequences(Checked):
    """One run as the model sees it; runs of one material share one p."""

    s: np.ndarray  # states [T, D_s]; of a cloth, z first
    u: np.ndarray  # commands [T, D_u]
    material: str

    def __post_init__(self) -> None:
        for name in ("s", "u"):
            what = f"{name} of a run of {self.material}"
            array = check_array(what, getattr(self, name), ("T", f"D_{name}"), np.float32)
            object.__setattr__(self, name, array)
        if not len(self.s) == len(self.u) > 0:
            raise ValueError(f"a run has as many states as commands, and some, got {len(self.s)} and {len(self.u)}")
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.s)

    def __getitem__(self, steps: slice) -> "Sequences":
        """Return a stretch of the run, `run[:100]`."""
        return Sequences(self.s[steps], self.u[steps], self.material)


RUNS_ADVICE = ": `learned.sequences(trial)` makes one of a trial"


def check_model(model: Any) -> DPMPB:
    """Return a model that can be used for estimation and control; a ValueError if it is none, or on another device."""
    check_kind("model", model, DPMPB)
    if model.s_mean.device.type != "cpu":
        raise ValueError(
            f"the model is on {model.s_mean.device}: move it with `model.cpu()`, since estimation and control compute "
            "there, where their small matrices are fastest"
        )
    return model


def check_run(run: Any) -> Sequences:
    """Return one run; a ValueError for anything else, such as a trial."""
    return check_kind("run", run, Sequences, RUNS_ADVICE)


def check_runs(runs: Any) -> list[Sequences]:
    """Return runs as a list; a ValueError says which is none."""
    return check_each("runs", runs, Sequences, RUNS_ADVICE)


class EpisodeEnded(ValueError):
    """A robot's episode was over before the run: `run` is what had been recorded."""

    def __init__(self, message: str, run: Sequences):
        super().__init__(message)
        self.run = run


def collect_run(
    env: Any,
    policy: Callable[[np.ndarray], ArrayLike],
    steps: int,
    material: str,
    *,
    seed: int = 0,
    observe: Callable[[Any], ArrayLike] = np.asarray,
    progress: bool = False,
) -> Sequences:
    """Record a Gymnasium robot from its reset on: `observe(observation)` is s `[D_s]`, and `policy(s)` is u `[D_u]`.

    An episode that ends early is an `EpisodeEnded`, which says why and keeps the steps so far as its `run`.
    """
    check_number("steps", steps, int, at_least=1)
    observation, _ = env.reset(seed=check_seed(seed))
    states: list[np.ndarray] = []
    commands: list[np.ndarray] = []
    for step in tqdm(range(steps), desc=material, disable=not progress, unit="step"):
        s = np.array(observe(observation), ndmin=1)
        u = np.array(policy(s), ndmin=1)
        states.append(s)
        commands.append(u)
        observation, _, terminated, truncated, _ = env.step(u)
        if (terminated or truncated) and step + 1 < steps:
            so_far = Sequences(np.stack(states), np.stack(commands), material)
            raise EpisodeEnded(_why_it_ended(terminated, len(so_far), steps), so_far)
    return Sequences(np.stack(states), np.stack(commands), material)


def _why_it_ended(terminated: bool, done: int, steps: int) -> str:
    """Advice for an episode that was over after `done` of `steps` steps."""
    where = f"after {done} of {steps} steps; they are kept as `run` of this error"
    if terminated:
        return f"the robot's task was over {where}. Use gentler commands, or record several short runs"
    return f"the time limit of the environment was reached {where}: raise its `max_episode_steps`"


# A sensor counts as constant where it varies by no more than single precision rounds, relative to its size.
_ROUNDING = 1e-6
# The standard deviation that such a sensor gets, in units of its size: so large that no reading of it means anything.
_UNHEARD = 1e6


def fit_normalisation(model: DPMPB, runs: Sequence[Sequences]) -> None:
    """Set the model's means and standard deviations from all the data (paper, "Network Structure of DPMPB").

    What never varies in the data teaches nothing, and dividing by its deviation would turn the first other reading
    into the largest signal of all. So a constant sensor or command is left out, with a warning: it gets a deviation
    that nothing reaches, and weights of zero, which stay zero in the training since their gradient is.
    """
    for name in ("s", "u"):
        values = torch.as_tensor(np.concatenate([getattr(run, name) for run in runs]), dtype=torch.float32)
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
                f"{kind} {places} (counted from 0) never changes in these runs: the model leaves it out", stacklevel=3
            )


@torch.no_grad()
def _leave_out(model: DPMPB, name: str, constant: Tensor) -> None:
    """Make the model deaf to some states or commands `[D]`, bool, and let it predict their mean."""
    first_layer = cast(nn.Linear, model.fc_in[0])
    last_layer = cast(nn.Linear, model.fc_out[-1])
    offset = 0 if name == "u" else model.command_size
    columns = offset + constant.nonzero().flatten()
    first_layer.weight[:, columns] = 0
    if name == "s":
        last_layer.weight[constant] = 0
        last_layer.bias[constant] = 0


def train_dpmpb(
    runs: Sequence[Sequences],
    settings: ModelTraining | None = None,
    *,
    known: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
) -> tuple[DPMPB, dict[str, np.ndarray], TrainingTrace]:
    """Train the weights W and one p for each material together (eqs. 3 and 4), p from zero.

    With `known`, p of each material `{name: [D_p]}`, only W is trained. The device is a GPU by default, where torch
    sees one. Returns the model on the CPU, p of each material, and the trace of losses and p.
    """
    settings = settings_or_default(settings, ModelTraining)
    device = device or best_device()
    runs = check_runs(runs)
    _check_lengths(runs, settings.sequence_length)
    names = _materials(runs)
    p = _first_biases(names, settings.bias_size, known).to(device).requires_grad_(not known)
    with training(seed):
        model = DPMPB(runs[0].s.shape[1], runs[0].u.shape[1], settings.bias_size)
        fit_normalisation(model, runs)
        losses, path = _train(model.to(device), p, runs, settings, device, progress)
    trace = TrainingTrace(np.array(losses), dict(zip(names, np.stack(path, axis=1), strict=True)))
    return model.cpu().eval(), {name: each[-1] for name, each in trace.biases.items()}, trace


def _train(
    model: DPMPB, p: Tensor, runs: Sequence[Sequences], settings: ModelTraining, device: str, progress: bool
) -> tuple[list[float], list[np.ndarray]]:
    """Train W and p `[K, D_p]` in place: the loss of each epoch, and p before the first and after each."""
    s, u, k = (part.to(device) for part in stretches(runs, settings.sequence_length, settings.stride))

    def loss(index: Tensor) -> Tensor:
        predicted, _ = model(s[index, :-1], u[index], p[k[index]])
        return model.loss(predicted, s[index, 1:])

    def batches() -> Sequence[Tensor]:
        return torch.randperm(len(s), device=device).split(settings.batch_size)

    groups: list[dict[str, Any]] = [{"params": model.parameters()}]
    if p.requires_grad:
        groups.append({"params": [p], "lr": settings.bias_learning_rate})
    losses, path, bar = [], [p.detach().cpu().numpy().copy()], "DPMPB" if progress else None
    for mean_loss in fit(groups, loss, batches, settings.epochs, settings.learning_rate, bar=bar):
        losses.append(mean_loss)
        path.append(p.detach().cpu().numpy().copy())
    return losses, path


def _materials(runs: Sequence[Sequences]) -> list[str]:
    """Each once, in the order in which they first occur."""
    return list(dict.fromkeys(run.material for run in runs))


def _first_biases(materials: list[str], size: int, known: Mapping[str, ArrayLike] | None) -> Tensor:
    """Zeros, or what is known, `[K, D_p]`."""
    if not known:
        return torch.zeros(len(materials), size)
    rows = [check_array(f"p of {name}", choose("material", name, known), (size,), np.float32) for name in materials]
    return torch.as_tensor(np.array(rows))


def _check_lengths(runs: Sequence[Sequences], length: int) -> None:
    if not runs:
        raise ValueError("no runs to train on")
    for run in runs:
        if len(run) <= length:
            raise ValueError(f"a run needs more steps than the {length} of a sequence, got {len(run)}")
        if run.s.shape[1] != runs[0].s.shape[1] or run.u.shape[1] != runs[0].u.shape[1]:
            raise ValueError(
                "all runs must have states and commands of the same sizes: was each recorded with the same robot?"
            )


def stretches(runs: Sequence[Sequences], length: int, stride: int) -> tuple[Tensor, Tensor, Tensor]:
    """Overlapping stretches of runs, whose starts are `stride` steps apart.

    States `[N, length + 1, D_s]`, commands `[N, length, D_u]`, and each material's place in `_materials` `[N]`.
    """
    materials = _materials(runs)
    s = [torch.as_tensor(run.s).unfold(0, length + 1, stride).transpose(1, 2) for run in runs]
    u = [torch.as_tensor(run.u[:-1]).unfold(0, length, stride).transpose(1, 2) for run in runs]
    k = [torch.full((len(part),), materials.index(run.material)) for part, run in zip(s, runs, strict=True)]
    return torch.cat(s), torch.cat(u), torch.cat(k)
