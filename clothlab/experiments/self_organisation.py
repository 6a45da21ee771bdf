"""Does p sort the cloths by itself? (paper, "Simulation Experiment": the figure on parametric biases)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clothlab._validation import Checked, setting
from clothlab.analysis import MaterialReadout, principal_axes
from clothlab.experiments._record import interleaved, run_jobs, trained
from clothlab.simulation.cloth import CLOTHS


@dataclass(frozen=True)
class Settings(Checked):
    """Which trainings; the defaults are the full size."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings


@dataclass(frozen=True, eq=False)
class Run:
    """One training.

    Attributes:
        model: its seed.
        r2: leave-one-cloth-out R² of log C_damp and log C_mass, `[2]`.
        ratio_r2: the same of log (C_damp / C_mass).
        linear_r2: as `r2`, of a straight map from p, `[2]`.
        pca_share: share of the variance of p along PC1 and PC2, `[2]`.
    """

    model: int
    r2: np.ndarray
    ratio_r2: float
    linear_r2: np.ndarray
    pca_share: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each training.
    """

    settings: Settings
    runs: tuple[Run, ...]


def run_one(weights: str, model: int) -> Run:
    """How well the trained p of one training explains the materials."""
    biases = trained(f"{weights}-{model}").biases
    readout = MaterialReadout.fit(biases, {name: CLOTHS[name] for name in biases})
    share = principal_axes(biases).explained_variance_ratio_
    return Run(model, readout.r2, readout.ratio_r2, readout.linear_r2, share)


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """The same for every training."""
    settings = settings or Settings()
    jobs = [(settings.weights, model) for model in settings.models]
    return Record(settings, tuple(run_jobs(run_one, jobs, workers=1, progress=progress, what="self-organisation")))


def merged(settings: Settings, records: Sequence[Record]) -> Record:
    """One record from those of single trainings, in the order of `settings`, as `run` finds it for all of them."""
    return Record(settings, interleaved([each.runs for each in records]))
