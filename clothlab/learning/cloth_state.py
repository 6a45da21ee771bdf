"""The state that the model of the cloth sees: latent image and robot state (paper, "Network Structure of DPMPB")."""

import numpy as np

from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.control import TRACED
from clothlab.learning.dpmpb import Sequences
from clothlab.learning.estimation import Estimator
from clothlab.policies import Policy, Wrapper
from clothlab.simulation.env import Observation
from clothlab.trials import Trial


def observe(autoencoder: Autoencoder, observation: Observation) -> np.ndarray:
    """State s = (z, robot state) of one observation, `[D_s]`: physics in float64 becomes learning in float32."""
    return np.concatenate([encode(autoencoder, observation["image"]), observation["robot"]]).astype(np.float32)


def to_sequences(autoencoder: Autoencoder, trial: Trial) -> Sequences:
    """States and commands of a recorded trial, encoded with this autoencoder."""
    s = np.concatenate([encode(autoencoder, trial.images), trial.robot], axis=1)
    return Sequences(s.astype(np.float32), trial.commands.astype(np.float32), trial.cloth.name)


class EstimatingPolicy(Wrapper):
    """Any policy, while p is estimated from what it does and given to it; `trace` has p after each step."""

    def __init__(self, policy: Policy, estimator: Estimator, autoencoder: Autoencoder):
        self.estimator, self.autoencoder = estimator, autoencoder
        super().__init__(policy)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and begin with the p that the estimator started from."""
        super().reset(seed)
        self.estimator.reset()
        self.set_bias(self.estimator.p)
        self.trace: list[np.ndarray] = []

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.policy(observation)
        p = self.estimator.update(observe(self.autoencoder, observation), u)
        self.trace = [*self.trace, p][-TRACED:]
        self.set_bias(p)
        return u
