"""Does the method find what no sensor shows on other robots, and does it pay there?

A pendulum, a cheetah, a hopper, forty CSV logs, and networks of one's own in the place
of the paper's, each as a user would do it, with three trainings. `python
examples/other_robots.py` measures all in about forty minutes of one core, writes the
table `other_robots`, and prints what *Your own robot* shows of it.

Seeds choose what is recorded, how each network begins, and which new runs are seen.
What counts as found, and what it takes to say that p pays, says `other_robots_page.py`.
"""

import argparse
import itertools
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gym_robots
import messy_logs
import numpy as np
import own_network
import pandas as pd
import torch
from gym_robots import CHEETAH, PENDULUM, Robot, Size, Trained
from hopper_damping import WAYS, fitted, shares_of_error
from other_robots_page import BEGIN, END, tell
from tqdm.auto import tqdm

import studies
from clothlab import Run
from clothlab._store import write_checksums
from clothlab.analysis import nearest_material
from clothlab.method.gauss_newton import NewtonSettings
from studies._pages import put_between

SMALL = Size(steps=100, seen=100, attempt=2, epochs=1, window=12)
NEW = 50_000  # seeds of new runs, beyond those of recordings
SOME = slice(None, None, 4)  # of nine materials, the first, middle, last: controlled
FEEDBACK = {"every step": 1, "every 8 steps": 8}
# Epochs for as many of the paper's network, in about the same time
AS_LONG = {"GRU": 3, "residual": 12}
SHORT_RUNS = NewtonSettings(warmup=3)  # of a hopper that falls

Rows = list[dict[str, Any]]


def add(rows: Rows, case: str, measure: str, values: dict[str, float] | float) -> None:
    """Note a number, or one of each arm."""
    arms = values if isinstance(values, dict) else {"": values}
    for arm, value in arms.items():
        row = {"case": case, "measure": measure, "arm": arm, "value": float(value)}
        rows.append(row)


def new_runs(
    robot: Robot, material: gym_robots.Material, number: int, seed: int, size: Size
) -> list[Run]:
    """Runs of a material that a training with this seed never saw.

    Args:
        robot: that is recorded.
        material: of it.
        number: of the material.
        seed: of the training.
        size: how long it is looked at.
    """
    first = NEW + gym_robots.seed_of(seed, number)
    return gym_robots.record(robot, material, size.seen, first)


def find_and_control(robot: Robot, seed: int, size: Size) -> Rows:
    """All four calls: p of nine materials, estimates, predictions, and control."""
    trained = gym_robots.trained_on(robot, size, seed)
    rows: Rows = []
    explained = gym_robots.r_squared(robot, trained.biases)
    add(rows, "", "R²", dict(zip(robot.properties, explained, strict=True)))

    # New runs of the same materials, whose names nobody is told
    for k, material in enumerate(robot.materials):
        name = robot.name_of(material)
        seen = new_runs(robot, material, k, seed, size)
        p = gym_robots.estimate(trained.model, seen)
        add(rows, name, "right", nearest_material(p, trained.biases) == name)
        biases = gym_robots.four_biases(trained, name, p)
        errors = {
            arm: gym_robots.error_ahead(trained.model, seen, bias)
            for arm, bias in biases.items()
        }
        add(rows, name, "error ahead", errors)
        if material in robot.materials[SOME]:
            control(rows, robot, trained, material, biases, size)
    return rows


def control(
    rows: Rows,
    robot: Robot,
    trained: Trained,
    material: gym_robots.Material,
    biases: dict[str, np.ndarray],
    size: Size,
) -> None:
    """Note the rewards of one material with each p, and of random commands.

    Args:
        rows: to which they are added.
        robot: that is controlled.
        trained: its model.
        material: of the robot.
        biases: p by the name of the arm.
        size: how long an attempt lasts.
    """
    name = robot.name_of(material)
    for feedback, every in FEEDBACK.items():
        rewards = {
            arm: gym_robots.control(robot, trained, material, p, size.attempt, every)
            for arm, p in biases.items()
        }
        add(rows, name, f"reward, {feedback}", rewards)
    drawn = gym_robots.without_control(robot, material, size.attempt)
    add(rows, name, "reward, random commands", drawn)


