"""What a training learns that holds for recordings which it has not seen.

Networks with and without p, and with and without a memory, by their errors on trials
that were held out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from clothlab import data
from clothlab.method.data import Run, materials_of, set_normalisation, windows
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining
from clothlab.trials import to_run
from studies._grid import Experiment, grid
from studies._optimise import minimise, seeded
from studies._runs import EVALUATION, RECORDINGS, errors_ahead, trained

_WEIGHTS = "torque-paper"  # whose autoencoder encodes: the paper's amount of images
_WARM = 10  # steps of a window that only fill the memory [step]
_HORIZON = 16  # how far ahead a closed loop predicts [step]
_EVERY = 32  # steps between the starts of two closed loops


@dataclass(frozen=True)
class _Kind:
    """One way to train, and what differs from the usual one."""

    bias_size: int = 2
    frames: int = 0  # of a stack in place of the LSTM; 0: the LSTM
    bias_rate: float = 6e-3  # of p
    updates: int = 300
    seeds: int = 5  # trainings
    stored: bool = False  # trained before: the weights `torque-paper`
    mean_p: bool = False  # predicts with the mean of all p


KINDS = {
    "p": _Kind(),
    "none": _Kind(bias_size=0),
    "4 frames": _Kind(frames=4, seeds=2),
    "1 frame": _Kind(frames=1),
    "1 frame, none": _Kind(frames=1, bias_size=0),
    "slow p": _Kind(bias_rate=2e-3),
    "4 frames, longer": _Kind(frames=4, updates=900, seeds=2),
    "1 frame, longer": _Kind(frames=1, updates=900),
    "1 frame, none, longer": _Kind(frames=1, bias_size=0, updates=900),
    "stored": _Kind(updates=900, stored=True),
    "stored, mean p": _Kind(updates=900, stored=True, mean_p=True),
    "p, longer": _Kind(updates=900),
    "none, longer": _Kind(updates=900, bias_size=0),
}


class Stack(nn.Module):
    """The paper's network with the last frames in place of the LSTM.

    A frame is a state and the command that was sent in it. It is called as `DPMPB` is;
    its memory is the frames before, of which the first stands in for earlier ones.
    """

    s_mean: Tensor
    s_std: Tensor
    u_mean: Tensor
    u_std: Tensor

    def __init__(self, states: int, commands: int, bias_size: int, frames: int):
        super().__init__()
        self.bias_size = bias_size
        self.frames = frames
        sizes = (frames * (states + commands) + bias_size, 300, 100, 100, 300)
        layers: list[nn.Module] = []
        for k in range(4):
            layers += [nn.Linear(sizes[k], sizes[k + 1]), nn.Tanh()]
        self.fc_in = nn.Sequential(*layers)
        self.fc_out = nn.Sequential(nn.Linear(300, states))
        for name, size in (("s", states), ("u", commands)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The next states `[B, T, D_s]`, and the frames to remember."""
        s = (s - self.s_mean) / self.s_std
        u = (u - self.u_mean) / self.u_std
        frames = torch.cat([s, u], dim=-1)
        if memory is None:
            memory = frames[:, :1].expand(-1, self.frames - 1, -1)
        known = torch.cat([memory, frames], dim=1)

        # Of each step, its own frame and those before
        stacked = known.unfold(1, self.frames, 1).flatten(2)
        p = p.expand(len(s), self.bias_size)[:, None].expand(-1, s.shape[1], -1)
        following = self.fc_out(self.fc_in(torch.cat([stacked, p], dim=-1)))
        kept = known[:, len(known[0]) - self.frames + 1 :]
        return following * self.s_std + self.s_mean, kept


def _train_one(kind: str, seed: int, updates: int = 300) -> dict[str, Any]:
    """Errors of one training, on its own trials and on those held out.

    An update takes 64 windows. Those stored, which are only looked at, took 300.
    """
    chosen = KINDS[kind]
    known = _runs(RECORDINGS["torque"])
    unseen = _runs(EVALUATION["torque"])
    materials = materials_of(known)
    with seeded(seed):
        model = _network(chosen, known)
        p = torch.zeros(len(materials), chosen.bias_size)
        before = _weights(model)
        if chosen.stored:
            learned = trained(f"{_WEIGHTS}-{seed}")
            model = learned.model
            p = torch.tensor(np.stack([learned.biases[name] for name in materials]))
            if chosen.mean_p:
                p = p.mean(dim=0).expand_as(p)
            curves = [(_loss(model, p, known), _loss(model, p, unseen))]
        else:
            curves = list(_train(model, p, chosen, known, unseen, updates))

    # Both losses after each tenth of the training, and what a closed loop is worth
    training, held_out = np.transpose(curves)
    biases = dict(zip(materials, p.detach(), strict=True))
    ahead = _errors_ahead(model, biases, unseen)
    moved = (_weights(model) - before).abs().median()
    moved_p = p.detach().abs().median() if chosen.bias_size else torch.zeros(())
    return {
        "training": training.round(5),
        "held_out": held_out.round(5),
        "error": ahead.mean(axis=0).round(4),
        "moved_weight": float(moved),
        "moved_p": float(moved_p),
    }


