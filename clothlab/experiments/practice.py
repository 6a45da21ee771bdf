"""Does learning from outcomes spread the cloth? Practice against the paper's method, and both against everyone else who
could do it, on both arms, with the same time per solve."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, choose, setting
from clothlab.analysis import LATE, best_per_period, target_distance
from clothlab.experiments import other_models
from clothlab.experiments._kept import once, piece, version
from clothlab.experiments._record import PAPER, RECORDINGS, Reached, new_trial, run_jobs, trained
from clothlab.experiments.opponents import (
    ChangesModel,
    ChangesPolicy,
    CrossEntropyPolicy,
    MeanLossPolicy,
    Repeat,
    train_changes,
)
from clothlab.learning.autoencoder import encode
from clothlab.learning.control import ControlSettings, nearest_plans, recorded_plans
from clothlab.learning.dpmpb import Sequences, to_sequences
from clothlab.learning.estimation import BiasEstimator, EstimatingPolicy
from clothlab.learning.trained import Trained
from clothlab.policies import Policy, RandomPolicy
from clothlab.simulation.cloth import cloth_name
from clothlab.simulation.env import ClothEnv
from clothlab.training_configs import recipe_of
from clothlab.trials import MotionWatch, Trial, rollout, sensed_by

ENSEMBLE = 5  # models
OWN_STEPS, OWN_SEED = 248, 30_000  # the run that a model learns from before the one that counts, and its seed
SAMPLES = 50  # of the hand's motion in each step
FOLDER = Path("build/practice")


@dataclass(frozen=True)
class Case(Checked):
    """A target, the cloth in the hand, and the cloth whose p is the wrong one."""

    arm: str = setting()
    target: str = setting()
    cloth: str = setting()
    wrong: str = setting()


LIGHT, HEAVY = cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)
CASES = {
    "target-1, light": Case("torque", "target-1", LIGHT, HEAVY),
    "target-1, heavy": Case("torque", "target-1", HEAVY, LIGHT),
    "target-2, light": Case("torque", "target-2", LIGHT, HEAVY),
    "target-2, heavy": Case("torque", "target-2", HEAVY, LIGHT),
    "foam hard-1": Case("muscle", "muscle", "hard-1", "soft-1"),
    "foam soft-1": Case("muscle", "muscle", "soft-1", "hard-1"),
}


Maker = Callable[[Trained, list[Sequences], int], Trained]


@dataclass(frozen=True)
class Method:
    """Who chooses the commands.

    Attributes:
        make: learned, case, seed of the training, p → policy.
        p: of the right cloth, of the wrong one, zero, or estimated from the wrong one.
        weights: what the names of the weights have after that of the arm.
        model: trains another: learned, its recordings, seed → learned.
        often: whether a claim stands on it, so that it has four runs for each training in place of one.
        arms: for which it makes sense.
        stiffness: f_const [N] that has to be sent; 0 for whatever it likes.
    """

    make: Callable[[Trained, Case, int, np.ndarray], Policy]
    p: str = "right"
    weights: str = ""
    model: Maker | None = None
    often: bool = False
    arms: tuple[str, ...] = tuple(RECORDINGS)
    stiffness: float = 0.0


def _target(case: Case) -> np.ndarray:
    return artifacts.load_target(case.target)


@cache
def _seen(sees_with: str, arm: str, recordings: str) -> list[Sequences]:
    """Recordings as an autoencoder sees and an arm senses them, encoded once in each process."""
    autoencoder, _ = artifacts.load_autoencoder(sees_with)
    return [to_sequences(autoencoder, sensed_by(trial, arm)) for trial in artifacts.load_trials(recordings)]


def seen_runs(learned: Trained) -> list[Sequences]:
    """The recordings that the weights learned from, as their model sees them.

    Raises:
        KeyError, ValueError: those beyond the paper's amount are missing; the message says how to make them.
    """
    recordings, how = recipe_of(learned).recordings, (learned.autoencoder_name, learned.arm.name)
    return [run for name in recordings for run in _seen(*how, name)]


def _best_recorded(learned: Trained, case: Case) -> np.ndarray:
    """The recorded plan that came nearest with this very cloth."""
    runs = [run for run in seen_runs(learned) if run.material == case.cloth]
    return nearest_plans(runs, encode(learned.autoencoder, _target(case)), count=1)[0]


def _random(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    return RandomPolicy(learned.arm)


def _replay(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    return Repeat(_best_recorded(learned, case))


def _gradient(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    return learned.controller(_target(case), p)


def _with_starts(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    return learned.controller(
        _target(case), p, plans=recorded_plans(artifacts.load_trials(RECORDINGS[case.arm]), seed=model)
    )


def _cross_entropy(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    return CrossEntropyPolicy(learned.model, learned.autoencoder, learned.arm, _target(case), p)


def _ensemble(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    others = [trained(f"{case.arm}-{k}") for k in range(ENSEMBLE) if k != model]
    members = [(other.model, other.biases[case.cloth]) for other in others]
    return MeanLossPolicy(learned.model, learned.autoencoder, learned.arm, _target(case), p, members=members)


def _practice(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    return learned.iterative_controller(_target(case), p, seen_runs(learned))


@cache
def _model_of_changes(weights: str, seed: int) -> ChangesModel:
    """Trained once in each process: it is the same in all cases of an arm."""
    learned = trained(weights)
    return train_changes(seen_runs(learned), learned.model, learned.autoencoder.latent_size, seed=seed)


def _changes(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    plan, changes = _best_recorded(learned, case), _model_of_changes(learned.name, model)
    return ChangesPolicy(changes, learned.model, learned.autoencoder, learned.arm, _target(case), plan)


def _retrained(learned: Trained, case: Case, model: int, p: np.ndarray) -> Policy:
    """Control, a round of learning from that run, control."""
    first = new_trial(learned.controller(_target(case), p), learned.arm, case.cloth, OWN_STEPS, OWN_SEED + model)
    wiser = other_models.retrained(learned, seen_runs(learned), [learned.sequences(first)], seed=model)
    return replace(learned, model=wiser).controller(_target(case), p)


RANDOM, RANDOM_ON_PAPERS = "random", "random, paper's recordings"
GRADIENT, PRACTICE = "gradient", "practice"
METHODS = {
    RANDOM: Method(_random, often=True),
    RANDOM_ON_PAPERS: Method(_random, weights=PAPER),
    "replay of the best recorded stretch": Method(_replay),
    GRADIENT: Method(_gradient, often=True),
    "gradient, p = 0": Method(_gradient, p="zero"),
    "gradient, wrong p": Method(_gradient, p="wrong", often=True),
    "gradient, paper's recordings": Method(_gradient, weights=PAPER),
    "gradient, recorded starts": Method(_with_starts),
    "gradient, five models": Method(_ensemble),
    "gradient, model without p": Method(_gradient, model=other_models.without_p),
    "gradient, known C_damp and C_mass": Method(_gradient, model=other_models.with_constants, arms=("torque",)),
    "gradient, retrained on its own run": Method(_retrained),
    "cross-entropy": Method(_cross_entropy),
    "changes": Method(_changes),
    PRACTICE: Method(_practice, often=True),
    "practice, p = 0": Method(_practice, p="zero"),
    "practice, wrong p": Method(_practice, p="wrong", often=True),
    "practice, estimated p": Method(_practice, p="estimated", often=True),
    "practice, paper's recordings": Method(_practice, weights=PAPER),
    "practice, model without p": Method(_practice, model=other_models.without_p),
    "gradient, without stiffness": Method(_gradient, stiffness=10.0, arms=("muscle",), often=True),
    "practice, without stiffness": Method(_practice, stiffness=10.0, arms=("muscle",), often=True),
}


def aim(method: str, learned: Trained, target: str, cloth: str) -> Policy:
    """Who moves one of the nine cloths towards a target with the right p, by the name of the method."""
    case = Case(learned.autoencoder_name, target, cloth, cloth)
    return METHODS[method].make(learned, case, 0, learned.biases[cloth])


@dataclass(frozen=True)
class Settings(Checked):
    """What is run; the defaults are the full size."""

    methods: tuple[str, ...] = setting(tuple(METHODS))
    cases: tuple[str, ...] = setting(tuple(CASES))
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    repeats: int = setting(4, at_least=1)  # runs for each training where a claim stands on a method, else 1; the first
    # of them starts from the arm's home, the others from random postures
    first_seed: int = setting(20_000, at_least=0)  # of the runs: this + 100 model + number of the run
    steps: int = setting(248, "step", at_least=16)  # 31 periods


@dataclass(frozen=True, eq=False)
class Run(Reached):
    """One run.

    Attributes:
        method: one of `METHODS`.
        case: one of `CASES`.
        model: seed of the training.
        seed: of the run.
        still: distance of the cloth that hangs still, where the run starts [s.d. of z].
        best: smallest distance in each period but the first [s.d. of z].
        hand_speed: highest in each of these periods [m/s].
        promises: what practice expected of the plan of each period; empty for others [s.d. of z].
        bias_ratio: distance to the right p in the end over that at the start; None where p is not estimated.
    """

    method: str
    case: str
    model: int
    seed: int
    still: float
    best: np.ndarray
    hand_speed: np.ndarray
    promises: np.ndarray
    bias_ratio: float | None


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each method, case, training and repeat.
    """

    settings: Settings
    runs: tuple[Run, ...]

    def select(self, method: str, case: str) -> list[Run]:
        """The runs of a method in a case, by training and repeat."""
        return [run for run in self.runs if (run.method, run.case) == (method, case)]

    @property
    def periods(self) -> int:
        """Of each run, the first among them."""
        return self.settings.steps // ControlSettings.period

    def cases(self, arm: str) -> list[str]:
        """Those of one arm."""
        return [name for name in self.settings.cases if CASES[name].arm == arm]

    def last(self, method: str, case: str) -> np.ndarray:
        """Median of the last ten periods of each training, mean over its repeats, `[models]` [s.d. of z]."""
        return self._values(method, case, lambda run: run.last).mean(axis=1)

    def _values(self, method: str, case: str, value: Callable[[Run], float]) -> np.ndarray:
        """A figure of each run, `[models, repeats]`."""
        runs = self.select(method, case)
        return np.array([[value(run) for run in runs if run.model == k] for k in self.settings.models])

    def _chance(self, method: str, case: str) -> float:
        """Median best distance under random commands, in the z of a method [s.d. of z]."""
        same_z = RANDOM_ON_PAPERS if METHODS[method].weights == PAPER else RANDOM
        return float(np.median([np.median(run.best) for run in self.select(same_z, case)]))

    def differences(self, first: str, second: str, cases: Sequence[str]) -> np.ndarray:
        """How much farther from the target one method stays than another, over random commands' distance.

        Last ten periods of runs that have training and start in common, mean over cases, `[models, repeats]`.
        """
        return self._paired(lambda run: run.last, lambda a, b, chance: (a - b) / chance, first, second, cases)

    def speed_gains(self, first: str, second: str, cases: Sequence[str]) -> np.ndarray:
        """Highest hand speed in the last ten periods under one method over that under another, minus one; likewise."""
        return self._paired(lambda run: run.hand_speed[LATE].max(), lambda a, b, _: a / b - 1, first, second, cases)

    def _paired(self, value: Callable, compare: Callable, first: str, second: str, cases: Sequence[str]) -> np.ndarray:
        pairs = [(self._values(first, case, value), self._values(second, case, value)) for case in cases]
        count = min(values.shape[1] for pair in pairs for values in pair)
        chances = [self._chance(first, case) for case in cases]
        return np.mean(
            [compare(a[:, :count], b[:, :count], c) for (a, b), c in zip(pairs, chances, strict=True)], axis=0
        )

    def periods_until(self, method: str, case: str, distance: float) -> np.ndarray:
        """How many periods each run took until it was as near as `distance` [s.d. of z]; one more than all if never."""
        best = np.array([run.best for run in self.select(method, case)])
        near = np.pad(best <= distance, ((0, 0), (0, 1)), constant_values=True)
        return near.argmax(axis=1) + 2  # the first period is left out of `best`

    def over_random(self, method: str, case: str, *, last: bool = True) -> np.ndarray:
        """Median best distance of each training, of all periods or the last, over random commands', `[models]`."""
        ours = self._values(method, case, lambda run: run.last if last else float(np.median(run.best)))
        return ours.mean(axis=1) / self._chance(method, case)


