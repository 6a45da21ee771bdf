"""Do estimation and control work at the same time?

Control starts with the p of a wrong cloth, and p is estimated while the robot works.
What varies is the training.
"""

from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import best_per_period, target_distance
from clothlab.method.rollout import Policy
from clothlab.simulation.cloth import cloth_name
from clothlab.trials import recorded_plans
from studies._grid import Experiment, over
from studies._runs import HEAVY, RECORDINGS, estimating, new_trial, trained

# What control knows of p: it is estimated from a wrong one, stays wrong, or is right
ESTIMATED = "estimated"
WRONG = "wrong"
RIGHT = "right"
KNOWLEDGE = (ESTIMATED, WRONG, RIGHT)
# The cloth in the hand, and the one that it is believed to be, as in the paper
HELD = cloth_name(0.03, 0.10)
BELIEVED = HEAVY


def _run_one(
    model: int,
    weights: str = "torque",
    target: str = "target-1",
    held: str = HELD,
    believed: str = BELIEVED,
    steps: int = 250,
) -> dict[str, Any]:
    """Estimate and control at once, from the p of a cloth that is not in the hand.

    Args:
        model: seed of the training.
        weights: name of the training.
        target: what is to be seen, by name.
        held: cloth in the hand; as steps and the other cloth, the paper's.
        believed: cloth whose p control starts with.
        steps: control steps.
    """
    learned = trained(f"{weights}-{model}")
    mask = data.load_target(target)
    right = learned.biases[held]
    start = learned.biases[believed]

    # A controller that is told p by an estimator
    policy = estimating(learned.controller(mask, start), learned, start)
    trial = new_trial(policy, learned.arm, held, steps, model)

    left = np.linalg.norm(policy.trace[-1] - right)
    distance = target_distance(learned.autoencoder, trial, mask)
    return {
        "trace": np.round(policy.trace, 4),  # p after each step [T, D_p]
        "distance": distance.round(4),  # at each step [T] [s.d. of z]
        # Distance to the right p in the end, over that of the start
        "ratio": float(left / np.linalg.norm(start - right)),
    }


def _run_arm(
    knowledge: str,
    starts: int,
    target: str,
    model: int,
    weights: str = "torque",
    steps: int = 250,
) -> dict[str, Any]:
    """The same task, with p estimated, with the wrong p, or with the right one.

    Args:
        knowledge: what control knows of p: one of `KNOWLEDGE`.
        starts: how many recorded plans a period may begin with, besides the paper's.
        target: what is to be seen, by name.
        model: seed of the training.
        weights: name of the training.
        steps: control steps.
    """
    learned = trained(f"{weights}-{model}")
    mask = data.load_target(target)
    recordings = data.load_trials(RECORDINGS["torque"])
    plans = recorded_plans(recordings, count=starts) if starts else None

    # A controller that knows p, or is told p by an estimator
    p = learned.biases[HELD if knowledge == RIGHT else BELIEVED]
    policy: Policy = learned.controller(mask, p, plans=plans)
    if knowledge == ESTIMATED:
        policy = estimating(policy, learned, p)
    trial = new_trial(policy, learned.arm, HELD, steps, model)
    distance = target_distance(learned.autoencoder, trial, mask)
    return {"distance": distance.round(4)}  # at each step [T] [s.d. of z]


def thirds(table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """How near a run comes in its first and in its last third, `[models]` each.

    Median of the periods' best distances [s.d. of z].
    """
    bests = np.array([best_per_period(distance) for distance in table["distance"]])
    third = bests.shape[1] // 3
    first = np.median(bests[:, :third], axis=1)
    last = np.median(bests[:, -third:], axis=1)
    return first, last


_ARMS = over(
    knowledge=KNOWLEDGE,
    starts=(0, 200),
    target=("target-1", "target-2"),
    model=range(5),
)
EXPERIMENTS = (
    Experiment(
        "joint_estimation_control",
        _run_one,
        over(model=range(5)),
        paper={"weights": "torque-paper"},
    ),
    Experiment("joint_arms", _run_arm, _ARMS, paper={"weights": "torque-paper"}),
)
