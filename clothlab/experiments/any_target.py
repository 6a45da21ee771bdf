"""Any target: practice on targets that nobody chose by their results, and on shapes that somebody drew."""

from dataclasses import dataclass

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, setting
from clothlab.analysis import best_per_period, late_median, target_distance
from clothlab.experiments._record import new_trial, random_trial, run_jobs, trained
from clothlab.experiments.practice import seen_runs
from clothlab.learning.autoencoder import iou
from clothlab.simulation.cloth import cloth_name
from clothlab.trials import Trial


@dataclass(frozen=True)
class Settings(Checked):
    """Which targets; the defaults are the full size."""

    weights: str = setting("torque")
    sets: tuple[str, ...] = setting(("held-out", "drawn"))
    first: int = setting(1000, at_least=1)  # only so many targets of each set
    models: int = setting(5, at_least=1)  # trainings, which take turns
    drawn_cloth: str = setting(cloth_name(0.05, 0.10))  # in the hand where the target does not say which
    first_seed: int = setting(30_000, at_least=0)  # of the runs: this + number of the target
    steps: int = setting(248, "step", at_least=16)


@dataclass(frozen=True, eq=False)
class Run:
    """One target.

    Attributes:
        target: its name.
        cloth: name of the cloth in the hand.
        model: seed of the training.
        still: distance of the cloth that hangs still [s.d. of z].
        practice: smallest distance in each period but the first [s.d. of z].
        random: the same under random commands.
        practice_overlap: largest IoU with the target in each period but the first.
        random_overlap: the same under random commands.
    """

    target: str
    cloth: str
    model: int
    still: float
    practice: np.ndarray
    random: np.ndarray
    practice_overlap: np.ndarray
    random_overlap: np.ndarray

    @property
    def ratio(self) -> float:
        """Last ten periods of practice over all of Random's, medians."""
        return late_median(self.practice) / float(np.median(self.random))

    @property
    def overlap(self) -> float:
        """Median IoU of the best image in each of the last ten periods of practice."""
        return late_median(self.practice_overlap)


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each target.
    """

    settings: Settings
    runs: tuple[Run, ...]

    def of(self, name: str) -> list[Run]:
        """The runs of one set of targets."""
        return [run for run in self.runs if run.target.startswith(f"{name}/")]


def targets(settings: Settings) -> list[str]:
    """Names of the targets of every set, in the order of their numbers."""
    return [name for each in settings.sets for name in list(artifacts.load_targets(each))[: settings.first]]


def run_one(settings: Settings, target: str, number: int) -> Run:
    """Practise one target, and move at random."""
    learned, mask = trained(f"{settings.weights}-{number % settings.models}"), artifacts.load_target(target)
    cloth = settings.drawn_cloth if target.startswith("drawn/") else artifacts.recorded_with(target)[1]
    policy = learned.iterative_controller(mask, cloth, seen_runs(learned))
    seed = settings.first_seed + number
    ours = new_trial(policy, learned.arm, cloth, settings.steps, seed)
    chance = random_trial(learned.arm.name, cloth, settings.steps, seed)
    away, astray = (target_distance(learned.autoencoder, trial, mask) for trial in (ours, chance))
    return Run(
        target=target,
        cloth=cloth,
        model=number % settings.models,
        still=float(away[0]),
        practice=best_per_period(away).round(4),
        random=best_per_period(astray).round(4),
        practice_overlap=_best_overlap(ours, mask).round(4),
        random_overlap=_best_overlap(chance, mask).round(4),
    )


def _best_overlap(trial: Trial, mask: np.ndarray) -> np.ndarray:
    """Largest IoU in each period but the first, as `best_per_period` has it for distances."""
    return 1 - best_per_period(1 - iou(trial.images, mask))


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """Every target of every set."""
    settings = settings or Settings()
    todo = [(settings, target, number) for number, target in enumerate(targets(settings))]
    return Record(settings, tuple(run_jobs(run_one, todo, workers=workers, progress=progress, what="any target")))
