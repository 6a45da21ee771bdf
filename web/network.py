"""The paper's network with one p, in tensors alone, for graphs.

It predicts what `clothlab.predict` does. What is constant over a plan is computed once,
and the LSTM is written out: ONNX has no counterpart to the gradient of a fused one.
"""

import torch
from torch import Tensor, nn

from clothlab import DPMPB

# Hidden and cell states of the LSTM's layers, each `[2, B, 30]`
Memory = tuple[Tensor, Tensor]


class Network:
    """Predictions of a trained model with one p.

    Args:
        model: a trained one.
        p: parametric bias, `[D_p]`.
    """

    def __init__(self, model: DPMPB, p: Tensor):
        self._model = model
        first, *self._rest_in = _linear(model.fc_in)
        *self._most_out, self._last = _linear(model.fc_out)

        # The first layer's parts for command and state; p joins its bias
        sizes = [model.command_size, model.state_size, model.bias_size]
        self._from_u, self._from_s, from_p = first.weight.split(sizes, dim=1)
        self._bias = first.bias + from_p @ p

    def predict(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """States after each command `[B, T, D_s]`, each from the prediction before.

        From s `[D_s]` or `[B, D_s]`, u `[B, T, D_u]`, and a memory of batch 1 or B.
        """
        states, _ = self._roll(s, u, memory)
        return states

    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The memory after a step that was seen: s `[D_s]`, u `[D_u]`."""
        _, memory = self._roll(s, u[None, None], memory)
        return memory

    def _roll(self, s: Tensor, u: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        model = self._model
        batch, steps, _ = u.shape

        # What the first layer makes of all commands at once
        u = (u - model.u_mean) / model.u_std
        flat = torch.addmm(self._bias, u.flatten(0, 1), self._from_u.T)
        from_commands = flat.reshape(batch, -1).chunk(steps, dim=1)

        # States stay normalised while they go round
        s = ((s - model.s_mean) / model.s_std).expand(batch, -1)
        h, c = ([*part.expand(-1, batch, -1)] for part in memory)
        states = []
        for x in from_commands:
            x = torch.addmm(x, s, self._from_s.T).tanh()
            for layer in self._rest_in:
                x = layer(x).tanh()
            x = self._remember(x, h, c)
            for layer in self._most_out:
                x = layer(x).tanh()
            s = self._last(x)
            states.append(s)
        predicted = torch.cat(states, dim=1).unflatten(1, (steps, -1))
        return predicted * model.s_std + model.s_mean, (torch.stack(h), torch.stack(c))

    def _remember(self, x: Tensor, h: list[Tensor], c: list[Tensor]) -> Tensor:
        """What both LSTM layers make of x `[B, 30]`; h and c are moved on."""
        for k, weights in enumerate(self._model.lstm.all_weights):
            from_below, from_own, bias_below, bias_own = weights
            gates = torch.addmm(bias_below + bias_own, x, from_below.T)
            gates = torch.addmm(gates, h[k], from_own.T)
            let_in, keep, new, out = gates.chunk(4, dim=-1)
            c[k] = keep.sigmoid() * c[k] + let_in.sigmoid() * new.tanh()
            h[k] = out.sigmoid() * c[k].tanh()
            x = h[k]
        return x


def _linear(layers: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in layers if isinstance(layer, nn.Linear)]
