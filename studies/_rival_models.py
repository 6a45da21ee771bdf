"""Networks that might do without parametric bias, and how they are trained.

Four ways to know a material beside p: not at all, by the memory of an LSTM, by an
encoder of a stretch of steps (as in rapid motor adaptation, Kumar et al., 2021), and by
being told its constants. All of them get the recordings and the compute of the others:
so many updates, each of the gradient of about as many predicted steps.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from clothlab.method._optimise import minimise, seeded
from clothlab.method._quick_tanh import quicken
from clothlab.method.data import Run, materials_of, set_normalisation, windows
from clothlab.method.model import DPMPB, Memory, PredictiveModel
from clothlab.method.training import ModelTraining
from studies import ablations
from studies._grid import shared
from studies._runs import recorded_runs, trained

UPDATES = 900  # of each training, as many as the stored weights `torque-paper` had
_STEPS = 3000  # predicted in an update, whatever the length of its sequences
_STRIDE = 5  # between the starts of two windows [step]


@dataclass(frozen=True)
class Kind:
    """What a model knows of a material, and the sequences that it learns from."""

    bias_size: int = 0  # D_p, or of what stands in its place
    length: int = 30  # steps of a window
    uncounted: int = 0  # first steps of a sequence, which only fill the memory
    # Steps of the same material that are drawn from anywhere in its recordings. An
    # encoder reads them; without one, the memory does, before it reads the window.
    stretch: int = 0
    encoder: bool = False
    told: bool = False  # the constants of the material in place of p
    # Predicted in an update, about, whatever the length of its sequences
    predicted: int = _STEPS


KINDS = {
    "p": Kind(bias_size=2),
    "p, windows of 100": Kind(bias_size=2, length=100, uncounted=30),
    "told constants": Kind(bias_size=2, told=True),
    "without p": Kind(),
    "without p, windows of 100": Kind(length=100, uncounted=30),
    "without p, windows of 200": Kind(length=200, uncounted=50),
    "without p, another run first": Kind(length=50, uncounted=30, stretch=100),
    "context of 30": Kind(bias_size=2, stretch=30, encoder=True),
    "context of 100": Kind(bias_size=2, stretch=100, encoder=True),
    "context of 200": Kind(bias_size=2, stretch=200, encoder=True),
}


class Remembering(DPMPB):
    """A trained model that begins each run with what it remembers of another one."""

    def __init__(self, model: PredictiveModel, memory: Memory):
        super().__init__(model.state_size, model.command_size, model.bias_size)
        self.load_state_dict(model.state_dict())
        self.eval().requires_grad_(False)
        self._first = memory

    def initial_memory(self) -> Memory:
        """The memory that it was given."""
        return self._first


@torch.no_grad()
def memory_of(model: PredictiveModel, run: Run, memory: Memory | None = None) -> Memory:
    """What a model without p remembers of a run."""
    s = torch.as_tensor(run.s)[None]
    u = torch.as_tensor(run.u)[None]
    _, after = model(s, u, torch.zeros(0), memory)
    return after


class StretchEncoder(nn.Module):
    """Some steps of a material to what stands in the place of p.

    Five neighbouring steps say something of a motion; what they say is averaged over
    the stretch. So it reads stretches of any length from nine steps on.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, model: PredictiveModel):
        super().__init__()
        width = model.state_size + model.command_size
        self.steps = nn.Sequential(
            nn.Conv1d(width, 32, 5), nn.Tanh(), nn.Conv1d(32, 32, 5), nn.Tanh()
        )
        self.out = nn.Linear(32, model.bias_size)
        self.register_buffer("mean", torch.cat([model.s_mean, model.u_mean]))
        self.register_buffer("std", torch.cat([model.s_std, model.u_std]))

    def forward(self, s: Tensor, u: Tensor) -> Tensor:
        """p `[B, D_p]` of states `[B, T, D_s]` and commands `[B, T, D_u]`."""
        steps = (torch.cat([s, u], dim=-1) - self.mean) / self.std
        return self.out(self.steps(steps.transpose(1, 2)).mean(2))


class TrainedKind(NamedTuple):
    """What one training gives."""

    model: PredictiveModel
    biases: dict[str, np.ndarray]  # of each recorded material [D_p]
    kind: Kind
    encoder: StretchEncoder | None = None

    @torch.no_grad()
    def read(self, run: Run) -> np.ndarray:
        """What the encoder makes of a run `[D_p]`: the mean over its stretches."""
        assert self.encoder is not None
        s, u, _ = windows([run], self.kind.stretch, _STRIDE)
        return self.encoder(s[:, :-1], u).mean(0).numpy()


