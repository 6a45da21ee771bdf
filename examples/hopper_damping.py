"""Where is the hopper's damping? Five ways to record it, and two yardsticks.

A hopper that gets random commands falls within a quarter of a second, and an episode of
Gymnasium's ends there. So it is recorded as it falls; held upright by springs; held
upright with a longer step, and with dampings that differ by a factor of ten in place of
two; and on the ground, in episodes that go on. Each time mass and damping are
estimated, and two things measured beside it: how far a step moves with each property,
over the error of the trained network; and whether the true simulation, with nine
candidates and sensors of 1 % noise, would find the property from the same run.
"""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gym_robots import Material, Robot, Trained, scaled

from clothlab import Run

FACTORS = (0.5, 1.0, 2.0)  # of mass, and of damping
WIDE = (0.1, 1.0, 10.0)  # of damping
NOISE = 0.01  # of the rival's sensors [s.d.]
BEAT = 0.008  # of Gymnasium's hopper [s]


class Longer(gymnasium.Wrapper):
    """A step of several beats in which a command is held, perhaps beside springs.

    The springs pull the three joints towards standing, as a position controller of the
    robot's own would. The command has 0.3 of the torque then.
    """

    def __init__(self, env: Any, beats: int, springs: bool):
        super().__init__(env)
        self.beats = beats
        self.springs = springs

    def step(self, action: np.ndarray) -> tuple:
        """One step; the reward is the last beat's."""
        data = self.unwrapped.data
        for _ in range(self.beats):
            torque = action
            if self.springs:
                pull = -3 * data.qpos[3:] - 0.3 * data.qvel[3:]
                torque = (0.3 * action + pull).clip(-1, 1)
            result = self.env.step(torque)
            if result[2] or result[3]:
                break
        return result


def make_hopper(material: Material, beats: int, springs: bool, falls: bool) -> Any:
    """Hopper with masses and dampings times these factors.

    Args:
        material: both factors.
        beats: in a step.
        springs: whether they hold it upright.
        falls: whether an episode is over where it falls.
    """
    env = gymnasium.make("Hopper-v5", terminate_when_unhealthy=falls)
    return Longer(scaled(env, *material), beats, springs)


def hopper(
    beats: int,
    springs: bool,
    falls: bool = True,
    dampings: tuple[float, ...] = FACTORS,
    shortest: int = 31,
) -> Robot:
    """One way to record it.

    Args:
        beats: in a step.
        springs: whether they hold it upright.
        falls: whether an episode is over where it falls.
        dampings: three factors.
        shortest: run that is kept [steps].
    """
    return Robot(
        "hopper",
        beats * BEAT,
        ("mass", "damping"),
        (FACTORS, dampings),
        partial(make_hopper, beats=beats, springs=springs, falls=falls),
        shortest=shortest,
    )


WAYS = {
    "it falls": hopper(1, springs=False, shortest=13),
    "upright": hopper(1, springs=True),
    "upright, longer step": hopper(5, springs=True),
    "upright, longer step, damping × 10": hopper(5, springs=True, dampings=WIDE),
    "on the ground, longer step": hopper(5, springs=False, falls=False),
}


def after_one_step(robot: Robot, material: Material, run: Run) -> np.ndarray:
    """What the simulation of a material makes of each state of a run `[T - 1, 11]`.

    A state is all that moves the hopper but its place along the ground, which changes
    nothing; speeds are told up to 10 rad/s.
    """
    env = robot.make(material)
    states = []
    env.reset(seed=0)
    for s, u in zip(run.s[:-1], run.u[:-1], strict=True):
        env.unwrapped.set_state(np.array([0, *s[:5]], float), s[5:].astype(float))
        states.append(env.step(u)[0])
    env.close()
    return np.array(states)


def shares_of_error(
    robot: Robot, trained: Trained, error: float, run: Run
) -> dict[str, float]:
    """How far a step moves with each property, over the network's error in a step.

    Between the middle material and the one with the next larger factor.

    Args:
        robot: one way to record.
        trained: whose standard deviations are the units.
        error: of the network, one step ahead [s.d.²].
        run: of the middle material.
    """
    scale = trained.model.s_std.numpy()
    middle = after_one_step(robot, (1.0, 1.0), run)
    heavier = (robot.values[0][2], 1.0)
    stiffer = (1.0, robot.values[1][2])
    shares = {}
    for name, neighbour in (("mass", heavier), ("damping", stiffer)):
        moved = (after_one_step(robot, neighbour, run) - middle) / scale
        shares[name] = float(np.sqrt((moved**2).mean() / error))
    return shares


def fitted(robot: Robot, runs: list[Run], scale: np.ndarray, seed: int) -> Material:
    """The material whose simulation follows runs best, step by step.

    It knows the hopper's equations, all but the two constants, and sees with noise.
    """
    rng = np.random.default_rng(seed)
    noisy = []
    for run in runs:
        noise = NOISE * scale * rng.normal(size=run.s.shape)
        noisy.append(Run(run.s + noise, run.u, run.material))

    def error(material: Material) -> float:
        squares = 0.0
        for run in noisy:
            gaps = (after_one_step(robot, material, run) - run.s[1:]) / scale
            squares += float((gaps**2).sum())
        return squares

    return min(robot.materials, key=error)
