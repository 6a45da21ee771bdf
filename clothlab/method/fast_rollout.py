"""DPMPB with W and p fixed, fast at many short predictions: the closed loop stands on
it.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from clothlab.method.model import DPMPB, Memory, _Tanh, predict

_Layer = tuple[Tensor, Tensor]  # bias [out], weight [in, out]


class FastDPMPB:
    """`dpmpb.predict` for one model and one p `[D_p]`, in a third of the time.

    The normalisation and p are folded into the first layer, states stay normalised
    while they go round the loop, and hidden layers compute σ, which takes a fraction of
    the time of tanh (`_fold`).
    """

    def __init__(self, model: DPMPB, p: Tensor):
        if not _can_fold(model):
            raise ValueError(
                f"this {type(model).__name__} has a forward or layers of its own, which can't be folded: `rollout_of` "
                "chooses the plain rollout for it"
            )
        self._s_mean, self._s_std = model.s_mean, model.s_std
        with torch.no_grad():
            self._fc_u, (_, self._fc_s), *layers = _fold(model, p)
        self._fc_in, self._lstm, self._fc_out, self._fc_last = (
            layers[:2],
            layers[2:6],
            layers[6:9],
            layers[9],
        )

    def __call__(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """Predict `[B, T, D_s]` from s `[D_s]` or `[B, D_s]`, u `[B, T, D_u]`, and
        memory of batch 1 or B.
        """
        return self._roll(s, u, memory)[0]

    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The recurrent state after one observed step: s `[D_s]` or `[B, D_s]`, u
        `[D_u]` or `[B, D_u]`.
        """
        return self._roll(s, u.reshape(-1, 1, u.shape[-1]), memory)[1]

    def _roll(self, s: Tensor, u: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        bias, weight = self._fc_u
        x_u = torch.addmm(bias, u.flatten(0, 1), weight).unflatten(0, u.shape[:2])
        s = ((s - self._s_mean) / self._s_std).expand(len(u), -1)
        h, c = ([*part.expand(-1, len(u), -1)] for part in memory)
        states = []
        for x in x_u.unbind(1):
            x = _hidden(torch.addmm(x, s, self._fc_s).sigmoid_(), self._fc_in)
            for k in range(2):
                (bias, w_below), (_, w_own) = self._lstm[2 * k : 2 * k + 2]
                gates = torch.addmm(
                    torch.addmm(bias, x, w_below), h[k], w_own
                ).sigmoid_()
                i, f, g, o = gates.chunk(4, dim=-1)
                c[k] = _cell(f, c[k], i, g)
                x = h[k] = o * c[k].tanh()
            bias, weight = self._fc_last
            s = torch.addmm(bias, _hidden(x, self._fc_out), weight)
            states.append(s)
        return torch.stack(states, dim=1) * self._s_std + self._s_mean, Memory(
            torch.stack(h), torch.stack(c)
        )


class PlainRollout:
    """The same two calls by the model's own forward: for a network that `FastDPMPB`
    can't fold, p `[D_p]`.
    """

    def __init__(self, model: DPMPB, p: Tensor):
        self._model = model
        self._p = p

    def __call__(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """Predict `[B, T, D_s]` from s `[D_s]` or `[B, D_s]`, u `[B, T, D_u]`, and
        memory of batch 1 or B.
        """
        return predict(self._model, s, u, self._p, memory)

    @torch.no_grad()
    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The recurrent state after one observed step: s `[D_s]` or `[B, D_s]`, u
        `[D_u]` or `[B, D_u]`.
        """
        s = s.reshape(-1, 1, s.shape[-1])
        u = u.reshape(-1, 1, u.shape[-1])
        return self._model(s, u, self._p, memory)[1]


Rollout = FastDPMPB | PlainRollout


def rollout_of(model: DPMPB) -> type[Rollout]:
    """The fast rollout where it computes what the model does, else the plain one.

    The fast one is a second copy of the network. A subclass with a norm, another
    activation or a residual connection would be trained as itself and controlled as
    something else. So layers are looked at, and both are compared once.
    """
    if _can_fold(model) and _agrees(model):
        return FastDPMPB
    return PlainRollout


def _can_fold(model: DPMPB) -> bool:
    """Whether the network is the paper's, layer by layer."""
    lstm = model.lstm
    return (
        type(model).forward is DPMPB.forward
        and [type(layer) for layer in model.fc_in] == [nn.Linear, _Tanh] * 3
        and [type(layer) for layer in model.fc_out]
        == [nn.Linear, _Tanh] * 3 + [nn.Linear]
        and type(lstm) is nn.LSTM
        and (lstm.num_layers, lstm.bidirectional, lstm.proj_size, lstm.bias)
        == (2, False, 0, True)
    )


@torch.no_grad()
def _agrees(model: DPMPB) -> bool:
    """Whether both predict the same within rounding, from states, commands and p that
    are drawn.
    """
    generator = torch.Generator().manual_seed(0)

    def drawn(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator).to(model.s_mean)

    s = model.s_mean + model.s_std * drawn(model.state_size)
    u = model.u_mean + model.u_std * drawn(4, 3, model.command_size)
    p = drawn(model.bias_size)
    memory = Memory(*(part.to(model.s_mean) for part in model.initial_memory()))
    gaps = (
        FastDPMPB(model, p)(s, u, memory) - predict(model, s, u, p, memory)
    ) / model.s_std
    return bool(gaps.abs().max() < 1e-3)


def _hidden(x: Tensor, layers: Sequence[_Layer]) -> Tensor:
    for bias, weight in layers:
        x = torch.addmm(bias, x, weight).sigmoid_()
    return x


def _cell(f: Tensor, c: Tensor, i: Tensor, g: Tensor) -> Tensor:
    """The next cell state f c + i (2g - 1).

    A closed loop makes much of last digits, and all stored results were made with this
    rounding: that of one formula for the value, and of another for the gradient.
    """
    if not torch.is_grad_enabled():
        return torch.addcmul(f * c, i, g, value=2) - i
    state = torch.addcmul(f * c, i, 2 * g - 1)
    with torch.no_grad():
        return state.copy_(torch.addcmul(f * c, i, g, value=2) - i)


def _fold(model: DPMPB, p: Tensor) -> list[_Layer]:
    """All layers, changed so that they compute the same with σ in place of tanh(a) =
    2σ(2a) - 1.

    A layer gives σ(2a) when all of it is doubled, and takes σ(2a) in place of tanh(a)
    when its weights are doubled and their sum is subtracted from its bias. The first
    layer comes in two parts, for u (with p in it) and for s; each LSTM layer in two,
    for the layer below and for its own last output.
    """

    def gives(bias: Tensor, weight: Tensor) -> _Layer:
        return 2 * bias, 2 * weight

    def takes(bias: Tensor, weight: Tensor) -> _Layer:
        return bias - weight.sum(1), 2 * weight

    linear = [
        (layer.bias, layer.weight)
        for layer in (*model.fc_in, *model.fc_out)
        if isinstance(layer, nn.Linear)
    ]
    (b_first, w_first), *fc_in, fc_out_first = linear[:4]
    w_u, w_s, w_p = w_first.split(
        [model.command_size, model.state_size, model.bias_size], dim=1
    )
    w_u = w_u / model.u_std
    lstm = []
    for w_below, w_own, b_below, b_own in model.lstm.all_weights:
        # Of i, f, g, o only g is a tanh
        factor = w_own.new_tensor([1, 1, 2, 1]).repeat_interleave(w_own.shape[1])
        lstm.append((factor * (b_below + b_own), factor[:, None] * w_below))
        lstm.append((torch.zeros_like(b_own), factor[:, None] * w_own))
    layers = [
        gives(b_first + w_p @ p - w_u @ model.u_mean, w_u),
        gives(torch.zeros_like(b_first), w_s),
        *(gives(*takes(*layer)) for layer in fc_in),
        takes(*lstm[0]),
        *lstm[1:],
        gives(*fc_out_first),
        *(gives(*takes(*layer)) for layer in linear[4:-1]),
        takes(*linear[-1]),
    ]
    return [(bias, weight.T) for bias, weight in layers]
