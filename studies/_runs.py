"""What several experiments need: cloths, tasks, trained weights, trials, figures.

Weights and recordings are loaded once in each process, trials are on fresh scenes.
"""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cache
from itertools import chain
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab import data
from clothlab._validation import HEIGHT, WIDTH, check_array, check_mask, choose
from clothlab.analysis import best_per_period, spread, target_distance
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.cloth_task import EstimatingPolicy
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, estimate_bias, prediction_loss
from clothlab.method.iterative import nearest_plans
from clothlab.method.model import DPMPB
from clothlab.method.rollout import Policy
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import SHEETS, Cloth, cloth_name, foam, get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import chamfer_distance, iou
from clothlab.trials import Trial, rollout, to_run
from clothlab.weights import ClothCheckpoint
from studies.training_configs import TRAINING_CONFIGS, TrainingConfig

# The paper's amount
RECORDINGS = {
    arm: TRAINING_CONFIGS[f"{arm}-paper"].recordings[0] for arm in ("torque", "muscle")
}
# Trials that no training sees
EVALUATION = {"torque": "evaluation", "muscle": "muscle-evaluation"}
LIGHT = cloth_name(0.03, 0.05)
MIDDLE = cloth_name(0.05, 0.10)
HEAVY = cloth_name(0.07, 0.15)
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
    (0.045, 0.07),
    (0.06, 0.13),
    (0.036, 0.11),
    (0.055, 0.065),
    (0.065, 0.085),
    (0.04, 0.125),
    (0.026, 0.055),
    (0.075, 0.16),
)
_SHEETS = (  # kind, number, thickness [mm]; the last two are extremes
    ("soft", 2, 4),
    ("soft", 3, 5),
    ("hard", 1, 3),
    ("hard", 2, 1.5),
    ("hard", 2, 2.5),
    ("hard", 3, 1.5),
    ("soft", 1, 7),
    ("hard", 4, 2),
)


def _new_foam(kind: str, number: int, thickness: float) -> Cloth:
    """A foam of another thickness [mm]."""
    sheet = replace(SHEETS[kind], thickness=thickness / 1e3)
    return replace(foam(kind, number, sheet), name=f"{kind}-{number}-{thickness}mm")


NEW = {
    "torque": [Cloth(f"damp{c}-mass{m}", damping=c, mass=m) for c, m in _MATERIALS],
    "muscle": [_new_foam(*sheet) for sheet in _SHEETS],
}
SAMPLES = 50  # of the hand's motion in each step
_LATENT = 3  # numbers of z, which lie first in a state
_LONGEST = 100  # periods that a plan is replayed


@cache
def trained(name: str) -> ClothCheckpoint:
    """`data.load`, once in each process."""
    return data.load(name)


@cache
def _encoded(autoencoder_name: str, recordings: str) -> list[Run]:
    autoencoder, _ = data.load_autoencoder(autoencoder_name)
    return [to_run(autoencoder, trial) for trial in data.load_trials(recordings)]


def recorded_runs(learned: ClothCheckpoint) -> list[Run]:
    """The recordings that weights learned from, as their model sees them.

    They are encoded once in each process.
    """
    runs: list[Run] = []
    for name in config_of(learned).recordings:
        runs += _encoded(learned.autoencoder_name, name)
    return runs


def find_cloth(name: str) -> Cloth:
    """A new cloth, or a recorded one."""
    new = {each.name: each for each in chain(*NEW.values())}
    return new[name] if name in new else get_cloth(name)


def own_cloth(target: str) -> str:
    """The recorded cloth with which a target of a set is tried.

    That is its own, or the middle one for targets that somebody drew.
    """
    if target.startswith("drawn/"):
        return MIDDLE
    _, cloth, _ = target.split("_")  # it is called SET/ARM_CLOTH_NUMBER
    return cloth


def replay_nearest(
    runs: Sequence[Run], autoencoder: Autoencoder, target: ArrayLike
) -> Policy:
    """The plan of some runs that came nearest to a target, again and again."""
    plan = nearest_plans(runs, encode(autoencoder, target), count=1).u[0]
    return ReplayPolicy(np.tile(plan, (_LONGEST, 1)))


def new_trial(
    policy: Policy, arm: Arm | str, cloth: Cloth | str, steps: int, seed: int
) -> Trial:
    """A policy on a fresh scene.

    Args:
        policy: chooses the commands.
        arm: the arm, or its name.
        cloth: the cloth, or its name.
        steps: control steps.
        seed: of the policy's random numbers.
    """
    with closing(ClothEnv(arm, cloth)) as env:
        return rollout(env, policy, steps, seed=seed)


