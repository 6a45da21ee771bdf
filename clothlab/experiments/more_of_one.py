"""More recordings of one cloth: of the one whose motion tells least, by the bound, and of one whose motion tells most.

The recordings of that cloth are doubled, and the model is trained again. Does p find it better? The other cloth is the
control: what it gains, too, comes from having more recordings, whichever.
"""

from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, choose, choose_all, setting
from clothlab.analysis import MaterialReadout, nearest_material
from clothlab.experiments._kept import once, piece, version
from clothlab.experiments._record import estimate_at_random, new_trial, run_jobs, trained
from clothlab.experiments.practice import seen_runs
from clothlab.experiments.sysid import logs
from clothlab.learning.dpmpb import Sequences, train_dpmpb
from clothlab.learning.estimation import NewtonSettings
from clothlab.learning.trained import Trained
from clothlab.policies import OperatorPolicy, RandomPolicy
from clothlab.simulation.cloth import CLOTHS, cloth_name
from clothlab.training_configs import recipe_of

FOLDER = Path("build") / "more_of_one"  # where each piece is kept as soon as it is done
NONE = "none"  # the stored weights
POLICIES = (RandomPolicy, OperatorPolicy)


@dataclass(frozen=True)
class Settings(Checked):
    """Which cloths and trainings; the defaults are the full size."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1), at_least=0)  # seeds of the trainings
    extra: tuple[str, ...] = setting((cloth_name(0.03, 0.15), cloth_name(0.03, 0.10)))  # told least and most by a run
    repeats: int = setting(20, at_least=1)  # further recordings of it with each policy: as many as there are
    recorded_steps: int = setting(250, "step", at_least=20)  # of each
    recorded_seed: int = setting(300_000, at_least=0)  # of them: this + 100 number of the cloth + 2 repeat + policy
    cloths: tuple[str, ...] = setting(tuple(CLOTHS))  # with which each training is tried
    tries: int = setting(4, at_least=1)  # with each of them
    steps: int = setting(200, "step", at_least=12)  # of each try, with random commands
    first_seed: int = setting(61_000, at_least=0)  # of them: this + 10 number of the cloth + try, the same for all

    def __post_init__(self) -> None:
        """Refuse what would only be noticed hours later.

        Raises:
            KeyError: an unknown cloth; the message lists the choices.
        """
        super().__post_init__()
        choose_all("cloth", self.extra + self.cloths, CLOTHS)


@dataclass(frozen=True, eq=False)
class Run:
    """p of one cloth, estimated from 0 by Gauss-Newton.

    Attributes:
        extra: name of the cloth of which there were more recordings, or `"none"`.
        model: seed of the training.
        cloth: name of the cloth in the hand.
        seed: of the commands.
        nearest: the material whose trained p is nearest in the end.
        error: of log C_damp and log C_mass, read off p `[2]`.
    """

    extra: str
    model: int
    cloth: str
    seed: int
    nearest: str
    error: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each training, cloth and try.
    """

    settings: Settings
    runs: tuple[Run, ...]

    def right(self, extra: str, cloth: str | None = None) -> float:
        """How often p comes nearest to the right one, 0 to 1; with all cloths where none is named."""
        return float(np.mean([run.nearest == run.cloth for run in self._of(extra, cloth)]))

    def errors(self, extra: str, cloth: str | None = None) -> np.ndarray:
        """Errors of log (C_damp / C_mass), likewise; the same order whatever there was more of `[runs]`."""
        return np.array([run.error @ [1, -1] for run in self._of(extra, cloth)])

    def _of(self, extra: str, cloth: str | None) -> list[Run]:
        choose("cloth of which there were more", extra, dict.fromkeys((NONE, *self.settings.extra)))
        return [run for run in self.runs if run.extra == extra and cloth in (None, run.cloth)]