@cache
def trained_here(make: Maker, arm: str, model: int, folder: Path) -> Trained:
    """A model that the project has no weights of, trained once and kept in the folder."""
    stored = trained(f"{arm}-{model}")
    name = f"{make.__name__}-{stored.name}"

    def train() -> str:
        artifacts.save_autoencoder(
            *artifacts.load_autoencoder(stored.autoencoder_name), stored.autoencoder_name, data=folder
        )
        artifacts.save(replace(make(stored, seen_runs(stored), model), name=name), data=folder)
        return name

    once(name, {"version": version()}, train, folder=folder, files=[f"weights/dpmpb-{name}.safetensors"])
    return artifacts.load(name, data=folder)


def run_one(settings: Settings, method: str, case: str, model: int, repeat: int, *, folder: str | Path = FOLDER) -> Run:
    """One run of a method in a case."""
    how, what = choose("method", method, METHODS), choose("case", case, CASES)
    if how.model:
        learned = trained_here(how.model, what.arm, model, Path(folder))
    else:
        learned = trained(f"{what.arm}{how.weights}-{model}")
    seed = settings.first_seed + 100 * model + repeat
    if how.stiffness:
        learned = replace(learned, arm=learned.arm.with_stiffness(how.stiffness))
    right = learned.biases[what.cloth]
    p = {"right": right, "zero": np.zeros_like(right)}.get(how.p, learned.biases[what.wrong])
    policy, inner = how.make(learned, what, model, p), None
    if how.p == "estimated":
        inner, policy = policy, EstimatingPolicy(policy, BiasEstimator(learned.model, p), learned.autoencoder)
    trial, speed = _watched(policy, what, settings.steps, seed, random_start=repeat > 0)
    away = target_distance(learned.autoencoder, trial, _target(what))
    ratio = None
    if isinstance(policy, EstimatingPolicy):
        ratio = float(np.linalg.norm(policy.trace[-1] - right) / np.linalg.norm(p - right))
    promises = np.array(getattr(inner or policy, "promises", []), dtype=np.float64)
    return Run(
        method=method,
        case=case,
        model=model,
        seed=seed,
        still=float(away[0]),
        best=best_per_period(away).round(4),
        hand_speed=speed.round(3),
        promises=promises.round(4),
        bias_ratio=ratio,
    )


