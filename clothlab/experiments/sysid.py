"""Which cloth moves like this? C_damp and C_mass without p, for comparison: by fitting the simulation, and by a network
that was told both constants of every cloth it learned from.

Who identifies is a function from a run, of which nobody says what was in the hand, to (log C_damp, log C_mass).
"""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._validation import Checked, check_array, check_number, choose, setting
from clothlab.learning._training import training
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import Sequences, to_sequences
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import DAMPINGS, MASSES, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout

MIDDLE = np.log([DAMPINGS[0] * DAMPINGS[-1], MASSES[0] * MASSES[-1]]) / 2  # of the trained range
UNKNOWN = "unknown"  # name of the material of a run whose cloth is to be found

Identify = Callable[[Sequences], np.ndarray]
Simulate = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (log C_damp, log C_mass), commands → states


def logs(cloth: Cloth) -> np.ndarray:
    """(log C_damp, log C_mass) of a cloth, `[2]`, log of [N s/m] and of [kg]."""
    return np.log([cloth.damping, cloth.mass])


class Simulator:
    """The simulation as a function from a cloth's two constants and commands to what the robot would sense.

    Args:
        arm: the arm.
        autoencoder: what turns its camera's images into z.
        cloth: all else that is known of the cloth; its own C_damp and C_mass don't matter.
    """

    def __init__(self, arm: Arm, autoencoder: Autoencoder, cloth: Cloth | None = None):
        self._autoencoder, self._cloth = autoencoder, cloth or Cloth("simulated")
        self._env = ClothEnv(arm, self._cloth)

    def __call__(self, constants: ArrayLike, u: ArrayLike) -> np.ndarray:
        """States `[T, D_s]` seen before each of the commands `[T, D_u]`, from a cloth that hangs still.

        Args:
            constants: (log C_damp, log C_mass).
            u: the commands.

        Raises:
            ValueError: constants or commands of another shape or not finite, or out of the arm's range.
            SimulationError: the physics diverged.
        """
        damping, mass = np.exp(check_array("(log C_damp, log C_mass)", constants, (2,)))
        self._env.hold(replace(self._cloth, damping=damping, mass=mass))
        return to_sequences(self._autoencoder, rollout(self._env, ReplayPolicy(u), len(np.asarray(u)))).s

    def close(self) -> None:
        """Release the OpenGL contexts."""
        self._env.close()


@dataclass(frozen=True)
class FitSettings(Checked):
    """How the simulation is fitted.

    From the middle of the range alone, Gauss-Newton stops in one of many small valleys: where a cloth folds, a
    thousandth of C_damp can move z by a tenth of its deviation. So a coarse search over the start of a run comes first.
    """

    reach: float = setting(3.0, "times", above=1)  # bounds: so far from the middle of the trained range, both ways
    cells: int = setting(7, at_least=1)  # of the coarse search, along each axis; one is the middle alone
    glance: int = setting(25, "step", at_least=1)  # of the run, which it looks at
    kept: int = setting(4, at_least=1)  # cells that are compared over the whole run; the best one is the start
    difference: float = setting(0.05, "log", above=0)  # of finite differences: wider than the small valleys
    iterations: int = setting(8, at_least=1)
    tolerance: float = setting(1e-3, "log", above=0)  # the optimiser stops at a step this short


