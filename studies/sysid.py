"""System identification without p: by a fitted simulation, and by a network.

Both find log C_damp and log C_mass of a cloth. A simulation is fitted to a run as a
whole, or to windows of it (multiple shooting).
"""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import torch
from mujoco import sysid
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._validation import choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import observe
from clothlab.method.data import Run
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import DAMPINGS, MASSES, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout, to_run
from studies._optimise import minimise, seeded

# Of the trained range
MIDDLE = np.log([DAMPINGS[0] * DAMPINGS[-1], MASSES[0] * MASSES[-1]]) / 2
_WARMUP = 10  # steps of a run that say too little of its cloth
_BATCH = 36  # runs in each batch of a training
_COARSE = 25  # steps of a run by which most cells of the coarse search are left out
_COARSE_KEPT = 4  # cells that are judged by the whole run

_WINDOW = 10  # steps of a window in multiple shooting: 2 s
# Steps before each window in which the simulated cloth, which starts at rest, takes up
# the motion of the real one in part: the first rows of a window still hold what is left
# of the start. As long as a window, so that each step is simulated about twice
_LEAD = 10

# (log C_damp, log C_mass), what was sensed and sent → states
_Simulate = Callable[[np.ndarray, Run], np.ndarray]


def logs(cloth: Cloth) -> np.ndarray:
    """(log C_damp, log C_mass) of a cloth, `[2]`, log of [N s/m] and of [kg]."""
    return np.log([cloth.damping, cloth.mass])


@contextmanager
def simulator(
    arm: Arm, autoencoder: Autoencoder, cloth: Cloth | None = None
) -> Iterator[_Simulate]:
    """The simulation as a function from constants and a run to states `[T, D_s]`.

    It gets (log C_damp, log C_mass), and sends the run's commands. All other constants
    are those of `cloth`, which hangs still at the beginning.
    """
    cloth = cloth or Cloth("simulated")
    with closing(ClothEnv(arm, cloth)) as env:

        def simulate(constants: np.ndarray, run: Run) -> np.ndarray:
            env.hold(_with_constants(cloth, constants))
            trial = rollout(env, ReplayPolicy(run.u), len(run))
            return to_run(autoencoder, trial).s

        yield simulate


def _with_constants(cloth: Cloth, constants: np.ndarray) -> Cloth:
    """The cloth with other (log C_damp, log C_mass) `[2]`."""
    damping, mass = np.exp(constants)
    return replace(cloth, damping=damping, mass=mass)


