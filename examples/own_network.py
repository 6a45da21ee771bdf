"""A network of one's own in the place of the paper's: does it control as well?

Two networks of twenty lines, one that remembers and one that doesn't, learn a mass on a
spring whose stiffness nobody tells them. Then each controls springs that it never saw,
with the p that it estimates. `python examples/own_network.py` prints how near the mass
comes to where it should be, and what a command costs in time.

Small networks take less time for an epoch. So each is trained twice: for as many epochs
as the paper's, and for about as long. Nothing was chosen by what came out; that the
longer trainings are a fair question was seen after the first run, of the shorter ones.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor, nn

from clothlab import (
    DPMPB,
    Controller,
    ControlSettings,
    ModelTraining,
    PredictiveModel,
    Run,
    estimate_bias,
    train_dpmpb,
)
from clothlab.analysis import crossed_interval

TRAINED = (0.05, 0.1, 0.2, 0.4)  # stiffnesses [1/step²]
UNSEEN = (0.07, 0.14, 0.28)
GOALS = (-1.0, 0.5, 1.0)  # places to hold the mass at
STEPS = 40  # of an attempt


class Gru(PredictiveModel):
    """One GRU layer between two linear ones."""

    def __init__(self, state_size: int, command_size: int, bias_size: int):
        super().__init__(state_size, command_size, bias_size)
        self.gru = nn.GRU(self.input_size, 32, batch_first=True)
        self.out = nn.Linear(32, state_size)

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: Any = None
    ) -> tuple[Tensor, Any]:
        """Next states, and the memory after them."""
        before = memory[0] if memory else None
        x, after = self.gru(self.to_inputs(s, u, p), before)
        return self.to_states(self.out(x)), (after,)

    def initial_memory(self) -> tuple[Tensor]:
        """What the GRU remembers before the first step: zeros."""
        return (torch.zeros(1, 1, 32),)


class Residual(PredictiveModel):
    """What changes in a step, of the step before alone; without a memory."""

    def __init__(self, state_size: int, command_size: int, bias_size: int):
        super().__init__(state_size, command_size, bias_size)
        self.net = nn.Sequential(
            nn.Linear(self.input_size, 64), nn.Tanh(), nn.Linear(64, state_size)
        )

    def forward(
        self, s: Tensor, u: Tensor, p: Tensor, memory: Any = None
    ) -> tuple[Tensor, Any]:
        """Next states; nothing is remembered."""
        x = self.to_inputs(s, u, p)  # commands first, then states, then p
        states = x[..., self.command_size :][..., : self.state_size]
        return self.to_states(states + self.net(x)), ()


NETWORKS: dict[str, Callable[[int, int, int], PredictiveModel]] = {
    "DPMPB": DPMPB,
    "GRU": Gru,
    "residual": Residual,
}
TRAININGS = {  # a network, and how many epochs it is trained for
    "DPMPB": ("DPMPB", 60),
    "GRU": ("GRU", 60),
    "residual": ("residual", 60),
    "GRU, as long": ("GRU", 240),
    "residual, as long": ("residual", 600),
}


def push(s: np.ndarray, u: float, stiffness: float) -> np.ndarray:
    """The place and speed of the mass `[2]` after a step with this push."""
    place, speed = s
    speed = 0.8 * speed + 0.3 * u - stiffness * np.tanh(place)
    return np.array([place + speed, speed])


def record(stiffness: float, seed: int, steps: int = 300) -> Run:
    """A run of random pushes, each held for two steps."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (steps // 2, 1)).repeat(2, axis=0)
    s = np.zeros((len(u), 2))
    for t in range(len(u) - 1):
        s[t + 1] = push(s[t], u[t, 0], stiffness)
    return Run(s, u, str(stiffness))


def train(name: str, seed: int, epochs: int) -> tuple[PredictiveModel, float]:
    """One training of one network, and the time of a core that it took [s]."""
    runs = [record(stiffness, k) for k, stiffness in enumerate(TRAINED)]
    settings = ModelTraining(
        epochs=epochs, batch_size=100, sequence_length=20, bias_size=1
    )
    start = time.process_time()
    model, _, _ = train_dpmpb(
        runs, settings, model=NETWORKS[name], seed=seed, progress=False
    )
    return model, time.process_time() - start


def control(
    model: PredictiveModel, stiffness: float, goal: float
) -> tuple[float, float]:
    """Mean distance to the goal in the second half of an attempt, and a step's [ms].

    With the p that twenty seconds of random pushes gave.
    """
    run = record(stiffness, seed=1000, steps=100)
    p, _ = estimate_bias(model, run, method="newton")

    def loss(states: Tensor, commands: Tensor, t: int) -> Tensor:
        return (states[..., 0] - goal).square().sum(-1)

    settings = ControlSettings(horizon=8, period=8)
    controller = Controller(model, loss, p, [-1], [1], settings)
    s = np.zeros(2)
    places = []
    start = time.process_time()
    for _ in range(STEPS):
        s = push(s, controller.act(s)[0], stiffness)
        places.append(s[0])
    each = (time.process_time() - start) / STEPS
    distances = np.abs(np.array(places) - goal)
    return float(distances[STEPS // 2 :].mean()), 1000 * each


def measure(seed: int, share: float = 1.0) -> pd.DataFrame:
    """A row for each training, unseen spring and goal, with a share of the epochs."""
    rows = []
    for training, (name, epochs) in TRAININGS.items():
        model, seconds = train(name, seed, round(share * epochs))
        for stiffness in UNSEEN:
            for goal in GOALS:
                distance, each = control(model, stiffness, goal)
                rows.append(
                    {
                        "training": training,
                        "seed": seed,
                        "stiffness": stiffness,
                        "goal": goal,
                        "distance": distance,
                        "act [ms]": each,
                        "training [s]": seconds,
                    }
                )
    return pd.DataFrame(rows)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means of each training, and a 95 % interval of its distance less the DPMPB's.

    The interval is over seeds and cases at once.
    """
    cases = rows.pivot_table(
        "distance", "training", ["seed", "stiffness", "goal"], sort=False
    )
    seeds = rows["seed"].nunique()
    table = rows.groupby("training", sort=False)[
        ["distance", "act [ms]", "training [s]"]
    ].mean()
    for training, distances in cases.iterrows():
        less = distances - cases.loc["DPMPB"]
        _, low, high = crossed_interval(less.to_numpy().reshape(seeds, -1).T)
        table.loc[training, "less DPMPB, from"] = low
        table.loc[training, "to"] = high
    return table


def main() -> None:
    """Measure, and print what each network comes to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="trainings of each")
    parser.add_argument("--share", type=float, default=1.0, help="of the epochs")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rows = [measure(seed, arguments.share) for seed in range(arguments.seeds)]
    print(summary(pd.concat(rows)).round(3).to_string())


if __name__ == "__main__":
    main()
