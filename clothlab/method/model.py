"""DPMPB, the deep predictive model with parametric bias.

    s[t+1] = h(s[t], u[t], p)

The parametric bias p says what a material is like: a few numbers for each, learned
together with the weights W (`training`). Source: the paper, eq. 1.
"""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn


class Memory(NamedTuple):
    """Hidden and cell state of the two LSTM layers, each `[2, B, 30]`."""

    h: Tensor
    c: Tensor


class DPMPB(nn.Module):
    """The paper's network of ten layers, the input among them, with tanh between them.

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

    # Of the runs it was trained on, where they know it; see `data.check_fits`.
    step: float | None = None  # [s]
    state_names: tuple[str, ...] = ()
    command_names: tuple[str, ...] = ()

    def __init__(self, state_size: int, command_size: int, bias_size: int = 2):
        super().__init__()
        self.state_size = state_size
        self.command_size = command_size
        self.bias_size = bias_size
        for name, size in (("s", state_size), ("u", command_size)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))

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
        next_s = self.fc_out(x) * self.s_std + self.s_mean
        return next_s, Memory(*memory)

    def loss(self, predicted: Tensor, s: Tensor) -> Tensor:
        """Mean squared error in standard deviations, so that every sensor counts.

        The mean of s, which both would lose, cancels.
        """
        return nn.functional.mse_loss(predicted / self.s_std, s / self.s_std)

    def __repr__(self) -> str:
        """Return one line, such as "DPMPB: 7 states, 2 commands, 2 numbers in p"."""
        sizes = f"{self.state_size} states, {self.command_size} commands"
        return f"{type(self).__name__}: {sizes}, {self.bias_size} numbers in p"

    def initial_memory(self) -> Memory:
        """The recurrent state before the first step of one run: zeros."""
        zeros = self.s_mean.new_zeros(self.lstm.num_layers, 1, self.lstm.hidden_size)
        return Memory(zeros, zeros)


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

    It computes what `model` would, called with one step after the other, in half the
    time (a test compares the two): the layers are written out, so that what stays the
    same over all steps is computed once.

    Args:
        model: a trained one.
        s: the state to start from, `[D_s]`, or one for each sequence, `[B, D_s]`.
        u: commands, `[B, T, D_u]`.
        p: parametric bias, `[D_p]`.
        memory: recurrent state before, of batch 1 or B; zeros by default.

    Returns:
        The states after each command, `[B, T, D_s]`.

    Raises:
        TypeError: the model computes something else than these layers.
    """
    if type(model).forward is not DPMPB.forward:
        raise TypeError(
            f"{type(model).__name__} has a `forward` of its own, and `predict` knows "
            "that of DPMPB alone: call the model step by step"
        )
    batch, steps, _ = u.shape
    (bias, weight), *more_in = _layers(model.fc_in)
    *more_out, (bias_out, weight_out) = _layers(model.fc_out)

    # The first layer in three parts: p's is a constant, the commands' is known for all
    # steps, and only that of the state has to wait for the step before.
    sizes = [model.command_size, model.state_size, model.bias_size]
    from_u, from_s, from_p = weight.split(sizes)
    commands = ((u - model.u_mean) / model.u_std).flatten(0, 1)  # [B T, D_u]
    constant = torch.addmm(bias + p @ from_p, commands, from_u)  # [B T, 300]

    # The two cells of the LSTM: weights of what comes from below and from the own
    # memory, and both biases as one.
    cells = [
        (w_ih.T, w_hh.T, b_ih + b_hh)
        for w_ih, w_hh, b_ih, b_hh in model.lstm.all_weights
    ]
    memory = model.initial_memory() if memory is None else memory
    h = list(memory.h.expand(-1, batch, -1))
    c = list(memory.c.expand(-1, batch, -1))

    # The loop; states stay normalised while they go round.
    s = ((s - model.s_mean) / model.s_std).expand(batch, -1)
    states = []
    for x in constant.unflatten(0, (batch, steps)).unbind(1):  # [B, 300] each
        x = torch.addmm(x, s, from_s).tanh_()
        for bias, weight in more_in:
            x = torch.addmm(bias, x, weight).tanh_()
        for k, (below, own, bias) in enumerate(cells):
            gates = torch.addmm(torch.addmm(bias, x, below), h[k], own)
            i, f, g, o = gates.chunk(4, dim=1)  # in torch's order
            c[k] = torch.addcmul(f.sigmoid() * c[k], i.sigmoid(), g.tanh())
            h[k] = o.sigmoid() * c[k].tanh()
            x = h[k]
        for bias, weight in more_out:
            x = torch.addmm(bias, x, weight).tanh_()
        s = torch.addmm(bias_out, x, weight_out)
        states.append(s)
    return torch.stack(states, dim=1) * model.s_std + model.s_mean


def _layers(layers: nn.Sequential) -> list[tuple[Tensor, Tensor]]:
    """Bias `[out]` and weight `[in, out]` of each linear layer."""
    return [
        (layer.bias, layer.weight.T) for layer in layers if isinstance(layer, nn.Linear)
    ]


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute on one thread, and afterwards on as many as before.

    The matrices of a control step are so small that a second thread costs more than it
    brings, and on a busy machine ten times as much: each waits for the other.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@contextmanager
def usual_torch() -> Iterator[None]:
    """Let torch compute as it does by default, on one thread, and afterwards as before.

    That is with gradients and in single precision. Programs of robots call policies
    under `torch.no_grad()` or `torch.inference_mode()`, and others compute in double
    precision; descents need the gradients, and the weights are in single precision.
    """
    dtype = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)
    try:
        with one_thread(), torch.inference_mode(False), torch.enable_grad():
            yield
    finally:
        torch.set_default_dtype(dtype)


def check_model(model: DPMPB) -> None:
    """Refuse anything but a model, such as a checkpoint that holds one."""
    if not isinstance(model, DPMPB):
        raise ValueError(
            f"model is a DPMPB, got {type(model).__name__}: a checkpoint has it as "
            "`learned.model`"
        )


def numbers(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Tensor:
    """A tensor of finite numbers of this shape, in single precision.

    Raises:
        ValueError: the shape is another one, or something is missing.
    """
    array = np.asarray(values, np.float32)
    wanted = f"{name} is {list(shape)} and finite"
    if array.shape != shape:
        raise ValueError(f"{wanted}, got the shape {list(array.shape)}")
    finite = np.isfinite(array)
    if not finite.all():
        raise ValueError(f"{wanted}, got {array[~finite][0]}")
    with torch.inference_mode(False):  # such a tensor could have no gradient
        return torch.tensor(array)
