"""Three of Gymnasium's robots, each with two properties that no sensor shows.

A pendulum of unknown mass and length, a cheetah and a hopper of unknown mass and
damping: nine materials each. What is done with them, the four calls of the method, is
the same for all. `other_robots.py` asks how well it goes.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np
import torch
from own_network import NETWORKS
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score
from sklearn.model_selection import LeaveOneOut, cross_val_predict
from torch import Tensor

from clothlab import (
    Controller,
    ControlSettings,
    ModelTraining,
    NewtonEstimator,
    PredictiveModel,
    Run,
    collect_runs,
    predict,
    train_dpmpb,
)
from clothlab.method.control import GradientSearch
from clothlab.method.data import windows
from clothlab.method.gauss_newton import NewtonSettings

Material = tuple[float, float]  # both hidden properties
HORIZON = 12  # steps that a controller looks ahead
AHEAD = 20  # steps that are predicted without a look


class Held:
    """Random commands over the whole range, each held for one to six steps."""

    name = "random commands"

    def __init__(self, env: Any):
        self.low = env.action_space.low
        self.high = env.action_space.high

    def reset(self, seed: int = 0) -> None:
        """Draw anew."""
        self.rng = np.random.default_rng(seed)
        self.left = 0

    def __call__(self, s: np.ndarray) -> np.ndarray:
        if not self.left:
            self.u = self.rng.uniform(self.low, self.high)
            self.left = self.rng.integers(1, 7)
        self.left -= 1
        return self.u


@dataclass(frozen=True)
class Robot:
    """What differs from robot to robot; `make` is given the material."""

    name: str
    step: float  # [s]
    properties: tuple[str, str]
    values: tuple[tuple[float, ...], tuple[float, ...]]  # of each property
    make: Callable[[Material], Any]
    policy: Callable[[Any], Any] = Held  # that records, made for an environment
    shortest: int = 31  # run that is kept [steps]
    # A step's loss [B, T] of states [B, T, D_s] and commands [B, T, D_u], which is
    # Gymnasium's reward with the other sign
    cost: Callable[[Tensor, Tensor], Tensor] | None = None
    start: Callable[[Any, int], np.ndarray] | None = None  # of an attempt

    @property
    def materials(self) -> list[Material]:
        """All combinations; the second property runs fastest."""
        first, second = self.values
        return list(itertools.product(first, second))

    def name_of(self, material: Material) -> str:
        """What its runs are called."""
        return ", ".join(f"{value:g}" for value in material)


def make_pendulum(material: Material) -> Any:
    """Gymnasium's pendulum with this mass [kg] and length [m]."""
    env: Any = gymnasium.make("Pendulum-v1")
    env.unwrapped.m, env.unwrapped.l = material
    return env


def hanging(env: Any, seed: int) -> np.ndarray:
    """Begin where the pendulum hangs, almost still."""
    env.reset(seed=seed)
    angle = np.pi + np.random.default_rng(seed).uniform(-0.1, 0.1)
    env.unwrapped.state = np.array([angle, 0.0])
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def pendulum_cost(states: Tensor, commands: Tensor) -> Tensor:
    """How far from upright, how fast, and with which torque."""
    angle = torch.atan2(states[..., 1], states[..., 0])
    speed = states[..., 2]
    return angle**2 + 0.1 * speed**2 + 0.001 * commands.square().sum(-1)


def scaled(env: Any, mass: float, damping: float) -> Any:
    """The same robot of MuJoCo, with masses and dampings times these factors."""
    model = env.unwrapped.model
    model.body_mass[:] *= mass
    model.body_inertia[:] *= mass
    model.dof_damping[:] *= damping
    mujoco.mj_setConst(model, env.unwrapped.data)
    return env


def make_cheetah(material: Material) -> Any:
    """HalfCheetah with masses and dampings times these factors."""
    return scaled(gymnasium.make("HalfCheetah-v5"), *material)


