"""How fast an arm moves, watched within the control steps.

In a run, or in a trial that is sent again.
"""

import numpy as np

from clothlab.simulation.arm import Arm
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial


class MotionWatch:
    """How an arm moves within the steps.

    Pass it as `watch` to `rollout` or `ClothEnv.advance`.
    """

    def __init__(self, env: ClothEnv):
        self._env = env
        self._rows: list[tuple[float, ...]] = []

    def __call__(self) -> None:
        data = self._env.data
        theta = self._env.arm.angles(data)
        hand = data.site("hand").xpos
        self._rows.append((data.time, *theta, *hand))

    @property
    def time(self) -> np.ndarray:
        """Time of each of N samples, `[N]` [s]."""
        return np.array(self._rows)[:, 0]

    @property
    def theta(self) -> np.ndarray:
        """Joint angles, `[N, 2]` [rad]."""
        return np.array(self._rows)[:, 1:3]

    @property
    def hand(self) -> np.ndarray:
        """Position of the hand in the world, `[N, 3]` [m]."""
        return np.array(self._rows)[:, 3:]

    @property
    def hand_speed(self) -> np.ndarray:
        """Speed of the hand, `[N]` [m/s]."""
        return np.linalg.norm(np.gradient(self.hand, self.time, axis=0), axis=1)


def replay(trial: Trial, *, arm: Arm | None = None, samples: int = 50) -> MotionWatch:
    """Send the commands of a trial again, and watch the arm.

    Args:
        trial: whose commands are sent.
        arm: another arm than its own.
        samples: of the motion in each step.

    Raises:
        ValueError: its own arm does not move again as recorded, as after a random
            start.
    """
    env = ClothEnv(arm or trial.arm, trial.cloth)
    watch = MotionWatch(env)
    env.start(seed=trial.seed)
    for u, recorded in zip(trial.commands, trial.robot, strict=True):
        here = env.arm.state(env.data)
        if arm is None and not np.allclose(here, recorded, atol=1e-6):
            raise ValueError(
                "the replay leaves the recorded run: it started elsewhere, or with "
                "another arm"
            )
        env.advance(u, watch, samples)
    return watch
