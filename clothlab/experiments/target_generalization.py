"""Does iterative learning control realise targets that were not chosen by their results?

Twenty held-out moments of the operator's recordings, and ten drawn shapes. Each has one run of 31 periods.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab.analysis import best_per_period, late_median, target_distance
from clothlab.experiments._grid import Case, Experiment, Tables
from clothlab.experiments._rows import Row
from clothlab.experiments._runs import MIDDLE, new_trial, random_trial, recorded_runs, trained
from clothlab.learning.autoencoder import iou
from clothlab.trials import Trial


def _run_one(target: str, model: int, seed: int, weights: str = "torque", steps: int = 248) -> dict[str, Any]:
    """Iterative learning control beside random commands: best distance and IoU of each period but the first `[P]`."""
    learned, mask = trained(f"{weights}-{model}"), artifacts.load_target(target)
    cloth = MIDDLE if target.startswith("drawn/") else target.split("_")[1]  # it is called SET/ARM_CLOTH_NUMBER
    policy = learned.iterative_controller(mask, cloth, recorded_runs(learned))
    controlled = new_trial(policy, learned.arm, cloth, steps, seed)
    random = random_trial(learned.arm.name, cloth, steps, seed)
    distance, by_chance = (target_distance(learned.autoencoder, trial, mask) for trial in (controlled, random))
    return {
        "cloth": cloth,
        "still": float(distance[0]),
        "best": best_per_period(distance).round(4),
        "random": best_per_period(by_chance).round(4),
        "iou": _best_iou(controlled, mask).round(4),
        "random_iou": _best_iou(random, mask).round(4),
    }


def _best_iou(trial: Trial, mask: np.ndarray) -> np.ndarray:
    """Largest IoU in each period but the first."""
    return 1 - best_per_period(1 - iou(trial.images, mask))


def _cases(sets: Iterable[str] = ("held-out", "drawn"), first: int | None = None, **same: Any) -> list[Case]:
    """Every target of the sets, or the `first` of each; the five trainings take turns."""
    names = [name for each in sets for name in list(artifacts.load_targets(each))[:first]]
    return [{"target": name, "model": k % 5, "seed": 30_000 + k, **same} for k, name in enumerate(names)]


def _rows(tables: Tables) -> list[Row]:
    """Medians over targets."""
    table, name = tables["target_generalization"], "target_generalization"
    drawn = table["target"].str.startswith("drawn/")
    ratio = (table["best"].map(late_median) / table["random"].map(np.median))[~drawn]
    overlap = table["iou"].map(late_median)[drawn]
    label = f"{len(ratio)} held-out targets: distance, last ten periods, over random commands'"
    shapes = f"{len(overlap)} drawn shapes: IoU of the best image of a period, last ten periods, median"
    span = f"{overlap.min():.2f} to {overlap.max():.2f}"
    return [
        Row(f"{name}/held-out/median", f"{label}, median", float(ratio.median()), at_most=0.2),
        Row(f"{name}/held-out/90", f"{label}, 90th percentile", float(ratio.quantile(0.9)), at_most=0.45),
        Row(f"{name}/drawn/iou", shapes, float(overlap.median()), note=span),
    ]


EXPERIMENTS = (Experiment("target_generalization", _run_one, _cases, seconds=120, slow=True, rows=_rows),)