def pendulum(seed: int, size: Size) -> Rows:
    """Mass and length of a pendulum that is swung up."""
    return find_and_control(PENDULUM, seed, size)


def cheetah(seed: int, size: Size) -> Rows:
    """Mass and damping of a cheetah that runs."""
    return find_and_control(CHEETAH, seed, size)


def hopper(seed: int, size: Size) -> Rows:
    """Mass and damping of a hopper, recorded in each of the ways."""
    rows: Rows = []
    for way, robot in WAYS.items():
        trained = gym_robots.trained_on(robot, size, seed)
        add(rows, way, "steps", sum(map(len, trained.runs)))
        for k in range(len(robot.materials)):
            look_for(rows, way, robot, trained, k, seed, size)
    return rows


def look_for(
    rows: Rows,
    way: str,
    robot: Robot,
    trained: Trained,
    number: int,
    seed: int,
    size: Size,
) -> None:
    """Note which mass and damping of one material are found, and by what.

    Args:
        rows: to which it is added.
        way: of recording.
        robot: the hopper, recorded so.
        trained: its model.
        number: of the material.
        seed: of the training.
        size: how long it is looked at.
    """
    material = robot.materials[number]
    seen = new_runs(robot, material, number, seed, size)

    # By p, by the error of each trained p, and by the simulation
    p = gym_robots.estimate(trained.model, seen, SHORT_RUNS)
    names = {robot.name_of(each): each for each in robot.materials}
    scale = trained.model.s_std.numpy()
    guesses = {
        "nearest p": names[nearest_material(p, trained.biases)],
        "least error": names[gym_robots.least_wrong(trained, seen)],
    }
    if seed == 0:  # no training is in this one
        noise = NEW + gym_robots.seed_of(seed, number)
        guesses["simulation"] = fitted(robot, seen, scale, noise)
    for k, quality in enumerate(robot.properties):
        right = {arm: guess[k] == material[k] for arm, guess in guesses.items()}
        add(rows, f"{way}: {robot.name_of(material)}", quality, right)

    # How much there is to see
    if material == (1.0, 1.0):
        error = gym_robots.error_ahead(
            trained.model, seen, trained.biases[robot.name_of(material)], 1
        )
        longest = max(seen, key=len)
        shares = shares_of_error(robot, trained, error, longest)
        add(rows, way, "moves a step", shares)


def logs(seed: int, size: Size) -> Rows:
    """The load of a pendulum from forty CSV logs, even ones and messy ones."""
    rows: Rows = []
    for arm, messy in (("even logs", False), ("messy logs", True)):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            messy_logs.write_logs(folder, seed, messy)
            runs = messy_logs.read(f"{folder}/*/[!f]*.csv")
            fridays = messy_logs.read(f"{folder}/*/friday.csv")
        trained = gym_robots.train(runs, size.training, seed)

        # The load of the day that was not trained on
        for each in messy_logs.LOADS:
            material = messy_logs.name_of(each)
            seen = [run for run in fridays if run.material == material]
            p = gym_robots.estimate(trained.model, seen)
            right = nearest_material(p, trained.biases) == material
            add(rows, material, "right", {arm: right})
        add(rows, "", "steps", {arm: sum(map(len, runs))})
    return rows


