"""DPMPB, the deep predictive model with parametric bias.

    s[t+1] = h(s[t], u[t], p)

The parametric bias p says what a material is like: a few numbers for each, learned
together with the weights W. Source: the paper, eqs. 1, 3 and 4.
"""

import itertools
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn

from clothlab._validation import check_number


class Memory(NamedTuple):
    """Hidden and cell state of the two LSTM layers, each `[2, B, 30]`."""

    h: Tensor
    c: Tensor

    def expand(self, batch: int) -> "Memory":
        """The same for each of a batch, from that of batch 1 or B."""
        h, c = (part.expand(-1, batch, -1).contiguous() for part in self)
        return Memory(h, c)


class DPMPB(nn.Module):
    """The paper's network of ten layers, with tanh between them.

        (u, s, p) → 300 → 100 → 30 → LSTM 30 → LSTM 30 → 30 → 100 → 300 → D_s

    In and out are physical units. The means and standard deviations of `s` and `u`, by
    which they are normalised inside, are buffers (`data.set_normalisation`).

    Args:
        state_size: D_s.
        command_size: D_u.
        bias_size: D_p, which may be 0: a model that knows nothing of materials.
    """

    s_mean: Tensor
    s_std: Tensor
    u_mean: Tensor
    u_std: Tensor
    step: float | None = None  # of the runs it was trained on [s], where it is known

    def __init__(self, state_size: int, command_size: int, bias_size: int = 2):
        super().__init__()
        self.state_size = check_number("state_size", state_size, int, at_least=1)
        self.command_size = check_number("command_size", command_size, int, at_least=1)
        self.bias_size = check_number("bias_size", bias_size, int, at_least=0)
        self.register_buffer("s_mean", torch.zeros(state_size))
        self.register_buffer("s_std", torch.ones(state_size))
        self.register_buffer("u_mean", torch.zeros(command_size))
        self.register_buffer("u_std", torch.ones(command_size))

        self.fc_in = _tanh_layers(command_size + state_size + bias_size, 300, 100, 30)
        self.lstm = nn.LSTM(30, 30, num_layers=2, batch_first=True)
        self.fc_out = _tanh_layers(30, 30, 100, 300)
        self.fc_out.append(nn.Linear(300, state_size))

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: Memory | None = None
    ) -> tuple[Tensor, Memory]:
        """Predict each next state from the states before it (eq. 1).

        Args:
            s: states, `[B, T, D_s]`.
            u: commands, `[B, T, D_u]`.
            p: parametric bias, `[B, D_p]`, or `[D_p]` for all.
            memory: recurrent state before the first step, zeros by default.

        Returns:
            The next states `[B, T, D_s]`, and the memory after the last step.
        """
        batch, steps, _ = s.shape
        s = (s - self.s_mean) / self.s_std
        u = (u - self.u_mean) / self.u_std
        p = p.expand(batch, self.bias_size).unsqueeze(1).expand(-1, steps, -1)

        x = self.fc_in(torch.cat([u, s, p], dim=-1))
        x, memory = self.lstm(x, memory)
        following = self.fc_out(x)
        return following * self.s_std + self.s_mean, Memory(*memory)

    def loss(self, predicted: Tensor, s: Tensor) -> Tensor:
        """Mean squared error of states `[..., D_s]` in standard deviations.

        So every sensor counts alike.
        """
        return nn.functional.mse_loss(predicted / self.s_std, s / self.s_std)

    def initial_memory(self) -> Memory:
        """The recurrent state before the first step of one run: zeros."""
        zeros = torch.zeros(self.lstm.num_layers, 1, self.lstm.hidden_size)
        return Memory(zeros, zeros)

    @torch.no_grad()
    def leave_out(self, states: Tensor, commands: Tensor) -> None:
        """Be deaf to some states `[D_s]` and commands `[D_u]`, bool; these never vary.

        The mean of such a state is predicted. Their weights are zero, and stay so in
        the training, since their gradient is.
        """
        first_layer = cast(nn.Linear, self.fc_in[0])
        last_layer = cast(nn.Linear, self.fc_out[-1])
        first_layer.weight[:, commands.nonzero().flatten()] = 0
        columns = self.command_size + states.nonzero().flatten()
        first_layer.weight[:, columns] = 0
        last_layer.weight[states] = 0
        last_layer.bias[states] = 0


def _tanh_layers(*sizes: int) -> nn.Sequential:
    """Fully connected layers from each size to the next, each with a tanh."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [nn.Linear(inputs, outputs), nn.Tanh()]
    return nn.Sequential(*layers)


def predict(
    model: DPMPB, s: Tensor, u: Tensor, p: Tensor, memory: Memory | None = None
) -> Tensor:
    """Predict states over many steps, each from the prediction before.

    This is the plain version of `FastDPMPB`: to read, and to test that against.

    Args:
        model: a trained one.
        s: the state to start from, `[D_s]`, or one for each sequence, `[B, D_s]`.
        u: commands, `[B, T, D_u]`.
        p: parametric bias, `[D_p]`.
        memory: recurrent state before, of batch 1 or B; zeros by default.

    Returns:
        The states after each command, `[B, T, D_s]`.
    """
    batch, steps, _ = u.shape
    if memory is not None:
        memory = memory.expand(batch)
    s = s.unsqueeze(-2).expand(batch, 1, -1)
    states = []
    for t in range(steps):
        s, memory = model(s, u[:, t : t + 1], p, memory)
        states.append(s)
    return torch.cat(states, dim=1)
