"""Does the model need a memory? A model solution, and its reference values.

Of the half page: equal are recordings, windows, updates and loss; the rate is tuned for
both. The number of weights can't be held equal, since four gates have four times as
many: so compare with a wider network, too.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import nn

from clothlab.method.data import Run


def train_memoryless(
    runs: Sequence[Run], updates: int, rate: float, seed: int
) -> Callable[[np.ndarray, np.ndarray, str], np.ndarray]:
    """A function from a state, commands and a material to predicted states."""
    # Steps of all runs, with the number of their material
    names = list(dict.fromkeys(run.material for run in runs))
    before = torch.as_tensor(np.concatenate([run.s[:-1] for run in runs]))
    after = torch.as_tensor(np.concatenate([run.s[1:] for run in runs]))
    command = torch.as_tensor(np.concatenate([run.u[:-1] for run in runs]))
    which = [np.full(len(run.s) - 1, names.index(run.material)) for run in runs]
    material = torch.as_tensor(np.concatenate(which))

    # In standard deviations; predicted is the change
    middle = before.mean(0)
    scale = before.std(0).clamp_min(1e-6)
    force = command.std(0).clamp_min(1e-6)
    push = command.mean(0)
    change = (after - before).std(0).clamp_min(1e-6)

    # One p for each material beside a network of the LSTM's width
    torch.manual_seed(seed)
    sizes = (before.shape[1] + command.shape[1] + 2, 100, 100, 100)
    layers: list[nn.Module] = []
    for wide, next_wide in pairwise(sizes):
        layers += [nn.Linear(wide, next_wide), nn.Tanh()]
    network = nn.Sequential(*layers, nn.Linear(100, before.shape[1]))
    p = nn.Parameter(torch.zeros(len(names), 2))
    groups = [
        {"params": network.parameters(), "lr": rate},
        {"params": [p], "lr": 3 * rate},
    ]
    optimiser = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, updates)

    def following(s: torch.Tensor, u: torch.Tensor, k: torch.Tensor) -> torch.Tensor:
        x = torch.cat([(s - middle) / scale, (u - push) / force, p[k]], dim=1)
        return s + change * network(x)

    # The LSTM's loss: squared errors of next states, in their standard deviations
    for _ in range(updates):
        some = torch.randint(len(before), (300,))
        gap = following(before[some], command[some], material[some]) - after[some]
        loss = (gap / change).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()

    @torch.no_grad()
    def ahead(s: np.ndarray, u: np.ndarray, material: str) -> np.ndarray:
        state = torch.as_tensor(s, dtype=torch.float32)[None]
        k = torch.tensor([names.index(material)])
        states = []
        for each in torch.as_tensor(u, dtype=torch.float32):
            state = following(state, each[None], k)
            states.append(state[0].numpy())
        return np.array(states)

    return ahead


def parts(
    answer: Callable, seed: int = 0
) -> Iterator[tuple[int, str, Callable[[], bool]]]:
    """Points, words and condition of each part."""
    rng = np.random.default_rng(seed)
    runs = [_run(rng, name) for name in ("light", "heavy") for _ in range(6)]
    trained: list[Callable] = []

    def error(material: str, told: str) -> float:
        """Error four steps ahead, over that of saying that nothing changes."""
        if not trained:
            trained.append(answer(runs, 600, 3e-3, seed))
        run = _run(rng, material)
        gaps = []
        still = []
        for t in range(20, 60, 4):
            predicted = trained[0](run.s[t], run.u[t : t + 4], told)
            gaps.append(np.asarray(predicted)[-1] - run.s[t + 4])
            still.append(run.s[t] - run.s[t + 4])
        return float(np.linalg.norm(gaps) / np.linalg.norm(still))

    def predicts() -> bool:
        return all(error(name, name) < 0.35 for name in ("light", "heavy"))

    def uses_material() -> bool:
        return error("heavy", "light") > 1.5 * error("heavy", "heavy")

    yield 2, "it predicts a hidden system without memory", predicts
    yield 1, "it uses the material", uses_material


def _run(rng: np.random.Generator, material: str, steps: int = 80) -> Run:
    """A hidden swing of seven states, driven by two commands, with its own drag."""
    drag = {"light": 0.6, "heavy": 0.25}[material]
    mix = np.random.default_rng(5).normal(size=(7, 4)) / 2
    u = np.repeat(rng.uniform(-1, 1, (steps // 4, 2)), 4, axis=0)
    x = rng.normal(0, 0.5, 2)
    v = np.zeros(2)
    states = []
    for each in u:
        states.append(mix @ np.concatenate([x, v]))
        v = v + 0.4 * (each - x) - drag * v
        x = x + 0.4 * v
    return Run(np.array(states, np.float32), u.astype(np.float32), material)
