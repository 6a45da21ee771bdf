"""Checks of notebook 03: what is drawn, what is right, and what usual slips give."""

import numpy as np
import torch

from clothlab.checks.ask import Question, exercise
from clothlab.method.autoencoder import Autoencoder

_PIXELS = 12  # of an image in the question about linear drawings
_IMAGES = 5


@exercise("the logit at which a pixel starts, one number", rtol=1e-4, moves=(0,))
def start_bright(rng: np.random.Generator) -> Question:
    """The logit of a pixel of a mended network where all ReLUs are off.

    Given are an autoencoder of random weights, and the logit that is wanted.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**31)))
        network = Autoencoder()
    *_, bias = network.parameters()  # that of the last layer
    before = bias.item()
    wanted = float(rng.uniform(1.0, 3.0))
    slips = {
        "nothing has changed: where all ReLUs are off, the layer multiplies zeros by "
        "its weights; what else does it have?": before,
        "the old number must go: put the logit in its place, don't add it": before
        + wanted,
        "a logit is no probability: put it in as it is": 1 / (1 + np.exp(-wanted)),
        "the sign is wrong: a large logit makes cloth likely": -wanted,
    }
    return Question(
        (network, wanted),
        wanted,
        slips,
        lambda found: f"a pixel is to start at {wanted:.3f}, not at {found:.3f}",
    )


@exercise("the drawings", _IMAGES, _PIXELS)
def linear_drawing(rng: np.random.Generator) -> Question:
    """Drawings `[N, D]` of images `[N, D]` by way of n numbers each.

    Given are the images, components of length 1 `[6, D]` at right angles, the mean
    image `[D]`, and n.
    """
    images = (rng.random((_IMAGES, _PIXELS)) < 0.5).astype(float)
    across, _ = np.linalg.qr(rng.normal(size=(_PIXELS, 6)))
    components = across.T
    mean = rng.uniform(0.2, 0.8, _PIXELS)
    n = int(rng.integers(2, 5))
    first = components[:n]
    z = (images - mean) @ first.T
    slips = {
        "the drawing begins at the mean image: add it again": z @ first,
        "the numbers say how an image differs from the mean: subtract it first": (
            images @ first.T @ first + mean
        ),
        "the first n components, and no others": (
            (images - mean) @ components.T @ components + mean
        ),
        "n components are those before number n: Python counts from 0": (
            (images - mean) @ components[: n + 1].T @ components[: n + 1] + mean
        ),
        "these are the images themselves": images,
    }
    return Question(
        (images, components, mean, n),
        z @ first + mean,
        slips,
        "n numbers for each image, then as much of each component, and the mean",
    )
