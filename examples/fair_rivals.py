"""What a sceptic would put in place of p on the Reacher of notebook 16.

A recurrent model without p, trained on windows as long as it is run for; encoders that
see 30, 100 or 200 steps; and a policy learned by trial and error (SAC) that is told
nothing, the estimated p, or both properties. `python examples/fair_rivals.py` trains
them and writes the tables `another_robot_rivals` and `another_robot_policies`;
trainings are kept in build/fair_rivals.
"""

from collections.abc import Sequence
from dataclasses import replace

import joblib
import torch
from another_robot import (
    MATERIALS,
    STEPS,
    TRAINING,
    TrainedRobot,
    encoded_bias,
    record,
    train_with_context,
)
from torch import Tensor

from clothlab.method._optimise import minimise, seeded
from clothlab.method._quick_tanh import quicken
from clothlab.method.data import Run, set_normalisation, windows
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb

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


train_once = joblib.Memory("build/fair_rivals", verbose=0).cache(train)
SEEDS = range(2)  # of the trainings