class _RestartedEnv(ClothEnv):
    """A scene that may also begin in another posture than the arm's home."""

    def begin(self, u: np.ndarray) -> None:
        """Begin where a command `u` `[D_u]` wants the arm, all at rest.

        The cloth hangs straight below the hand.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._place(u)
        mujoco.mj_forward(self.model, self.data)


@contextmanager
def windowed_simulator(
    arm: Arm, autoencoder: Autoencoder, *, window: int = _WINDOW, lead: int = _LEAD
) -> Iterator[_Simulate]:
    """The same in windows, each restarted: multiple shooting.

    An error cannot grow for longer than a window and its lead. What would have to be
    known at the start of a window is the place and the speed of each point of the
    cloth; an observer has three numbers z of an image, and the joints. So the arm is
    put where its joints were sensed some steps before, the cloth hangs still below the
    hand, and the run's commands of these steps, the lead, bring both into motion before
    the window counts. Only the first window begins with a state that is known.

    Args:
        arm: it senses its joint angles.
        autoencoder: sees the simulated cloth as it saw the real one.
        window: its length [step].
        lead: steps that are simulated before it and do not count.
    """
    with closing(_RestartedEnv(arm, Cloth("simulated"))) as env:
        layout = arm.layout(autoencoder.latent_size)

        def posture(s: np.ndarray) -> np.ndarray:
            """The command that holds the arm where its joints were sensed."""
            u = arm.home_command
            u[arm.angle_command] = s[layout.robot][arm.sensed_angles]
            return np.clip(u, arm.command_lower, arm.command_upper)

        def simulate(constants: np.ndarray, run: Run) -> np.ndarray:
            env.hold(_with_constants(env.cloth, constants))
            states = []
            for first in range(0, len(run), window):
                # Up to the window, from what is known of the state before it
                led = max(0, first - lead)
                if first:
                    env.begin(posture(run.s[led]))
                for u in run.u[led:first]:
                    env.advance(u)

                # The window itself
                for u in run.u[first : first + window]:
                    states.append(observe(autoencoder, env.observe()))
                    env.advance(u)
            return np.array(states)

        yield simulate


# Of `mujoco.sysid.optimize`. Finite differences (`eps`) are wider than the small
# valleys. An uphill step shortens the next by much (`mu_factor`), since each costs a
# simulation; by how much at the most must not depend on the states' units (`x_scale`).
_OPTIONS = {
    "max_iters": 8,
    "eps": 0.05,
    "xtol": 1e-3,
    "verbose": False,
    "mu_min": 1e-3,
    "mu_factor": 4.0,
    "mu_max": 1e2,
    "x_scale": "jac",
}


def fit_simulation(
    simulate: _Simulate,
    run: Run,
    scale: np.ndarray,
    *,
    reach: float = 3.0,
    cells: int = 7,
    **options: Any,
) -> np.ndarray:
    """Fit (log C_damp, log C_mass) `[2]` of a simulation to a run with `mujoco.sysid`.

    States are compared as sensed. From the middle of the range alone, Gauss-Newton
    stops in one of many small valleys: where a cloth folds, a thousandth of C_damp can
    move z by a tenth of its deviation. So a coarse search over the start of a run comes
    first.

    Args:
        simulate: constants and a run to states, as a `simulator` gives.
        run: what was sensed and sent.
        scale: standard deviation of each state's error `[D_s]`.
        reach: the search ends so many times above and below the middle of the trained
            range.
        cells: of the coarse search, along each axis.
        options: of `mujoco.sysid.optimize`.
    """
    # MuJoCo leaves the module empty where a package that it needs is missing
    if not hasattr(sysid, "optimize"):
        raise ImportError(
            "mujoco.sysid needs further packages: "
            "`pip install absl-py colorama pyyaml tabulate`"
        )
    bound = float(np.log(reach))
    scale = scale.astype(np.float64)

    def error(x: np.ndarray, part: Run) -> np.ndarray:
        """Errors of all states, whose sum of squares is a mean over the steps."""
        missed = simulate(MIDDLE + x, part) - part.s
        return (missed / scale).ravel() / len(part) ** 0.5

    def residual(x: np.ndarray, _: Any) -> tuple[list[np.ndarray], None, None]:
        """The same as the optimiser wants it, for constants `[2]` or `[2, N]`."""
        columns = np.stack([error(each, run) for each in x.reshape(2, -1).T], axis=-1)
        return [columns.reshape(-1, *x.shape[1:])], None, None

    # From the best cell of the coarse search
    start = _coarse_search(error, run, bound, cells)
    parameters = sysid.ParameterDict()
    for name, value in zip(("log C_damp", "log C_mass"), start, strict=True):
        parameters.add(sysid.Parameter(name, value, -bound, bound))

    silent = {"output": io.StringIO()}
    found, _ = sysid.optimize(
        parameters, residual, "mujoco", **_OPTIONS | silent | options
    )
    return MIDDLE + found.as_vector()


def _coarse_search(
    error: Callable[[np.ndarray, Run], np.ndarray], run: Run, bound: float, cells: int
) -> np.ndarray:
    """The best cell of a grid over the whole range, `[2]`.

    The start of the run chooses the few best ones, the whole run the best of them.
    """
    axis = (np.arange(cells) + 0.5) / cells * 2 * bound - bound
    centres = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    for part, kept in ((run[:_COARSE], _COARSE_KEPT), (run, 1)):
        if len(centres) > kept:
            costs = [(error(x, part) ** 2).sum() for x in centres]
            centres = centres[np.argsort(costs)[:kept]]
    return centres[0]


class Regressor(nn.Module):
    """s, u → GRU → its mean since the start → tanh layer → (log C_damp, log C_mass).

    It answers after each step.
    """

    mean: Tensor  # of s and u [D_s + D_u]
    std: Tensor
    label_mean: Tensor  # of the labels [2]
    label_std: Tensor

    def __init__(self, state_size: int, command_size: int, hidden_size: int = 64):
        super().__init__()
        input_size = state_size + command_size
        self.gru = nn.GRU(input_size, hidden_size, batch_first=True)
        self.head = nn.Sequential(
            nn.Linear(hidden_size, hidden_size), nn.Tanh(), nn.Linear(hidden_size, 2)
        )
        self.register_buffer("mean", torch.zeros(input_size))
        self.register_buffer("std", torch.ones(input_size))
        self.register_buffer("label_mean", torch.zeros(2))
        self.register_buffer("label_std", torch.ones(2))

    def set_normalisation(
        self, s: Sequence[Tensor], u: Sequence[Tensor], labels: Tensor
    ) -> None:
        """Take mean and deviation from runs `[T, D_s]`, `[T, D_u]` and labels."""
        x = torch.cat([torch.cat(list(s)), torch.cat(list(u))], dim=1)
        self.mean.copy_(x.mean(0))
        self.std.copy_(x.std(0, correction=0).clamp_min(1e-6))
        self.label_mean.copy_(labels.mean(0))
        self.label_std.copy_(labels.std(0, correction=0).clamp_min(1e-6))

    def forward(self, s: Tensor, u: Tensor) -> Tensor:
        """Answers after each step of runs `[B, T, D_s]`, `[B, T, D_u]`: `[B, T, 2]`."""
        x = (torch.cat([s, u], dim=-1) - self.mean) / self.std
        h, _ = self.gru(x)
        count = torch.arange(1, h.shape[1] + 1)[:, None]
        answers = self.head(h.cumsum(dim=1) / count)
        return answers * self.label_std + self.label_mean

    @torch.no_grad()
    def identify(self, run: Run) -> np.ndarray:
        """(log C_damp, log C_mass) after a run, `[2]`."""
        s = torch.as_tensor(run.s)[None]
        u = torch.as_tensor(run.u)[None]
        return self(s, u)[0, -1].double().numpy()


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
    """Train a network on runs with cloths whose constants are known.

    In each update it answers after every step of a window, from a random place in some
    runs. The learning rate falls to zero along a cosine.

    Args:
        runs: what was sensed and sent, with the name of the cloth.
        constants: (log C_damp, log C_mass) of each cloth, `{name: [2]}`.
        seed: of the first weights and of what is drawn.
        updates: of the weights.
        window: its length [step], or that of the shortest run.
        hidden_size: of GRU and layer.
        learning_rate: at the beginning.

    Returns: the network, and the loss of each update `[updates]`: mean squared error in
        standard deviations of the labels.
    """
    known = [choose("material", run.material, constants) for run in runs]
    labels = torch.as_tensor(np.array(known, np.float32))
    s = [torch.as_tensor(run.s) for run in runs]
    u = [torch.as_tensor(run.u) for run in runs]
    length = min(window, min(map(len, runs)))

    with seeded(seed):
        model = Regressor(s[0].shape[1], u[0].shape[1], hidden_size)
        model.set_normalisation(s, u, labels)

        def loss(index: Tensor) -> Tensor:
            """Of the runs of a batch `[B]`, each from a random place."""
            starts = [int(torch.randint(len(runs[k]) - length + 1, ())) for k in index]
            places = [*zip(index.tolist(), starts, strict=True)]
            s_batch = torch.stack([s[k][t : t + length] for k, t in places])
            u_batch = torch.stack([u[k][t : t + length] for k, t in places])
            answers = model(s_batch, u_batch)[:, _WARMUP:]
            errors = (answers - labels[index][:, None]) / model.label_std
            return (errors**2).mean()

        def batches() -> list[Tensor]:
            """One batch is one round: every run is as likely as any other."""
            return [torch.randperm(len(runs))[:_BATCH]]

        # Each step of it is one update
        steps = minimise(
            model.parameters(), loss, batches, updates, learning_rate, fused=False
        )
        losses = list(steps)
    return model.eval().requires_grad_(False), np.array(losses)
