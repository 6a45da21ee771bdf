"""Other models to control with: one that knows of the cloth nothing, one that is told what it is made of, and one that
learned from its own runs as well."""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import torch

from clothlab._validation import Checked, setting
from clothlab.learning.dpmpb import DPMPB, Sequences, materials_of, stretches, train_dpmpb
from clothlab.learning.trained import Trained
from clothlab.simulation.cloth import get_cloth
from clothlab.training_configs import recipe_of


def without_p(learned: Trained, runs: Sequence[Sequences], seed: int) -> Trained:
    """A model trained in the same way, for which all materials are one.

    Args:
        learned: weights, whose recipe it is.
        runs: the recordings that they learned from.
        seed: of the training.
    """
    recipe = replace(recipe_of(learned).model, bias_size=0)
    model, biases, trace = train_dpmpb(runs, recipe, seed=seed, progress=False)
    return replace(learned, model=model, biases=biases, losses=trace.losses)


def with_constants(learned: Trained, runs: Sequence[Sequences], seed: int) -> Trained:
    """A model trained in the same way, whose p is log C_damp and log C_mass of each cloth, both standardised.

    Args:
        learned: weights, whose recipe it is.
        runs: the recordings that they learned from; foams have no such pair.
        seed: of the training.
    """
    cloths = [get_cloth(name) for name in learned.biases]
    logs = np.log([(cloth.damping, cloth.mass) for cloth in cloths])
    known = dict(zip(learned.biases, (logs - logs.mean(0)) / logs.std(0), strict=True))
    model, biases, trace = train_dpmpb(runs, recipe_of(learned).model, known=known, seed=seed, progress=False)
    return replace(learned, model=model, biases=biases, losses=trace.losses)


@dataclass(frozen=True)
class Retraining(Checked):
    """How a trained model goes on learning."""

    updates: int = setting(300, at_least=1)
    batch_size: int = setting(100, at_least=2)  # stretches: half of its own runs, half of the recordings
    learning_rate: float = setting(5e-4, above=0)  # at the start; it falls to zero along a cosine


def retrained(
    learned: Trained,
    runs: Sequence[Sequences],
    own: Sequence[Sequences],
    settings: Retraining | None = None,
    *,
    seed: int = 0,
) -> DPMPB:
    """The model after it has learned from its own runs too, so that it knows where its plans led; p stays.

    Args:
        learned: weights.
        runs: the recordings that they learned from.
        own: runs of the controller.
        settings: how it goes on.
        seed: of the batches.
    """
    settings, model = settings or Retraining(), deepcopy(learned.model).train().requires_grad_(True)
    recipe = recipe_of(learned).model
    sets = [(stretches(each, recipe.sequence_length, recipe.stride), _biases(learned, each)) for each in (runs, own)]
    optimizer = torch.optim.Adam(model.parameters(), lr=settings.learning_rate, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.updates)
    generator = torch.Generator().manual_seed(seed)
    for _ in range(settings.updates):
        parts = []
        for (s, u, k), p in sets:
            pick = torch.randint(len(s), (settings.batch_size // 2,), generator=generator)
            parts.append((s[pick], u[pick], p[k[pick]]))
        s, u, p = (torch.cat(each) for each in zip(*parts, strict=True))
        predicted, _ = model(s[:, :-1], u, p)
        optimizer.zero_grad()
        model.loss(predicted, s[:, 1:]).backward()
        optimizer.step()
        schedule.step()
    return model.eval().requires_grad_(False)


def _biases(learned: Trained, runs: Sequence[Sequences]) -> torch.Tensor:
    """p of the runs' materials, as `stretches` counts them."""
    return torch.as_tensor(np.array([learned.biases[name] for name in materials_of(runs)]))
