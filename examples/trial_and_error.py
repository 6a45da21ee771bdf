"""A rival that learns by trial and error on the Reacher of notebook 16.

SAC (Haarnoja et al., 2018) gets as many steps on the robot as the recordings had. It is
told nothing of the robot's payload and friction, the p that the predictive model
estimates, or both properties. It needs what no other part of this project does:
`pip install stable-baselines3`. `python examples/trial_and_error.py` writes the table
`another_robot_policies`.
"""

import itertools
from collections.abc import Callable
from typing import Any

import fair_rivals
import gymnasium
import joblib
import numpy as np
import pandas as pd
import torch
from another_robot import (
    ATTEMPT,
    BETWEEN,
    ESTIMATE,
    MATERIALS,
    STEPS,
    Material,
    attempts,
    draw_goals,
    make_robot,
    random_commands,
    see,
    told,
)
from gymnasium import spaces
from tqdm.auto import tqdm

from clothlab._store import write_checksums
from clothlab.method.data import Run
from clothlab.method.gauss_newton import estimate_bias
from studies import save

BUDGET = STEPS * len(MATERIALS)  # steps on the robot: those of the recordings
TOLD = ("nothing", "estimated p", "both properties")
KEPT_FOR = 10  # attempts with one material, as in the test
SEEDS = range(2)  # of the trainings
TESTS = range(100, 104)  # seeds of goals and of random commands; the study's are 0 to 4


def learner() -> Any:
    """The class SAC; an ImportError says how to get it."""
    try:
        from stable_baselines3 import SAC
    except ImportError as error:
        raise ImportError(
            "learning by trial and error needs: pip install stable-baselines3"
        ) from error
    return SAC


class Reaching(gymnasium.Env):
    """Attempts of 0.6 s to bring the tip to a goal, each from where the last one ended.

    After ten attempts the robot gets another payload and friction. An observation has
    the state `[8]`, the way to the goal `[2]` [m], the share of the time that is left,
    and what is told.

    Args:
        told_of: material → what a policy is told of it `[0 or 2]`.
        seed: of materials, goals and the commands before the first attempt.
    """

    def __init__(self, told_of: Callable[[Material], np.ndarray], seed: int):
        self.told_of = told_of
        self.rng = np.random.default_rng(seed)
        self.robots = {material: make_robot(material) for material in MATERIALS}
        self.attempt = 0  # so far
        size = 11 + len(told_of(MATERIALS[0]))
        self.observation_space = spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = spaces.Box(-1, 1, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple:
        """The next attempt, and now and then another robot."""
        if self.attempt % KEPT_FOR == 0:
            self.material = MATERIALS[self.rng.integers(len(MATERIALS))]
            robot = self.robots[self.material]
            observation, _ = robot.reset(seed=int(self.rng.integers(2**31)))
            for _ in range(ATTEMPT):
                observation, *_ = robot.step(self.rng.uniform(-1, 1, 2))
            self.s = see(observation)
        self.attempt += 1
        self.goal = draw_goals(int(self.rng.integers(1_000, 2**31)), 1)[0]
        self.t = 0
        return self._observation(), {}

    def step(self, action: np.ndarray) -> tuple:
        """One command; the reward is the lack of distance at the attempt's end."""
        observation, *_ = self.robots[self.material].step(np.clip(action, -1, 1))
        self.s = see(observation)
        self.t += 1
        over = self.t == ATTEMPT
        distance = float(np.linalg.norm(self.s[6:8] - self.goal))
        return self._observation(), -10 * distance * over, over, False, {}

    def _observation(self) -> np.ndarray:
        return observed(self.s, self.goal, self.t, self.told_of(self.material))


def observed(s: np.ndarray, goal: np.ndarray, t: int, about: np.ndarray) -> np.ndarray:
    """What a policy sees `[11 + D]`, all of it of order one."""
    way = 10 * (goal - s[6:8])
    left = [1 - t / ATTEMPT]
    angles = s[:4]
    speeds = s[4:6] / 5
    tip = 5 * s[6:8]
    return np.concatenate([angles, speeds, tip, way, left, about]).astype(np.float32)


def train(telling: str, seed: int, steps: int = BUDGET) -> dict[str, Any]:
    """Weights of the policy after so many steps on the robot."""
    torch.set_num_threads(1)
    env = Reaching(teller(telling), seed)
    agent = _agent(env, seed)
    agent.learn(steps)
    return agent.policy.state_dict()


def _agent(env: Reaching, seed: int) -> Any:
    """SAC with its usual settings, and two layers of 64 units."""
    sizes = {"net_arch": [64, 64]}
    return learner()("MlpPolicy", env, seed=seed, policy_kwargs=sizes, gamma=1.0)


train_once = joblib.Memory("build/trial_and_error", verbose=0).cache(train)


def teller(telling: str) -> Callable[[Material], np.ndarray]:
    """What is told of a material that was recorded."""
    if telling == "nothing":
        return lambda material: np.zeros(0)
    if telling == "both properties":
        return told
    biases = fair_rivals.train_once("p", 0).biases
    return lambda material: biases[str(material)]


class Learned:
    """Random commands for 10 s, and then what was learned.

    A policy for `another_robot.attempts`.

    Args:
        telling: one of `TOLD`.
        agent: the trained SAC.
        material: of the robot.
        seed: of goals and random commands.
    """

    def __init__(self, telling: str, agent: Any, material: Material, seed: int):
        self.telling = telling
        self.agent = agent
        self.goals = draw_goals(seed)
        self.explore = random_commands(seed)
        self.about = told(material) if telling == "both properties" else np.zeros(0)
        self.states: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []

    def __call__(self, s: np.ndarray) -> np.ndarray:
        step = len(self.states) - ESTIMATE
        if step == 0 and self.telling == "estimated p":
            seen = Run(np.array(self.states), np.array(self.commands), "")
            model = fair_rivals.train_once("p", 0).model
            self.about, _ = estimate_bias(model, seen, method="newton")
        if step < 0:
            u = self.explore(s)
        else:
            attempt, t = divmod(step, ATTEMPT)
            goal = self.goals[attempt % len(self.goals)]
            seen_now = observed(s, goal, t, self.about)
            u, _ = self.agent.predict(seen_now, deterministic=True)
        self.states.append(s)
        self.commands.append(u)
        return u


def main() -> None:
    """Train, and try new materials and goals."""
    rows = []
    for telling, seed in tqdm(list(itertools.product(TOLD, SEEDS))):
        agent = _agent(Reaching(teller(telling), seed), seed)
        agent.policy.load_state_dict(train_once(telling, seed))
        for material, goals in itertools.product(BETWEEN, TESTS):
            policy = Learned(telling, agent, material, goals)
            rows.append(
                {
                    "told": telling,
                    "seed": seed,
                    "payload": material.payload,
                    "friction": material.friction,
                    "goals": goals,
                    "distance": attempts(policy, material, goals),
                }
            )
    save(pd.DataFrame(rows), "another_robot_policies")
    write_checksums()


if __name__ == "__main__":
    main()
