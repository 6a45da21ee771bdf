"""Which commands realise this picture? Control with the right p against random commands, hanging still, and an empty
image (paper, "Simulation Experiment": the figure on control)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, setting
from clothlab.analysis import best_per_period, empty_distance, success_rate, target_distance
from clothlab.experiments._record import interleaved, new_trial, random_trial, run_jobs, trained
from clothlab.simulation.cloth import cloth_name


@dataclass(frozen=True)
class Settings(Checked):
    """Which cases; the defaults are the full size."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    targets: tuple[str, ...] = setting(("target-1", "target-2"))
    cloths: tuple[str, ...] = setting((cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)))
    steps: int = setting(250, "step", at_least=16)  # 50 s, as in the paper
    first_random_seed: int = setting(7000, at_least=0)  # of the random commands: this + model


@dataclass(frozen=True, eq=False)
class Run:
    """One case.

    Attributes:
        target: its name.
        cloth: name of the cloth in the hand.
        model: seed of the training.
        still: distance of the cloth that hangs still, with which every run begins [s.d. of z].
        empty: distance of an image without cloth [s.d. of z].
        control: distance at each step under control `[T]` [s.d. of z].
        random: the same under random commands `[T]` [s.d. of z].
    """

    target: str
    cloth: str
    model: int
    still: float
    empty: float
    control: np.ndarray
    random: np.ndarray

    def best(self, who: str) -> np.ndarray:
        """Smallest distance of `"control"` or `"random"` in each period but the first [s.d. of z]."""
        return best_per_period(getattr(self, who))


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each target, cloth and training.
    """

    settings: Settings
    runs: tuple[Run, ...]

    def case(self, target: str, cloth: str) -> list[Run]:
        """The runs with a target and a cloth, one for each training."""
        return [run for run in self.runs if (run.target, run.cloth) == (target, cloth)]

    def cases(self) -> dict[tuple[str, str], list[Run]]:
        """The same by `(target, cloth)`."""
        return {pair: self.case(*pair) for pair in product(self.settings.targets, self.settings.cloths)}

    def rates(self, thresholds: ArrayLike) -> dict[tuple[str, str], dict[str, np.ndarray]]:
        """Share of steps nearer than each threshold `[N]` [s.d. of z], by `(target, cloth)` and who, `[models, N]`.

        Who is Control, Random, still and empty.
        """
        away = {
            "Control": lambda run: run.control,
            "Random": lambda run: run.random,
            "still": lambda run: [run.still],
            "empty": lambda run: [run.empty],
        }
        return {
            pair: {who: np.array([success_rate(of(run), thresholds) for run in runs]) for who, of in away.items()}
            for pair, runs in self.cases().items()
        }


def run_one(settings: Settings, target: str, cloth: str, model: int) -> Run:
    """Control with the right p, and random commands, on the same cloth and target."""
    learned, mask = trained(f"{settings.weights}-{model}"), artifacts.load_target(target)
    control = new_trial(learned.controller(mask, cloth), learned.arm, cloth, settings.steps, model)
    random = random_trial(learned.arm.name, cloth, settings.steps, settings.first_random_seed + model)
    away, chance = (target_distance(learned.autoencoder, trial, mask) for trial in (control, random))
    empty = empty_distance(learned.autoencoder, mask)
    return Run(target, cloth, model, float(away[0]), empty, away.round(4), chance.round(4))


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """Every target with every cloth and training."""
    settings = settings or Settings()
    jobs = [(settings, *case) for case in product(settings.targets, settings.cloths, settings.models)]
    return Record(settings, tuple(run_jobs(run_one, jobs, workers=workers, progress=progress, what="control")))


def merged(settings: Settings, records: Sequence[Record]) -> Record:
    """One record from those of single trainings, in the order of `settings`, as `run` finds it for all of them."""
    return Record(settings, interleaved([each.runs for each in records]))