@shared
def train(name: str, weights: str, seed: int, updates: int = UPDATES) -> TrainedKind:
    """Train a kind of model on the recordings of stored weights.

    Args:
        name: one of `KINDS`.
        weights: whose recordings and autoencoder it has, such as "torque-paper".
        seed: of the first weights, and of what is drawn.
        updates: how many.
    """
    runs = recorded_runs(trained(f"{weights}-0"))
    return train_kind(KINDS[name], runs, seed, updates)


def train_kind(
    kind: Kind, runs: Sequence[Run], seed: int, updates: int = UPDATES
) -> TrainedKind:
    """Train a model, and an encoder or p beside it."""
    materials = materials_of(runs)
    with seeded(seed):
        # The network; and what is learned, or told, of each material
        states = runs[0].s.shape[1]
        commands = runs[0].u.shape[1]
        model = DPMPB(states, commands, kind.bias_size)
        set_normalisation(model, runs)
        model = quicken(model)
        encoder = StretchEncoder(model) if kind.encoder else None
        p = torch.zeros(len(materials), kind.bias_size)
        if kind.told:
            told = [ablations.constants(name, materials) for name in materials]
            p = torch.as_tensor(np.stack(told), dtype=torch.float32)

        for _ in _train(model, encoder, p, kind, runs, updates):
            pass

    # What stands for each recorded material
    model = model.eval().requires_grad_(False)
    biases = dict(zip(materials, p.detach().numpy(), strict=True))
    learned = TrainedKind(model, biases, kind, encoder)
    if encoder is None:
        return learned
    return learned._replace(biases=_mean_readings(learned, runs))


def _mean_readings(learned: TrainedKind, runs: Sequence[Run]) -> dict[str, np.ndarray]:
    """Of each material the mean over its runs."""
    readings: dict[str, list[np.ndarray]] = {}
    for run in runs:
        readings.setdefault(run.material, []).append(learned.read(run))
    return {name: np.mean(each, axis=0) for name, each in readings.items()}


def _train(
    model: PredictiveModel,
    encoder: StretchEncoder | None,
    p: Tensor,
    kind: Kind,
    runs: Sequence[Run],
    updates: int,
) -> Iterator[float]:
    """Train in place, what is not told of p `[K, D_p]` included; yields the losses."""
    s, u, k = windows(runs, kind.length, _STRIDE)
    stretch_of = _stretches(runs, kind.stretch) if kind.stretch else None

    def loss(index: Tensor) -> Tensor:
        # A window, and perhaps a stretch of the same material before it
        states = [s[index]]
        commands = [u[index]]
        code = p[k[index]]
        if stretch_of is not None:
            read, sent = stretch_of(k[index])
            if encoder is not None:
                code = encoder(read[:, :-1], sent)
            else:
                states.insert(0, read)
                commands.insert(0, sent)

        # One sequence of both: where they meet, the robot was reset
        before = torch.cat([each[:, :-1] for each in states], dim=1)
        after = torch.cat([each[:, 1:] for each in states], dim=1)
        predicted, _ = model(before, torch.cat(commands, dim=1), code)
        counted = slice(kind.uncounted, None)
        return model.loss(predicted[:, counted], after[:, counted])

    # As many predicted steps in each update, whatever a sequence's length
    steps = kind.length + (0 if kind.encoder else kind.stretch)
    count = max(1, round(kind.predicted / steps))

    def batches() -> Sequence[Tensor]:
        return [torch.randint(len(s), (count,))]

    groups = _groups(model, encoder, p, kind)
    yield from minimise(groups, loss, batches, updates, ModelTraining.learning_rate)


def _groups(
    model: PredictiveModel, encoder: StretchEncoder | None, p: Tensor, kind: Kind
) -> list[dict[str, Any]]:
    """What a training moves: W, the encoder's weights, or p at its own rate."""
    groups: list[dict[str, Any]] = [{"params": list(model.parameters())}]
    if encoder is not None:
        groups.append({"params": list(encoder.parameters())})
    elif kind.bias_size and not kind.told:
        p.requires_grad_()
        groups.append({"params": [p], "lr": ModelTraining.bias_learning_rate})
    return groups


