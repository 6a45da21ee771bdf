"""What do the numbers of p depend on? Controls of notebook 05.

`similar_cloths`: which change of a cloth changes its motion? `bias_size`: how many
numbers should p have? `plain_training`: what becomes of p without overlapping windows
and larger steps for p?
"""

from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import torch

from clothlab import data
from clothlab._validation import choose
from clothlab.method.autoencoder import encode
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.policies import OperatorPolicy
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies._grid import Experiment, over
from studies._runs import EVALUATION, loss_of_run, recorded_runs, trained

_MIDDLE = Cloth("middle", damping=0.05, mass=0.10)
# Factors of drag, of mass, and of springs and their dampers. The first two leave the
# terminal speed as it is, all others double or halve it.
CHANGES = {
    "mass and drag × 2": (2.0, 2.0, 1.0),
    "everything × 2": (2.0, 2.0, 2.0),
    "drag × √2, mass ÷ √2": (2**0.5, 0.5**0.5, 1.0),
    "drag × 2": (2.0, 1.0, 1.0),
    "mass × 2": (1.0, 2.0, 1.0),
}
# A short training: 260 steps of Adam, enough for the map of p
_SHORT = ModelTraining(
    epochs=20, batch_size=64, learning_rate=4e-3, bias_learning_rate=2e-2
)
# Without overlapping windows and larger steps for p
_PLAIN = ModelTraining(stride=30, bias_learning_rate=2e-3)
RECIPES = ("as stored", "plain")


def changed(change: str) -> Cloth:
    """The middle cloth after a change."""
    drag, mass, springs = choose("change", change, CHANGES)
    return replace(
        _MIDDLE,
        name=change,
        damping=drag * _MIDDLE.damping,
        mass=mass * _MIDDLE.mass,
        stiffness=springs * _MIDDLE.stiffness,
        bending=springs * _MIDDLE.bending,
        spring_damping=springs * _MIDDLE.spring_damping,
    )


@cache
def _swing(cloth: Cloth, steps: int, seed: int) -> np.ndarray:
    """z of a cloth that the scripted operator swings, `[T, D_z]`."""
    learned = trained("torque-0")
    with closing(ClothEnv(learned.arm, cloth)) as env:
        trial = rollout(env, OperatorPolicy(env.arm), steps, seed=seed)
    return encode(learned.autoencoder, trial.images)


def _compare_one(change: str, seed: int, steps: int = 60) -> dict[str, Any]:
    """Distance in z from the middle cloth after each of the same commands, `[T]`.

    Args:
        change: one of `CHANGES`.
        seed: of the commands.
        steps: control steps.
    """
    middle = _swing(_MIDDLE, steps, seed)
    other = _swing(changed(change), steps, seed)
    return {"gap": np.linalg.norm(other - middle, axis=1).round(3)}


def _size_one(bias_size: int, model: int, epochs: int = 20) -> dict[str, Any]:
    """A short training on the paper's amount of recordings, with so many numbers in p.

    Args:
        bias_size: D_p, 0 to 3.
        model: seed of the training.
        epochs: of the training.

    Returns: what `_judged` says.
    """
    runs = recorded_runs(trained("torque-paper-0"))
    settings = replace(_SHORT, bias_size=bias_size, epochs=epochs)
    network, biases, losses = train_dpmpb(runs, settings, seed=model, progress=False)
    return _judged(network, biases, losses)


def _plain_one(recipe: str, model: int, epochs: int = 300) -> dict[str, Any]:
    """The paper's amount of recordings, with or without the settings of this project.

    Args:
        recipe: one of `RECIPES`: the stored weights, or a plain training.
        model: seed of the training.
        epochs: of the plain training.

    Returns: what `_judged` says.
    """
    stored = trained(f"torque-paper-{model}")
    if choose("recipe", recipe, dict.fromkeys(RECIPES, recipe)) == "as stored":
        return _judged(stored.model, stored.biases, stored.losses)
    settings = replace(_PLAIN, epochs=epochs)
    network, biases, losses = train_dpmpb(
        recorded_runs(stored), settings, seed=model, progress=False
    )
    return _judged(network, biases, losses)


def _judged(
    model: DPMPB, biases: dict[str, np.ndarray], losses: np.ndarray
) -> dict[str, Any]:
    """What a training came to.

    The `loss` of its last epoch; `held_out`, that of runs that no training saw, with
    the p of their cloth; R² of what a straight map of eight cloths reads off the ninth
    p, of log terminal speed, log C_damp and log C_mass `[3]`; the trained `p`
    `[9, D_p]`.
    """
    p = np.array([biases[name] for name in CLOTHS])
    return {
        "loss": round(float(losses[-1]), 5),
        "held_out": round(_held_out(model, biases), 5),
        "r2": _read_off(p).round(3),
        "p": p.round(4),
    }


def _held_out(model: DPMPB, biases: dict[str, np.ndarray]) -> float:
    """Mean loss of evaluation runs, each with the p of its cloth."""
    learned = trained("torque-paper-0")
    losses = []
    for trial in data.load_trials(EVALUATION["torque"]):
        run = learned.to_run(trial)
        p = torch.as_tensor(biases[run.material])
        losses.append(float(loss_of_run(model, run, p)))
    return float(np.mean(losses))


def _read_off(p: np.ndarray) -> np.ndarray:
    """R² of what a straight map of the other cloths reads off each p, `[3]`."""
    if p.shape[1] == 0:
        return np.zeros(3)  # without p, nothing is read off it
    # Slow to import
    from sklearn.linear_model import LinearRegression
    from sklearn.metrics import r2_score
    from sklearn.model_selection import LeaveOneOut, cross_val_predict

    logs = np.log([(cloth.damping, cloth.mass) for cloth in CLOTHS.values()])
    wanted = np.column_stack([logs[:, 1] - logs[:, 0], logs])
    found = cross_val_predict(LinearRegression(), p, wanted, cv=LeaveOneOut())
    return r2_score(wanted, found, multioutput="raw_values")


EXPERIMENTS = (
    Experiment(
        "similar_cloths", _compare_one, over(change=CHANGES, seed=range(46, 52))
    ),
    Experiment("bias_size", _size_one, over(bias_size=range(4), model=range(3))),
    Experiment("plain_training", _plain_one, over(recipe=RECIPES, model=range(2))),
)
