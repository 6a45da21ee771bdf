"""System identification without p: log C_damp and log C_mass by a fitted simulation,
and by a network.
"""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from mujoco import sysid
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._validation import choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.data import Run
from clothlab.method.training import minimise, seeded
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import DAMPINGS, MASSES, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout, to_run

# Of the trained range
MIDDLE = np.log([DAMPINGS[0] * DAMPINGS[-1], MASSES[0] * MASSES[-1]]) / 2
_WARMUP, _BATCH = (
    10,
    36,
    # Steps of a run that say too little of its cloth, and runs in each batch of a
    # training
)

# (log C_damp, log C_mass), commands → states
_Simulate = Callable[[np.ndarray, np.ndarray], np.ndarray]


def logs(cloth: Cloth) -> np.ndarray:
    """(log C_damp, log C_mass) of a cloth, `[2]`, log of [N s/m] and of [kg]."""
    return np.log([cloth.damping, cloth.mass])


@contextmanager
def simulator(
    arm: Arm, autoencoder: Autoencoder, cloth: Cloth | None = None
) -> Iterator[_Simulate]:
    """The simulation as a function from (log C_damp, log C_mass) and commands `[T,
    D_u]` to states `[T, D_s]`.

    All other constants are those of `cloth`, which hangs still at the beginning.
    """
    cloth = cloth or Cloth("simulated")
    with closing(ClothEnv(arm, cloth)) as env:

        def simulate(constants: np.ndarray, u: np.ndarray) -> np.ndarray:
            damping, mass = np.exp(constants)
            env.hold(replace(cloth, damping=damping, mass=mass))
            return to_run(autoencoder, rollout(env, ReplayPolicy(u), len(u))).s

        yield simulate


def fit_simulation(
    simulate: _Simulate,
    run: Run,
    scale: np.ndarray,
    *,
    reach: float = 3.0,
    cells: int = 7,
    **options: Any,
) -> np.ndarray:
    """Fit (log C_damp, log C_mass) `[2]` of a simulation to a run with `mujoco.sysid`;
    states are compared as sensed.

    From the middle of the range alone, Gauss-Newton stops in one of many small valleys:
    where a cloth folds, a thousandth of C_damp can move z by a tenth of its deviation.
    So a coarse search over the start of a run comes first.

    Args:
        simulate: constants and commands to states, as a `simulator` gives.
        run: what was sensed and sent.
        scale: standard deviation of each state's error `[D_s]`.
        reach: the search ends so many times above and below the middle of the trained
            range.
        cells: of the coarse search, along each axis.
        options: of `mujoco.sysid.optimize`.
    """
    if not hasattr(
        sysid, "optimize"
    ):  # MuJoCo leaves it empty where a package that it needs is missing
        raise ImportError(
            "mujoco.sysid needs further packages: `pip install absl-py colorama pyyaml tabulate`"
        )
    bound, scale = float(np.log(reach)), scale.astype(np.float64)

    def error(x: np.ndarray, part: Run) -> np.ndarray:
        return ((simulate(MIDDLE + x, part.u) - part.s) / scale).ravel() / len(
            part
        ) ** 0.5

    def residual(x: np.ndarray, _: Any) -> tuple[list[np.ndarray], None, None]:
        columns = np.stack([error(each, run) for each in x.reshape(2, -1).T], axis=-1)
        return [columns.reshape(-1, *x.shape[1:])], None, None

    parameters = sysid.ParameterDict()
    for name, value in zip(
        ("log C_damp", "log C_mass"),
        _coarse_search(error, run, bound, cells),
        strict=True,
    ):
        parameters.add(sysid.Parameter(name, value, -bound, bound))
    # Finite differences are wider than the small valleys. An uphill step shortens the
    # next by much, since each costs a simulation; by how much at the most must not
    # depend on the states' units.
    usual = {
        "max_iters": 8,
        "eps": 0.05,
        "xtol": 1e-3,
        "verbose": False,
        "output": io.StringIO(),
    }
    usual |= {"mu_min": 1e-3, "mu_factor": 4.0, "mu_max": 1e2, "x_scale": "jac"}
    found, _ = sysid.optimize(parameters, residual, "mujoco", **usual | options)
    return MIDDLE + found.as_vector()