def _runs(recordings: str) -> list[Run]:
    autoencoder, _ = data.load_autoencoder(_WEIGHTS)
    return [to_run(autoencoder, trial) for trial in data.load_trials(recordings)]


def _network(kind: _Kind, runs: Sequence[Run]) -> DPMPB | Stack:
    """A network of random weights, normalised by these runs."""
    states = runs[0].s.shape[1]
    commands = runs[0].u.shape[1]
    lstm = DPMPB(states, commands, kind.bias_size)
    set_normalisation(lstm, runs)
    if not kind.frames:
        return lstm

    # The stack has the same buffers
    stack: Any = Stack(states, commands, kind.bias_size, kind.frames)
    stack.load_state_dict(dict(lstm.named_buffers()), strict=False)
    return stack


def _weights(model: DPMPB | Stack) -> Tensor:
    """All weights, as one vector."""
    return torch.cat([each.detach().flatten() for each in model.parameters()])


def _train(
    model: DPMPB | Stack,
    p: Tensor,
    kind: _Kind,
    known: Sequence[Run],
    unseen: Sequence[Run],
    updates: int,
) -> Iterator[tuple[float, float]]:
    """Train in place; yields the two losses after each tenth of the updates.

    Args:
        model: a network.
        p: of each material `[K, D_p]`.
        kind: how it is trained.
        known: runs to learn from.
        unseen: runs of the same materials that are only looked at.
        updates: how many.
    """
    usual = ModelTraining()
    s, u, k = windows(known, usual.sequence_length, usual.stride)
    p.requires_grad_()
    groups: list[dict[str, Any]] = [{"params": list(model.parameters())}]
    if kind.bias_size:
        groups.append({"params": [p], "lr": kind.bias_rate})

    def loss(index: Tensor) -> Tensor:
        predicted, _ = model(s[index, :-1], u[index], p[k[index]])
        return _squared(model, predicted, s[index, 1:])

    def batches() -> Sequence[Tensor]:
        return [torch.randint(len(s), (64,))]

    # An epoch is one update here
    steps = minimise(groups, loss, batches, updates, usual.learning_rate)
    for n, _ in enumerate(steps, start=1):
        if n % (updates // 10) == 0:
            yield _loss(model, p, known), _loss(model, p, unseen)


def _squared(model: DPMPB | Stack, predicted: Tensor, s: Tensor) -> Tensor:
    """Mean squared error of states in standard deviations."""
    return nn.functional.mse_loss(predicted / model.s_std, s / model.s_std)


@torch.no_grad()
def _loss(model: DPMPB | Stack, p: Tensor, runs: Sequence[Run]) -> float:
    """One-step loss on windows of runs, once there is something to remember."""
    s, u, k = windows(runs, ModelTraining().sequence_length, 30)
    predicted, _ = model(s[:, :-1], u, p[k])
    return float(_squared(model, predicted[:, _WARM:], s[:, _WARM + 1 :]))


def _errors_ahead(
    model: DPMPB | Stack, biases: dict[str, Tensor], runs: Sequence[Run]
) -> np.ndarray:
    """Distances in z of closed loops to the truth [s.d.], `[N, _HORIZON]`."""
    errors = []
    for run in runs:
        starts = range(_EVERY, len(run) - _HORIZON, _EVERY)
        p = biases[run.material]
        errors.append(errors_ahead(model, run, p, starts, _HORIZON))
    return np.concatenate(errors)


def _cases(**sizes: Any) -> list[dict[str, Any]]:
    """Each kind with the seeds that it has."""
    cases: list[dict[str, Any]] = []
    for kind, chosen in KINDS.items():
        seeds = range(chosen.seeds)
        usual = {"kind": kind, "seed": seeds, "updates": chosen.updates}
        cases += grid(**(usual | sizes))
    return cases


EXPERIMENTS = (Experiment("held_out", _train_one, _cases, slow=True),)
