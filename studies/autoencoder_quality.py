"""Does z describe the cloth?

Two experiments: how well images are reconstructed where the size of z varies, and
whether distances of z to a target order images as their outlines do.
"""

from typing import Any

import numpy as np
from scipy.spatial import KDTree

from clothlab import data
from clothlab.method.autoencoder import (
    AutoencoderTraining,
    decode,
    encode,
    train_autoencoder,
)
from clothlab.simulation.vision import iou
from studies._grid import Experiment, over
from studies._runs import MIDDLE, chamfer_against_z, random_trial

_NEIGHBOURS = 16  # images of nearest z that stand in for the decoder


def _images(recordings: str) -> np.ndarray:
    return np.concatenate([trial.images for trial in data.load_trials(recordings)])


def _train(
    latent_size: int, epochs: int = 30, train: str = "train", test: str = "evaluation"
) -> dict[str, Any]:
    """Intersection over union by size of z.

    With the decoder, and with the images of nearest z in its place: what limits the
    reconstruction, the decoder or how much z can hold?
    """
    settings = AutoencoderTraining(epochs=epochs, latent_size=latent_size)
    known = _images(train)
    images = _images(test)[::3]
    model, _ = train_autoencoder(known, settings, progress=False)

    # By the decoder
    z = encode(model, images)
    probability = decode(model, z)
    overlap = iou(probability > 0.5, images)
    overlap_low = iou(probability > 0.4, images)  # a threshold that is best for most
    area = images.mean(axis=(1, 2))
    thin = (area > 0) & (area < np.median(area))

    # By the images of nearest z
    _, near = KDTree(encode(model, known)).query(z, k=_NEIGHBOURS)
    nearest = np.stack([known[numbers].mean(0) > 0.5 for numbers in near])
    return {
        "iou": float(overlap.mean()),
        "iou_low": float(overlap_low.mean()),
        "iou_thin": float(overlap[thin].mean()),
        "iou_nearest": float(iou(nearest, images).mean()),
    }


def _compare(target: str, weights: str = "torque", steps: int = 450) -> dict[str, Any]:
    """Two distances to a target and their correlation.

    The log chamfer distance [log pixel] and the distance of z [s.d. of z], both `[N]`.
    """
    autoencoder, _ = data.load_autoencoder(weights)
    trial = random_trial("torque", MIDDLE, steps, seed=5000)
    mask = data.load_target(target)
    log_chamfer, z_distance = chamfer_against_z(autoencoder, trial, mask)
    return {
        "correlation": float(np.corrcoef(log_chamfer, z_distance)[0, 1]),
        "log_chamfer": log_chamfer.round(4),
        "z_distance": z_distance.round(4),
    }


_PAPER = {"weights": "torque-paper"}
EXPERIMENTS = (
    Experiment("latent_size", _train, over(latent_size=(2, 3, 4, 6, 12)), slow=True),
    Experiment(
        "chamfer", _compare, over(target=("target-1", "target-2")), paper=_PAPER
    ),
)