def record_one(settings: Settings, cloth: str, policy: int, repeat: int, folder: Path) -> Sequences:
    """One more recording, as the model sees it."""
    learned = trained(f"{settings.weights}-{settings.models[0]}")
    seed = settings.recorded_seed + 100 * [*CLOTHS].index(cloth) + len(POLICIES) * repeat + policy

    def make() -> Sequences:
        return learned.sequences(
            new_trial(POLICIES[policy](learned.arm), learned.arm, cloth, settings.recorded_steps, seed)
        )

    made_with = {"weights": settings.weights, "steps": settings.recorded_steps, "seed": seed}
    return piece(("recording", cloth, policy, repeat), made_with, make, Sequences, folder)


def train_one(settings: Settings, extra: str, model: int, folder: Path) -> None:
    """Train on all recordings and those beside them, and keep the weights in the folder."""
    learned, name = trained(f"{settings.weights}-{model}"), _name(settings, extra, model)

    def train() -> None:
        more = [record_one(settings, extra, *job, folder) for job in _recordings(settings)]
        network, biases, trace = train_dpmpb(
            [*seen_runs(learned), *more], recipe_of(learned).model, seed=model, progress=False
        )
        kept = Trained(name, learned.arm, learned.autoencoder, network, biases, trace.losses, learned.autoencoder_name)
        artifacts.save(kept, data=folder)

    matters = {each: getattr(settings, each) for each in ("weights", "repeats", "recorded_steps", "recorded_seed")}
    made_with = matters | {"recipe": asdict(recipe_of(learned).model), "version": version()}
    once(name, made_with, train, folder=folder, files=[f"weights/dpmpb-{name}.safetensors"])


def run_one(settings: Settings, extra: str, model: int, cloth: str, folder: Path) -> list[Run]:
    """Try one training with one cloth."""
    learned = trained(f"{settings.weights}-{model}")
    if extra != NONE:
        learned = artifacts.load(_name(settings, extra, model), data=folder)
    readout, first = MaterialReadout.fit(learned.biases, CLOTHS), settings.first_seed + 10 * [*CLOTHS].index(cloth)

    def measure(seed: int) -> Run:
        p, _ = estimate_at_random(learned, cloth, settings.steps, seed, NewtonSettings())
        error = np.log(readout(p)) - logs(CLOTHS[cloth])
        return Run(extra, model, cloth, seed, nearest_material(p, learned.biases), error.round(4))

    return [measure(seed) for seed in range(first, first + settings.tries)]


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Record, train and try.

    Args:
        settings: what is run.
        workers: processes.
        progress: show a progress bar.
        folder: where recordings and weights are kept; an interrupted experiment goes on from there.

    Raises:
        KeyError, ValueError: the recordings of the weights are missing; the message says how to make them.
    """
    settings, folder = settings or Settings(), Path(folder)
    together: dict[str, Any] = {"workers": workers, "progress": progress}
    jobs = [(settings, extra, *job, folder) for extra, job in product(settings.extra, _recordings(settings))]
    run_jobs(record_one, jobs, what="recordings", **together)
    eye = trained(f"{settings.weights}-{settings.models[0]}").autoencoder_name
    artifacts.save_autoencoder(*artifacts.load_autoencoder(eye), eye, data=folder)  # weights are kept beside theirs
    to_train = [(settings, *pair, folder) for pair in product(settings.extra, settings.models)]
    run_jobs(train_one, to_train, what="trainings", **together)
    tried = product((NONE, *settings.extra), settings.models, settings.cloths)
    found = run_jobs(run_one, [(settings, *each, folder) for each in tried], what="tries", **together)
    return Record(settings, tuple(run for runs in found for run in runs))


def _recordings(settings: Settings) -> list[tuple[int, int]]:
    return list(product(range(len(POLICIES)), range(settings.repeats)))


def _name(settings: Settings, extra: str, model: int) -> str:
    return f"{settings.weights}-more-{[*CLOTHS].index(extra)}-{model}"
