"""When does p pay? A rule with numbers, and predictions written before the test.

A task is a goal, two materials, and how often the plan is made anew. Three things are
measured:

* its **gap**, by a planner that has the true simulation: how much farther from the goal
  the best plan of one material ends when it is sent with the other;
* what is **left** of the gap when that planner, which believes in the wrong material,
  plans anew as often as the task allows. `1 - left / gap` is what feedback repairs;
* the **gain** by p: how much nearer the network's controller comes with the estimated p
  than with the p of the other material.

The rule says that the gain is what is left of the gap, times one number. Distances are
over those of random commands, so that the number may hold for another robot. It comes
from a random half of goals and materials of one robot. `python examples/when_p_pays.py`
has three steps, `measure`, `predict` and `test`; predictions for the other half, and
for another robot, are stored before any of their gains is measured.
"""

import itertools
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import another_robot
import fair_rivals
import joblib
import mujoco
import numpy as np
import pandas as pd
import torch
from another_robot import TrainedRobot, random_commands
from mujoco import rollout as batch
from torch import Tensor
from tqdm.auto import tqdm

import studies
from clothlab import load_model
from clothlab._store import write_checksums
from clothlab.method.control import Controller, ControlSettings, GradientSearch
from clothlab.method.data import Run
from clothlab.method.gauss_newton import estimate_bias
from clothlab.method.training import ModelTraining, train_dpmpb
from studies import save

SUBSTEPS = 5  # of the Reacher's simulation in a step of 0.05 s
GOALS = range(6)
PAIRS = {  # by numbers of the nine materials, the first property running slowest
    "some mass": (1, 4),
    "all of the mass": (1, 7),
    "all of the friction": (3, 5),
    "both": (0, 8),
}
FEEDBACK = {"never": 1000, "every 4 steps": 4, "every step": 1}  # plans anew
# Of the network in each world: the number of the rule comes from one robot alone
TRAININGS = {"development": {"reacher": 1}, "test": {"reacher": 2, "pendulum": 1}}
ESTIMATE = 200  # steps of random commands for an estimate: 10 s
KEEP = Path("build/when_p_pays")


# Full state, step, whether to plan → command [D_u]
Policy = Callable[[np.ndarray, int, bool], np.ndarray]


@dataclass(frozen=True)
class World:
    """A robot with two hidden properties, whose simulation can be asked anything.

    Its full state is angles and speeds `[..., 2 D]`.
    """

    name: str
    steps: int  # of an attempt
    limit: float  # of each command
    commands: int  # D_u
    place: slice  # of what has to reach the goal [m], in what the network sees
    materials: tuple[tuple[float, float], ...]  # nine pairs of hidden properties
    # Material, full state [2 D], plans [N, T, D_u] → full states [N, T, 2 D]
    move: Callable[[int, np.ndarray, np.ndarray], np.ndarray]
    see: Callable[[np.ndarray], np.ndarray]  # full states → states of the network
    draw: Callable[[int], tuple[np.ndarray, np.ndarray]]  # → start, goal [m]

    def ends(self, material: int, start: np.ndarray, plans: np.ndarray) -> np.ndarray:
        """Where plans `[N, T, D_u]` lead `[N, 2]` [m]."""
        return self.see(self.move(material, start, plans)[:, -1])[:, self.place]