def on_its_feet(env: Any, seed: int) -> np.ndarray:
    """Begin as Gymnasium does."""
    s, _ = env.reset(seed=seed)
    return s


def cheetah_cost(states: Tensor, commands: Tensor) -> Tensor:
    """How slowly it runs forward [m/s], and with which torques."""
    return 0.1 * commands.square().sum(-1) - states[..., 8]


PENDULUM = Robot(
    "pendulum",
    0.05,
    ("mass", "length"),
    ((0.5, 0.7, 1.0), (0.5, 0.7, 1.0)),
    make_pendulum,
    cost=pendulum_cost,
    start=hanging,
)
CHEETAH = Robot(
    "cheetah",
    0.05,
    ("mass", "damping"),
    ((0.5, 1.0, 2.0), (0.5, 1.0, 2.0)),
    make_cheetah,
    cost=cheetah_cost,
    start=on_its_feet,
)


@dataclass(frozen=True)
class Size:
    """How much is recorded, trained and tried."""

    steps: int = 500  # recorded of each material
    seen: int = 200  # of new commands, for an estimate
    attempt: int = 100  # steps under control
    epochs: int = 40
    window: int = 30  # steps of a training's window

    @property
    def training(self) -> ModelTraining:
        """Many short batches, as *Your own robot* advises."""
        return ModelTraining(
            epochs=self.epochs, batch_size=50, stride=3, sequence_length=self.window
        )


class Trained(NamedTuple):
    """What a training gives."""

    model: PredictiveModel
    biases: dict[str, np.ndarray]  # of each material [D_p]
    runs: list[Run]
    seconds: float  # of a core


def record(robot: Robot, material: Material, steps: int, seed: int) -> list[Run]:
    """Runs of one material, over as many episodes as that takes."""
    env = robot.make(material)
    runs = collect_runs(
        env,
        robot.policy(env),
        steps,
        material=robot.name_of(material),
        shortest=robot.shortest,
        seed=seed,
        step=robot.step,
        progress=False,
    )
    env.close()
    return runs


def seed_of(training: int, material: int) -> int:
    """Of the runs of a material, by its number; those of a training are its own."""
    return 100_000 * training + 1000 * material


def record_all(robot: Robot, steps: int, seed: int) -> list[Run]:
    """Runs of all materials, of seeds that no other training has."""
    runs = []
    for k, material in enumerate(robot.materials):
        runs += record(robot, material, steps, seed_of(seed, k))
    return runs


def train(
    runs: list[Run], settings: ModelTraining, seed: int, network: str = "DPMPB"
) -> Trained:
    """W, and p of each material."""
    start = time.process_time()
    model, biases, _ = train_dpmpb(
        runs, settings, model=NETWORKS[network], seed=seed, device="cpu", progress=False
    )
    return Trained(model, biases, runs, time.process_time() - start)


@cache
def trained_on(
    robot: Robot, size: Size, seed: int, network: str = "DPMPB", times: int = 1
) -> Trained:
    """A training on random commands with all materials of a robot.

    Args:
        robot: whose runs are recorded.
        size: how much, and how long it is trained.
        seed: of recordings and training.
        network: of `NETWORKS`.
        times: as many epochs.
    """
    runs = record_all(robot, size.steps, seed)
    epochs = times * size.epochs
    length = min(size.window, robot.shortest - 1)
    settings = replace(size, epochs=epochs, window=length).training
    return train(runs, settings, seed, network)


def estimate(
    model: PredictiveModel, runs: list[Run], settings: NewtonSettings | None = None
) -> np.ndarray:
    """p `[D_p]` from zero; from run to run all is forgotten but p."""
    estimator = NewtonEstimator(model, settings=settings, from_rest=False)
    for run in runs:
        estimator.forget()
        for s, u in zip(run.s, run.u, strict=True):
            estimator.update(s, u)
    return estimator.p