def fit_simulation(
    simulate: Simulate, run: Sequences, scale: ArrayLike, settings: FitSettings | None = None
) -> np.ndarray:
    """Fit (log C_damp, log C_mass) of a simulation to a run with `mujoco.sysid`; states are compared as sensed.

    Args:
        simulate: constants and commands to states, such as a `Simulator`.
        run: what was sensed and sent.
        scale: of each state's error, its standard deviation for one, `[D_s]`.
        settings: of the coarse search and of the optimiser.

    Returns:
        (log C_damp, log C_mass) `[2]`.

    Raises:
        ImportError: a package that `mujoco.sysid` needs is missing; the message names them.
        ValueError: a scale that is not `[D_s]` and above zero.
        SimulationError: the physics diverged.
    """
    settings, tools = settings or FitSettings(), sysid_tools()
    scale = check_array("scale", scale, run.s.shape[1:])
    if (scale <= 0).any():
        raise ValueError(f"scale is above zero, got {scale.min()}")

    def error(x: np.ndarray, part: Sequences) -> np.ndarray:
        return ((simulate(MIDDLE + x, part.u) - part.s) / scale).ravel() / len(part) ** 0.5

    def residual(x: np.ndarray, _: Any) -> tuple[list[np.ndarray], None, None]:
        columns = np.stack([error(each, run) for each in x.reshape(2, -1).T], axis=-1)
        return [columns.reshape(-1, *x.shape[1:])], None, None

    bound = float(np.log(settings.reach))
    start = _coarse_search(error, run, bound, settings)
    parameters = tools.ParameterDict()
    for name, value in zip(("log C_damp", "log C_mass"), start, strict=True):
        parameters.add(tools.Parameter(name, value, -bound, bound))
    # An uphill step shortens the next by much, since each costs a simulation; by how much at the most must not depend
    # on the states' units.
    careful = {"mu_min": 1e-3, "mu_factor": 4.0, "mu_max": 1e2, "xtol": settings.tolerance, "x_scale": "jac"}
    how = {"max_iters": settings.iterations, "eps": settings.difference, "output": io.StringIO()} | careful
    found, _ = tools.optimize(parameters, residual, "mujoco", verbose=False, **how)
    return MIDDLE + found.as_vector()


def _coarse_search(
    error: Callable[[np.ndarray, Sequences], np.ndarray], run: Sequences, bound: float, settings: FitSettings
) -> np.ndarray:
    """The best cell of a grid over the whole range, from its middle, `[2]`."""
    axis = (np.arange(settings.cells) + 0.5) / settings.cells * 2 * bound - bound
    cells = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    for part, kept in ((run[: settings.glance], settings.kept), (run, 1)):
        if len(cells) > kept:
            costs = [(error(x, part) ** 2).sum() for x in cells]
            cells = cells[np.argsort(costs)[:kept]]
    return cells[0]


def sysid_tools() -> Any:
    """`mujoco.sysid`, which MuJoCo leaves empty where a package that it needs is missing.

    Raises:
        ImportError: one is; the message names them.
    """
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):
        raise ImportError(
            "mujoco.sysid needs packages that MuJoCo does not bring: `pip install absl-py colorama pyyaml tabulate`, "
            "or `pip install clothlab[sysid]`"
        )
    return sysid


class Regressor(nn.Module):
    """s, u → GRU → its mean since the start → tanh layer → (log C_damp, log C_mass), after each step.

    A mean has no length, so that one network answers after any number of steps. Means and standard deviations travel
    with the weights.

    Args:
        state_size: D_s.
        command_size: D_u.
        hidden_size: of both layers.
    """

    mean: Tensor
    std: Tensor
    label_mean: Tensor
    label_std: Tensor

    def __init__(self, state_size: int, command_size: int, hidden_size: int = 64):
        super().__init__()
        state_size = check_number("state_size", state_size, int, at_least=1)
        command_size = check_number("command_size", command_size, int, at_least=0)
        hidden_size = check_number("hidden_size", hidden_size, int, at_least=1)
        self.gru = nn.GRU(state_size + command_size, hidden_size, batch_first=True)
        self.head = nn.Sequential(nn.Linear(hidden_size, hidden_size), nn.Tanh(), nn.Linear(hidden_size, 2))
        for name, size in (("", state_size + command_size), ("label_", 2)):
            self.register_buffer(f"{name}mean", torch.zeros(size))
            self.register_buffer(f"{name}std", torch.ones(size))

    def forward(self, s: Tensor, u: Tensor) -> Tensor:
        """What it says after each step of runs `[B, T, D_s]`, `[B, T, D_u]`: `[B, T, 2]`."""
        x = (torch.cat([s, u], dim=-1) - self.mean) / self.std
        h, _ = self.gru(x)
        count = torch.arange(1, h.shape[1] + 1)[:, None]
        return self.head(h.cumsum(dim=1) / count) * self.label_std + self.label_mean

    @torch.no_grad()
    def identify(self, run: Sequences) -> np.ndarray:
        """(log C_damp, log C_mass) after a run, `[2]`."""
        return self(torch.as_tensor(run.s)[None], torch.as_tensor(run.u)[None])[0, -1].double().numpy()


