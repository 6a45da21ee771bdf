"""With which rollout a model is controlled: the fast one where it can be, or plain."""

import torch
from torch import Tensor

from clothlab.method.fast_rollout import FastDPMPB
from clothlab.method.model import DPMPB, Memory, predict


class PlainRollout:
    """The same two calls by the model's own forward, for a network of another kind.

    Args:
        model: any, also one that `FastDPMPB` can't fold.
        p: parametric bias, `[D_p]`.
    """

    def __init__(self, model: DPMPB, p: Tensor):
        self._model = model
        self._p = p

    def __call__(self, s: Tensor, u: Tensor, memory: Memory) -> Tensor:
        """Predict states `[B, T, D_s]`, as `FastDPMPB` does."""
        return predict(self._model, s, u, self._p, memory)

    @torch.no_grad()
    def follow(self, s: Tensor, u: Tensor, memory: Memory) -> Memory:
        """The recurrent state after one observed step, as `FastDPMPB` has it."""
        s = s.reshape(-1, 1, s.shape[-1])
        u = u.reshape(-1, 1, u.shape[-1])
        _, memory = self._model(s, u, self._p, memory)
        return memory


Rollout = FastDPMPB | PlainRollout


def rollout_of(model: DPMPB) -> type[Rollout]:
    """The fast rollout where it computes what the model does, else the plain one.

    The fast one is a second copy of the network. A subclass with a norm, another
    activation or a residual connection would be trained as itself and controlled as
    something else. So layers are looked at, and both are compared once.
    """
    if FastDPMPB.can_fold(model) and _agrees(model):
        return FastDPMPB
    return PlainRollout


@torch.no_grad()
def _agrees(model: DPMPB) -> bool:
    """Whether both predict the same within rounding, from drawn states and commands."""
    generator = torch.Generator().manual_seed(0)

    def drawn(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator).to(model.s_mean)

    s = model.s_mean + model.s_std * drawn(model.state_size)
    u = model.u_mean + model.u_std * drawn(4, 3, model.command_size)
    p = drawn(model.bias_size)
    memory = Memory(*(part.to(model.s_mean) for part in model.initial_memory()))
    fast = FastDPMPB(model, p)(s, u, memory)
    plain = predict(model, s, u, p, memory)
    gaps = (fast - plain) / model.s_std
    return bool(gaps.abs().max() < 1e-3)