def _coarse_search(
    error: Callable[[np.ndarray, Run], np.ndarray], run: Run, bound: float, cells: int
) -> np.ndarray:
    """The best cell of a grid over the whole range `[2]`, of the four best over the
    first 25 steps.
    """
    axis = (np.arange(cells) + 0.5) / cells * 2 * bound - bound
    centres = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    for part, kept in ((run[:25], 4), (run, 1)):
        if len(centres) > kept:
            costs = [(error(x, part) ** 2).sum() for x in centres]
            centres = centres[np.argsort(costs)[:kept]]
    return centres[0]


class Regressor(nn.Module):
    """s, u → GRU → its mean since the start → tanh layer → (log C_damp, log C_mass),
    after each step.
    """

    mean: Tensor
    std: Tensor
    label_mean: Tensor
    label_std: Tensor

    def __init__(self, state_size: int, command_size: int, hidden_size: int = 64):
        super().__init__()
        self.gru = nn.GRU(state_size + command_size, hidden_size, batch_first=True)
        self.head = nn.Sequential(
            nn.Linear(hidden_size, hidden_size), nn.Tanh(), nn.Linear(hidden_size, 2)
        )
        for name, size in (("", state_size + command_size), ("label_", 2)):
            self.register_buffer(f"{name}mean", torch.zeros(size))
            self.register_buffer(f"{name}std", torch.ones(size))

    def forward(self, s: Tensor, u: Tensor) -> Tensor:
        """Answers after each step of runs `[B, T, D_s]`, `[B, T, D_u]`: `[B, T, 2]`."""
        x = (torch.cat([s, u], dim=-1) - self.mean) / self.std
        h, _ = self.gru(x)
        count = torch.arange(1, h.shape[1] + 1)[:, None]
        return self.head(h.cumsum(dim=1) / count) * self.label_std + self.label_mean

    @torch.no_grad()
    def identify(self, run: Run) -> np.ndarray:
        """(log C_damp, log C_mass) after a run, `[2]`."""
        return (
            self(torch.as_tensor(run.s)[None], torch.as_tensor(run.u)[None])[0, -1]
            .double()
            .numpy()
        )


def train_regressor(
    runs: Sequence[Run],
    constants: Mapping[str, ArrayLike],
    *,
    seed: int = 0,
    updates: int = 800,
    window: int = 200,
    hidden_size: int = 64,
    learning_rate: float = 3e-3,
) -> tuple[Regressor, np.ndarray]:
    """Train a network on runs with cloths whose (log C_damp, log C_mass) are known,
    `{name: [2]}`.

    In each update it answers after every step of `window` steps from a random place in
    some runs. The learning rate falls to zero along a cosine. Besides the network: the
    loss of each update `[updates]`, mean squared error in standard deviations of the
    labels.
    """
    labels = torch.as_tensor(
        np.array(
            [choose("material", run.material, constants) for run in runs], np.float32
        )
    )
    s, u = (
        [torch.as_tensor(getattr(run, name)) for run in runs] for name in ("s", "u")
    )
    length = min(window, min(map(len, runs)))
    with seeded(seed):
        model = Regressor(s[0].shape[1], u[0].shape[1], hidden_size)
        for name, values in (
            ("", torch.cat([torch.cat(s), torch.cat(u)], dim=1)),
            ("label_", labels),
        ):
            getattr(model, f"{name}mean").copy_(values.mean(0))
            getattr(model, f"{name}std").copy_(
                values.std(0, correction=0).clamp_min(1e-6)
            )

        def loss(index: Tensor) -> Tensor:
            starts = [int(torch.randint(len(runs[k]) - length + 1, ())) for k in index]
            pairs = [*zip(index.tolist(), starts, strict=True)]
            batch = (
                torch.stack([each[k][t : t + length] for k, t in pairs])
                for each in (s, u)
            )
            answers = model(*batch)[:, _WARMUP:]
            return (((answers - labels[index][:, None]) / model.label_std) ** 2).mean()

        def batches() -> list[Tensor]:
            return [torch.randperm(len(runs))[:_BATCH]]

        losses = [
            *minimise(
                model.parameters(), loss, batches, updates, learning_rate, fused=False
            )
        ]
    return model.eval().requires_grad_(False), np.array(losses)