def networks(seed: int, size: Size) -> Rows:
    """Three networks that swing up the pendulum: at equal epochs, at equal time."""
    rows: Rows = []
    for material in PENDULUM.materials[SOME]:
        drawn = gym_robots.without_control(PENDULUM, material, size.attempt)
        add(rows, PENDULUM.name_of(material), "reward", {"without control": drawn})
    trainings = {name: (name, 1) for name in own_network.NETWORKS}
    trainings |= {f"{name}, as long": (name, n) for name, n in AS_LONG.items()}
    for arm, (network, times) in trainings.items():
        trained = gym_robots.trained_on(PENDULUM, size, seed, network, times)
        add(rows, "", "training [s]", {arm: trained.seconds})

        # With the p that each estimates itself
        for k, material in enumerate(PENDULUM.materials[SOME]):
            name = PENDULUM.name_of(material)
            seen = new_runs(PENDULUM, material, k, seed, size)
            p = gym_robots.estimate(trained.model, seen)
            reward = gym_robots.control(PENDULUM, trained, material, p, size.attempt)
            add(rows, name, "reward", {arm: reward})
    return rows


def speed(seed: int, size: Size) -> Rows:
    """What a command takes with each network, in turn: all share one machine's moods.

    What they learned doesn't matter.
    """
    brief = replace(size, steps=100, epochs=1)
    controllers = {}
    for network in own_network.NETWORKS:
        trained = gym_robots.trained_on(PENDULUM, brief, seed, network)
        p = np.zeros(trained.model.bias_size)
        controllers[network] = gym_robots.controller_of(PENDULUM, trained, p)

    # Any states will do
    rng = np.random.default_rng(seed)
    times: dict[str, list[float]] = {network: [] for network in controllers}
    for _ in range(size.attempt):
        s = rng.normal(size=3)
        for network, controller in controllers.items():
            start = time.thread_time()
            controller.act(s)
            times[network].append(1000 * (time.thread_time() - start))
    rows: Rows = []
    medians = {network: float(np.median(each)) for network, each in times.items()}
    add(rows, "", "act [ms]", medians)
    return rows


TASKS: dict[str, Callable[[int, Size], Rows]] = {
    "pendulum": pendulum,
    "cheetah": cheetah,
    "hopper": hopper,
    "logs": logs,
    "networks": networks,
    "speed": speed,
}
TABLE = "other_robots"


def measure(name: str, seed: int, size: Size) -> pd.DataFrame:
    """A row for each number that a task notes."""
    rows = TASKS[name](seed, size)
    return pd.DataFrame([{"task": name, "seed": seed, **row} for row in rows])


def keep(found: pd.DataFrame) -> None:
    """Store rows in the place of those of the same task and seed."""
    try:
        before = studies.load(TABLE)
    except KeyError:  # the first ones
        before = found.iloc[:0]

    # In the order of tasks, whatever was measured first
    cases = ["task", "seed"]
    same = before.set_index(cases).index.isin(found.set_index(cases).index)
    rows = pd.concat([before[~same], found], ignore_index=True)
    tasks = pd.Categorical(rows["task"], list(TASKS), ordered=True)
    order = rows.assign(task=tasks).sort_values(cases, kind="stable").index
    studies.save(rows.loc[order], TABLE)
    write_checksums()


def main() -> None:
    """Measure, store and tell; or tell what is stored."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--small", action="store_true", help="tiny, and not stored")
    parser.add_argument("--tell", action="store_true", help="only what is stored")
    parser.add_argument("--page", type=Path, help="write the tables into this page")
    arguments = parser.parse_args()
    torch.set_num_threads(1)

    # Each training is stored as soon as it is tried
    cases = itertools.product(arguments.seeds, arguments.only)
    bar = tqdm([] if arguments.tell else list(cases), disable=arguments.tell)
    for seed, name in bar:
        bar.set_description(f"{name}, seed {seed}")
        found = measure(name, seed, SMALL if arguments.small else Size())
        if arguments.small:
            bar.write(found.to_string())
        else:
            keep(found)
    if arguments.small:
        return

    # A page of some would look like one of all
    rows = studies.load(TABLE)
    missing = TASKS.keys() - set(rows["task"])
    if missing:
        print("not measured yet:", ", ".join(sorted(missing)))
        return
    told = tell(rows)
    print(told)
    if arguments.page:
        put_between(arguments.page, f"\n{told}\n", BEGIN, END)


if __name__ == "__main__":
    main()
