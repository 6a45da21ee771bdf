"""A robot without cloth: Gymnasium's Reacher with a payload and friction.

Two motors turn an arm of two links in a plane. Neither the payload at its tip nor the
friction of its joints is part of the state, and the arm knows of neither. Three
experiments: what a training makes of the materials, how well p is estimated online, and
how near each method brings the tip to its goals. `python -m studies.another_robot`
trains the model that notebook 16 shows.

What a researcher might take in place of p is here too: a model that is told both
properties, one without p, whose memory may adapt, and an encoder that infers p from the
last steps (as in rapid motor adaptation, Kumar et al., 2021).
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
import torch
from torch import Tensor, nn

from clothlab.data import data_folder, write_checksums
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run, set_normalisation, windows
from clothlab.method.estimation import NewtonEstimator, estimate_bias
from clothlab.method.model import DPMPB
from clothlab.method.rollout import rollout
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.weights import Checkpoint
from studies._grid import Case, Experiment, grid, over, shared
from studies._optimise import minimise, seeded

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
    """Reacher with this payload and friction, and a command every 0.05 s."""
    import gymnasium  # slow to import

    env: Any = gymnasium.make("Reacher-v5", frame_skip=5, max_episode_steps=-1)
    model = env.unwrapped.model
    model.body("fingertip").mass = material.payload
    model.dof_damping[:2] = material.friction
    mujoco.mj_setConst(model, env.unwrapped.data)
    return env


def see(observation: np.ndarray) -> np.ndarray:
    """State `[8]` of an observation `[10]`.

    Cosines and sines of both angles, their speeds [rad/s], and where the tip is [m]:
    Reacher says that from its own target.
    """
    angles = observation[:4]
    target = observation[4:6]
    speeds = observation[6:8]
    tip = observation[8:10] + target
    return np.concatenate([angles, speeds, tip])


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


def read_out() -> Any:
    """A smooth map from p to the logarithms of payload and friction.

    It is that of the study of cloths.
    """
    # Slow to import
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, DotProduct, WhiteKernel
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    kernel = DotProduct() + RBF(2.0) + WhiteKernel(0.01)
    process = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True)
    return make_pipeline(StandardScaler(), process)


def r_squared(biases: dict[str, np.ndarray]) -> np.ndarray:
    """How well the logarithms of payload and friction follow from p, `[2]`.

    By a smooth map, and with one material left out at a time.
    """
    # Slow to import
    from sklearn.metrics import r2_score
    from sklearn.model_selection import LeaveOneOut, cross_val_predict

    p, logs = columns(biases)
    predicted = cross_val_predict(read_out(), p, logs, cv=LeaveOneOut())
    return r2_score(logs, predicted, multioutput="raw_values")


def columns(biases: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """p `[9, D_p]` and the logarithms of payload and friction `[9, 2]`."""
    p = np.array([biases[str(material)] for material in MATERIALS], dtype=float)
    return p, np.array([material.logs for material in MATERIALS])


class ContextEncoder(nn.Module):
    """The last steps to p, in place of p's training.

    From `[B, context, D_s + D_u]` to `[B, D_p]`.
    """

    def __init__(self, model: DPMPB, context: int = CONTEXT):
        super().__init__()
        self.context = context
        width = context * (model.state_size + model.command_size)
        self.layers = nn.Sequential(
            nn.Flatten(),
            nn.Linear(width, 100),
            nn.Tanh(),
            nn.Linear(100, model.bias_size),
        )
        self.mean = torch.cat([model.s_mean, model.u_mean])
        self.std = torch.cat([model.s_std, model.u_std])

    def forward(self, s: Tensor, u: Tensor) -> Tensor:
        """p of states `[B, context, D_s]` and commands `[B, context, D_u]`."""
        steps = torch.cat([s, u], dim=-1)
        return self.layers((steps - self.mean) / self.std)


class TrainedRobot(NamedTuple):
    """What one training gives."""

    model: DPMPB
    biases: dict[str, np.ndarray]  # of each material `[D_p]`
    encoder: ContextEncoder | None = None


def train_with_context(
    runs: list[Run], settings: ModelTraining, seed: int, context: int = CONTEXT
) -> tuple[DPMPB, ContextEncoder]:
    """The same network, loss and training, with an encoder in place of p.

    p is what it makes of the steps before a sequence.
    """
    # Each sequence has those steps before it
    length = context + settings.sequence_length
    s, u, _ = windows(runs, length, settings.stride)
    with seeded(seed):
        model = DPMPB(s.shape[-1], u.shape[-1], settings.bias_size)
        set_normalisation(model, runs)
        encoder = ContextEncoder(model, context)

        def loss(index: Tensor) -> Tensor:
            p = encoder(s[index, :context], u[index, :context])
            predicted, _ = model(s[index, context:-1], u[index, context:], p)
            return model.loss(predicted, s[index, context + 1 :])

        def batches() -> Sequence[Tensor]:
            return torch.randperm(len(s)).split(settings.batch_size)

        # Both learn at once
        both = [*model.parameters(), *encoder.parameters()]
        list(minimise(both, loss, batches, settings.epochs, settings.learning_rate))
    return model.eval(), encoder.eval()


@torch.no_grad()
def encoded_bias(encoder: ContextEncoder, run: Run) -> np.ndarray:
    """Mean p `[D_p]` of all stretches of a run."""
    s, u, _ = windows([run], encoder.context, 1)
    return encoder(s[:, :-1], u).mean(0).numpy()


@shared
def train(
    kind: str, seed: int, steps: int = STEPS, settings: ModelTraining = TRAINING
) -> TrainedRobot:
    """Train one model: of kind "p", "told both", "without p" or "context encoder"."""
    runs = [record(material, steps, 100 + k) for k, material in enumerate(MATERIALS)]
    if kind == "context encoder":
        model, encoder = train_with_context(runs, settings, seed)
        biases = {run.material: encoded_bias(encoder, run) for run in runs}
        return TrainedRobot(model, biases, encoder)
    known = None
    if kind == "told both":
        known = {str(material): told(material) for material in MATERIALS}
    if kind == "without p":
        settings = replace(settings, bias_size=0)
    model, biases, _ = train_dpmpb(
        runs, settings, known=known, seed=seed, progress=False
    )
    return TrainedRobot(model, biases)


def told(material: Material) -> np.ndarray:
    """Both logarithms, in steps of the grid from its middle `[2]`."""
    middle = MATERIALS[4].logs
    return (material.logs - middle) / (MATERIALS[8].logs - middle)


def _map_one(kind: str, seed: int) -> dict[str, Any]:
    """R² of payload and friction by p.

    Args:
        kind: of model, "p" or "context encoder".
        seed: of the training.
    """
    payload, friction = r_squared(train(kind, seed).biases)
    return {"payload": payload, "friction": friction}


def identify(
    trained: TrainedRobot, material: Material, seed: int, steps: int = ESTIMATE
) -> dict[str, Any]:
    """An online estimate from p = 0 with new random commands."""
    run = record(material, steps, seed)
    found, _ = estimate_bias(trained.model, run, method="newton")

    # Read it in two ways
    p, logs = columns(trained.biases)
    nearest = MATERIALS[int(np.linalg.norm(p - found, axis=1).argmin())]
    readout = read_out().fit(p, logs)
    payload, friction = np.exp(readout.predict(found[None].astype(float))[0])
    return {
        "trained": material in MATERIALS,
        "right": nearest == material,
        "found_payload": payload,
        "found_friction": friction,
    }


def _estimate_one(
    seed: int, payload: float, friction: float, repeat: int
) -> dict[str, Any]:
    """How well p is estimated online.

    Args:
        seed: of the training.
        payload, friction: of the robot [kg] [N m s/rad].
        repeat: number of the run; each has other random commands.
    """
    material = Material(payload, friction)
    return identify(train("p", seed), material, 5000 + 100 * seed + repeat)


def search_plan(
    env: Any, goal: np.ndarray, seed: int, rounds: int = 15, count: int = 100
) -> np.ndarray:
    """The oracle: the best commands `[ATTEMPT, 2]` that a search finds from here.

    It searches in the true simulation, by the cross-entropy method.

    Args:
        env: the robot, which is afterwards where it was.
        goal: where the tip should end `[2]` [m].
        seed: of the plans that are drawn.
        rounds: how often plans are drawn, around the best of the round before.
        count: plans in a round, a tenth of which are the best.
    """
    data = env.unwrapped.data
    start = (data.qpos.copy(), data.qvel.copy())

    def outcome(plan: np.ndarray) -> float:
        env.unwrapped.set_state(*start)
        for u in plan:
            observation, *_ = env.step(u)
        return float(np.linalg.norm(see(observation)[TIP] - goal))

    # Wide at first, then around what was good
    rng = np.random.default_rng(seed)
    mean = np.zeros((ATTEMPT, 2))
    deviation = np.full((ATTEMPT, 2), 0.7)
    for _ in range(rounds):
        plans = np.clip(rng.normal(mean, deviation, (count, ATTEMPT, 2)), -1, 1)
        order = np.argsort([outcome(plan) for plan in plans])
        best = plans[order[: count // 10]]
        mean = best.mean(0)
        deviation = best.std(0) + 0.01
    env.unwrapped.set_state(*start)
    return best[0]


def draw_goals(seed: int, count: int = 10) -> np.ndarray:
    """Places for the tip `[count, 2]` [m], within its reach of 0.21 m."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-np.pi, np.pi, count)
    radius = rng.uniform(0.08, 0.19, count)
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
    """Random commands for 10 s, then ten attempts to bring the tip to a goal.

    A policy; an attempt takes 0.6 s.

    Args:
        method: one of `METHODS` with a model: which p it has.
        trained: that model, its p and perhaps its encoder.
        material: of the robot.
        replan: whether it plans in each step, or only when an attempt begins.
        seed: of goals and random commands.
    """

    def __init__(
        self,
        method: str,
        trained: TrainedRobot,
        material: Material,
        replan: bool,
        seed: int,
    ):
        self.explore = random_commands(seed)
        self.goals = draw_goals(seed)
        self.replan = replan
        self.encoder = trained.encoder
        self.t = 0  # steps so far
        self.states: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []

        # With which p it begins, and whether that is estimated on the way
        p = self._first_bias(method, trained, material)
        self.estimator = None
        if method == "estimated p":
            self.estimator = NewtonEstimator(trained.model)

        # Plans to start from, which are random commands, too
        drawn = random_commands(seed + 1)
        plans = np.array([[drawn(p) for _ in range(ATTEMPT)] for _ in range(200)])
        self.controller = Controller(
            trained.model,
            self.loss,
            p,
            [-1, -1],
            [1, 1],
            REPLANNING if replan else SETTINGS,
            plans=plans,
        )

    @staticmethod
    def _first_bias(
        method: str, trained: TrainedRobot, material: Material
    ) -> np.ndarray:
        """p at the start `[D_p]`."""
        if method in ("estimated p", "p = 0", "without p", "context encoder"):
            return np.zeros(trained.model.bias_size)
        right = trained.biases[str(material)]
        if method == "wrong p":
            others = trained.biases.values()
            return max(others, key=lambda p: float(np.linalg.norm(p - right)))
        return right

    def loss(self, states: Tensor, commands: Tensor, t: int) -> Tensor:
        """Distance of the tip to the goal at the attempt's end [m]."""
        attempt, step = divmod(t, ATTEMPT)
        goal = torch.as_tensor(self.goals[attempt % 10])
        at_end = states[:, ATTEMPT - 1 - step, TIP]
        return torch.linalg.vector_norm(at_end - goal, dim=1)

    def __call__(self, s: np.ndarray) -> np.ndarray:
        step = self.t - ESTIMATE
        begins = step >= 0 and step % ATTEMPT == 0

        # An encoder takes all that was seen so far; what comes next is not in it
        if begins and self.encoder is not None:
            states = np.array([*self.states, s])
            commands = np.array([*self.commands, np.zeros(2)])
            seen = Run(states, commands, "")
            self.controller.set_bias(encoded_bias(self.encoder, seen))

        # Move
        if step < 0:
            u = self.explore(s)
            self.controller.follow(s, u)
        else:
            u = self.controller.act(s, solve=self.replan or begins)

        # And learn from it
        if self.estimator is not None:
            self.controller.set_bias(self.estimator.update(s, u))
        self.states.append(s)
        self.commands.append(u)
        self.t += 1
        return u