def _stretches(
    runs: Sequence[Run], length: int
) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
    """Draws a stretch of each of some materials `[B]`: states and commands.

    States are `[B, length + 1, D_s]`, commands `[B, length, D_u]`.
    """
    s, u, k = windows(runs, length, _STRIDE)
    in_order = k.argsort(stable=True)
    counts = k.bincount()
    first = counts.cumsum(0) - counts

    def draw(materials: Tensor) -> tuple[Tensor, Tensor]:
        within = torch.rand(len(materials)) * counts[materials]
        index = in_order[first[materials] + within.long()]
        return s[index], u[index]

    return draw


class HindsightPlans(nn.Module):
    """Where a plan should lead to a plan that led there.

    It is told z at the end, perhaps the state at the start, and what is known of the
    material, and answers with a mixture of normal distributions of plans. Its training
    is on recorded stretches: what each led to was, in hindsight, its goal.

    Args:
        inputs: how many numbers it is told.
        steps: of a plan, T.
        commands: D_u.
        components: of the mixture; with one, it is a regression.
    """

    def __init__(self, inputs: int, steps: int, commands: int, components: int):
        super().__init__()
        self.components = components
        self.plan = (steps, commands)
        width = steps * commands
        self.layers = nn.Sequential(
            nn.Linear(inputs, 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh()
        )
        self.means = nn.Linear(128, components * width)
        self.logits = nn.Linear(128, components)
        self.log_std = nn.Parameter(torch.zeros(components, width))

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Means `[B, K, T D_u]` and log weights `[B, K]` for inputs `[B, D]`."""
        hidden = self.layers(x)
        means = self.means(hidden).unflatten(1, (self.components, -1))
        return means, self.logits(hidden).log_softmax(1)

    def loss(self, x: Tensor, plans: Tensor) -> Tensor:
        """Negative log likelihood of plans `[B, T D_u]`, per command."""
        means, logs = self(x)
        errors = (plans[:, None] - means) / self.log_std.exp()
        likelihood = logs - (0.5 * errors.square() + self.log_std).sum(2)
        return -likelihood.logsumexp(1).mean() / plans.shape[1]

    @torch.no_grad()
    def likeliest(self, x: Tensor) -> Tensor:
        """Mean of the component with the largest weight, `[T, D_u]`, for x `[D]`."""
        means, logs = self(x[None])
        return means[0, logs[0].argmax()].reshape(self.plan)


def train_hindsight(
    runs: Sequence[Run],
    codes: Mapping[str, np.ndarray],
    model: PredictiveModel,
    *,
    latent: int,
    period: int,
    from_state: bool,
    components: int,
    updates: int,
    seed: int,
) -> HindsightPlans:
    """Learn which plans led where.

    Args:
        runs: recordings.
        codes: what is known of each material, `{name: [D_c]}`; D_c may be 0.
        model: whose normalisation is used.
        latent: size of z, D_z.
        period: steps of a plan.
        from_state: whether the network is told the state at the start.
        components: of the mixture.
        updates: of 256 stretches each.
        seed: of the first weights, and of what is drawn.
    """
    # Every stretch: how it began, where it led, and what it was
    s, u, k = windows(runs, period, 1)
    table = np.stack([codes[name] for name in materials_of(runs)])
    known = torch.as_tensor(table, dtype=torch.float32)
    start = s[:, 0] if from_state else None
    x = hindsight_input(model, start, s[:, -1, :latent], known[k])
    plans = ((u - model.u_mean) / model.u_std).flatten(1)

    with seeded(seed):
        network = HindsightPlans(x.shape[1], period, u.shape[2], components)

        def batches() -> Sequence[Tensor]:
            return [torch.randint(len(x), (256,))]

        def loss(index: Tensor) -> Tensor:
            return network.loss(x[index], plans[index])

        for _ in minimise(network.parameters(), loss, batches, updates, 2e-3):
            pass
    return network.eval()


def hindsight_input(
    model: PredictiveModel, s: Tensor | None, z: Tensor, code: Tensor
) -> Tensor:
    """What such a network is told, normalised and side by side, `[..., D]`.

    States `[..., D_s]` at the start, if they are told, goals `[..., D_z]` and codes.
    """
    latent = z.shape[-1]
    parts = [(z - model.s_mean[:latent]) / model.s_std[:latent], code]
    if s is not None:
        parts.append((s - model.s_mean) / model.s_std)
    return torch.cat(parts, dim=-1)