def random_trial(arm: str, cloth: Cloth | str, steps: int, seed: int) -> Trial:
    """Random commands on a fresh scene."""
    return new_trial(RandomPolicy(arm), arm, cloth, steps, seed)


def estimate_at_random(
    learned: ClothCheckpoint, cloth: Cloth | str, steps: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate p of a cloth from 0 while it is moved at random.

    Returned are the final p `[D_p]`, and its trace `[T, D_p]`.
    """
    trial = random_trial(learned.arm.name, cloth, steps, seed)
    return estimate_bias(learned.model, learned.to_run(trial))


def estimating(
    policy: Policy, learned: ClothCheckpoint, p: np.ndarray
) -> EstimatingPolicy:
    """The policy, with an estimator of p beside it that starts from p `[D_p]`."""
    estimator = BiasEstimator(learned.model, p)
    return EstimatingPolicy(policy, estimator, learned.autoencoder)


@torch.no_grad()
def loss_of_run(model: DPMPB, run: Run, p: Tensor) -> np.ndarray:
    """Loss of predicting a run with one p `[D_p]`, `[]`, or with several `[B, D_p]`."""
    s = torch.as_tensor(run.s)
    u = torch.as_tensor(run.u)
    return prediction_loss(model, s, u, p).numpy()


@torch.no_grad()
def errors_ahead(
    model: nn.Module,
    run: Run,
    p: Tensor,
    starts: Iterable[int],
    horizon: int,
    memory: Any = None,
) -> np.ndarray:
    """Distances in z of closed loops to the truth [s.d.], `[N, horizon]`.

    Args:
        model: called as `DPMPB` is.
        run: what was recorded before a start fills the memory.
        p: parametric bias `[D_p]`.
        starts: steps from which predictions come back as states.
        horizon: how far ahead [step].
        memory: before the first step of the run; empty by default.
    """
    s = torch.as_tensor(run.s)
    u = torch.as_tensor(run.u)
    errors = []
    for start in starts:
        # What was before fills the memory; then predictions come back
        remembered = memory
        if start:
            _, remembered = model(s[None, :start], u[None, :start], p, memory)
        now = s[None, start : start + 1]
        predicted = []
        for t in range(start, start + horizon):
            now, remembered = model(now, u[None, t : t + 1], p, remembered)
            predicted.append(now[0, 0])

        # In z alone
        gap = torch.stack(predicted) - s[start + 1 : start + 1 + horizon]
        errors.append(gap[:, :_LATENT].norm(dim=1).numpy())
    return np.stack(errors)


def bias_error(p: ArrayLike, material: str, biases: dict[str, np.ndarray]) -> float:
    """Distance of p `[D_p]` to the trained p of a material, over the spread of all."""
    right = choose("material", material, biases)
    distance = np.linalg.norm(check_array("p", p, np.shape(right)) - right)
    return float(distance) / spread(biases)


def chamfer_against_z(
    autoencoder: Autoencoder, trial: Trial, target: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Log chamfer distance [log pixel] and ‖z_ref - z‖₂ to a target, each `[N]`.

    Steps with no cloth in view, or exactly the target's image, have no logarithm and
    are left out.
    """
    chamfer = np.full(len(trial), np.nan)
    for k, image in enumerate(trial.images):
        if image.any():
            chamfer[k] = chamfer_distance(image, target)
    seen = chamfer > 0
    return np.log(chamfer[seen]), target_distance(autoencoder, trial, target)[seen]


def best_iou(trial: Trial, mask: ArrayLike) -> np.ndarray:
    """Largest IoU of an image with a mask in each period, `[P]`."""
    return 1 - best_per_period(1 - iou(trial.images, mask))


def median_best(runs: Iterable[ArrayLike]) -> float:
    """Median over periods and runs of the smallest distance in a period."""
    return float(
        np.median(np.concatenate([best_per_period(distances) for distances in runs]))
    )


def config_of(learned: ClothCheckpoint) -> TrainingConfig:
    """The configuration with which stored weights were trained.

    Or others on top of the same autoencoder.
    """
    return choose("training configuration", learned.autoencoder_name, TRAINING_CONFIGS)


def empty_distance(autoencoder: Autoencoder, target: ArrayLike) -> float:
    """Distance ‖z_ref - z‖₂ of an image without cloth to a target [s.d. of z].

    The target is a mask `[H, W]`.
    """
    z_ref = encode(autoencoder, check_mask(target))
    z = encode(autoencoder, np.zeros((HEIGHT, WIDTH), bool))
    return float(np.linalg.norm(z_ref - z))
