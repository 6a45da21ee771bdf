"""Does z describe the cloth?

Images of recordings that no training has seen, and their reconstructions; and two distances of an image to a target:
the chamfer distance of the outlines and that of z (paper, "Simulation Experiment": the figure on chamfer distances).
"""

from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab.experiments._grid import Experiment, Tables, over
from clothlab.experiments._rows import Row
from clothlab.experiments._runs import MIDDLE, chamfer_against_z, random_trial
from clothlab.learning.autoencoder import decode, encode, iou


def _reconstruct(weights: str = "torque", trials: str = "evaluation") -> dict[str, Any]:
    """Intersection over union of recorded images and their reconstructions."""
    autoencoder, _ = artifacts.load_autoencoder(weights)
    images = np.concatenate([trial.images for trial in artifacts.load_trials(trials)])
    overlap, visible = iou(decode(autoencoder, encode(autoencoder, images)) > 0.5, images), images.any(axis=(1, 2))
    return {
        "iou": float(overlap.mean()),
        "iou_visible": float(overlap[visible].mean()),  # over the images in which cloth is visible
        "iou_deviation": float(overlap.std()),
    }


def _compare(target: str, weights: str = "torque", steps: int = 450) -> dict[str, Any]:
    """Log chamfer distance [log pixel] and distance of z [s.d. of z] to a target, both `[N]`, and their correlation."""
    autoencoder, _ = artifacts.load_autoencoder(weights)
    trial = random_trial("torque", MIDDLE, steps, seed=5000)
    log_chamfer, z_distance = chamfer_against_z(autoencoder, trial, artifacts.load_target(target))
    correlation = float(np.corrcoef(log_chamfer, z_distance)[0, 1])
    return {"correlation": correlation, "log_chamfer": log_chamfer.round(4), "z_distance": z_distance.round(4)}


def _reconstruction_rows(tables: Tables) -> list[Row]:
    (overlap,) = tables["reconstruction"]["iou"]
    label = "image and reconstruction, recordings not trained on: intersection over union, mean"
    return [Row("reconstruction", label, overlap, at_least=0.85)]


def _chamfer_rows(tables: Tables) -> list[Row]:
    """Whether z orders images as their outlines do."""
    (correlation,) = tables["chamfer"].query("target == 'target-2'")["correlation"]
    label = "correlation of z distance and log chamfer distance, target-2"
    return [Row("chamfer", label, correlation, paper="0.811", above=0.7, at_least=0.85)]


_PAPER, _TARGETS = {"weights": "torque-paper"}, ("target-1", "target-2")
EXPERIMENTS = (
    Experiment("reconstruction", _reconstruct, over(), seconds=10, paper=_PAPER, rows=_reconstruction_rows),
    Experiment("chamfer", _compare, over(target=_TARGETS), seconds=8, paper=_PAPER, rows=_chamfer_rows),
)
