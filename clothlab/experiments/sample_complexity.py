"""How many recordings are enough?

The same networks after half to twenty times the paper's recordings: prediction, what p tells of the material, and
control. Only the recordings differ: every autoencoder and every model has the same number of updates.
"""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from clothlab import artifacts
from clothlab.analysis import (
    MaterialReadout,
    best_per_period,
    bias_error,
    chamfer_against_z,
    late_median,
    median_best,
    nearest_material,
    target_distance,
)
from clothlab.artifacts import MORE
from clothlab.experiments._grid import Experiment, over, shared
from clothlab.experiments._runs import (
    EVALUATION,
    HEAVY,
    LIGHT,
    MIDDLE,
    RECORDINGS,
    estimate_at_random,
    new_trial,
    random_trial,
)
from clothlab.learning.autoencoder import Autoencoder, AutoencoderTraining, decode, encode, iou, train_autoencoder
from clothlab.learning.control import recorded_plans
from clothlab.learning.dpmpb import ModelTraining, stretches, to_sequences, train_dpmpb
from clothlab.learning.estimation import prediction_loss
from clothlab.learning.trained import Trained
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS
from clothlab.training_configs import TRAINING_CONFIGS
from clothlab.trials import Trial

_TARGETS = {"torque": ("target-1", "target-2"), "muscle": ("muscle",)}  # the first is the one to realise
_MOVED = {"torque": MIDDLE, "muscle": "soft-2"}  # moved at random for the chamfer distances
_HELD = {"torque": (LIGHT, HEAVY), "muscle": ("hard-1", "soft-1")}


def _recordings(arm: str, amount: float) -> list[Trial]:
    """Trials of an amount: below one, the first part of each of the paper's; above, whole repeats of them as well."""
    name = RECORDINGS[arm]
    paper = artifacts.load_trials(name)
    if amount < 1:
        return [trial[: round(amount * len(trial))] for trial in paper]
    repeats = int(amount) - 1
    if not repeats:
        return paper
    try:
        more = artifacts.load_trials(name + MORE, first=repeats * len(paper))
    except KeyError:
        more = []
    wanted, found = (Counter((trial.cloth.name, trial.policy) for trial in trials) for trials in (paper, more))
    if found != Counter({each: repeats * count for each, count in wanted.items()}):
        raise FileNotFoundError(
            f"{amount:g} times the paper's recordings need {repeats * len(paper)} trials in data/trials/{name + MORE}, "
            f"and {len(more)} of them are there: record them with `make data`"
        )
    return paper + more


