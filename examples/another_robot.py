"""DPMPB for a robot without cloth: Gymnasium's Reacher, which carries a payload against
friction, both unknown to it.

Two motors turn an arm of two links in a plane. Neither the payload at its tip nor the
friction of its joints is part of the state. `python examples/another_robot.py` trains
five models of each kind, and writes the tables and the model that notebook 16 shows;
trainings are kept in build/another_robot.

What a researcher might take in place of p is here too: a model that is told both
properties, one without p, whose memory may adapt, and an encoder that infers p from the
last steps (as in rapid motor adaptation, Kumar et al., 2021).
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import joblib
import mujoco
import numpy as np
import pandas as pd
import torch
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, DotProduct, WhiteKernel
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score
from sklearn.model_selection import LeaveOneOut, cross_val_predict
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from torch import Tensor, nn
from tqdm.auto import tqdm

from clothlab import data
from clothlab.method.checkpoint import Checkpoint
from clothlab.method.control import Controller, ControlSettings, GradientSearch
from clothlab.method.data import Run, set_normalisation, windows
from clothlab.method.estimation import estimate_bias, prediction_loss
from clothlab.method.fast_rollout import quicken
from clothlab.method.gauss_newton import NewtonEstimator
from clothlab.method.model import DPMPB
from clothlab.method.rollout import rollout
from clothlab.method.training import ModelTraining, minimise, seeded, train_dpmpb
from studies import save

STEPS = 3000  # recorded with each material
TRAINING = ModelTraining(epochs=70, batch_size=100, stride=3)
TIP = slice(6, 8)  # its position [m] in the state
ATTEMPT = 12  # steps in which the tip has to reach a goal
CONTEXT = 30  # last steps that the encoder sees
ESTIMATE = 200  # steps of random commands for an estimate: 10 s
KINDS = ("p", "told both", "without p", "context encoder")  # of models
SEEDS = range(5)  # of the trainings; 5 was that of the development


@dataclass(frozen=True)
class Material:
    """What is not in the state."""

    payload: float  # at the tip [kg]
    friction: float  # of each joint [N m s/rad]

    def __str__(self) -> str:
        return f"{self.payload:g} kg, {self.friction:g} N m s"

    @property
    def logs(self) -> np.ndarray:
        """Natural logarithms of both."""
        return np.log([self.payload, self.friction])


MATERIALS = [Material(*both) for both in itertools.product((20, 60, 180), (6, 12, 24))]
BETWEEN = [Material(*both) for both in itertools.product((35, 104), (8.5, 17))]


def make_robot(material: Material) -> Any:
    """Reacher with this payload and friction, and 0.05 s from one command to the next."""
    env: Any = gymnasium.make("Reacher-v5", frame_skip=5, max_episode_steps=-1)
    model = env.unwrapped.model
    model.body("fingertip").mass = material.payload
    model.dof_damping[:2] = material.friction
    mujoco.mj_setConst(model, env.unwrapped.data)
    return env


def see(observation: np.ndarray) -> np.ndarray:
    """State `[8]`: cosines and sines of both angles, their speeds [rad/s], position of
    the tip [m].
    """
    return np.concatenate(
        [observation[:4], observation[6:8], observation[8:10] + observation[4:6]]
    )


def random_commands(seed: int) -> Callable[[np.ndarray], np.ndarray]:
    """A policy of random torques, each held for one to six steps."""

    def drawn() -> Iterator[np.ndarray]:
        rng = np.random.default_rng(seed)
        while True:
            u = rng.uniform(-1, 1, 2)
            yield from [u] * rng.integers(1, 7)

    commands = drawn()
    return lambda s: next(commands)


def record(material: Material, steps: int = STEPS, seed: int = 0) -> Run:
    """A run of random commands."""
    return rollout(
        make_robot(material),
        random_commands(seed),
        steps,
        seed=seed,
        material=str(material),
        observe=see,
    )


def read_out() -> Pipeline:
    """A smooth map from p to the logarithms of payload and friction, as in the study of
    cloths.
    """
    kernel = DotProduct() + RBF(2.0) + WhiteKernel(0.01)
    return make_pipeline(
        StandardScaler(),
        GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True),
    )


def r_squared(biases: dict[str, np.ndarray], readout: Any) -> np.ndarray:
    """How well the logarithms of payload and friction follow from p, one material left
    out at a time, `[2]`.
    """
    p, logs = columns(biases)
    return r2_score(
        logs,
        cross_val_predict(readout, p, logs, cv=LeaveOneOut()),
        multioutput="raw_values",
    )


def columns(biases: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """p `[9, D_p]` and the logarithms of payload and friction `[9, 2]`."""
    p = np.array([biases[str(material)] for material in MATERIALS], dtype=float)
    return p, np.array([material.logs for material in MATERIALS])


class ContextEncoder(nn.Module):
    """The last steps to p, in place of p's training: `[B, CONTEXT, D_s + D_u]` to `[B,
    D_p]`.
    """

    def __init__(self, model: DPMPB):
        super().__init__()
        width = CONTEXT * (model.state_size + model.command_size)
        self.layers = nn.Sequential(
            nn.Flatten(),
            nn.Linear(width, 100),
            nn.Tanh(),
            nn.Linear(100, model.bias_size),
        )
        self.mean, self.std = (
            torch.cat([model.s_mean, model.u_mean]),
            torch.cat([model.s_std, model.u_std]),
        )

    def forward(self, s: Tensor, u: Tensor) -> Tensor:
        """p `[B, D_p]` of states `[B, CONTEXT, D_s]` and commands `[B, CONTEXT, D_u]`."""
        return self.layers((torch.cat([s, u], dim=-1) - self.mean) / self.std)


def train_with_context(
    runs: list[Run], settings: ModelTraining, seed: int
) -> tuple[DPMPB, ContextEncoder]:
    """The same network, loss and training; p is what the encoder makes of the steps
    before a sequence.
    """
    s, u, _ = windows(runs, CONTEXT + settings.sequence_length, settings.stride)
    with seeded(seed):
        model = quicken(DPMPB(s.shape[-1], u.shape[-1], settings.bias_size))
        set_normalisation(model, runs)
        encoder = ContextEncoder(model)

        def loss(index: Tensor) -> Tensor:
            p = encoder(s[index, :CONTEXT], u[index, :CONTEXT])
            predicted, _ = model(s[index, CONTEXT:-1], u[index, CONTEXT:], p)
            return model.loss(predicted, s[index, CONTEXT + 1 :])

        def batches() -> Sequence[Tensor]:
            return torch.randperm(len(s)).split(settings.batch_size)

        both = [*model.parameters(), *encoder.parameters()]
        list(minimise(both, loss, batches, settings.epochs, settings.learning_rate))
    return model.eval(), encoder.eval()


@torch.no_grad()
def encoded_bias(encoder: ContextEncoder, run: Run) -> np.ndarray:
    """Mean p `[D_p]` of all stretches of a run."""
    s, u, _ = windows([run], CONTEXT, 1)
    return encoder(s[:, :-1], u).mean(0).numpy()


def train(
    kind: str, seed: int, steps: int = STEPS, settings: ModelTraining = TRAINING
) -> dict[str, Any]:
    """Train one model: of kind "p", "told both", "without p" or "context encoder"."""
    torch.set_num_threads(1)
    runs = [record(material, steps, 100 + k) for k, material in enumerate(MATERIALS)]
    if kind == "context encoder":
        model, encoder = train_with_context(runs, settings, seed)
        biases = {run.material: encoded_bias(encoder, run) for run in runs}
        return {"model": model, "biases": biases, "encoder": encoder}
    known = {"told both": {str(each): told(each) for each in MATERIALS}}.get(kind)
    settings = replace(settings, bias_size=0) if kind == "without p" else settings
    model, biases, _ = train_dpmpb(
        runs, settings, known=known, seed=seed, progress=False
    )
    return {"model": model, "biases": biases}


def told(material: Material) -> np.ndarray:
    """Both logarithms, in steps of the grid from its middle `[2]`."""
    return (material.logs - MATERIALS[4].logs) / (MATERIALS[8].logs - MATERIALS[4].logs)


def vary(steps: int, bias_size: int, seed: int) -> dict[str, float]:
    """R², and the squared error on new runs [s.d. of s], with so many recorded steps of
    each material and this D_p.
    """
    trained = train("p", seed, steps, replace(TRAINING, bias_size=bias_size))
    errors = []
    for k, material in enumerate(MATERIALS):
        run, p = (
            record(material, ESTIMATE, 9000 + k),
            torch.as_tensor(trained["biases"][str(material)]),
        )
        with torch.no_grad():
            errors.append(
                prediction_loss(
                    trained["model"], torch.as_tensor(run.s), torch.as_tensor(run.u), p
                ).item()
            )
    row = {
        "steps": steps,
        "bias_size": bias_size,
        "seed": seed,
        "error": float(np.mean(errors)),
    }
    return row | explained(trained["biases"])


def identify(
    trained: dict[str, Any], seed: int, repeats: int = 10, steps: int = ESTIMATE
) -> list[dict[str, Any]]:
    """Online estimates from p = 0 with new random commands: for materials trained on,
    and for four between them.
    """
    torch.set_num_threads(1)
    p, logs = columns(trained["biases"])
    readout, rows = read_out().fit(p, logs), []
    for material, repeat in itertools.product(MATERIALS + BETWEEN, range(repeats)):
        run = record(material, steps, 5000 + 100 * seed + repeat)
        found, _ = estimate_bias(trained["model"], run, method="newton")
        nearest = MATERIALS[int(np.linalg.norm(p - found, axis=1).argmin())]
        payload, friction = np.exp(readout.predict(found[None].astype(float))[0])
        rows.append(
            {
                "seed": seed,
                "payload": material.payload,
                "friction": material.friction,
                "repeat": repeat,
            }
        )
        rows[-1] |= {
            "trained": material in MATERIALS,
            "right": nearest == material,
            "found_payload": payload,
            "found_friction": friction,
        }
    return rows


def search_plan(
    env: Any, goal: np.ndarray, seed: int, rounds: int = 15, count: int = 100
) -> np.ndarray:
    """The oracle: the best commands `[ATTEMPT, 2]` that a search in the true simulation
    finds from here.
    """
    rng, data = np.random.default_rng(seed), env.unwrapped.data
    start = data.qpos.copy(), data.qvel.copy()

    def outcome(plan: np.ndarray) -> float:
        env.unwrapped.set_state(*start)
        for u in plan:
            observation, *_ = env.step(u)
        return float(np.linalg.norm(see(observation)[TIP] - goal))

    mean, deviation = np.zeros((ATTEMPT, 2)), np.full((ATTEMPT, 2), 0.7)
    for _ in range(rounds):
        plans = np.clip(rng.normal(mean, deviation, (count, ATTEMPT, 2)), -1, 1)
        best = plans[np.argsort([outcome(plan) for plan in plans])[: count // 10]]
        mean, deviation = best.mean(0), best.std(0) + 0.01
    env.unwrapped.set_state(*start)
    return best[0]


def draw_goals(seed: int, count: int = 10) -> np.ndarray:
    """Places for the tip `[count, 2]` [m], within its reach of 0.21 m."""
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.08, 0.19, count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


SETTINGS = ControlSettings(horizon=ATTEMPT, period=ATTEMPT, iterations=10)
REPLANNING = replace(SETTINGS, iterations=3)  # in every step
METHODS = {  # the kind of model that each needs; "" for none
    "right p": "p",
    "estimated p": "p",
    "wrong p": "p",
    "p = 0": "p",
    "told both": "told both",
    "without p": "without p",
    "context encoder": "context encoder",
    "random": "",
    "oracle": "",
}


class Attempts:
    """A policy of random commands for 10 s, then of ten attempts to bring the tip to a
    goal, each of 0.6 s.

    It plans once when an attempt begins, or `replan`s in each step; the method says
    with which p.
    """

    def __init__(
        self,
        method: str,
        trained: dict[str, Any],
        material: Material,
        replan: bool,
        seed: int,
    ):
        self.explore, self.goals, self.method, self.replan = (
            random_commands(seed),
            draw_goals(seed),
            method,
            replan,
        )
        self.model, self.encoder, self.t = trained["model"], trained.get("encoder"), 0
        self.seen: list[tuple[np.ndarray, np.ndarray]] = []
        biases = trained["biases"]
        p = biases.get(str(material))
        if method == "wrong p":
            p = max(biases.values(), key=lambda other: float(np.linalg.norm(other - p)))
        elif method in ("estimated p", "p = 0", "context encoder"):
            p = np.zeros(self.model.bias_size)
        self.estimator = (
            NewtonEstimator(self.model) if method == "estimated p" else None
        )
        drawn = random_commands(seed + 1)
        plans = np.array([[drawn(p) for _ in range(ATTEMPT)] for _ in range(200)])
        settings = REPLANNING if replan else SETTINGS
        self.controller = Controller(
            self.model,
            self.loss,
            p,
            [-1, -1],
            [1, 1],
            settings,
            search=GradientSearch(plans),
        )

    def loss(self, states: Tensor, commands: Tensor, t: int) -> Tensor:
        """Distance of the tip to the goal at the attempt's end [m]."""
        attempt, step = divmod(t, ATTEMPT)
        return torch.linalg.vector_norm(
            states[:, ATTEMPT - 1 - step, TIP]
            - torch.as_tensor(self.goals[attempt % 10]),
            dim=1,
        )

    def __call__(self, s: np.ndarray) -> np.ndarray:
        step = self.t - ESTIMATE
        begins = step >= 0 and step % ATTEMPT == 0
        if begins and self.encoder is not None:
            states, commands = (
                np.array(column) for column in zip(*self.seen, strict=True)
            )
            self.controller.set_bias(
                encoded_bias(self.encoder, Run(states, commands, ""))
            )
        if step < 0:
            u = self.explore(s)
            self.controller.follow(s, u)
        else:
            u = self.controller.act(s, solve=self.replan or begins)
        if self.estimator is not None:
            self.controller.set_bias(self.estimator.update(s, u))
        self.seen.append((s, u))
        self.t += 1
        return u


def control(
    trained: Any, method: str, material: Material, replan: bool, seed: int
) -> np.ndarray:
    """How far the tip ends from its goal in each of ten attempts `[10]` [m]."""
    torch.set_num_threads(1)
    env, goals = make_robot(material), draw_goals(seed)
    policy = (
        Attempts(method, trained, material, replan, seed)
        if trained
        else without_model(method, env, seed)
    )
    run = rollout(
        env,
        policy,
        ESTIMATE + ATTEMPT * len(goals) + 1,
        seed=seed,
        material=str(material),
        observe=see,
    )
    return np.linalg.norm(run.s[ESTIMATE + ATTEMPT :: ATTEMPT, TIP] - goals, axis=1)


def without_model(
    method: str, env: Any, seed: int
) -> Callable[[np.ndarray], np.ndarray]:
    """A policy of the same shape that goes on with random commands, or searches in the
    true simulation.
    """
    goals, explore, t, plan = (
        draw_goals(seed),
        random_commands(seed),
        itertools.count(-ESTIMATE),
        [np.zeros(2)],
    )

    def policy(s: np.ndarray) -> np.ndarray:
        attempt, step = divmod(next(t), ATTEMPT)
        if attempt < 0 or method == "random":
            return explore(s)
        if step == 0 and attempt < len(goals):
            plan[:] = search_plan(env, goals[attempt], seed)
        return plan[step]

    return policy


def side_by_side(
    title: str, function: Callable[..., Any], cases: list[tuple]
) -> list[Any]:
    """What the function returns for each case, one on each core."""
    calls = joblib.Parallel(n_jobs=-1, return_as="generator")(
        joblib.delayed(function)(*case) for case in cases
    )
    return list(tqdm(calls, desc=title, total=len(cases)))


def explained(biases: dict[str, np.ndarray]) -> dict[str, float]:
    """R² of both logarithms, by a smooth and by a straight map."""
    smooth, straight = (
        r_squared(biases, read_out()),
        r_squared(biases, LinearRegression()),
    )
    return dict(
        zip(
            ("payload", "friction", "payload_straight", "friction_straight"),
            [*smooth, *straight],
            strict=True,
        )
    )


def main() -> None:
    """Train five models of each kind, and write what they show."""
    kept = joblib.Memory("build/another_robot", verbose=0).cache(train)
    trainings = list(itertools.product(KINDS, SEEDS))
    trained = dict(
        zip(trainings, side_by_side("trainings", kept, trainings), strict=True)
    )
    rows = [
        {"kind": kind, "seed": seed} | explained(trained[kind, seed]["biases"])
        for kind, seed in itertools.product(("p", "context encoder"), SEEDS)
    ]
    save(pd.DataFrame(rows), "another_robot")

    sizes = [(steps, 2) for steps in (100, 300, 1000)] + [
        (1000, size) for size in (1, 3, 4)
    ]
    varied = [(*size, seed) for size, seed in itertools.product(sizes, SEEDS)]
    save(pd.DataFrame(side_by_side("amounts", vary, varied)), "another_robot_amount")

    rows = side_by_side(
        "estimates", identify, [(trained["p", seed], seed) for seed in SEEDS]
    )
    save(pd.DataFrame(itertools.chain(*rows)), "another_robot_estimates")

    cases = [
        (
            METHODS[method] and trained[METHODS[method], seed],
            method,
            material,
            replan,
            seed,
        )
        for seed, material, method, replan in itertools.product(
            SEEDS, MATERIALS, METHODS, (False, True)
        )
        if METHODS[method] or not replan
    ]
    distances = side_by_side("control", control, cases)
    rows = [
        {
            "method": method,
            "seed": seed,
            "payload": material.payload,
            "friction": material.friction,
            "replan": replan,
        }
        | {"distance": distance}
        for (_, method, material, replan, seed), distance in zip(
            cases, distances, strict=True
        )
    ]
    save(pd.DataFrame(rows), "another_robot_control")
    kept = trained["p", 0]
    data.save_model(
        Checkpoint(name="reacher", model=kept["model"], biases=kept["biases"])
    )
    data.write_checksums()


if __name__ == "__main__":
    main()
