"""What a sceptic would put in place of p on the Reacher of notebook 16.

A recurrent model without p, trained on long windows; and encoders that see 100 or 200
steps, which are ready to be trained, and were not. `python examples/fair_rivals.py`
trains what the table `another_robot_rivals` has; names of `MODELS` behind it choose
others. Trainings are kept in build/fair_rivals.
"""

import itertools
import sys
from collections.abc import Sequence
from dataclasses import replace

import joblib
import numpy as np
import pandas as pd
import torch
from another_robot import (
    BETWEEN,
    ESTIMATE,
    MATERIALS,
    STEPS,
    TRAINING,
    TrainedRobot,
    control,
    encoded_bias,
    record,
    train_with_context,
)
from torch import Tensor
from tqdm.auto import tqdm

from clothlab._store import write_checksums
from clothlab.method._quick_tanh import quicken
from clothlab.method.data import Run, set_normalisation, windows
from clothlab.method.gauss_newton import best_bias
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from studies import save
from studies._optimise import minimise, seeded

# As many updates as the study's, of half as many windows each
BUDGET = replace(TRAINING, epochs=35, batch_size=50)
LONG = 150  # steps of a long window
BURN_IN = 50  # its first steps, in which the memory fills; they are not in the loss
MODELS: dict[
    str, str | int
] = {  # how each is trained: with p, in long windows, or with so long a context
    "p": "p",
    "long memory": "long memory",
    "context of 100": 100,
    "context of 200": 200,
}


def train_long_memory(runs: list[Run], settings: ModelTraining, seed: int) -> DPMPB:
    """A model without p, whose loss is of what comes after a burn-in.

    A window starts with an empty memory, as a run does; it is so long that the memory
    learns to find out what the robot is like, and to keep it.
    """
    # As many steps in a batch, and as many batches, as with short windows
    times = LONG // settings.sequence_length
    stride = settings.stride * times
    s, u, _ = windows(runs, LONG, stride)
    size = settings.batch_size // times
    with seeded(seed):
        model = quicken(DPMPB(s.shape[-1], u.shape[-1], 0))
        set_normalisation(model, runs)
        nothing = torch.zeros(0)

        def loss(index: Tensor) -> Tensor:
            predicted, _ = model(s[index, :-1], u[index], nothing)
            return model.loss(predicted[:, BURN_IN:], s[index, BURN_IN + 1 :])

        def batches() -> Sequence[Tensor]:
            return torch.randperm(len(s)).split(size)

        each = minimise(
            model.parameters(), loss, batches, settings.epochs, settings.learning_rate
        )
        list(each)
    return model.eval()


def train(
    kind: str, seed: int, steps: int = STEPS, settings: ModelTraining = BUDGET
) -> TrainedRobot:
    """Train one model of the kinds `MODELS`, on the recordings of the study."""
    torch.set_num_threads(1)
    runs = [record(material, steps, 100 + k) for k, material in enumerate(MATERIALS)]
    how = MODELS[kind]
    if how == "p":
        model, biases, _ = train_dpmpb(runs, settings, seed=seed, progress=False)
        return TrainedRobot(model, biases)
    if how == "long memory":
        model = train_long_memory(runs, settings, seed)
        return TrainedRobot(model, {})
    model, encoder = train_with_context(runs, settings, seed, int(how))
    biases = {run.material: encoded_bias(encoder, run) for run in runs}
    return TrainedRobot(model, biases, encoder)


kept = joblib.Memory("build/fair_rivals", verbose=0).cache
train_once = kept(train)
STORED = ("p", "long memory")  # of these; the table has no longer contexts yet
SEEDS = range(1)  # of the trainings
TESTS = range(100, 102)  # seeds of goals and of random commands; the study's are 0 to 4
METHODS = {  # what the study calls them
    "p": "right p",
    "long memory": "without p",
    "context of 100": "context encoder",
    "context of 200": "context encoder",
}


def estimate_at_once(model: DPMPB, run: Run) -> np.ndarray:
    """p `[D_p]` with the lowest loss of a whole run, by Gauss-Newton from zero.

    Step by step, as `estimate_bias` does it, takes ten times as long.
    """
    p, _ = best_bias(model, run, np.zeros(model.bias_size), rounds=20, from_rest=False)
    return p


def reach(kind: str, seed: int, number: int, replan: bool, goals: int) -> np.ndarray:
    """How far from ten goals one training ends with a new material `[10]` [m].

    Args:
        kind: of the model.
        seed: of its training.
        number: of the material, which no training saw.
        replan: whether it plans in each step.
        goals: seed of the goals and of the commands before them.
    """
    trained = train_once(kind, seed)
    material = BETWEEN[number]
    if kind == "p":
        seen = record(material, ESTIMATE, goals)
        p = estimate_at_once(trained.model, seen)
        trained = TrainedRobot(trained.model, {str(material): p})
    return control(trained, METHODS[kind], material, replan, goals)


def main(kinds: Sequence[str] = STORED) -> None:
    """Each model with new materials and new goals, all combinations."""
    numbers = range(len(BETWEEN))
    cases = list(itertools.product(kinds, SEEDS, numbers, (False, True), TESTS))
    rows = []
    for kind, seed, number, replan, goals in tqdm(cases):
        row = {"model": kind, "seed": seed, "replan": replan, "goals": goals}
        row |= {"payload": BETWEEN[number].payload}
        row |= {"friction": BETWEEN[number].friction}
        row["distance"] = kept(reach)(kind, seed, number, replan, goals)
        rows.append(row)
    save(pd.DataFrame(rows), "another_robot_rivals")
    write_checksums()


if __name__ == "__main__":
    main(sys.argv[1:] or STORED)
