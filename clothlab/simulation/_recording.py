"""How an environment records itself."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.trial import Trial
from clothlab.simulation.vision import Observation


@dataclass
class Recording:
    """What an environment keeps of each step while it is recorded."""

    watch: Callable[[], None] | None = None  # called in each step, to film it
    samples: int = 1  # how often
    images: list[np.ndarray] = field(default_factory=list)
    robot: list[np.ndarray] = field(default_factory=list)
    commands: list[np.ndarray] = field(default_factory=list)

    def keep(self, observation: Observation, u: np.ndarray) -> None:
        """Keep what was seen, and the command `[D_u]` that was then sent."""
        self.images.append(observation["image"])
        self.robot.append(observation["robot"])
        self.commands.append(u)

    def trial(self, cloth: Cloth, arm: Arm, policy: str, seed: int) -> Trial:
        """The steps so far as a trial."""
        images = np.array(self.images)
        robot = np.array(self.robot)
        commands = np.array(self.commands)
        return Trial(images, robot, commands, cloth, arm, policy, seed)