def _watched(policy: Policy, case: Case, steps: int, seed: int, *, random_start: bool) -> tuple[Trial, np.ndarray]:
    """A run, and the highest speed of the hand in each of its periods but the first [m/s]."""
    env = ClothEnv(case.arm, case.cloth)
    watch = MotionWatch(env)
    try:
        trial = rollout(env, policy, steps, seed=seed, random_start=random_start, watch=watch, samples=SAMPLES)
    finally:
        env.close()
    samples = ControlSettings.period * SAMPLES
    speed = watch.motion().hand_speed[: len(trial) * SAMPLES // samples * samples]
    return trial, speed.reshape(-1, samples).max(axis=1)[1:]


def jobs(settings: Settings) -> list[tuple[str, str, int, int]]:
    """Every run: method, case, training and repeat."""
    found = []
    for method, case, model in product(settings.methods, settings.cases, settings.models):
        how = choose("method", method, METHODS)
        if choose("case", case, CASES).arm not in how.arms:
            continue
        repeats = settings.repeats if how.often else 1
        found += [(method, case, model, repeat) for repeat in range(repeats)]
    return found


def _models(todo: list[tuple[str, str, int, int]]) -> list[tuple[Maker, str, int]]:
    """Those that have to be trained, each once."""
    wanted = [(METHODS[method].model, CASES[case].arm, model) for method, case, model, _ in todo]
    return list(dict.fromkeys((make, arm, model) for make, arm, model in wanted if make))


def run_kept(folder: Path, settings: Settings, *job: Any) -> Run:
    """`run_one`, or what it said before."""
    made_with = {"steps": settings.steps, "first_seed": settings.first_seed}
    return piece(job, made_with, lambda: run_one(settings, *job, folder=folder), Run, folder)


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Every method in every case with every training.

    Args:
        settings: what is run.
        workers: processes.
        progress: show a progress bar.
        folder: where each run is kept as soon as it is done; an interrupted experiment goes on from there.
    """
    settings, folder = settings or Settings(), Path(folder)
    todo = jobs(settings)
    if models := _models(todo):  # before the runs, that no two of them train the same
        run_jobs(trained_here, [(*each, folder) for each in models], workers=workers, progress=progress, what="models")
    runs = [(folder, settings, *job) for job in todo]
    return Record(settings, tuple(run_jobs(run_kept, runs, workers=workers, progress=progress, what="practice")))
