"""Does z describe the cloth?

Images of recordings that no training has seen, and their reconstructions, by the size
of z; and two distances of an image to a target: the chamfer distance of the outlines
and that of z (paper, "Simulation Experiment": the figure on chamfer distances).
"""

from typing import Any

import numpy as np
from scipy.spatial import KDTree

from clothlab import data
from clothlab.masks import iou
from clothlab.method.autoencoder import (
    AutoencoderTraining,
    decode,
    encode,
    train_autoencoder,
)
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import MIDDLE, chamfer_against_z, random_trial


def _reconstruct(weights: str = "torque", trials: str = "evaluation") -> dict[str, Any]:
    """Intersection over union of recorded images and their reconstructions."""
    autoencoder, _ = data.load_autoencoder(weights)
    images = _images(trials)
    overlap, visible = (
        iou(decode(autoencoder, encode(autoencoder, images)) > 0.5, images),
        images.any(axis=(1, 2)),
    )
    return {
        "iou": float(overlap.mean()),
        "iou_visible": float(
            overlap[visible].mean()
        ),  # over the images in which cloth is visible
        "iou_deviation": float(overlap.std()),
    }


def _images(recordings: str) -> np.ndarray:
    return np.concatenate([trial.images for trial in data.load_trials(recordings)])


def _train(
    latent_size: int, epochs: int = 30, train: str = "train", test: str = "evaluation"
) -> dict[str, Any]:
    """Intersection over union by size of z: with the decoder, and with the 16 images of
    nearest z in its place.
    """
    settings = AutoencoderTraining(epochs=epochs, latent_size=latent_size)
    known, images = _images(train), _images(test)[::3]
    model, _ = train_autoencoder(known, settings, device="cpu", progress=False)
    z, probability = encode(model, images), decode(model, encode(model, images))
    _, near = KDTree(encode(model, known)).query(z, k=16)
    overlap, area = iou(probability > 0.5, images), images.mean(axis=(1, 2))
    nearest = np.stack([known[each].mean(0) > 0.5 for each in near])
    return {
        "iou": float(overlap.mean()),
        "iou_low": float(
            iou(probability > 0.4, images).mean()
        ),  # with a threshold of 0.4, which is best for most
        "iou_thin": float(overlap[(area > 0) & (area < np.median(area))].mean()),
        "iou_nearest": float(iou(nearest, images).mean()),
    }


def _compare(target: str, weights: str = "torque", steps: int = 450) -> dict[str, Any]:
    """Log chamfer distance [log pixel] and distance of z [s.d. of z] to a target, both
    `[N]`, and their correlation.
    """
    autoencoder, _ = data.load_autoencoder(weights)
    trial = random_trial("torque", MIDDLE, steps, seed=5000)
    log_chamfer, z_distance = chamfer_against_z(
        autoencoder, trial, data.load_target(target)
    )
    correlation = float(np.corrcoef(log_chamfer, z_distance)[0, 1])
    return {
        "correlation": correlation,
        "log_chamfer": log_chamfer.round(4),
        "z_distance": z_distance.round(4),
    }


def _reconstruction_rows(tables: Tables) -> list[Row]:
    (overlap,) = tables["reconstruction"]["iou"]
    label = "image and reconstruction, recordings not trained on: intersection over union, mean"
    return [Row("reconstruction", label, overlap, at_least=0.88)]


def _latent_rows(tables: Tables) -> list[Row]:
    """What limits the reconstruction: the decoder, or how much z can hold."""
    sizes = tables["latent_size"].set_index("latent_size")
    label = "the same for the paper's recordings, the mean of the 16 images of nearest z in place of the decoder"
    note = "; ".join(
        f"D_z {size}: {row.iou_nearest:.2f}, decoder {row.iou_low:.2f}"
        for size, row in sizes.iterrows()
    )
    return [Row("latent_size", label, float(sizes.loc[3, "iou_nearest"]), note=note)]


def _chamfer_rows(tables: Tables) -> list[Row]:
    """Whether z orders images as their outlines do."""
    (correlation,) = tables["chamfer"].query("target == 'target-2'")["correlation"]
    label = "correlation of z distance and log chamfer distance, target-2"
    return [Row("chamfer", label, correlation, paper="0.811", above=0.7, at_least=0.85)]


_PAPER, _TARGETS = {"weights": "torque-paper"}, ("target-1", "target-2")
EXPERIMENTS = (
    Experiment(
        "reconstruction",
        _reconstruct,
        over(),
        seconds=10,
        paper=_PAPER,
        rows=_reconstruction_rows,
    ),
    Experiment(
        "latent_size",
        _train,
        over(latent_size=(2, 3, 4, 6, 12)),
        seconds=300,
        slow=True,
        rows=_latent_rows,
    ),
    Experiment(
        "chamfer",
        _compare,
        over(target=_TARGETS),
        seconds=8,
        paper=_PAPER,
        rows=_chamfer_rows,
    ),
)
