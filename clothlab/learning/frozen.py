"""DPMPB with W and p fixed, fast at many short predictions: the closed loop stands on it. One model, or several."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from clothlab.learning.dpmpb import DPMPB, Memory


class FrozenEnsemble:
    """The functions of several models, each with its own p and its own memory, computed together.

    The same as `clothlab.learning.dpmpb.predict` with each of them, in less time:

    - each layer is one batched product for all members;
    - the normalisation and p are folded into the first layer, and states stay normalised while they go round the loop;
    - hidden layers compute σ, which takes a fraction of the time of tanh (`_fold`);
    - the gradient is written out (`_roll_back`): operations as small as these take longer to record than to compute.

    Args:
        models: E trained networks of the same sizes.
        biases: parametric bias of each, `[E, D_p]` or a sequence of `[D_p]`.

    Raises:
        ValueError: no models, models of different sizes, or not one p for each.
    """

    def __init__(self, models: Sequence[DPMPB], biases: Tensor | Sequence[Tensor]):
        sizes = {(model.state_size, model.command_size, model.bias_size) for model in models}
        if len(sizes) != 1:
            found = " and ".join(map(str, sorted(sizes))) or "no models"
            raise ValueError(f"the members of an ensemble have the same D_s, D_u and D_p, got {found}")
        if len(models) != len(biases):
            raise ValueError(f"an ensemble needs one p for each of its {len(models)} models, got {len(biases)}")
        with torch.no_grad():
            members = [_fold(model, p) for model, p in zip(models, biases, strict=True)]
            self._fc_u, *layers = (_Layer.stack(parts) for parts in zip(*members, strict=True))
            self._layers = _Layers(layers[0], layers[1:3], (layers[3:5], layers[5:7]), layers[7:10], layers[10])
            self.s_mean = torch.stack([model.s_mean for model in models]).unsqueeze(1)
            self.s_std = torch.stack([model.s_std for model in models]).unsqueeze(1)

    def __call__(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """Predict with the models' own predictions as the next inputs.

        Args:
            s: current state, `[D_s]` for all sequences or `[B, D_s]`.
            u: commands `[B, T, D_u]`.
            memory: recurrent state of each member before this step, parts `[2, E, 1, 30]` or `[2, E, B, 30]`.

        Returns:
            Predicted states of the T next steps, `[E, B, T, D_s]`.
        """
        start = self._start(s, u, memory)
        if torch.is_grad_enabled() and u.requires_grad:
            states = _Rollout.apply(self._layers, *start)
        else:
            states, _ = _roll(self._layers, None, *start)
        return states * self.s_std.unsqueeze(2) + self.s_mean.unsqueeze(2)

    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The recurrent state of each member after a step that was observed.

        Args:
            s: state before the command, `[D_s]` or `[B, D_s]`.
            u: the command, `[D_u]` or `[B, D_u]`.
            memory: recurrent state before the step, parts `[2, E, 1, 30]` or `[2, E, B, 30]`.

        Returns:
            Recurrent state after it, parts `[2, E, B, 30]`; B is 1 for a single command.
        """
        start = self._start(s, u.reshape(-1, 1, u.shape[-1]), memory)
        return _roll(self._layers, None, *start)[1]

    def initial_memory(self) -> Memory:
        """The recurrent state of each member before the first step of one run: zeros."""
        below, _ = self._layers.lstm[0]
        zeros = self.s_mean.new_zeros(2, len(self.s_mean), 1, below.weight.shape[1])
        return Memory(zeros, zeros)

    def _start(self, s: Tensor, u: Tensor, memory: Memory) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """All that `_roll` begins with: x_u `[E, B, T, 300]`, which is u in the first layer, and s, h and c."""
        members, batch = len(self.s_mean), len(u)
        x_u = torch.baddbmm(self._fc_u.bias, u.flatten(0, 1).expand(members, -1, -1), self._fc_u.weight)
        s = ((s - self.s_mean) / self.s_std).expand(-1, batch, -1)
        h, c = (part.expand(-1, -1, batch, -1) for part in memory)
        return x_u.unflatten(1, u.shape[:2]), s, h, c