def four_biases(
    trained: Trained, right: str, estimated: np.ndarray
) -> dict[str, np.ndarray]:
    """The four p `[D_p]` that are compared for a material."""
    biases = trained.biases
    farthest = max(
        biases.values(), key=lambda p: float(np.linalg.norm(p - biases[right]))
    )
    return {
        "right p": biases[right],
        "estimated p": estimated,
        "p = 0": np.zeros_like(estimated),
        "wrong p": farthest,
    }


@torch.no_grad()
def error_ahead(
    model: PredictiveModel, runs: list[Run], p: np.ndarray, ahead: int = AHEAD
) -> float:
    """Squared error of predictions so many steps ahead [s.d.²], mean over all."""
    # Ten steps to fill the memory, and then no look
    warmup = 10
    s, u, _ = windows(runs, warmup + ahead, 10)
    bias = torch.as_tensor(p)
    _, memory = model(s[:, :warmup], u[:, :warmup], bias)
    states = predict(model, s[:, warmup], u[:, warmup:], bias, memory)
    return model.loss(states, s[:, warmup + 1 :]).item()


def least_wrong(trained: Trained, runs: list[Run]) -> str:
    """The material whose p predicts runs best, one step ahead."""
    errors = {
        name: error_ahead(trained.model, runs, p, 1)
        for name, p in trained.biases.items()
    }
    return min(errors, key=errors.__getitem__)


def controller_of(robot: Robot, trained: Trained, p: np.ndarray) -> Controller:
    """A controller of a robot that believes in p `[D_p]`."""
    limits = robot.make(robot.materials[0]).action_space

    def loss(states: Tensor, commands: Tensor, t: int) -> Tensor:
        return robot.cost(states, commands).mean(-1)

    return Controller(
        trained.model,
        loss,
        p,
        limits.low,
        limits.high,
        ControlSettings(horizon=HORIZON, period=HORIZON),
        search=GradientSearch(recorded_plans(trained.runs)),
    )


def control(
    robot: Robot,
    trained: Trained,
    material: Material,
    p: np.ndarray,
    steps: int,
    every: int = 1,
) -> float:
    """Mean reward of an attempt, by Gymnasium's own measure.

    Args:
        robot: that is controlled.
        trained: the model, and recorded commands as starts for plans.
        material: which the robot has.
        p: which the controller believes in, `[D_p]`.
        steps: of the attempt.
        every: steps after which it plans anew.
    """
    env = robot.make(material)
    controller = controller_of(robot, trained, p)
    s = robot.start(env, 0)
    rewards = []
    for t in range(steps):
        u = controller.act(s, solve=t % every == 0)
        s, reward, *_ = env.step(u)
        rewards.append(float(reward))
    env.close()
    return float(np.mean(rewards))


def recorded_plans(runs: list[Run], count: int = 100) -> np.ndarray:
    """Stretches of recorded commands `[count, HORIZON, D_u]`, evenly spread."""
    stretches = [
        run.u[k : k + HORIZON] for run in runs for k in range(len(run) - HORIZON)
    ]
    chosen = np.linspace(0, len(stretches) - 1, count).astype(int)
    return np.stack([stretches[k] for k in chosen])


def without_control(robot: Robot, material: Material, steps: int) -> float:
    """Mean reward of random commands, over ten attempts."""
    rewards = []
    for seed in range(10):
        env = robot.make(material)
        s = robot.start(env, 0)
        policy = robot.policy(env)
        policy.reset(seed)
        for _ in range(steps):
            s, reward, *_ = env.step(policy(s))
            rewards.append(float(reward))
        env.close()
    return float(np.mean(rewards))


def r_squared(robot: Robot, biases: dict[str, np.ndarray]) -> np.ndarray:
    """How well the logarithms of both properties follow from p, `[2]`.

    By a straight map, which one material at a time is left out of.
    """
    p = np.array([biases[robot.name_of(each)] for each in robot.materials])
    logs = np.log(robot.materials)
    found = cross_val_predict(LinearRegression(), p, logs, cv=LeaveOneOut())
    return r2_score(logs, found, multioutput="raw_values")
