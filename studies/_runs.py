"""What several experiments need: cloths and tasks, trained weights, loaded once, and
trials on fresh scenes.
"""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from functools import cache
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from clothlab import data
from clothlab._validation import check_array, choose
from clothlab.analysis import best_per_period, spread, target_distance
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.masks import iou
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias
from clothlab.method.policy import Policy
from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import SHEETS, Cloth, cloth_name, foam, get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import chamfer_distance
from clothlab.trials import Trial, rollout, to_run
from studies.training_configs import TRAINING_CONFIGS, TrainingConfig

# The paper's amount
RECORDINGS = {
    arm: TRAINING_CONFIGS[f"{arm}-paper"].recordings[0] for arm in ("torque", "muscle")
}
# Trials that no training sees
EVALUATION = {"torque": "evaluation", "muscle": "muscle-evaluation"}
LIGHT, MIDDLE, HEAVY = (
    cloth_name(0.03, 0.05),
    cloth_name(0.05, 0.10),
    cloth_name(0.07, 0.15),
)
TASKS = (  # arm, target, cloth
    *(
        ("torque", target, cloth)
        for target in ("target-1", "target-2")
        for cloth in (LIGHT, HEAVY)
    ),
    *(("muscle", "muscle", cloth) for cloth in ("hard-1", "soft-1")),
)
# C_damp [N s/m], C_mass [kg] of cloths that no training saw: six between the trained
# ones, two beyond
_MATERIALS = (
    *(
        (0.045, 0.07),
        (0.06, 0.13),
        (0.036, 0.11),
        (0.055, 0.065),
        (0.065, 0.085),
        (0.04, 0.125),
    ),
    *((0.026, 0.055), (0.075, 0.16)),
)
_SHEETS = (  # kind, number, thickness [mm]; the last two are extremes
    *(
        ("soft", 2, 4),
        ("soft", 3, 5),
        ("hard", 1, 3),
        ("hard", 2, 1.5),
        ("hard", 2, 2.5),
        ("hard", 3, 1.5),
    ),
    *(("soft", 1, 7), ("hard", 4, 2)),
)
NEW = {
    "torque": [Cloth(f"damp{c}-mass{m}", damping=c, mass=m) for c, m in _MATERIALS],
    "muscle": [
        replace(
            foam(kind, n, replace(SHEETS[kind], thickness=t / 1e3)),
            name=f"{kind}-{n}-{t}mm",
        )
        for kind, n, t in _SHEETS
    ],
}
SAMPLES = 50  # of the hand's motion in each step


@cache
def trained(name: str) -> ClothCheckpoint:
    """`data.load`, once in each process."""
    return data.load(name)


@cache
def _encoded(autoencoder_name: str, recordings: str) -> list[Run]:
    autoencoder, _ = data.load_autoencoder(autoencoder_name)
    return [to_run(autoencoder, trial) for trial in data.load_trials(recordings)]


def recorded_runs(learned: ClothCheckpoint) -> list[Run]:
    """The recordings that weights learned from, as their model sees them, encoded once
    in each process.
    """
    return [
        run
        for name in config_of(learned).recordings
        for run in _encoded(learned.autoencoder_name, name)
    ]


def find_cloth(name: str) -> Cloth:
    """A new cloth, or a recorded one."""
    return {each.name: each for each in chain(*NEW.values())}.get(name) or get_cloth(
        name
    )


def own_cloth(target: str) -> str:
    """The recorded cloth with which a target of a set is tried: its own, which its name
    says, or the middle one.
    """
    # It is called SET/ARM_CLOTH_NUMBER
    return MIDDLE if target.startswith("drawn/") else target.split("_")[1]


def new_trial(
    policy: Policy, arm: Arm | str, cloth: Cloth | str, steps: int, seed: int
) -> Trial:
    """A policy on a fresh scene."""
    with closing(ClothEnv(arm, cloth)) as env:
        return rollout(env, policy, steps, seed=seed)


def random_trial(arm: str, cloth: Cloth | str, steps: int, seed: int) -> Trial:
    """Random commands on a fresh scene."""
    return new_trial(RandomPolicy(arm), arm, cloth, steps, seed)


def estimate_at_random(
    learned: ClothCheckpoint, cloth: Cloth | str, steps: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate p of a cloth from 0 while it is moved at random: the final p `[D_p]`,
    and its trace `[T, D_p]`.
    """
    trial = random_trial(learned.arm.name, cloth, steps, seed)
    return estimate_bias(learned.model, learned.to_run(trial))


def bias_error(p: ArrayLike, material: str, biases: dict[str, np.ndarray]) -> float:
    """Distance of `p` `[D_p]` to the trained p of a material, over the `spread` of all."""
    right = choose("material", material, biases)
    return float(np.linalg.norm(check_array("p", p, np.shape(right)) - right)) / spread(
        biases
    )


def chamfer_against_z(
    autoencoder: Autoencoder, trial: Trial, target: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Log chamfer distance [log pixel] and ‖z_ref - z‖₂ to a target, each `[N]`.

    Steps with no cloth in view, or exactly the target's image, have no logarithm and
    are left out.
    """
    chamfer = np.array(
        [
            chamfer_distance(image, target) if image.any() else np.nan
            for image in trial.images
        ]
    )
    seen = chamfer > 0
    return np.log(chamfer[seen]), target_distance(autoencoder, trial, target)[seen]


def best_iou(trial: Trial, mask: ArrayLike) -> np.ndarray:
    """Largest IoU of an image with a mask in each period but the first, `[P]`."""
    return 1 - best_per_period(1 - iou(trial.images, mask))


def median_best(runs: Iterable[ArrayLike]) -> float:
    """Median over periods and runs of the smallest distance in a period."""
    return float(
        np.median(np.concatenate([best_per_period(distances) for distances in runs]))
    )


def config_of(learned: ClothCheckpoint) -> TrainingConfig:
    """The configuration with which stored weights were trained, or others on top of the
    same autoencoder.
    """
    return choose("training configuration", learned.autoencoder_name, TRAINING_CONFIGS)
