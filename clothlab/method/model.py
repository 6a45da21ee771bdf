"""DPMPB, the deep predictive model with parametric bias: s[t+1] = h(s[t], u[t], p)
(paper, eqs. 1, 3 and 4).
"""

import itertools
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from clothlab._validation import check_kind, check_number


class Memory(NamedTuple):
    """Hidden and cell state of the two LSTM layers, each `[2, B, 30]`."""

    h: Tensor
    c: Tensor


class DPMPB(nn.Module):
    """Ten layers: input → 300 → 100 → 30 → LSTM 30 → LSTM 30 → 30 → 100 → 300 → D_s,
    with tanh between them.

    In and out are physical units: means and standard deviations of `s` and `u` are
    buffers (`set_normalisation`).
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
        self.fc_out = nn.Sequential(
            *_tanh_layers(30, 30, 100, 300), nn.Linear(300, state_size)
        )
        for name, size in (("s", state_size), ("u", command_size)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: Memory | None = None
    ) -> tuple[Tensor, Memory]:
        """Predict each next state `[B, T, D_s]`, and the memory after the last step
        (eq. 1).

        From states `[B, T, D_s]`, commands `[B, T, D_u]`, the parametric bias `[B,
        D_p]` or `[D_p]`, and the memory before the first step, zeros by default.
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
        """Mean squared error of states `[..., D_s]` in standard deviations, so that
        every sensor counts alike.
        """
        return nn.functional.mse_loss(predicted / self.s_std, s / self.s_std)


def _tanh_layers(*sizes: int) -> nn.Sequential:
    pairs = itertools.pairwise(sizes)
    return nn.Sequential(
        *[layer for a, b in pairs for layer in (nn.Linear(a, b), _Tanh())]
    )


class _Tanh(nn.Module):
    """tanh(a) = 2σ(2a) - 1: on a processor σ takes a tenth of tanh's time, which was a
    fifth of a training's.
    """

    def forward(self, a: Tensor) -> Tensor:
        return 2 * torch.sigmoid(2 * a) - 1


def predict(
    model: DPMPB, s: Tensor, u: Tensor, p: Tensor, memory: Memory | None = None
) -> Tensor:
    """Predict states `[B, T, D_s]` from one state `[D_s]` and commands `[B, T, D_u]`,
    each from the prediction before.

    The state may be one for each sequence, `[B, D_s]`; p is `[D_p]`, and `memory` of
    batch 1 or B. This is the plain version of `FastDPMPB`, to test and time it against,
    and what controllers use where that does not fit.
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


def check_model(model: Any) -> DPMPB:
    """Return a model that can be used for estimation and control; a ValueError if it is
    none, or on another device.
    """
    check_kind("model", model, DPMPB)
    if model.s_mean.device.type != "cpu":
        raise ValueError(
            f"the model is on {model.s_mean.device}: move it with `model.cpu()`, since estimation and control compute "
            "there, where their small matrices are fastest"
        )
    return model
