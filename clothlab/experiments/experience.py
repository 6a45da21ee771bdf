"""How much experience? The same networks after half to twenty times the paper's recordings: what they foresee, what p
knows of the cloth, and what control makes of it.

Only the recordings differ: every autoencoder and every model has the same number of updates, whatever it learns from.
A full run takes hours, so what is finished is kept in a folder, and the next run goes on from there. It is known by its
settings and by the recordings learned from, not by the code: who changes how something is measured deletes
`results/point-*` in that folder.
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from clothlab import artifacts
from clothlab._validation import Checked, choose_all, setting
from clothlab.analysis import (
    MaterialReadout,
    best_per_period,
    bias_error,
    late_median,
    median_best,
    nearest_material,
    target_distance,
)
from clothlab.artifacts import MORE
from clothlab.experiments import perception
from clothlab.experiments._kept import once
from clothlab.experiments._record import RECORDINGS, converter, estimate_at_random, new_trial, random_trial, run_jobs
from clothlab.learning.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.learning.control import recorded_plans
from clothlab.learning.dpmpb import ModelTraining, stretches, to_sequences, train_dpmpb
from clothlab.learning.estimation import prediction_loss
from clothlab.learning.trained import Trained
from clothlab.policies import Policy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS, cloth_name
from clothlab.training_configs import RECIPES
from clothlab.trials import Trial

FOLDER = Path("build") / "experience"  # where trainings are kept, from the folder in which the experiment is run
PAPER, DEFAULT = 1.0, 20.0  # the paper's amount, and that of the weights `torque-K` and `muscle-K`


@dataclass(frozen=True)
class Setup:
    """What is recorded, learned and tried with an arm.

    Attributes:
        trials: name of the paper's recordings; more of them are in the set of that name with `-more`.
        evaluation: name of trials that no training sees.
        seen: targets with which distances of images are compared.
        moved: name of the cloth that is moved at random for that.
        target: name of the one to realise.
        cloths: names of those to realise it with.
    """

    trials: str
    evaluation: str
    seen: tuple[str, ...]
    moved: str
    target: str
    cloths: tuple[str, ...]


ARMS = {
    "torque": Setup(
        trials=RECORDINGS["torque"],
        evaluation="evaluation",
        seen=("target-1", "target-2"),
        moved=cloth_name(0.05, 0.10),
        target="target-1",
        cloths=(cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)),
    ),
    "muscle": Setup(
        trials=RECORDINGS["muscle"],
        evaluation="muscle-evaluation",
        seen=("muscle",),
        moved="soft-2",
        target="muscle",
        cloths=("hard-1", "soft-1"),
    ),
}

Method = Callable[[Trained, np.ndarray, str], Policy]  # what was learned, mask of the target, name of the cloth


def from_warm_start(learned: Trained, target: np.ndarray, cloth: str) -> Policy:
    """The paper's method."""
    return learned.controller(target, cloth)


def from_recorded_starts(learned: Trained, target: np.ndarray, cloth: str) -> Policy:
    """The same, where each period may start from a stretch of the paper's recordings: the same ones for all amounts."""
    return learned.controller(target, cloth, plans=recorded_plans(artifacts.load_trials(ARMS[learned.arm.name].trials)))


def by_practice(learned: Trained, target: np.ndarray, cloth: str) -> Policy:
    """Practice, which begins with plans of the paper's recordings: the same ones for all amounts."""
    runs = [learned.sequences(trial) for trial in artifacts.load_trials(ARMS[learned.arm.name].trials)]
    return learned.iterative_controller(target, cloth, runs)


METHODS: dict[str, Method] = {  # who controls: another `Method` in a line of its own joins the experiment
    "paper's control": from_warm_start,
    "paper's control, recorded starts": from_recorded_starts,
    "practice": by_practice,
}