@cache
def _reacher(material: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    env = another_robot.make_robot(another_robot.MATERIALS[material]).unwrapped
    return env.model, mujoco.MjData(env.model)


def move_reacher(material: int, start: np.ndarray, plans: np.ndarray) -> np.ndarray:
    """Full states `[N, T, 4]` of the Reacher after each command of plans."""
    model, data = _reacher(material)

    # Time, angles and speeds; Reacher's own goal has two of each, and rests
    first = np.zeros(1 + model.nq + model.nv)
    first[1:3] = start[:2]
    first[1 + model.nq : 3 + model.nq] = start[2:]
    held = np.repeat(plans, SUBSTEPS, axis=1)
    states, _ = batch.rollout(model, data, np.tile(first, (len(plans), 1)), held)
    after = states[:, SUBSTEPS - 1 :: SUBSTEPS]
    angles = after[..., 1:3]
    speeds = after[..., 1 + model.nq : 3 + model.nq]
    return np.concatenate([angles, speeds], axis=-1)


def see_reacher(full: np.ndarray) -> np.ndarray:
    """States `[..., 8]` as notebook 16 has them, of full states `[..., 4]`."""
    angles = full[..., :2]
    both = angles.sum(-1)
    x = 0.1 * np.cos(angles[..., 0]) + 0.11 * np.cos(both)
    y = 0.1 * np.sin(angles[..., 0]) + 0.11 * np.sin(both)
    tip = np.stack([x, y], axis=-1)
    return np.concatenate([np.cos(angles), np.sin(angles), full[..., 2:], tip], -1)


def draw_reacher(number: int) -> tuple[np.ndarray, np.ndarray]:
    """A pose at rest, and a goal for the tip."""
    rng = np.random.default_rng(7000 + number)
    start = np.array([*rng.uniform(-2, 2, 2), 0, 0])
    return start, another_robot.draw_goals(7000 + number, 1)[0]


# Mass [kg] and friction of the joint [N m s/rad]
PENDULA = tuple(itertools.product((0.5, 1.0, 2.0), (0.05, 0.2, 0.8)))


def move_pendulum(material: int, start: np.ndarray, plans: np.ndarray) -> np.ndarray:
    """Full states `[N, T, 2]` of Gymnasium's pendulum, to which friction is added.

    Its angle is 0 where it stands; a rod of 1 m, steps of 0.05 s.
    """
    mass, friction = PENDULA[material]
    angle = np.full(len(plans), start[0])
    speed = np.full(len(plans), start[1])
    states = []
    for u in np.clip(plans[..., 0], -2, 2).T:
        torque = u - friction * speed
        speed = speed + 0.05 * (15 * np.sin(angle) + 3 * torque / mass)
        speed = np.clip(speed, -8, 8)
        angle = angle + 0.05 * speed
        states.append(np.stack([angle, speed], axis=-1))
    return np.stack(states, axis=1)


def see_pendulum(full: np.ndarray) -> np.ndarray:
    """States `[..., 3]`: height and side of the tip [m], and speed [rad/s]."""
    angle = full[..., 0]
    return np.stack([np.cos(angle), np.sin(angle), full[..., 1]], axis=-1)


def draw_pendulum(number: int) -> tuple[np.ndarray, np.ndarray]:
    """It hangs still, and has to be swung by 0.3 to 1.6 rad."""
    rng = np.random.default_rng(7100 + number)
    swing = rng.choice([-1, 1]) * rng.uniform(0.3, 1.6)  # from hanging [rad]
    return np.array([np.pi, 0]), np.array([-np.cos(swing), np.sin(swing)])


WORLDS = {
    "reacher": World(
        "reacher",
        another_robot.ATTEMPT,
        1.0,
        2,
        another_robot.TIP,
        tuple((each.payload, each.friction) for each in another_robot.MATERIALS),
        move_reacher,
        see_reacher,
        draw_reacher,
    ),
    "pendulum": World(
        "pendulum",
        20,
        2.0,
        1,
        slice(0, 2),
        PENDULA,
        move_pendulum,
        see_pendulum,
        draw_pendulum,
    ),
}


def search(
    world: World,
    believed: int,
    start: np.ndarray,
    goal: np.ndarray,
    plan: np.ndarray,
    effort: "Effort",
    rng: np.random.Generator,
) -> np.ndarray:
    """The best plan `[T, D_u]` for a goal if the robot were as it is believed.

    Cross-entropy method in that simulation; the plan at hand is one of those tried.

    Args:
        world: the robot.
        believed: number of the material that the planner has in mind.
        start: full state `[2 D]`.
        goal: for the tip at the end `[2]` [m].
        plan: around which plans are drawn first `[T, D_u]`.
        effort: how many, and how widely.
        rng: draws them.
    """
    mean = plan
    deviation = np.full(plan.shape, effort.wide * world.limit)
    best = plan[None]
    for _ in range(effort.rounds):
        drawn = rng.normal(mean, deviation, (effort.plans, *plan.shape))
        plans = np.concatenate([best, drawn]).clip(-world.limit, world.limit)
        misses = np.linalg.norm(world.ends(believed, start, plans) - goal, axis=1)
        best = plans[misses.argsort()[: effort.plans // 10]]
        mean = best.mean(0)
        deviation = best.std(0) + 0.01 * world.limit
    return best[0]


class Effort(NamedTuple):
    """Of a search in the true simulation."""

    rounds: int
    plans: int  # drawn in a round
    wide: float  # the first round's standard deviation, in limits of the commands


FIRST = Effort(rounds=10, plans=100, wide=0.7)
AGAIN = Effort(rounds=3, plans=50, wide=0.2)


@cache
def first_plan(name: str, believed: int, number: int) -> np.ndarray:
    """The plan `[T, D_u]` with which the planner of a material begins."""
    world = WORLDS[name]
    start, goal = world.draw(number)
    nothing = np.zeros((world.steps, world.commands))
    rng = np.random.default_rng([number, believed])
    return search(world, believed, start, goal, nothing, FIRST, rng)


def oracle(world: World, believed: int, number: int) -> Policy:
    """The planner with the true simulation of the material that it believes in."""
    rng = np.random.default_rng([number, believed, 1])
    _, goal = world.draw(number)
    plan = first_plan(world.name, believed, number).copy()

    def policy(full: np.ndarray, t: int, solve: bool) -> np.ndarray:
        if t and solve:
            plan[t:] = search(world, believed, full, goal, plan[t:], AGAIN, rng)
        return plan[t]

    return policy


def learned(world: World, trained: TrainedRobot, p: np.ndarray, number: int) -> Policy:
    """The network's controller with one p, as a policy of the same shape."""
    _, goal = world.draw(number)
    aim = torch.as_tensor(goal, dtype=torch.float32)
    end = world.steps - 1

    def loss(states: Tensor, commands: Tensor, t: int) -> Tensor:
        there = states[:, end - t, world.place]
        return torch.linalg.vector_norm(there - aim, dim=1)

    # Random commands to start from
    starts = np.stack([excite(world, world.steps, 300 + k) for k in range(200)])
    limits = np.full(world.commands, world.limit)
    settings = ControlSettings(world.steps, period=world.steps, iterations=5)
    search = GradientSearch(starts)
    controller = Controller(
        trained.model, loss, p, -limits, limits, settings, search=search
    )

    def policy(full: np.ndarray, t: int, solve: bool) -> np.ndarray:
        return controller.act(world.see(full), solve=solve)

    return policy


def excite(world: World, steps: int, seed: int) -> np.ndarray:
    """Random commands `[T, D_u]`, each held for one to six steps."""
    drawn = random_commands(seed)
    commands = [drawn(np.empty(0)) for _ in range(steps)]
    return world.limit * np.array(commands)[:, : world.commands]


def miss(
    world: World, material: int, number: int, policy: Policy, every: int = 1000
) -> float:
    """How far from its goal an attempt ends [m].

    Args:
        world: the robot.
        material: which it really has.
        number: of start and goal.
        policy: full state, step, whether to plan → command.
        every: steps after which it plans anew.
    """
    full, goal = world.draw(number)
    for t in range(world.steps):
        u = policy(full, t, t % every == 0)
        full = world.move(material, full, u[None, None])[0, 0]
    return float(np.linalg.norm(world.see(full)[world.place] - goal))


def record(world: World, material: int, steps: int, seed: int) -> Run:
    """A run of random commands from the first start."""
    u = excite(world, steps, seed)
    start, _ = world.draw(0)
    after = world.move(material, start, u[None])[0]
    full = np.concatenate([start[None], after[:-1]])
    return Run(world.see(full), u, str(material))


PENDULUM_TRAINING = ModelTraining(epochs=40, batch_size=50, stride=3)


def train(
    name: str, seed: int, steps: int = 1500, settings: ModelTraining = PENDULUM_TRAINING
) -> TrainedRobot:
    """W and nine p for a world, from random commands."""
    torch.set_num_threads(1)
    world = WORLDS[name]
    materials = range(len(world.materials))
    runs = [record(world, k, steps, 100 + k) for k in materials]
    model, biases, _ = train_dpmpb(runs, settings, seed=seed, progress=False)
    return TrainedRobot(model, biases)


kept = joblib.Memory(KEEP, verbose=0).cache
train_once = kept(train)


def trained_for(name: str, training: int) -> TrainedRobot:
    """A training for a world: of the Reacher the stored one, and one of half of it."""
    if name == "pendulum":
        return train_once(name, training)
    if training:
        return fair_rivals.train_once("p", training - 1)
    stored = load_model(name)
    return TrainedRobot(stored.model, stored.biases)


def tasks(name: str) -> list[tuple[int, str]]:
    """Goals and pairs of a world, in a random order: the first half is to learn from.

    How often a plan is made anew does not part them: all three are on one side.
    """
    cells = list(itertools.product(GOALS, PAIRS))
    order = np.random.default_rng(list(WORLDS).index(name)).permutation(len(cells))
    return [cells[k] for k in order]


def half(name: str, which: str) -> list[tuple[int, str]]:
    """The half of the tasks that is for "development", or the "test"."""
    cells = tasks(name)
    middle = len(cells) // 2
    return cells[:middle] if which == "development" else cells[middle:]


def both_ways(function: Callable[[int, int], float], pair: str) -> float:
    """Mean over both materials of a pair: what the function makes of (true, other)."""
    first, second = PAIRS[pair]
    return (function(first, second) + function(second, first)) / 2


def measure_gap(name: str, goal: int, pair: str) -> list[dict[str, Any]]:
    """Rows of one goal and pair: what the wrong material costs the oracle [m]."""
    world = WORLDS[name]
    rows = []
    for feedback, every in FEEDBACK.items():

        def distance(true: int, believed: int, every: int = every) -> float:
            return miss(world, true, goal, oracle(world, believed, goal), every)

        own = both_ways(lambda true, other: distance(true, true), pair)
        foreign = both_ways(distance, pair)
        case = {"world": name, "goal": goal, "pair": pair, "feedback": feedback}
        rows.append(case | {"own": own, "left": foreign - own})

    # Without feedback all of the gap is left
    return [row | {"gap": rows[0]["left"]} for row in rows]


def estimates(name: str, training: int) -> dict[int, np.ndarray]:
    """p of each material in a pair, from 10 s of random commands `[D_p]`."""
    torch.set_num_threads(1)
    world = WORLDS[name]
    model = trained_for(name, training).model
    found = {}
    for material in sorted({*itertools.chain(*PAIRS.values())}):
        run = record(world, material, ESTIMATE, 5000 + material)
        found[material], _ = estimate_bias(model, run, method="newton")
    return found


def measure_gain(
    name: str, training: int, goal: int, pair: str
) -> list[dict[str, Any]]:
    """Rows of one training, goal and pair: how near with which p [m]."""
    torch.set_num_threads(1)
    world = WORLDS[name]
    trained = trained_for(name, training)
    known = list(trained.biases.values())
    found = kept(estimates)(name, training)
    rows = []
    for feedback, every in FEEDBACK.items():

        def distance(true: int, p: np.ndarray, every: int = every) -> float:
            return miss(world, true, goal, learned(world, trained, p, goal), every)

        case = {"world": name, "goal": goal, "pair": pair, "feedback": feedback}
        estimated = both_ways(lambda true, _: distance(true, found[true]), pair)
        wrong = both_ways(lambda true, other: distance(true, known[other]), pair)
        how = {"training": training, "estimated": estimated, "wrong": wrong}
        rows.append(case | how)
    return rows


def yardstick(name: str) -> float:
    """How far from a goal random commands end, mean over goals and materials [m]."""
    world = WORLDS[name]
    misses = []
    for goal, material in itertools.product(GOALS, range(len(world.materials))):
        start, place = world.draw(goal)
        plans = np.stack([excite(world, world.steps, 900 + k) for k in range(20)])
        misses.append(
            np.linalg.norm(world.ends(material, start, plans) - place, axis=1)
        )
    return float(np.mean(misses))


RULES = {  # what each makes a gain of, with one number
    "rule": lambda tasks: tasks["left"],
    "gap alone": lambda tasks: tasks["gap"],
    "mean gain": lambda tasks: tasks["left"] * 0 + 1,
}


def in_units(rows: pd.DataFrame) -> pd.DataFrame:
    """The same rows, with distances over those of random commands in their world."""
    lengths = [each for each in rows if each in ("gap", "left", "own", "gain")]
    return rows.assign(**{each: rows[each] / rows["random"] for each in lengths})


def gains(which: str) -> pd.DataFrame:
    """Gains by p of half of the tasks, beside what the oracle says of them [m]."""
    rows = []
    for name, count in TRAININGS[which].items():
        cases = itertools.product(range(count), half(name, which))
        for training, task in tqdm(list(cases), desc=f"gains of the {name}"):
            rows += kept(measure_gain)(name, training, *task)
    table = pd.DataFrame(rows)
    table["gain"] = table["wrong"] - table["estimated"]
    return table.merge(studies.load("when_p_pays_oracle"), on=TASK)


TASK = ["world", "goal", "pair", "feedback"]  # columns that say which task it is


def slope(feature: pd.Series, gain: pd.Series) -> float:
    """Of the line through zero with the least squared error."""
    return float((feature * gain).sum() / (feature**2).sum())


def measure() -> None:
    """Gaps of all tasks, by the oracle; gains of the first half."""
    rows = []
    for name in WORLDS:
        scale = yardstick(name)
        for goal, pair in tqdm(tasks(name), desc=f"gaps of the {name}"):
            found = kept(measure_gap)(name, goal, pair)
            rows += [row | {"random": scale} for row in found]
    save(pd.DataFrame(rows), "when_p_pays_oracle")
    save(gains("development"), "when_p_pays_development")


def predict() -> None:
    """Gains of the other half and of another robot, before anybody knows them.

    A row of the table is a task, and what each rule says of it, in distances of random
    commands.
    """
    learnt = in_units(studies.load("when_p_pays_development"))
    ahead = in_units(studies.load("when_p_pays_oracle"))
    for name, feature in RULES.items():
        number = slope(feature(learnt), learnt["gain"])
        print(f"{name}: times {number:.3f}")
        ahead[name] = number * feature(ahead)

    # Only of tasks whose gain was not measured, and will be
    cases = [(name, *task) for name in WORLDS for task in half(name, "test")]
    unknown = ahead.merge(pd.DataFrame(cases, columns=TASK[:3]), on=TASK[:3])
    save(unknown[[*TASK, *RULES]], "when_p_pays_predicted")


def test() -> None:
    """Gains of what was predicted."""
    save(gains("test"), "when_p_pays_test")


if __name__ == "__main__":
    steps = {"measure": measure, "predict": predict, "test": test}
    steps[sys.argv[1]]()
    write_checksums()
