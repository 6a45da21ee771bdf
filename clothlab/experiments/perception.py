"""Does z see the cloth? (paper, "Simulation Experiment": the figure on chamfer distances)."""

from dataclasses import dataclass

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, setting
from clothlab.analysis import chamfer_against_z
from clothlab.experiments._record import random_trial, run_jobs
from clothlab.learning.autoencoder import Autoencoder, decode, encode, iou
from clothlab.simulation.cloth import cloth_name
from clothlab.trials import Trial


@dataclass(frozen=True)
class Settings(Checked):
    """What is seen; the defaults are the full size."""

    weights: str = setting("torque")  # which autoencoder
    arm: str = setting("torque")
    trials: str = setting("evaluation")  # recorded, never trained on
    targets: tuple[str, ...] = setting(("target-1", "target-2"))
    cloth: str = setting(cloth_name(0.05, 0.10))  # moved at random for the chamfer distances
    steps: int = setting(450, "step", at_least=3)
    seed: int = setting(5000, at_least=0)


@dataclass(frozen=True, eq=False)
class Chamfer:
    """Two distances of the same images to a target.

    Attributes:
        target: its name.
        correlation: of the two.
        log_chamfer: `[N]` [log pixel].
        z_distance: ‖z_ref - z‖ `[N]` [s.d. of z].
    """

    target: str
    correlation: float
    log_chamfer: np.ndarray
    z_distance: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        iou: intersection over union of images and their reconstructions, mean.
        iou_visible: the same over images in which cloth is visible.
        iou_deviation: its standard deviation over all images.
        chamfer: one for each target.
    """

    settings: Settings
    iou: float
    iou_visible: float
    iou_deviation: float
    chamfer: tuple[Chamfer, ...]


def look(settings: Settings, autoencoder: Autoencoder) -> Record:
    """Reconstruct recorded images, and compare two distances to the targets, with any autoencoder."""
    images = np.concatenate([trial.images for trial in artifacts.load_trials(settings.trials)])
    overlap, visible = iou(decode(autoencoder, encode(autoencoder, images)) > 0.5, images), images.any(axis=(1, 2))
    trial = random_trial(settings.arm, settings.cloth, settings.steps, settings.seed)
    chamfer = tuple(_chamfer(autoencoder, trial, target) for target in settings.targets)
    return Record(settings, float(overlap.mean()), float(overlap[visible].mean()), float(overlap.std()), chamfer)


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """The same with the stored autoencoder of the arm."""
    settings = settings or Settings()
    autoencoder, _ = artifacts.load_autoencoder(settings.weights)
    (record,) = run_jobs(look, [(settings, autoencoder)], workers=workers, progress=progress, what="perception")
    return record


def _chamfer(autoencoder: Autoencoder, trial: Trial, target: str) -> Chamfer:
    log_chamfer, z_distance = chamfer_against_z(autoencoder, trial, artifacts.load_target(target))
    correlation = float(np.corrcoef(log_chamfer, z_distance)[0, 1])
    return Chamfer(target, correlation, log_chamfer.round(4), z_distance.round(4))