@dataclass(frozen=True)
class Settings(Checked):
    """How much is learned from, and what is tried; the defaults are the full size."""

    arms: tuple[str, ...] = setting(tuple(ARMS))
    amounts: tuple[float, ...] = setting((0.5, 1.0, 2.0, 5.0, 10.0, 20.0), "times the paper's recordings", above=0)
    models: tuple[int, ...] = setting((0, 1), at_least=0)  # seeds of the trainings
    autoencoder_updates: int = setting(4200, at_least=1)  # to the next whole epoch, as all updates
    model_updates: int = setting(1500, at_least=1)
    seen_steps: int = setting(450, "step", at_least=3)  # of random commands, for the chamfer distances
    seen_seed: int = setting(25000, at_least=0)
    estimation_steps: int = setting(200, "step", at_least=12)  # 40 s of random commands
    estimation_seed: int = setting(26000, at_least=0)  # of the commands: this + 100 model + number of the cloth
    methods: tuple[str, ...] = setting(tuple(METHODS))
    control_steps: int = setting(248, "step", at_least=16)  # 31 periods
    random_seed: int = setting(27000, at_least=0)  # of the random commands beside control: this + model

    def __post_init__(self) -> None:
        """Refuse what would only be noticed hours later.

        Raises:
            KeyError: an unknown arm or method; the message lists the choices.
            ValueError: nothing to measure, or an amount that is neither a part of the recordings nor whole repeats.
        """
        super().__post_init__()
        choose_all("arm", self.arms, ARMS)
        choose_all("method of control", self.methods, METHODS)
        for what in ("arms", "amounts", "models"):
            if not getattr(self, what):
                raise ValueError(f"Settings.{what} needs an entry at least")
        for amount in self.amounts:
            if amount > 1 and amount % 1:
                raise ValueError(
                    f"Settings.amounts are parts of the paper's recordings or whole repeats, got {amount:g}"
                )


@dataclass(frozen=True)
class Seen:
    """An autoencoder.

    Attributes:
        arm: name of the arm.
        amount: of experience [times the paper's].
        steps: of all trials learned from.
        recordings: fingerprint of those trials.
        updates: of the training.
        iou: intersection over union of images of the evaluation trials and their reconstructions, mean.
        correlation: of log chamfer distance and z distance, mean over targets.
    """

    arm: str
    amount: float
    steps: int
    recordings: str
    updates: int
    iou: float
    correlation: float


@dataclass(frozen=True)
class Control:
    """One method with one cloth.

    Attributes:
        method: its name.
        cloth: name of the cloth in the hand.
        best: smallest distance to the target in a period, median over all periods but the first [s.d. of z].
        last: the same over the last ten periods [s.d. of z].
        random: the same as `best` under random commands [s.d. of z].
    """

    method: str
    cloth: str
    best: float
    last: float
    random: float

    @property
    def ratio(self) -> float:
        """Last ten periods over random commands: each autoencoder has a z, and so a distance, of its own."""
        return self.last / self.random


