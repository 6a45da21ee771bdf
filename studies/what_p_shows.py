"""What do the numbers of p depend on? Controls of notebook 05.

`similar_cloths`: which change of a cloth changes its motion? `twins`: two trials of
each cloth get a p each. `bias_size`: how many numbers should p have? `plain_training`:
what becomes of p without overlapping windows and larger steps for p? `recorded_by`:
does it matter whether random commands or an operator moved the cloth?
"""

from contextlib import closing
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import torch

from clothlab import data
from clothlab._validation import choose
from clothlab.analysis import best_per_period, crossed_interval, target_distance
from clothlab.method.autoencoder import encode
from clothlab.method.data import Run
from clothlab.method.model import PredictiveModel
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.policies import OperatorPolicy
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import (
    EVALUATION,
    LIGHT,
    config_of,
    loss_of_run,
    new_trial,
    recorded_runs,
    trained,
)

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
# Who moved the cloth
RECORDED_BY = ("random", "operator", "both")


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


def _recorded_by_one(
    recorded_by: str, model: int, epochs: int = 300, steps: int = 250
) -> dict[str, Any]:
    """Half of the paper's amount of recordings, chosen by who moved the cloth.

    Args:
        recorded_by: one of `RECORDED_BY`.
        model: seed of the training.
        epochs: of the training.
        steps: of each run under control.

    Returns: what `_judged` says; the loss on new `random` runs and on those of an
        `operator`; and the best distance of a period, median, over that of the hanging
        light cloth, under the paper's controller, for both targets `[2]`.
    """
    stored = trained(f"torque-paper-{model}")
    runs = _half_of(recorded_runs(stored), recorded_by)
    settings = replace(config_of(stored).model, epochs=epochs)
    network, biases, curve = train_dpmpb(runs, settings, seed=model, progress=False)

    # What it predicts of either kind of motion, and what it can do
    by_policy: dict[str, list[float]] = {"random": [], "operator": []}
    for trial in data.load_trials(EVALUATION["torque"]):
        run = stored.to_run(trial)
        p = torch.as_tensor(biases[run.material])
        by_policy[trial.policy].append(float(loss_of_run(network, run, p)))
    learned = replace(stored, model=network, biases=biases)
    near = []
    for target in ("target-1", "target-2"):
        mask = data.load_target(target)
        controller = learned.controller(mask, LIGHT)
        trial = new_trial(controller, learned.arm, LIGHT, steps, model)
        distance = target_distance(learned.autoencoder, trial, mask)
        near.append(np.median(best_per_period(distance)) / distance[0])
    losses = {kind: round(float(np.mean(each)), 5) for kind, each in by_policy.items()}
    found = _judged(network, biases, curve)
    return found | losses | {"control": np.round(near, 4)}


def _half_of(runs: list[Run], recorded_by: str) -> list[Run]:
    """One of the two runs of each cloth, or the first half of both."""
    if recorded_by == "both":
        return [run[: len(run) // 2] for run in runs]
    halves = {"operator": runs[::2], "random": runs[1::2]}
    return choose("recording", recorded_by, halves)


def _judged(
    model: PredictiveModel, biases: dict[str, np.ndarray], losses: np.ndarray
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


def _held_out(model: PredictiveModel, biases: dict[str, np.ndarray]) -> float:
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


def _twins_one(model: int, epochs: int = 20) -> dict[str, Any]:
    """A short training with a p for each of the paper's 18 trials: p `[9, 2, D_p]`.

    The second axis is the operator's trial, then that of random commands.

    Args:
        model: seed of the training.
        epochs: of the training.
    """
    runs: list[Run] = []
    for n, run in enumerate(recorded_runs(trained("torque-paper-0"))):
        runs.append(replace(run, material=f"{run.material}, trial {n % 2}"))
    settings = replace(_SHORT, epochs=epochs)
    _, biases, _ = train_dpmpb(runs, settings, seed=model, progress=False)
    p = np.array(list(biases.values()))
    return {"p": p.reshape(len(CLOTHS), 2, -1).round(4)}


def _recorded_by_rows(tables: Tables) -> list[Row]:
    """What a model of one kind of motion loses on the other kind."""
    table = tables["recorded_by"].set_index("recorded_by")
    rows = []
    for kind, other in (("random", "operator"), ("operator", "random")):
        alone = table.loc[kind].set_index("model")[other]
        both = table.loc["both"].set_index("model")[other]
        ratio, low, high = crossed_interval((alone / both).to_numpy()[:, None])
        row = Row(
            f"recorded_by/{kind}",
            f"recorded with {_MOVED[kind]} alone: error with {_MOVED[other]}, over "
            "that of a model with half of both",
            ratio,
            interval=(low, high),
            of_paper=True,
        )
        rows.append(row)
    return rows


_MOVED = {"random": "random commands", "operator": "an operator"}
_ABOUT = """
Who should move the cloth while it is recorded?

The paper records each cloth at random and by hand (paper, "Simulation Experiment").
Here three trainings each have half of that: random commands alone, the operator alone,
or the first half of both; all are tried on new motions of both kinds.
"""
EXPERIMENTS = (
    Experiment(
        "similar_cloths",
        _compare_one,
        over(change=CHANGES, seed=range(46, 52)),
        seconds=1,
    ),
    Experiment("twins", _twins_one, over(model=range(3)), seconds=10),
    Experiment(
        "bias_size", _size_one, over(bias_size=range(4), model=range(3)), seconds=12
    ),
    Experiment(
        "plain_training", _plain_one, over(recipe=RECIPES, model=range(2)), seconds=25
    ),
    Experiment(
        "recorded_by",
        _recorded_by_one,
        over(recorded_by=RECORDED_BY, model=range(3)),
        seconds=100,
        rows=_recorded_by_rows,
        about=_ABOUT,
    ),
)
