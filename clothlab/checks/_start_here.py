"""Checks of notebook 00: what is drawn, what is right, and what usual slips give."""

import numpy as np
import torch
from torch import nn

from clothlab.checks.ask import Question, exercise


class _Swing(nn.Module):
    """How a state changes, with a damping that is a straight function of p."""

    def __init__(self, slope: float):
        super().__init__()
        self.slope = nn.Parameter(torch.tensor([1.0, slope]))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """The change of x and v `[..., 2]`, from x, v, u and p `[..., 4]`."""
        x, v, u, p = inputs.unbind(dim=-1)
        damping = self.slope[0] + self.slope[1] * p
        return 0.2 * torch.stack([v, u - x - damping * v], dim=-1)


@exercise("p", 1, 1, 1, atol=0.005)
def infer(rng: np.random.Generator) -> Question:
    """The p `[1, 1, 1]` with which a trained network predicts a recording best.

    Given are a network, the states of a recording `[1, T + 1, 2]` and its pushes `[1,
    T]`. The network must stay what it is.
    """
    W = _Swing(float(rng.uniform(0.4, 0.8)))
    p = float(rng.choice([-1, 1]) * rng.uniform(0.6, 1.2))

    # A recording with that p
    u = torch.as_tensor(rng.uniform(-2, 2, (1, 40)), dtype=torch.float32)
    states = [torch.zeros(1, 2)]
    with torch.no_grad():
        for push in u.T:
            s = states[-1]
            inputs = torch.cat([s, push[:, None], torch.full((1, 1), p)], dim=-1)
            states.append(s + W(inputs))

    slips = {
        "p is still zero: `descend` moves what stands in its list, if it has a "
        "gradient (`requires_grad_`)": np.zeros((1, 1, 1))
    }
    return Question(
        (W, torch.stack(states, dim=1), u),
        np.full((1, 1, 1), p),
        slips,
        lambda found: (
            f"the recording was made with p = {p:.2f}, not {found.item():.2f}: the "
            "loss is `mismatch` of it, with a rate of 0.05 and 150 steps"
        ),
    )
