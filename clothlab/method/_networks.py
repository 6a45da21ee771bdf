"""Whether a network of one's own does what training and control take for granted."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from clothlab._validation import check_kind
from clothlab.method._memories import AnyMemory, expanded
from clothlab.method.model import DPMPB, PredictiveModel

# State, command and bias sizes → a network
MakeModel = Callable[[int, int, int], PredictiveModel]

_BATCH = 2
_STEPS = 4
_ROUNDING = 1e-4  # by which predictions may differ, relative to the largest


def made(make: MakeModel, *sizes: int) -> PredictiveModel:
    """A network of these sizes; a ValueError says what its `forward` does wrong."""
    model = check_kind("what `model` makes", make(*sizes), PredictiveModel)
    own = (model.state_size, model.command_size, model.bias_size)
    if own != sizes:
        raise ValueError(
            f"{_name(model)} was made for {sizes} states, commands and numbers of p, "
            f"and says that it has {own}"
        )
    if type(model) is not DPMPB:
        _check(model)
    return model


@torch.no_grad()
def _check(model: PredictiveModel) -> None:
    """Predict a few drawn steps, all at once and one after the other."""
    generator = torch.Generator().manual_seed(0)
    s = torch.randn(_BATCH, _STEPS, model.state_size, generator=generator)
    u = torch.randn(_BATCH, _STEPS, model.command_size, generator=generator)
    p = torch.randn(model.bias_size, generator=generator)
    training = model.training
    model.eval()  # without dropout
    first = model.initial_memory()
    _check_memory(model, first, first, 1)

    # At once, without a memory, as trainings do; p is one for all, or one for each
    for bias in (p, p.expand(_BATCH, -1)):
        whole, after = _answer(model, model(s, u, bias))
        _check_memory(model, after, first, _BATCH)

    # Step by step, from the first memory on, as controllers do
    memory: AnyMemory = expanded(first, _BATCH)
    steps = []
    for t in range(_STEPS):
        following, memory = model(s[:, t : t + 1], u[:, t : t + 1], p, memory)
        steps.append(following)
    gap = (torch.cat(steps, dim=1) - whole).abs().max()
    model.train(training)
    if not gap <= _ROUNDING * (1 + whole.abs().max()):
        raise ValueError(
            f"{_name(model)} predicts otherwise step by step than at once: a prediction"
            " may depend on the steps before it alone, the memory has to hold all that "
            "is needed of them, and None stands for `initial_memory()`"
        )


def _answer(model: PredictiveModel, answer: Any) -> tuple[Tensor, Any]:
    """The two things that a `forward` returns."""
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise ValueError(f"{_name(model)} returns next states, and the memory after")
    predicted, memory = answer
    wanted = [_BATCH, _STEPS, model.state_size]
    if list(predicted.shape) != wanted:
        raise ValueError(
            f"{_name(model)} predicts states [B, T, D_s], here {wanted}, got "
            f"{list(predicted.shape)}"
        )
    return predicted, memory


def _check_memory(
    model: PredictiveModel, memory: Any, first: AnyMemory, batch: int
) -> None:
    """Whether this memory is like the first one, for so many sequences."""
    is_tuple = isinstance(memory, tuple) and isinstance(first, tuple)
    if not is_tuple or len(memory) != len(first):
        raise ValueError(
            f"the memory of {_name(model)} is a tuple of as many tensors as "
            "`initial_memory()` has, none where it remembers nothing"
        )
    for part, begun in zip(memory, first, strict=True):
        wanted = [begun.shape[0], batch, *begun.shape[2:]]
        if list(part.shape) != wanted:
            raise ValueError(
                f"the memory of {_name(model)} has tensors [layers, B, ...], as those "
                f"of `initial_memory()` with B = 1: expected {wanted}, got "
                f"{list(part.shape)}"
            )


def _name(model: PredictiveModel) -> str:
    return type(model).__name__
