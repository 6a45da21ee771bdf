"""Which commands produce the target image?

Control with the right p, against random commands. What varies is the target and the
cloth.
"""

from typing import Any

import numpy as np

from clothlab import data
from clothlab.analysis import target_distance
from clothlab.method.autoencoder import encode
from clothlab.method.iterative import nearest_plans
from studies._grid import Experiment, over
from studies._runs import (
    HEAVY,
    LIGHT,
    RECORDINGS,
    empty_distance,
    new_trial,
    random_trial,
    trained,
)


def _run_one(
    target: str, cloth: str, model: int, weights: str = "torque", steps: int = 250
) -> dict[str, Any]:
    """Distance at each step `[T]` under control and under random commands [s.d. of z].

    Besides, those of a hanging cloth, of an empty image, and of the nearest recording.

    Args:
        target, cloth: of the task, by name.
        model: seed of the training.
        weights: name of the training.
        steps: control steps; the paper has 250.
    """
    learned = trained(f"{weights}-{model}")
    mask = data.load_target(target)

    # A run under control, and one with random commands
    controller = learned.controller(mask, cloth)
    control = new_trial(controller, learned.arm, cloth, steps, model)
    random = random_trial(learned.arm.name, cloth, steps, seed=7000 + model)

    # How near this cloth came to the target in the paper's amount of recordings
    trials = data.load_trials(RECORDINGS[learned.arm.name])
    runs = [learned.to_run(trial) for trial in trials if trial.cloth.name == cloth]
    z_ref = encode(learned.autoencoder, mask)
    recorded = nearest_plans(runs, z_ref, count=1).distance[0] if runs else np.nan

    controlled = target_distance(learned.autoencoder, control, mask)
    at_random = target_distance(learned.autoencoder, random, mask)
    return {
        "still": float(controlled[0]),  # every run begins with the cloth hanging still
        "empty": empty_distance(learned.autoencoder, mask),
        "recorded": float(recorded),
        "control": controlled.round(4),
        "random": at_random.round(4),
    }


_CASES = over(target=("target-1", "target-2"), cloth=(LIGHT, HEAVY), model=range(5))
EXPERIMENTS = (
    Experiment("control", _run_one, _CASES, paper={"weights": "torque-paper"}),
)
