"""What is trained on a drone's flights, and what physics says without a training.

Settings were chosen on the flights of one controller, `DEVELOPMENT`, which no other
table is about (`drone_development`): predictions over 1 s by models of the other four.
So the flights of the tested controllers had a part in the choice, as recordings, while
none was predicted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from clothlab.method.data import Run, count_windows
from clothlab.method.gauss_newton import NewtonSettings, best_bias
from clothlab.method.model import DPMPB, AnyMemory, PredictiveModel, expanded, predict
from clothlab.method.training import ModelTraining, train_dpmpb
from studies._grid import shared
from studies._rival_models import Kind, TrainedKind, train_kind
from studies.neural_fly import CONTROLLERS, STEP, WINDS, load_flight

DEVELOPMENT = "L1"  # its flights are among those of every training
TESTED = tuple(name for name in CONTROLLERS if name != DEVELOPMENT)
_BATCH = 50  # windows of 30 steps in an update, or as many steps in longer ones
_PREDICTED = 30 * _BATCH
TRAINING = ModelTraining(epochs=1, batch_size=_BATCH, stride=5, sequence_length=30)
P = "p"
TOLD = "wind told"
NO_P = "no p"
LONG_MEMORY = "long memory"
CONTEXT = "context encoder"
LONG_P = "p, windows of 10 s"
REHEARSED = "kept memory, rehearsed"
# How many updates a training has: what served it best in `drone_development`
UPDATES = {P: 1200, NO_P: 600, LONG_MEMORY: 1200, CONTEXT: 1200}
UPDATES |= {TOLD: 1200, LONG_P: 2400, REHEARSED: 1200}
_RIVALS = {
    NO_P: Kind(predicted=_PREDICTED),
    LONG_MEMORY: Kind(length=100, predicted=_PREDICTED),
    CONTEXT: Kind(bias_size=2, stretch=100, encoder=True, predicted=_PREDICTED),
    # Its memory has read another stretch of the same wind before each window
    REHEARSED: Kind(length=50, uncounted=30, stretch=100, predicted=_PREDICTED),
}
_SLOWEST_WIND = 12.1  # [m/s] by which a wind is divided that a model is told
_TILT = slice(3, 5)  # of the state
_SPEED = slice(0, 3)
_GRAVITY = 9.81  # [m/s²]


@dataclass(frozen=True)
class Recordings:
    """Which flights a training sees."""

    controllers: tuple[str, ...]
    winds: tuple[str, ...] = tuple(WINDS)
    # Whether flights are said to have other winds, others for each controller
    shuffled: bool = False
    tilt: bool = True  # whether the state has it

    def runs(self) -> list[Run]:
        """The flights, each named by its wind."""
        found = []
        for k, controller in enumerate(self.controllers):
            names = list(self.winds)
            if self.shuffled:
                # One place further for each: a name is that of all winds alike
                names = [*names[k:], *names[:k]]
            for wind, name in zip(self.winds, names, strict=True):
                run = load_flight(controller, wind).run
                found.append(self.seen(replace(run, material=name)))
        return found

    def seen(self, run: Run) -> Run:
        """What a model of these recordings sees of a flight."""
        if self.tilt:
            return run
        return replace(run, s=np.delete(run.s, _TILT, axis=1))


def without(controller: str, wind: str | None = None, **others: Any) -> Recordings:
    """All flights but those of a controller, and of a wind."""
    controllers = tuple(name for name in CONTROLLERS if name != controller)
    winds = tuple(name for name in WINDS if name != wind)
    return Recordings(controllers, winds, **others)


def few(controller: str, count: int) -> Recordings:
    """The flights of so many other controllers, those that are named after it."""
    start = CONTROLLERS.index(controller) + 1
    following = [*CONTROLLERS[start:], *CONTROLLERS][:count]
    return Recordings(tuple(following))


@shared
def train(
    kind: str, recordings: Recordings, seed: int, updates: int | None = None
) -> TrainedKind:
    """Train one kind of model on some flights.

    Args:
        kind: P, LONG_P, TOLD, or one of the rivals that have no p.
        recordings: which flights.
        seed: of the first weights, and of the order of what is seen.
        updates: how many; by default those of its kind.
    """
    runs = recordings.runs()
    updates = updates or UPDATES[kind]
    if kind in _RIVALS:
        return train_kind(_RIVALS[kind], runs, seed, updates)
    known = None
    settings = TRAINING
    if kind == LONG_P:
        settings = replace(settings, sequence_length=100, batch_size=_PREDICTED // 100)
    settings = with_updates(settings, runs, updates)
    if kind == TOLD:
        known = {name: [WINDS[name] / _SLOWEST_WIND] for name in recordings.winds}
        settings = replace(settings, bias_size=1)
    model, biases, _ = train_dpmpb(
        runs, settings, known=known, seed=seed, device="cpu", progress=False
    )
    return TrainedKind(model.requires_grad_(False), biases, Kind(bias_size=2))


def with_updates(
    settings: ModelTraining, runs: Sequence[Run], updates: int
) -> ModelTraining:
    """The same settings, with as many epochs as make so many updates."""
    length = settings.sequence_length
    windows = sum(count_windows(run, length, settings.stride) for run in runs)
    batches = -(-windows // settings.batch_size)
    return replace(settings, epochs=max(1, round(updates / batches)))


def estimate_at_once(model: PredictiveModel, run: Run) -> np.ndarray:
    """p `[D_p]` with the lowest loss of a whole run in motion, from zero."""
    p, _ = best_bias(model, run, np.zeros(model.bias_size), rounds=15, from_rest=False)
    return p


class Forecasts(NamedTuple):
    """From where predictions begin, and what was flown after it."""

    before: Tensor  # states, the last is where a prediction begins [B, H + 1, D_s]
    sent_before: Tensor  # commands between them [B, H, D_u]
    commands: Tensor  # from there on [B, T, D_u]
    flown: Tensor  # states after each of them [B, T, D_s]


def forecasts(run: Run, starts: Sequence[int], history: int, steps: int) -> Forecasts:
    """Stretches of a flight, with so many steps of history before each start."""
    s = torch.as_tensor(run.s)
    u = torch.as_tensor(run.u)
    return Forecasts(
        torch.stack([s[t - history : t + 1] for t in starts]),
        torch.stack([u[t - history : t] for t in starts]),
        torch.stack([u[t : t + steps] for t in starts]),
        torch.stack([s[t + 1 : t + steps + 1] for t in starts]),
    )


@torch.no_grad()
def predicted(
    model: PredictiveModel, p: Tensor, kept: AnyMemory | None, given: Forecasts
) -> Tensor:
    """States `[B, T, D_s]` that a model predicts, each from the prediction before.

    The memory is filled by the history. Before it, it is empty, or what was kept.
    """
    memory = None if kept is None else expanded(kept, len(given.before))
    if given.sent_before.shape[1]:
        _, memory = model(given.before[:, :-1], given.sent_before, p, memory)
    return predict(model, given.before[:, -1], given.commands, p, memory)


@torch.no_grad()
def with_last_layer(model: PredictiveModel, run: Run, ridge: float) -> DPMPB:
    """A copy whose last layer is fitted to a run, by ridge regression.

    All other layers stay. So does the last one where the run says little: what is
    fitted is its change, and `ridge` is the price of its square.
    """
    # What the last layer reads, and what it should say
    s = torch.as_tensor(run.s)
    u = torch.as_tensor(run.u)
    copy = DPMPB(model.state_size, model.command_size, model.bias_size)
    copy.load_state_dict(model.state_dict())
    body = nn.Sequential(*list(copy.fc_out)[:-1])
    inputs = model.to_inputs(s[None, :-1], u[None, :-1], torch.zeros(0))
    hidden, _ = copy.lstm(copy.fc_in(inputs))
    features = body(hidden)[0]
    last = copy.fc_out[-1]
    assert isinstance(last, nn.Linear)
    seen = (s[1:] - model.s_mean) / model.s_std
    errors = seen - last(features)

    # The change of weights and offsets with the least squares
    warm = slice(NewtonSettings.warmup, None)
    design = torch.cat([features, torch.ones(len(features), 1)], dim=1)[warm].double()
    normal = design.T @ design + ridge * torch.eye(design.shape[1]).double()
    change = torch.linalg.solve(normal, design.T @ errors[warm].double()).float()
    last.weight.add_(change[:-1].T)
    last.bias.add_(change[-1])
    return copy.eval()


class HoverModel(NamedTuple):
    """A quadrotor as its thrust, its tilt, and a residual force.

    The force is what the thrust does not explain: the same at all speeds, as
    Neural-Fly's variant without learning has it, or with a drag that is linear in
    speed.
    """

    approach: float  # share of the way to the commanded tilt in one step
    gain: float  # thrust per commanded thrust, both over hover's
    force: np.ndarray  # residual, over the mass [3] [m/s²]
    drag: np.ndarray  # over the mass [3] [1/s]

    @classmethod
    def of(cls, runs: Sequence[Run]) -> "HoverModel":
        """Fit what is the drone's own, of flights each with a force of its own."""
        moved = []
        asked = []
        pushed = []
        gained = []
        for run in runs:
            # Tilt: how far it goes of what it is asked to
            asked.append((run.u[:-1, 1:] - run.s[:-1, _TILT]).ravel())
            moved.append(np.diff(run.s[:, _TILT], axis=0).ravel())

            # Speed: what thrust explains beyond a force that is linear in speed
            tilt = (run.s[:-1, _TILT] + run.s[1:, _TILT]) / 2
            thrust = _GRAVITY * _axis(tilt) * run.u[:-1, :1]
            change = np.diff(run.s[:, _SPEED], axis=0) / STEP
            for k in range(3):
                speed = run.s[:-1, k]
                pushed.append(_without_line(speed, thrust[:, k]))
                gained.append(_without_line(speed, change[:, k]))
        approach = _slope(np.concatenate(asked), np.concatenate(moved))
        gain = _slope(np.concatenate(pushed), np.concatenate(gained))
        return cls(approach, gain, np.zeros(3), np.zeros(3))

    def with_force(self, run: Run, drag: bool = False) -> "HoverModel":
        """The same drone with the residual force of a run, by least squares."""
        calm = self._replace(force=np.zeros(3), drag=np.zeros(3))
        between = (run.s[:-1] + run.s[1:]) / 2
        expected = calm.acceleration(between, run.u[:-1])
        residual = np.diff(run.s[:, _SPEED], axis=0) / STEP - expected
        if not drag:
            return calm._replace(force=residual.mean(axis=0))
        lines = [
            np.polyfit(run.s[:-1, axis], residual[:, axis], 1) for axis in range(3)
        ]
        slopes, offsets = np.transpose(lines)
        return calm._replace(force=offsets, drag=-slopes)

    def acceleration(self, s: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What thrust, weight and the force do `[B, 3]` [m/s²]."""
        thrust = self.gain * _GRAVITY * u[:, :1] * _axis(s[:, _TILT])
        return thrust - [0, 0, _GRAVITY] + self.force - self.drag * s[:, _SPEED]

    def predict(self, given: Forecasts) -> Tensor:
        """States `[B, T, D_s]`; angular velocities are those of the start, fading."""
        s = given.before[:, -1].double().numpy()
        states = []
        for u in given.commands.double().numpy().transpose(1, 0, 2):
            after = s.copy()
            after[:, _TILT] += self.approach * (u[:, 1:] - s[:, _TILT])
            between = (s + after) / 2
            after[:, _SPEED] += self.acceleration(between, u) * STEP
            after[:, 5:] *= 1 - self.approach
            states.append(after)
            s = after
        return torch.as_tensor(np.stack(states, axis=1), dtype=torch.float32)


def _axis(tilt: np.ndarray) -> np.ndarray:
    """The unit vector along which thrust acts `[T, 3]`, of its first two numbers."""
    upwards = np.sqrt(np.clip(1 - (tilt**2).sum(axis=1, keepdims=True), 0, 1))
    return np.hstack([tilt, upwards])


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    return float(x @ y / (x @ x))


def _without_line(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What is left of y `[T]` when the best line in x `[T]` is taken away."""
    slope, offset = np.polyfit(x, y, 1)
    return y - slope * x - offset