def control(
    trained: TrainedRobot | None,
    method: str,
    material: Material,
    replan: bool,
    seed: int,
) -> np.ndarray:
    """How far the tip ends from its goal in each of ten attempts `[10]` [m].

    Args:
        trained: the model that the method needs; None for one that needs none.
        method: one of `METHODS`.
        material: of the robot.
        replan: whether a controller plans in each step.
        seed: of goals and random commands.
    """
    if trained is None:
        env = make_robot(material)
        return attempts(without_model(method, env, seed), material, seed, env)
    policy = Attempts(method, trained, material, replan, seed)
    return attempts(policy, material, seed)


def attempts(
    policy: Callable[[np.ndarray], np.ndarray],
    material: Material,
    seed: int,
    env: Any = None,
) -> np.ndarray:
    """How far the tip ends from each of ten goals `[10]` [m].

    Args:
        policy: state → command; its first 10 s are its own.
        material: of the robot.
        seed: of the goals.
        env: the robot, if the policy has it, too.
    """
    env = env or make_robot(material)
    goals = draw_goals(seed)

    # One step more: the state after the last attempt is seen before it
    steps = ESTIMATE + ATTEMPT * len(goals) + 1
    run = rollout(env, policy, steps, seed=seed, material=str(material), observe=see)
    ends = run.s[ESTIMATE + ATTEMPT :: ATTEMPT, TIP]
    return np.linalg.norm(ends - goals, axis=1)


