"""Which cloth is in the hand? p is estimated online from 0 while the cloth is moved at random (paper, "Simulation
Experiment": the figure on parametric biases)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from clothlab._validation import Checked, choose, setting
from clothlab.analysis import MaterialReadout, bias_error, nearest_material
from clothlab.experiments._record import estimate_at_random, interleaved, run_jobs, trained
from clothlab.simulation.cloth import CLOTHS, Cloth

BETWEEN = {  # never trained on: geometric means of neighbouring trained values, and one nearer to a corner of them
    name: Cloth(name, damping=(c * d) ** 0.5, mass=(m * n) ** 0.5)
    for name, (c, d), (m, n) in (
        ("between-light", (0.03, 0.05), (0.05, 0.10)),
        ("between-heavy", (0.05, 0.07), (0.10, 0.15)),
        ("between-slow", (0.05, 0.07), (0.05, 0.10)),  # much drag for its mass
        ("between-fast", (0.03, 0.05), (0.10, 0.15)),
        ("between-corner", (0.06, 0.07), (0.05, 0.07)),
    )
}
ESTIMATED = (*CLOTHS, "between-light", "between-heavy")


@dataclass(frozen=True)
class Settings(Checked):
    """Which cloths and trainings; the defaults are the full size."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    repeats: int = setting(4, at_least=1)  # other commands for each training and cloth
    cloths: tuple[str, ...] = setting(ESTIMATED)
    steps: int = setting(200, "step", at_least=12)  # 40 s, about as in the paper
    first_seed: int = setting(6000, at_least=0)  # of the commands: this + 100 model + 20 repeat + number of the cloth


@dataclass(frozen=True, eq=False)
class Run:
    """One estimation.

    Attributes:
        cloth: name of the cloth in the hand.
        model: seed of the training.
        seed: of the commands.
        trace: p after each step `[T, D_p]`.
        nearest: the material whose trained p is nearest in the end.
        distance: final distance to the right p [spreads of the trained p]; none for a cloth that was never trained.
        read: C_damp [N s/m] and C_mass [kg] read off the final p `[2]`.
        error: their relative errors `[2]`.
    """

    cloth: str
    model: int
    seed: int
    trace: np.ndarray
    nearest: str
    distance: float | None
    read: np.ndarray
    error: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each training, cloth and repeat.
    """

    settings: Settings
    runs: tuple[Run, ...]

    @property
    def trained(self) -> list[Run]:
        """The runs with cloths that the model was trained on."""
        return [run for run in self.runs if run.distance is not None]

    @property
    def between(self) -> list[Run]:
        """The runs with cloths between those."""
        return [run for run in self.runs if run.distance is None]


def get_cloth(name: str) -> Cloth:
    """One of the nine cloths, or one between them, by its name."""
    return choose("cloth", name, CLOTHS | BETWEEN)


def seed_of(settings: Settings, name: str, model: int, repeat: int = 0) -> int:
    """Seed of the commands of a run."""
    return settings.first_seed + 100 * model + 20 * repeat + [*CLOTHS, *BETWEEN].index(name)


def run_one(settings: Settings, name: str, model: int, repeat: int = 0) -> Run:
    """Estimate p of one cloth."""
    learned, cloth = trained(f"{settings.weights}-{model}"), get_cloth(name)
    seed = seed_of(settings, name, model, repeat)
    p, trace = estimate_at_random(learned, cloth, settings.steps, seed)
    distance = bias_error(p, name, learned.biases) if name in learned.biases else None
    read = np.array(MaterialReadout.fit(learned.biases, CLOTHS)(p))
    error = read / (cloth.damping, cloth.mass) - 1
    return Run(name, model, seed, trace.round(3), nearest_material(p, learned.biases), distance, read, error)


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """Estimate p of every cloth with every training."""
    settings = settings or Settings()
    jobs = [(settings, *job) for job in product(settings.cloths, settings.models, range(settings.repeats))]
    return Record(settings, tuple(run_jobs(run_one, jobs, workers=workers, progress=progress, what="estimation")))


def merged(settings: Settings, records: Sequence[Record]) -> Record:
    """One record from those of single trainings, in the order of `settings`, as `run` finds it for all of them."""
    return Record(settings, interleaved([each.runs for each in records], settings.repeats))
