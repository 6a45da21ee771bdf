"""Checks of notebook 03: what is drawn, what is right, and what usual slips give."""

import numpy as np
import torch

from clothlab.checks.ask import Question, exercise
from clothlab.method.autoencoder import Autoencoder


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
