"""A tanh that takes half the time on a processor."""

import torch
from torch import Tensor, nn

from clothlab.method.model import DPMPB


class SigmoidTanh(nn.Tanh):
    """tanh(a) = 2σ(2a) - 1, in half the time on a processor."""

    def forward(self, a: Tensor) -> Tensor:
        return 2 * torch.sigmoid(2 * a) - 1


def quicken(model: DPMPB) -> DPMPB:
    """Give a model the quicker tanh, and return it. It computes the same.

    Trainings use it, and stored models have it: tanh is a fifth of a training's time,
    and stored results were made with its rounding, of which a closed loop makes much.
    """
    for part in (model.fc_in, model.fc_out):
        for k, layer in enumerate(part):
            if type(layer) is nn.Tanh:
                part[k] = SigmoidTanh()
    return model
