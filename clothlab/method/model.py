"""DPMPB, the deep predictive model with parametric bias.

    s[t+1] = h(s[t], u[t], p)

The parametric bias p says what a material is like: a few numbers for each, learned
together with the weights W. Source: the paper, eqs. 1, 3 and 4. A network of one's own
takes its place as another `PredictiveModel`.
"""

import itertools
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn

from clothlab._validation import check_number
from clothlab.method._memories import AnyMemory, expanded

# The standard deviation of a sensor that a network leaves out: no real one reaches it.
_LEFT_OUT = 1e30


class PredictiveModel(nn.Module):
    """What training, estimation and control need of a network; `DPMPB` is one.

    A network of one's own is a subclass with a `forward`. One that remembers says in
    `initial_memory` what it remembers before the first step, and `loss` may be another
    one. In and out are physical units: `to_inputs` and `to_states` normalise inside,
    by buffers that the training sets from all the data.

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

    @property
    def input_size(self) -> int:
        """How many numbers `to_inputs` gives for each step, D_u + D_s + D_p."""
        return self.command_size + self.state_size + self.bias_size

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: AnyMemory | None = None
    ) -> tuple[Tensor, AnyMemory]:
        """Predict each next state from the states before it (eq. 1).

        Args:
            s: states, `[B, T, D_s]`.
            u: commands, `[B, T, D_u]`.
            p: parametric bias, `[B, D_p]`, or `[D_p]` for all.
            memory: what is remembered of the steps before; None before the first.

        Returns:
            The next states `[B, T, D_s]`, and the memory after the last step.
        """
        raise NotImplementedError(f"{type(self).__name__} has no forward")

    def initial_memory(self) -> AnyMemory:
        """What is remembered before the first step of one run.

        A tuple of tensors `[layers, 1, ...]`, empty for a network without a memory.
        """
        return ()

    def loss(self, predicted: Tensor, s: Tensor) -> Tensor:
        """Mean squared error of states `[..., D_s]` in standard deviations.

        So every sensor counts alike.
        """
        return nn.functional.mse_loss(predicted / self.s_std, s / self.s_std)

    def to_inputs(self, s: Tensor, u: Tensor, p: Tensor) -> Tensor:
        """Normalised commands and states, and p, side by side: `[B, T, input_size]`."""
        batch, steps, _ = s.shape
        s = (s - self.s_mean) / self.s_std
        u = (u - self.u_mean) / self.u_std
        p = p.expand(batch, self.bias_size).unsqueeze(1).expand(-1, steps, -1)

        # What is left out is zero, and so is its gradient.
        s = s.where(self.s_std < _LEFT_OUT, 0)
        u = u.where(self.u_std < _LEFT_OUT, 0)
        return torch.cat([u, s, p], dim=-1)

    def to_states(self, x: Tensor) -> Tensor:
        """States in physical units of what a network gives for them `[B, T, D_s]`."""
        x = x.where(self.s_std < _LEFT_OUT, 0)
        return x * self.s_std + self.s_mean

    def leave_out(self, states: Tensor, commands: Tensor) -> None:
        """Be deaf to some states `[D_s]` and commands `[D_u]`, bool; these never vary.

        The mean of such a state is predicted.
        """
        self.s_std[states] = _LEFT_OUT
        self.u_std[commands] = _LEFT_OUT


class Memory(NamedTuple):
    """Hidden and cell state of the two LSTM layers, each `[2, B, 30]`."""

    h: Tensor
    c: Tensor


class DPMPB(PredictiveModel):
    """The paper's network of ten layers, with tanh between them.

        (u, s, p) → 300 → 100 → 30 → LSTM 30 → LSTM 30 → 30 → 100 → 300 → D_s

    In and out are physical units. The means and standard deviations of `s` and `u`, by
    which they are normalised inside, are buffers (`data.set_normalisation`).

    Args:
        state_size: D_s.
        command_size: D_u.
        bias_size: D_p, which may be 0: a model that knows nothing of materials.
    """

    def __init__(self, state_size: int, command_size: int, bias_size: int = 2):
        super().__init__(state_size, command_size, bias_size)
        self.fc_in = _tanh_layers(self.input_size, 300, 100, 30)
        self.lstm = nn.LSTM(30, 30, num_layers=2, batch_first=True)
        self.fc_out = _tanh_layers(30, 30, 100, 300)
        self.fc_out.append(nn.Linear(300, state_size))

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: AnyMemory | None = None
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

    def initial_memory(self) -> Memory:
        """The recurrent state before the first step of one run: zeros."""
        zeros = torch.zeros(self.lstm.num_layers, 1, self.lstm.hidden_size)
        return Memory(zeros, zeros)

    @torch.no_grad()
    def leave_out(self, states: Tensor, commands: Tensor) -> None:
        """Weights of zero, which stay zero in the training since their gradient is."""
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
    model: PredictiveModel,
    s: Tensor,
    u: Tensor,
    p: Tensor,
    memory: AnyMemory | None = None,
) -> Tensor:
    """Predict states over many steps, each from the prediction before.

    This is the plain version of `FastDPMPB`: to read, to test and to time that
    against, and what controllers use for a network that it can't take.

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
        memory = expanded(memory, batch)
    s = s.unsqueeze(-2).expand(batch, 1, -1)
    states = []
    for t in range(steps):
        s, memory = model(s, u[:, t : t + 1], p, memory)
        states.append(s)
    return torch.cat(states, dim=1)
