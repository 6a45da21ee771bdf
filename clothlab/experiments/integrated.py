"""Both at once: estimation from a wrong p while controlling (paper, "Simulation Experiment": the last two figures)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, setting
from clothlab.analysis import best_per_period, target_distance
from clothlab.experiments._record import interleaved, new_trial, run_jobs, trained
from clothlab.learning.estimation import BiasEstimator, EstimatingPolicy
from clothlab.simulation.cloth import cloth_name


@dataclass(frozen=True)
class Settings(Checked):
    """Which case; the defaults are the full size and the paper's pair of cloths."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    target: str = setting("target-1")
    held: str = setting(cloth_name(0.03, 0.10))  # the cloth in the hand
    believed: str = setting(cloth_name(0.07, 0.15))  # the cloth whose p is the start
    steps: int = setting(250, "step", at_least=16)  # 50 s, as in the paper


@dataclass(frozen=True, eq=False)
class Run:
    """One run.

    Attributes:
        model: seed of the training.
        trace: p after each step `[T, D_p]`.
        distance: to the target at each step `[T]` [s.d. of z].
        ratio: distance to the right p in the end, over that of the start.
    """

    model: int
    trace: np.ndarray
    distance: np.ndarray
    ratio: float

    @property
    def best(self) -> np.ndarray:
        """Smallest distance in each period but the first [s.d. of z]."""
        return best_per_period(self.distance)


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each training.
    """

    settings: Settings
    runs: tuple[Run, ...]

    def thirds(self) -> tuple[np.ndarray, np.ndarray]:
        """Median of the periods' best in the first and in the last third of each run, `[models]` each [s.d. of z]."""
        bests = np.array([run.best for run in self.runs])
        third = bests.shape[1] // 3
        return np.median(bests[:, :third], axis=1), np.median(bests[:, -third:], axis=1)


def run_one(settings: Settings, model: int) -> Run:
    """Estimate and control at once, from a wrong p."""
    learned, mask = trained(f"{settings.weights}-{model}"), artifacts.load_target(settings.target)
    start, goal = learned.biases[settings.believed], learned.biases[settings.held]
    estimator = BiasEstimator(learned.model, start)
    policy = EstimatingPolicy(learned.controller(mask, start), estimator, learned.autoencoder)
    trial = new_trial(policy, learned.arm, settings.held, settings.steps, model)
    ratio = np.linalg.norm(policy.trace[-1] - goal) / np.linalg.norm(start - goal)
    distance = target_distance(learned.autoencoder, trial, mask)
    return Run(model, np.round(policy.trace, 4), distance.round(4), float(ratio))


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """The same with every training."""
    settings = settings or Settings()
    jobs = [(settings, model) for model in settings.models]
    return Record(settings, tuple(run_jobs(run_one, jobs, workers=workers, progress=progress, what="integrated")))


def merged(settings: Settings, records: Sequence[Record]) -> Record:
    """One record from those of single trainings, in the order of `settings`, as `run` finds it for all of them."""
    return Record(settings, interleaved([each.runs for each in records]))