@dataclass(frozen=True, eq=False)
class Run:
    """One training of the model.

    Attributes:
        arm: name of the arm.
        amount: of experience [times the paper's].
        model: seed of the training.
        updates: of the training.
        prediction: mean squared error of the next state on evaluation trials, with the trained p of their cloths
            [s.d.² of the states learned from].
        r2: leave-one-cloth-out R² of log C_damp and log C_mass read off the trained p, `[2]`; `[0]` for foams, which
            have no such pair.
        ratio_r2: the same of log (C_damp / C_mass).
        nearest: how often p, estimated from 0, comes nearest to the right one, of all cloths.
        distance: of that estimate to the right p, median over cloths [spreads of the trained p].
        control: one for each method and cloth.
    """

    arm: str
    amount: float
    model: int
    updates: int
    prediction: float
    r2: np.ndarray
    ratio_r2: float | None
    nearest: float
    distance: float
    control: tuple[Control, ...]

    def ratio(self, method: str) -> float:
        """Distance under a method over that of random commands, mean over cloths."""
        return float(np.mean([each.ratio for each in self.control if each.method == method]))


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        seen: one for each arm and amount, the smallest first.
        runs: one for each arm, amount and training, likewise.
    """

    settings: Settings
    seen: tuple[Seen, ...]
    runs: tuple[Run, ...]

    def steps(self, arm: str) -> dict[float, int]:
        """Control steps that were learned from, by amount, the smallest first."""
        return {each.amount: each.steps for each in self.seen if each.arm == arm}

    def marks(self) -> dict[str, float]:
        """Amounts to point out in a figure."""
        return {"the paper's amount": PAPER, "amount of the default weights": DEFAULT}

    def curves(self) -> dict[str, dict[str, np.ndarray]]:
        """Each quantity by arm, `{quantity: {arm: [amounts, trainings]}}`, amounts as `steps` has them.

        An arm for which a quantity has no meaning is left out there.
        """
        of_models: dict[str, Callable[[Run], float | None]] = {
            "prediction error [s.d.²]": lambda run: run.prediction,
            "R² of log C_damp": lambda run: run.r2[0] if len(run.r2) else None,
            "R² of log C_mass": lambda run: run.r2[1] if len(run.r2) else None,
            "R² of log (C_damp / C_mass)": lambda run: run.ratio_r2,
            "rate of nearest p being right": lambda run: run.nearest,
        }
        for method in self.settings.methods:
            of_models[f"distance over random commands',\n{method}"] = partial(Run.ratio, method=method)
        of_autoencoders: dict[str, Callable[[Seen], float | None]] = {
            "correlation of z distance\nand log chamfer distance": lambda seen: seen.correlation,
            "IoU of reconstructions": lambda seen: seen.iou,
        }
        return {name: self._by_arm(self.runs, value) for name, value in of_models.items()} | {
            name: self._by_arm(self.seen, value) for name, value in of_autoencoders.items()
        }

    def _by_arm(self, measured: Sequence[Any], value: Callable[[Any], float | None]) -> dict[str, np.ndarray]:
        found = {}
        for arm in self.settings.arms:
            rows = [[value(x) for x in measured if (x.arm, x.amount) == (arm, amount)] for amount in self.steps(arm)]
            if not any(each is None for row in rows for each in row):
                found[arm] = np.array(rows, float)
        return found


def learned_from(arm: str, amount: float) -> list[Trial]:
    """The trials that an amount of experience is made of.

    Below one, the first part of each of the paper's; above, the paper's and whole repeats of them, first ones first.

    Raises:
        FileNotFoundError: not so many are recorded.
        ValueError: a damaged, altered or missing file.
    """
    name = ARMS[arm].trials
    paper = artifacts.load_trials(name)
    if amount < 1:
        return [trial[: round(amount * len(trial))] for trial in paper]
    repeats = int(amount) - 1
    if not repeats:
        return paper
    try:
        more = artifacts.load_trials(name + MORE, first=repeats * len(paper))
    except KeyError:
        more = []
    wanted, found = (Counter((trial.cloth.name, trial.policy) for trial in trials) for trials in (paper, more))
    if found != Counter({each: repeats * count for each, count in wanted.items()}):
        raise FileNotFoundError(
            f"{amount:g} times the paper's recordings need {repeats} repeats of {name} in data/trials/{name + MORE}, "
            f"{repeats * len(paper)} trials, and {len(more)} of them are there: record them with `make data`"
        )
    return paper + more


def fingerprint(trials: Sequence[Trial]) -> str:
    """Hash of what was recorded, by which trainings know what they were trained on."""
    digest = hashlib.sha256()
    for trial in trials:
        digest.update(trial.cloth.name.encode())
        for array in (np.packbits(trial.images), trial.robot, trial.commands):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _epochs(updates: int, batches: int) -> int:
    """Whole epochs that come nearest to a number of updates."""
    return max(1, round(updates / batches))


def _recipe(training: AutoencoderTraining | ModelTraining, updates: int) -> dict[str, Any]:
    """What a training is known by: its settings, with updates in place of the epochs that follow from them."""
    return {name: value for name, value in asdict(training).items() if name != "epochs"} | {"updates": updates}


def weights_name(arm: str, amount: float) -> str:
    """What the weights of an amount of experience are called, such as `torque-x5` or `torque-x0_5`."""
    return f"{arm}-x{amount:g}".replace(".", "_")


def run_autoencoder(settings: Settings, arm: str, amount: float, folder: Path) -> Seen:
    """Train an autoencoder, or take the one that is kept, and measure what it sees."""
    trials, recipe, name = learned_from(arm, amount), AutoencoderTraining(), weights_name(arm, amount)
    steps, recordings = sum(map(len, trials)), fingerprint(trials)

    def train() -> int:
        images, batches = np.concatenate([trial.images for trial in trials]), max(1, steps // recipe.batch_size)
        trials.clear()  # the images of twenty times the paper's are a gigabyte, and other jobs run beside this one
        training = replace(recipe, epochs=_epochs(settings.autoencoder_updates, batches))
        model, losses = train_autoencoder(images, training, seed=0, progress=False)
        artifacts.save_autoencoder(model, losses, name, data=folder)
        return training.epochs * batches

    def see() -> list[float]:
        setup, (autoencoder, _) = ARMS[arm], artifacts.load_autoencoder(name, data=folder)
        what = perception.Settings(
            arm=arm,
            trials=setup.evaluation,
            targets=setup.seen,
            cloth=setup.moved,
            steps=settings.seen_steps,
            seed=settings.seen_seed,
        )
        found = perception.look(what, autoencoder)
        return [found.iou, float(np.mean([each.correlation for each in found.chamfer]))]

    made_with = {"recordings": recordings, "training": _recipe(recipe, settings.autoencoder_updates), "seed": 0}
    file = f"weights/autoencoder-{name}.safetensors"
    updates = once(name, made_with, train, folder=folder, files=[file])
    tried = {"autoencoder": made_with, "steps": settings.seen_steps, "seed": settings.seen_seed}
    iou, correlation = once(f"point-{name}", tried, see, folder=folder)
    return Seen(arm, amount, steps, recordings, updates, iou, correlation)


def run_model(settings: Settings, seen: Seen, model: int, folder: Path) -> Run:
    """Train a model on what an autoencoder has seen, or take the one that is kept, and measure what it is good for."""
    eye = weights_name(seen.arm, seen.amount)
    recipe = ModelTraining(sequence_length=RECIPES[seen.arm].model.sequence_length)
    name = f"{eye}-{model}"
    autoencoder, _ = artifacts.load_autoencoder(eye, data=folder)

    def train() -> int:
        runs = [to_sequences(autoencoder, trial) for trial in learned_from(seen.arm, seen.amount)]
        sequences = len(stretches(runs, recipe.sequence_length, recipe.stride)[0])
        batches = -(-sequences // recipe.batch_size)
        training = replace(recipe, epochs=_epochs(settings.model_updates, batches))
        network, biases, trace = train_dpmpb(runs, training, seed=model, progress=False)
        arm = get_arm(seen.arm)
        artifacts.save(Trained(name, arm, autoencoder, network, biases, trace.losses, eye), data=folder)
        return training.epochs * batches

    made_with = {"recordings": seen.recordings, "autoencoder": autoencoder.fingerprint(), "seed": model}
    made_with |= {"training": _recipe(recipe, settings.model_updates)}
    file = f"weights/dpmpb-{name}.safetensors"
    updates = once(name, made_with, train, folder=folder, files=[file])
    names = ("estimation_steps", "estimation_seed", "methods", "control_steps", "random_seed")
    tried = {"model": made_with} | {each: getattr(settings, each) for each in names}

    def measure() -> Any:
        learned = artifacts.load(name, data=folder)
        return converter.unstructure(_measured(settings, seen, learned, model, updates))

    return converter.structure(once(f"point-{name}", tried, measure, folder=folder), Run)


def _measured(settings: Settings, seen: Seen, learned: Trained, model: int, updates: int) -> Run:
    cloths = {name: CLOTHS[name] for name in learned.biases if name in CLOTHS}  # foams have no C_damp and C_mass
    readout = MaterialReadout.fit(learned.biases, cloths) if cloths else None
    right, distance = _estimated(settings, learned, model)
    return Run(
        arm=seen.arm,
        amount=seen.amount,
        model=model,
        updates=updates,
        prediction=_prediction(learned),
        r2=readout.r2 if readout else np.empty(0),
        ratio_r2=readout.ratio_r2 if readout else None,
        nearest=right,
        distance=distance,
        control=tuple(_controlled(settings, learned, model)),
    )


def _prediction(learned: Trained) -> float:
    """Prediction error on the evaluation trials, mean."""
    losses = []
    for trial in artifacts.load_trials(ARMS[learned.arm.name].evaluation):
        run, p = learned.sequences(trial), torch.as_tensor(learned.biases[trial.cloth.name])
        with torch.no_grad():
            losses.append(prediction_loss(learned.model, torch.as_tensor(run.s), torch.as_tensor(run.u), p).item())
    return float(np.mean(losses))


def _estimated(settings: Settings, learned: Trained, model: int) -> tuple[float, float]:
    """How often the estimate of p comes nearest to the right one, and its median distance to it [spreads]."""
    right, distances = [], []
    for k, name in enumerate(learned.biases):
        seed = settings.estimation_seed + 100 * model + k
        p, _ = estimate_at_random(learned, name, settings.estimation_steps, seed)
        right.append(nearest_material(p, learned.biases) == name)
        distances.append(bias_error(p, name, learned.biases))
    return float(np.mean(right)), float(np.median(distances))


def _controlled(settings: Settings, learned: Trained, model: int) -> Iterator[Control]:
    """Every method with every cloth, beside the same random commands."""
    setup = ARMS[learned.arm.name]
    mask = artifacts.load_target(setup.target)
    for cloth in setup.cloths:
        chance = random_trial(learned.arm.name, cloth, settings.control_steps, settings.random_seed + model)
        random = median_best([target_distance(learned.autoencoder, chance, mask)])
        for method in settings.methods:
            policy = METHODS[method](learned, mask, cloth)
            trial = new_trial(policy, learned.arm, cloth, settings.control_steps, model)
            best = best_per_period(target_distance(learned.autoencoder, trial, mask))
            yield Control(method, cloth, float(np.median(best)), late_median(best), random)


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Every amount of experience: train what is not kept in the folder yet, and measure.

    Raises:
        FileNotFoundError: fewer recordings than an amount needs; the message says how to get them.
    """
    settings, folder = settings or Settings(), Path(folder)
    options: dict[str, Any] = {"workers": workers, "progress": progress}
    # The largest first, so that recordings that are missing are noticed early.
    pairs = product(sorted(settings.amounts, reverse=True), settings.arms)
    jobs = [(settings, arm, amount, folder) for amount, arm in pairs]
    seen = run_jobs(run_autoencoder, jobs, what="autoencoders", **options)
    trainings = [(settings, each, model, folder) for each in seen for model in settings.models]
    runs = run_jobs(run_model, trainings, what="models", **options)
    order = {each: k for k, each in enumerate(product(settings.arms, sorted(settings.amounts)))}
    for measured in (seen, runs):
        measured.sort(key=lambda each: order[each.arm, each.amount])  # it keeps the order of the models
    return Record(settings, tuple(seen), tuple(runs))