class FrozenDPMPB:
    """The function of one model: an ensemble of one, without the axis of the members.

    Args:
        model: trained network.
        p: parametric bias `[D_p]`.
    """

    def __init__(self, model: DPMPB, p: Tensor):
        self._ensemble = FrozenEnsemble([model], [p])

    def __call__(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """Predict with the model's own predictions as the next inputs.

        Args:
            s: current state, `[D_s]` for all sequences or `[B, D_s]`.
            u: commands `[B, T, D_u]`.
            memory: recurrent state before this step, parts `[2, 1, 30]` or `[2, B, 30]`.

        Returns:
            Predicted states of the T next steps, `[B, T, D_s]`.
        """
        return self._ensemble(s, u, Memory(memory.h.unsqueeze(1), memory.c.unsqueeze(1)))[0]

    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The recurrent state after a step that was observed.

        Args:
            s: state before the command, `[D_s]` or `[B, D_s]`.
            u: the command, `[D_u]` or `[B, D_u]`.
            memory: recurrent state before the step, parts `[2, 1, 30]` or `[2, B, 30]`.

        Returns:
            Recurrent state after it, parts `[2, B, 30]`; B is 1 for a single command.
        """
        h, c = self._ensemble.follow(s, u, Memory(memory.h.unsqueeze(1), memory.c.unsqueeze(1)))
        return Memory(h.squeeze(1), c.squeeze(1))


class _Layer(NamedTuple):
    """One linear layer of all members."""

    bias: Tensor  # [E, 1, out]
    weight: Tensor  # [E, in, out]
    back: Tensor  # [E, out, in], what a gradient is multiplied with

    @classmethod
    def stack(cls, members: Sequence[tuple[Tensor, Tensor]]) -> "_Layer":
        """From weight `[out, in]` and bias `[out]` of each member."""
        weight, bias = (torch.stack(parts) for parts in zip(*members, strict=True))
        return cls(bias.unsqueeze(1), weight.mT, weight)


class _Layers(NamedTuple):
    """What a state goes through at each step."""

    fc_s: _Layer  # the first layer is split into parts for s and u; this one has no bias
    fc_in: Sequence[_Layer]
    lstm: Sequence[Sequence[_Layer]]  # two each: from the layer below, and from its own last output
    fc_out: Sequence[_Layer]
    fc_last: _Layer


def _fold(model: DPMPB, p: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Weight `[out, in]` and bias `[out]` of all layers, changed so that they compute the same with σ in place of tanh.

    tanh(a) = 2σ(2a) - 1. So a layer gives σ(2a) when all of it is doubled, and takes σ(2a) in place of tanh(a) when its
    weights are doubled and their sum is subtracted from its bias.

    Returns:
        The layer that takes u, with p and the normalisation of u in it, and those of `_Layers` in turn.
    """

    def gives(weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
        return 2 * weight, 2 * bias

    def takes(weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
        return 2 * weight, bias - weight.sum(1)

    linear = [(layer.weight, layer.bias) for layer in (*model.fc_in, *model.fc_out) if isinstance(layer, nn.Linear)]
    (w_first, b_first), *fc_in, fc_out_first = linear[:4]
    w_u, w_s, w_p = w_first.split([model.command_size, model.state_size, model.bias_size], dim=1)
    w_u = w_u / model.u_std
    lstm = []
    for w_below, w_own, b_below, b_own in model.lstm.all_weights:
        factor = w_own.new_tensor([1, 1, 2, 1]).repeat_interleave(w_own.shape[1])  # of i, f, g, o only g is a tanh
        lstm.append((factor[:, None] * w_below, factor * (b_below + b_own)))
        lstm.append((factor[:, None] * w_own, torch.zeros_like(b_own)))
    return [
        gives(w_u, b_first + w_p @ p - w_u @ model.u_mean),
        gives(w_s, torch.zeros_like(b_first)),
        *(gives(*takes(*layer)) for layer in fc_in),
        takes(*lstm[0]),
        *lstm[1:],
        gives(*fc_out_first),
        *(gives(*takes(*layer)) for layer in linear[4:-1]),
        takes(*linear[-1]),
    ]


class _Step(NamedTuple):
    """What one step computed and its gradient needs."""

    into: Sequence[Tensor]  # what fc_s and each layer of fc_in gave
    lstm: Sequence[tuple[Tensor, ...]]
    out: Sequence[Tensor]  # what the LSTM and each layer of fc_out gave


def _roll(
    layers: _Layers, record: list[_Step] | None, x_u: Tensor, s: Tensor, h: Tensor, c: Tensor
) -> tuple[Tensor, Memory]:
    """Let the state go round the loop.

    Args:
        layers: of all members.
        record: takes the steps, where a gradient is wanted.
        x_u: what the commands add to the first layer `[E, B, T, 300]`.
        s: normalised state `[E, B, D_s]`.
        h: hidden state `[2, E, B, 30]`.
        c: cell state `[2, E, B, 30]`.

    Returns:
        Normalised states `[E, B, T, D_s]`, and the memory after the last step.
    """
    hs, cs, states = [*h], [*c], []
    for x in x_u.unbind(2):
        into = _hidden(torch.baddbmm(x, s, layers.fc_s.weight).sigmoid_(), layers.fc_in)
        x, lstm = into[-1], []
        for k, (below, own) in enumerate(layers.lstm):
            gates = torch.baddbmm(torch.baddbmm(below.bias, x, below.weight), hs[k], own.weight).sigmoid_()
            i, f, g, o = gates.chunk(4, dim=-1)
            c_last, cs[k] = cs[k], torch.addcmul(f * cs[k], i, g, value=2) - i  # f c + i (2g - 1)
            tanh_c = cs[k].tanh()
            x = hs[k] = o * tanh_c
            lstm.append((gates, i, f, g, o, c_last, tanh_c))
        out = _hidden(x, layers.fc_out)
        s = torch.baddbmm(layers.fc_last.bias, out[-1], layers.fc_last.weight)
        states.append(s)
        if record is not None:
            record.append(_Step(into, lstm, out))
    return torch.stack(states, dim=2), Memory(torch.stack(hs), torch.stack(cs))


def _hidden(x: Tensor, layers: Sequence[_Layer]) -> list[Tensor]:
    """x, and what each layer with its σ makes of the one before."""
    given = [x]
    for layer in layers:
        given.append(torch.baddbmm(layer.bias, given[-1], layer.weight).sigmoid_())
    return given


# From the gradient with respect to y = σ(a) or tanh(a), and y, to the gradient with respect to a.
_sigmoid_back = torch.ops.aten.sigmoid_backward.default
_tanh_back = torch.ops.aten.tanh_backward.default


def _roll_back(layers: _Layers, record: list[_Step], d_states: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Backpropagation through time: from the gradient with respect to the states, to those of x_u, s, h and c."""
    zero = d_states.new_zeros(())
    d_x, d_s, d_h, d_c = [], zero, [zero, zero], [zero, zero]
    for d, step in zip(reversed(d_states.unbind(2)), reversed(record), strict=True):
        d = _hidden_back(torch.bmm(d + d_s, layers.fc_last.back), layers.fc_out, step.out)
        for k in (1, 0):
            gates, i, f, g, o, c_last, tanh_c = step.lstm[k]
            d = d + d_h[k]
            d_cell = _tanh_back(d * o, tanh_c) + d_c[k]
            d_gates = torch.cat([d_cell * (g + g - 1), d_cell * c_last, d_cell * (i + i), d * tanh_c], dim=-1)
            d_gates = _sigmoid_back(d_gates, gates)
            below, own = layers.lstm[k]
            d, d_h[k], d_c[k] = torch.bmm(d_gates, below.back), torch.bmm(d_gates, own.back), d_cell * f
        d = _sigmoid_back(_hidden_back(d, layers.fc_in, step.into), step.into[0])
        d_x.append(d)
        d_s = torch.bmm(d, layers.fc_s.back)
    return torch.stack(d_x[::-1], dim=2), d_s, torch.stack(d_h), torch.stack(d_c)


def _hidden_back(d: Tensor, layers: Sequence[_Layer], given: Sequence[Tensor]) -> Tensor:
    """From the gradient with respect to the last of what `_hidden` gave, to that of the first."""
    for layer, y in zip(reversed(layers), reversed(given[1:]), strict=True):
        d = torch.bmm(_sigmoid_back(d, y), layer.back)
    return d


class _Rollout(torch.autograd.Function):
    """The states of `_roll`, with its gradient."""

    @staticmethod
    def forward(ctx: Any, layers: _Layers, *start: Tensor) -> Tensor:
        ctx.layers, ctx.record = layers, []
        return _roll(layers, ctx.record, *start)[0]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_states: Tensor) -> tuple:
        return None, *_roll_back(ctx.layers, ctx.record, d_states)