@dataclass(frozen=True)
class RegressorTraining(Checked):
    """How the network is trained."""

    updates: int = setting(800, at_least=1)
    batch_size: int = setting(36, at_least=1)  # runs
    window: int = setting(200, "step", at_least=1)  # of each, from a random start; it answers after every step of it
    warmup: int = setting(10, "step", at_least=0)  # first of them, after which nobody could know
    hidden_size: int = setting(64, at_least=1)
    learning_rate: float = setting(3e-3, above=0)  # at the start; it falls to zero along a cosine

    def __post_init__(self) -> None:
        """Refuse windows after which there is nothing to learn."""
        super().__post_init__()
        if self.window <= self.warmup:
            raise ValueError(
                f"RegressorTraining.window must be longer than the warmup of {self.warmup} steps, got {self.window}"
            )


def train_regressor(
    runs: Sequence[Sequences],
    constants: Mapping[str, ArrayLike],
    settings: RegressorTraining | None = None,
    *,
    seed: int = 0,
) -> tuple[Regressor, np.ndarray]:
    """Train a network on runs with cloths whose constants are told.

    Args:
        runs: recorded runs.
        constants: (log C_damp, log C_mass) of each material, `{name: [2]}`.
        settings: window, batch, updates, learning rate.
        seed: of weights, windows and batches.

    Returns:
        The network, and the loss of each update `[updates]`: mean squared error in standard deviations of the labels.

    Raises:
        KeyError: a material whose constants are not told; the message lists those that are.
        ValueError: no runs, or one no longer than the warmup.
    """
    settings = settings or RegressorTraining()
    if not runs or min(map(len, runs)) <= settings.warmup:
        raise ValueError(f"training takes runs of more than the warmup of {settings.warmup} steps")
    told = {name: check_array(f"constants of {name}", each, (2,)) for name, each in constants.items()}
    labels = np.array([choose("material", run.material, told) for run in runs], np.float32)
    with training(seed):
        return _train(runs, torch.as_tensor(labels), settings)


def _train(runs: Sequence[Sequences], labels: Tensor, settings: RegressorTraining) -> tuple[Regressor, np.ndarray]:
    s, u = ([torch.as_tensor(getattr(run, name)) for run in runs] for name in ("s", "u"))
    model = Regressor(s[0].shape[1], u[0].shape[1], settings.hidden_size)
    seen = torch.cat([torch.cat(s), torch.cat(u)], dim=1)
    for name, values in (("", seen), ("label_", labels)):
        getattr(model, f"{name}mean").copy_(values.mean(0))
        getattr(model, f"{name}std").copy_(values.std(0, correction=0).clamp_min(1e-6))
    optimizer = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.updates)
    length, losses = min(settings.window, min(map(len, runs))), []
    for _ in range(settings.updates):
        index = torch.randperm(len(runs))[: settings.batch_size].tolist()
        starts = [int(torch.randint(len(runs[k]) - length + 1, ())) for k in index]
        batch = (torch.stack([each[k][t : t + length] for k, t in zip(index, starts, strict=True)]) for each in (s, u))
        said = model(*batch)[:, settings.warmup :]
        loss = (((said - labels[index][:, None]) / model.label_std) ** 2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        losses.append(loss.item())
    return model.eval().requires_grad_(False), np.array(losses)
