"""Does the model need a memory? A model solution, and its reference values.

Of the half page: equal are recordings, windows, updates and loss; the rate is tuned for
both. The number of weights can't be held equal, since four gates have four times as
many: so compare with a wider network, too.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from clothlab.method.data import Run


class _Memoryless(nn.Module):
    """Predicts the change of a state, with one p for each material."""

    def __init__(self, states: int, commands: int, materials: int):
        super().__init__()
        wide = 100  # as the layers of the LSTM
        self.p = nn.Parameter(torch.zeros(materials, 2))
        self.network = nn.Sequential(
            nn.Linear(states + commands + 2, wide),
            nn.Tanh(),
            nn.Linear(wide, wide),
            nn.Tanh(),
            nn.Linear(wide, wide),
            nn.Tanh(),
            nn.Linear(wide, states),
        )

    def forward(self, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
        """Changes `[B, D_s]`, all in standard deviations; k names materials `[B]`."""
        return self.network(torch.cat([s, u, self.p[k]], dim=1))


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
    scales = _Scales(before, command, after - before)

    # The loss is the LSTM's: squared errors of next states in standard deviations
    torch.manual_seed(seed)
    network = _Memoryless(before.shape[1], command.shape[1], len(names))
    optimiser = torch.optim.Adam(network.parameters(), rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, updates)
    for _ in range(updates):
        some = torch.randint(len(before), (300,))
        found = scales.next(network, before[some], command[some], material[some])
        loss = ((found - after[some]) / scales.change).square().mean()
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
            state = scales.next(network, state, each[None], k)
            states.append(state[0].numpy())
        return np.array(states)

    return ahead


class _Scales:
    """Means and standard deviations of states and commands, and those of changes."""

    def __init__(self, s: Tensor, u: Tensor, change: Tensor):
        self.middle = s.mean(0)
        self.scale = s.std(0).clamp_min(1e-6)
        self.push = u.mean(0)
        self.force = u.std(0).clamp_min(1e-6)
        self.change = change.std(0).clamp_min(1e-6)

    def next(self, network: _Memoryless, s: Tensor, u: Tensor, k: Tensor) -> Tensor:
        """States after commands `[B, D_s]`."""
        unit_s = (s - self.middle) / self.scale
        unit_u = (u - self.push) / self.force
        return s + self.change * network(unit_s, unit_u, k)


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
