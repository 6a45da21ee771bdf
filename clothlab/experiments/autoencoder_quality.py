"""Does z describe the cloth?

Images of recordings that no training has seen, and their reconstructions; and two distances of an image to a target:
the chamfer distance of the outlines and that of z (paper, "Simulation Experiment": the figure on chamfer distances).
"""

from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab.analysis import chamfer_against_z
from clothlab.experiments._grid import Experiment, Tables, over
from clothlab.experiments._rows import Row
from clothlab.experiments._runs import random_trial
from clothlab.learning.autoencoder import Autoencoder, decode, encode, iou
from clothlab.simulation.cloth import cloth_name

MOVED = cloth_name(0.05, 0.10)  # moved at random for the chamfer distances


def reconstruction(autoencoder: Autoencoder, trials: str = "evaluation") -> dict[str, Any]:
    """Intersection over union of recorded images and their reconstructions."""
    images = np.concatenate([trial.images for trial in artifacts.load_trials(trials)])
    overlap, visible = iou(decode(autoencoder, encode(autoencoder, images)) > 0.5, images), images.any(axis=(1, 2))
    return {
        "iou": float(overlap.mean()),
        "iou_visible": float(overlap[visible].mean()),  # over the images in which cloth is visible
        "iou_deviation": float(overlap.std()),
    }


def chamfer(
    autoencoder: Autoencoder, target: str, arm: str = "torque", cloth: str = MOVED, steps: int = 450, seed: int = 5000
) -> dict[str, Any]:
    """Log chamfer distance [log pixel] and distance of z [s.d. of z] to a target, both `[N]`, and their correlation."""
    trial = random_trial(arm, cloth, steps, seed)
    log_chamfer, z_distance = chamfer_against_z(autoencoder, trial, artifacts.load_target(target))
    correlation = float(np.corrcoef(log_chamfer, z_distance)[0, 1])
    return {"correlation": correlation, "log_chamfer": log_chamfer.round(4), "z_distance": z_distance.round(4)}


def reconstruct_one(weights: str = "torque", trials: str = "evaluation") -> dict[str, Any]:
    """`reconstruction` by a stored autoencoder."""
    return reconstruction(artifacts.load_autoencoder(weights)[0], trials)


def compare_one(target: str, weights: str = "torque", steps: int = 450) -> dict[str, Any]:
    """`chamfer` of a stored autoencoder."""
    return chamfer(artifacts.load_autoencoder(weights)[0], target, steps=steps)


def reconstruction_rows(tables: Tables) -> list[Row]:
    """How much of an image is reconstructed."""
    (overlap,) = tables["reconstruction"]["iou"]
    label = "image and reconstruction, recordings not trained on: intersection over union, mean"
    return [Row(key="reconstruction", label=label, value=overlap, at_least=0.85)]


def chamfer_rows(tables: Tables) -> list[Row]:
    """Whether z orders images as their outlines do."""
    (correlation,) = tables["chamfer"].query("target == 'target-2'")["correlation"]
    label = "correlation of z distance and log chamfer distance, target-2"
    return [Row(key="chamfer", label=label, value=correlation, paper="0.811", above=0.7, at_least=0.85)]


PAPER_SIZES = {"weights": "torque-paper"}
RECONSTRUCTION = Experiment(
    "reconstruction", reconstruct_one, over(), seconds=10, paper=PAPER_SIZES, rows=reconstruction_rows
)
CHAMFER = Experiment(
    "chamfer", compare_one, over(target=("target-1", "target-2")), seconds=8, paper=PAPER_SIZES, rows=chamfer_rows
)
