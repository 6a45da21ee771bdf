"""DPMPB with W and p fixed, fast at many short predictions: control stands on it.

A solve predicts a hundred plans some steps ahead, again and again. Its matrices are
small, so its time goes into calling many small operations, and into tanh. `FastDPMPB`
has fewer operations and no tanh in its layers: σ takes a fraction of the time, and
tanh(a) = 2σ(2a) - 1. Not in the paper.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeGuard

import torch
from torch import Tensor, nn

from clothlab.method._quick_tanh import SigmoidTanh
from clothlab.method.model import DPMPB, Memory


class _Layer(NamedTuple):
    """A fully connected layer."""

    bias: Tensor  # [out]
    weight: Tensor  # [in, out]

    def __call__(self, x: Tensor) -> Tensor:
        """σ of what the layer makes of x `[B, in]`."""
        return torch.addmm(self.bias, x, self.weight).sigmoid_()


class _Cell(NamedTuple):
    """An LSTM layer, its four gates side by side."""

    below: _Layer  # from the layer below [30, 4 × 30]
    own: Tensor  # from its own last output [30, 4 × 30]


class _Folded(NamedTuple):
    """The network, changed so that it computes the same with σ in place of tanh."""

    command: _Layer  # the first layer's part for u, with p and normalisation in it
    state: Tensor  # its part for the normalised s [D_s, 300]
    rest_in: list[_Layer]
    cells: list[_Cell]
    most_out: list[_Layer]
    last: _Layer


class FastDPMPB:
    """`model.predict` for one model and one p, in a third of the time.

    The normalisation and p are folded into the first layer, states stay normalised
    while they go round the loop, and hidden layers compute σ.

    Args:
        model: with the layers of the paper; a ValueError for any other.
        p: parametric bias, `[D_p]`.
    """

    def __init__(self, model: DPMPB, p: Tensor):
        if not self.can_fold(model):
            raise ValueError(
                f"this {type(model).__name__} has a forward or layers of its own, "
                "which can't be folded: use `predict`, as controllers do for it"
            )
        self._s_mean = model.s_mean
        self._s_std = model.s_std
        with torch.no_grad():
            self._net = _fold(model, p)

    @staticmethod
    def can_fold(model: DPMPB) -> TypeGuard[DPMPB]:
        """Whether the network is the paper's, layer by layer."""
        if not isinstance(model, DPMPB):
            return False
        lstm = model.lstm
        return (
            type(model).forward is DPMPB.forward
            and _kinds(model.fc_in) == "LT" * 3
            and _kinds(model.fc_out) == "LT" * 3 + "L"
            and type(lstm) is nn.LSTM
            and lstm.num_layers == 2
            and not lstm.bidirectional
            and not lstm.proj_size
            and lstm.bias
        )

    def __call__(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """Predict states `[B, T, D_s]`, each from the prediction before.

        From s `[D_s]` or `[B, D_s]`, u `[B, T, D_u]`, and memory of batch 1 or B.
        """
        states, _ = self._roll(s, u, memory)
        return states

    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The recurrent state after one observed step.

        From s `[D_s]` or `[B, D_s]`, u `[D_u]` or `[B, D_u]`, and memory.
        """
        _, memory = self._roll(s, u.reshape(-1, 1, u.shape[-1]), memory)
        return memory

    def _roll(self, s: Tensor, u: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        net = self._net
        batch, steps, _ = u.shape

        # What the first layer makes of all commands at once, step beside step.
        bias, weight = net.command
        flat = torch.addmm(bias, u.flatten(0, 1), weight)
        from_commands = flat.reshape(batch, -1).chunk(steps, dim=1)

        s = ((s - self._s_mean) / self._s_std).expand(batch, -1)
        h, c = ([*part.expand(-1, batch, -1)] for part in memory)
        states = []
        for x in from_commands:
            x = torch.addmm(x, s, net.state).sigmoid_()
            for layer in net.rest_in:
                x = layer(x)
            for k, cell in enumerate(net.cells):
                gates = torch.addmm(cell.below.bias, x, cell.below.weight)
                gates = torch.addmm(gates, h[k], cell.own).sigmoid_()
                i, f, g, o = gates.chunk(4, dim=-1)
                # tanh of the cell's input is 2g - 1
                c[k] = torch.addcmul(f * c[k], i, 2 * g - 1)
                h[k] = o * c[k].tanh()
                x = h[k]
            for layer in net.most_out:
                x = layer(x)
            s = torch.addmm(net.last.bias, x, net.last.weight)
            states.append(s)

        predicted = torch.cat(states, dim=1).unflatten(1, (steps, -1))
        predicted = predicted * self._s_std + self._s_mean
        return predicted, Memory(torch.stack(h), torch.stack(c))


def _kinds(layers: nn.Sequential) -> str:
    """L for each linear layer, T for each tanh, ? for any other."""
    names = {nn.Linear: "L", nn.Tanh: "T", SigmoidTanh: "T"}
    return "".join(names.get(type(layer), "?") for layer in layers)


_Weights = tuple[Tensor, Tensor]  # bias [out], weight [out, in], as torch has them


def _gives_sigmoid(bias: Tensor, weight: Tensor) -> _Weights:
    """A layer whose σ is σ(2a): all of it is doubled."""
    return 2 * bias, 2 * weight


def _takes_sigmoid(bias: Tensor, weight: Tensor) -> _Weights:
    """A layer that takes σ(2a) in place of tanh(a).

    Its weights are doubled, and their sum is subtracted from its bias.
    """
    return bias - weight.sum(1), 2 * weight


def _layer(bias: Tensor, weight: Tensor) -> _Layer:
    return _Layer(bias, weight.T)


def _fold(model: DPMPB, p: Tensor) -> _Folded:
    """All layers, changed so that they compute the same with σ in place of tanh."""
    first, *more_in = _linear(model.fc_in)
    first_out, *more_out, last = _linear(model.fc_out)

    # The first layer in two parts, for u (with p in it) and for s.
    bias, weight = first
    sizes = [model.command_size, model.state_size, model.bias_size]
    w_u, w_s, w_p = weight.split(sizes, dim=1)
    w_u = w_u / model.u_std
    command = _gives_sigmoid(bias + w_p @ p - w_u @ model.u_mean, w_u)

    # A hidden layer takes σ and gives σ. The first LSTM layer only takes it: its own
    # outputs are the true ones.
    cells = _cells(model.lstm)
    below = _takes_sigmoid(cells[0].below.bias, cells[0].below.weight.T)
    cells[0] = cells[0]._replace(below=_layer(*below))
    return _Folded(
        command=_layer(*command),
        state=(2 * w_s).T,
        rest_in=[_hidden(layer) for layer in more_in],
        cells=cells,
        most_out=[
            _layer(*_gives_sigmoid(*first_out)),
            *(_hidden(layer) for layer in more_out),
        ],
        last=_layer(*_takes_sigmoid(*last)),
    )


def _hidden(weights: _Weights) -> _Layer:
    return _layer(*_gives_sigmoid(*_takes_sigmoid(*weights)))


def _linear(layers: Sequence[nn.Module] | nn.Sequential) -> list[_Weights]:
    """Bias and weight of each linear layer."""
    return [(each.bias, each.weight) for each in layers if isinstance(each, nn.Linear)]


def _cells(lstm: nn.LSTM) -> list[_Cell]:
    """The LSTM's layers, with σ for all four gates."""
    cells = []
    for w_below, w_own, b_below, b_own in lstm.all_weights:
        # Of i, f, g, o only g is a tanh.
        factor = w_own.new_tensor([1, 1, 2, 1]).repeat_interleave(w_own.shape[1])
        bias = factor * (b_below + b_own)
        below = _layer(bias, factor[:, None] * w_below)
        cells.append(_Cell(below, (factor[:, None] * w_own).T))
    return cells