def without_model(
    method: str, env: Any, seed: int
) -> Callable[[np.ndarray], np.ndarray]:
    """A policy of the same shape without a model.

    It goes on with random commands, or searches in the true simulation.
    """
    goals = draw_goals(seed)
    explore = random_commands(seed)
    t = itertools.count(-ESTIMATE)
    plan = np.zeros((ATTEMPT, 2))  # of the present attempt

    def policy(s: np.ndarray) -> np.ndarray:
        nonlocal plan
        attempt, step = divmod(next(t), ATTEMPT)
        if attempt < 0 or method == "random":
            return explore(s)
        if step == 0 and attempt < len(goals):
            plan = search_plan(env, goals[attempt], seed)
        return plan[step]

    return policy


def _control_one(
    method: str, seed: int, payload: float, friction: float, replan: bool
) -> dict[str, Any]:
    """How near a method brings the tip to its goals.

    Args:
        method: one of `METHODS`.
        seed: of the training, of goals and random commands.
        payload, friction: of the robot [kg] [N m s/rad].
        replan: whether a controller plans in each step.
    """
    kind = METHODS[method]
    trained = train(kind, seed) if kind else None
    material = Material(payload, friction)
    return {"distance": control(trained, method, material, replan, seed)}


def _estimate_cases(seed: Iterable[int] = SEEDS, repeats: int = 10) -> list[Case]:
    """Ten runs of each material, of those between the trained ones, too."""
    cases = []
    for training, material in itertools.product(seed, MATERIALS + BETWEEN):
        of_material = {"payload": material.payload, "friction": material.friction}
        cases += grid(seed=training, **of_material, repeat=range(repeats))
    return cases


def _control_cases(seed: Iterable[int] = SEEDS) -> list[Case]:
    """All methods with each material; without a model there is nothing to replan."""
    cases = []
    for training, material, method in itertools.product(seed, MATERIALS, METHODS):
        task = {"method": method, "seed": training}
        task |= {"payload": material.payload, "friction": material.friction}
        cases += grid(**task, replan=(False, True) if METHODS[method] else False)
    return cases


_MAP_CASES = over(kind=("p", "context encoder"), seed=SEEDS)
EXPERIMENTS = (
    Experiment("another_robot", _map_one, _MAP_CASES, slow=True),
    Experiment("another_robot_estimates", _estimate_one, _estimate_cases, slow=True),
    Experiment("another_robot_control", _control_one, _control_cases, slow=True),
)


def main() -> None:
    """Train the model that notebook 16 shows, into `data/weights`."""
    shown = train("p", 0)
    trained = Checkpoint(name="reacher", model=shown.model, biases=shown.biases)
    trained.save(data_folder() / "weights" / "model-reacher.safetensors")
    write_checksums()


if __name__ == "__main__":
    main()