@shared
def _autoencoder(arm: str, amount: float, updates: int) -> tuple[Autoencoder, int]:
    """The autoencoder of an amount, and its number of updates: whole epochs, as near as they come to `updates`."""
    images, training = np.concatenate([trial.images for trial in _recordings(arm, amount)]), AutoencoderTraining()
    batches = max(1, len(images) // training.batch_size)
    training = replace(training, epochs=max(1, round(updates / batches)))
    model, _ = train_autoencoder(images, training, seed=0, progress=False)
    return model, training.epochs * batches


@shared
def _model(arm: str, amount: float, model: int, autoencoder_updates: int, updates: int) -> tuple[Trained, int]:
    """A model of an amount, trained on what its autoencoder sees, and its number of updates."""
    autoencoder, _ = _autoencoder(arm, amount, autoencoder_updates)
    runs = [to_sequences(autoencoder, trial) for trial in _recordings(arm, amount)]
    training = ModelTraining(sequence_length=TRAINING_CONFIGS[arm].model.sequence_length)
    batches = -(-len(stretches(runs, training.sequence_length, training.stride)[0]) // training.batch_size)
    training = replace(training, epochs=max(1, round(updates / batches)))
    network, biases, trace = train_dpmpb(runs, training, seed=model, progress=False)
    name = f"{arm}-x{amount:g}"
    learned = Trained(f"{name}-{model}", get_arm(arm), autoencoder, network, biases, trace.losses, name)
    return learned, training.epochs * batches


def _run_autoencoder(arm: str, amount: float, updates: int = 4200, moved_steps: int = 450) -> dict[str, Any]:
    """IoU of reconstructions on evaluation trials, and the correlation of log chamfer distance and z distance."""
    autoencoder, done = _autoencoder(arm, amount, updates)
    images = np.concatenate([trial.images for trial in artifacts.load_trials(EVALUATION[arm])])
    trial = random_trial(arm, _MOVED[arm], moved_steps, 25_000)
    pairs = [chamfer_against_z(autoencoder, trial, artifacts.load_target(name)) for name in _TARGETS[arm]]
    return {
        "steps": sum(map(len, _recordings(arm, amount))),
        "updates_done": done,
        "iou": float(iou(decode(autoencoder, encode(autoencoder, images)) > 0.5, images).mean()),
        "correlation": float(np.mean([np.corrcoef(*pair)[0, 1] for pair in pairs])),
    }


def _run_model(
    arm: str,
    amount: float,
    model: int,
    autoencoder_updates: int = 4200,
    updates: int = 1500,
    estimation_steps: int = 200,
    control_steps: int = 248,
) -> dict[str, Any]:
    """What a training is good for: prediction, estimation, control."""
    learned, done = _model(arm, amount, model, autoencoder_updates, updates)
    cloths = {name: CLOTHS[name] for name in learned.biases if name in CLOTHS}  # foams have no C_damp and C_mass
    readout = MaterialReadout.fit(learned.biases, cloths) if cloths else None
    nearest, distance = _estimated(learned, model, estimation_steps)
    return {
        "updates_done": done,
        "prediction": _prediction(learned),  # error of the next state on evaluation trials [s.d.²]
        "r2_damp": float(readout.r2[0]) if readout else None,  # leave one cloth out, of log C_damp
        "r2_mass": float(readout.r2[1]) if readout else None,  # of log C_mass
        "r2_ratio": readout.ratio_r2 if readout else None,  # of their difference
        "nearest": nearest,  # share of nearest p that are right
        "distance": distance,  # to the right p, median [spreads]
        **_controlled(learned, model, control_steps),
    }


def _prediction(learned: Trained) -> float:
    losses = []
    for trial in artifacts.load_trials(EVALUATION[learned.arm.name]):
        run, p = learned.sequences(trial), torch.as_tensor(learned.biases[trial.cloth.name])
        with torch.no_grad():
            losses.append(prediction_loss(learned.model, torch.as_tensor(run.s), torch.as_tensor(run.u), p).item())
    return float(np.mean(losses))


def _estimated(learned: Trained, model: int, steps: int) -> tuple[float, float]:
    right, distances = [], []
    for k, name in enumerate(learned.biases):
        p, _ = estimate_at_random(learned, name, steps, 26_000 + 100 * model + k)
        right.append(nearest_material(p, learned.biases) == name)
        distances.append(bias_error(p, name, learned.biases))
    return float(np.mean(right)), float(np.median(distances))


def _controlled(learned: Trained, model: int, steps: int) -> dict[str, np.ndarray]:
    """For each cloth, median distances of all periods and of the last ten under each controller [s.d. of z].

    All amounts begin with plans of the paper's recordings.
    """
    arm = learned.arm.name
    mask, trials = artifacts.load_target(_TARGETS[arm][0]), artifacts.load_trials(RECORDINGS[arm])
    runs = [learned.sequences(trial) for trial in trials]
    found: dict[str, list[float]] = {}
    for cloth in _HELD[arm]:
        random = random_trial(arm, cloth, steps, 27_000 + model)
        found.setdefault("random", []).append(median_best([target_distance(learned.autoencoder, random, mask)]))
        policies = {
            "paper": learned.controller(mask, cloth),
            "starts": learned.controller(mask, cloth, plans=recorded_plans(trials)),
            "iterative": learned.iterative_controller(mask, cloth, runs),
        }
        for name, policy in policies.items():
            trial = new_trial(policy, arm, cloth, steps, model)
            best = best_per_period(target_distance(learned.autoencoder, trial, mask))
            found.setdefault(f"{name}_best", []).append(float(np.median(best)))
            found.setdefault(f"{name}_last", []).append(late_median(best))
    return {name: np.array(values) for name, values in found.items()}


_AXES: dict[str, Any] = {"arm": ("torque", "muscle"), "amount": (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)}
EXPERIMENTS = (
    Experiment("sample_complexity_autoencoder", _run_autoencoder, over(**_AXES), seconds=600, slow=True),
    Experiment("sample_complexity", _run_model, over(**_AXES, model=range(2)), seconds=900, slow=True),
)
