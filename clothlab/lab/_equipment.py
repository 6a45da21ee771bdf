"""What a live run has, depending on its arm: weights, recordings and images."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab import data
from clothlab._validation import choose
from clothlab.lab._drivers import Drivers
from clothlab.lab._targets import (
    Aim,
    aim_at,
    recorded_targets,
    reference_images,
    usual_reconstruction_distance,
)
from clothlab.lab._tracker import BiasTracker
from clothlab.method.data import Run
from clothlab.simulation.arm import Arm
from clothlab.trials import recorded_plans
from clothlab.weights import ClothCheckpoint


class _Setup(NamedTuple):
    """What comes with an arm, by names of the data."""

    weights: str
    trials: str  # that the weights learned from
    cloth: str
    target: str


SETUPS = {
    "torque": _Setup(
        weights="torque-0", trials="train", cloth="damp0.05-mass0.10", target="target-2"
    ),
    "muscle": _Setup(
        weights="muscle-0", trials="muscle-train", cloth="soft-1", target="muscle"
    ),
}


@dataclass(frozen=True, eq=False)
class Equipment:
    """All that a session loads for an arm, and what it makes of it."""

    setup: _Setup
    trained: ClothCheckpoint
    runs: list[Run]  # that the weights learned from
    plans: np.ndarray  # commands of these, starts of the control [N, horizon, D_u]
    images: np.ndarray  # some of their images [N, H, W], bool
    # Beyond this chamfer distance to its reconstruction [pixel], an image is unlike any
    # of these
    usual_distance: float
    # To aim at, `{name: mask [H, W]}`: the stored ones, and recorded ones from large to
    # small
    gallery: dict[str, np.ndarray]

    @classmethod
    def of(cls, arm: str) -> "Equipment":
        """Load what comes with an arm of this name."""
        setup = choose("arm", arm, SETUPS)
        trained = data.load(setup.weights)
        trials = data.load_trials(setup.trials)
        images = reference_images(trials)
        return cls(
            setup=setup,
            trained=trained,
            runs=[trained.to_run(trial) for trial in trials],
            plans=recorded_plans(trials),
            images=images,
            usual_distance=usual_reconstruction_distance(trained.autoencoder, images),
            gallery=data.load_targets() | recorded_targets(images),
        )

    def first_aim(self) -> Aim:
        """The target that comes with the arm."""
        return self.aim_at(choose("target", self.setup.target, self.gallery))

    def first_p(self) -> np.ndarray:
        """The trained p `[D_p]` of the cloth that comes with the arm."""
        return choose("material", self.setup.cloth, self.trained.biases).copy()

    def aim_at(self, mask: ArrayLike) -> Aim:
        """Look at a target `[H, W]` beside the recorded images."""
        return aim_at(mask, self.trained.autoencoder, self.images)

    def drivers(self, arm: Arm, aim: Aim, p: ArrayLike) -> Drivers:
        """Those who drive this arm, whose limits may not be those of the weights."""
        return Drivers(
            self.trained, arm, aim.known, p, plans=self.plans, runs=self.runs
        )

    def tracker(self, p: ArrayLike) -> BiasTracker:
        """An estimation that begins with this p `[D_p]`."""
        return BiasTracker(self.trained, p)
