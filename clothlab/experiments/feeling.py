"""Does a robot that feels its torques know a cloth better? The same cameras, cloths and commands, with and without two
torques in the robot state: what p knows of C_damp and C_mass, how well it is found, what control makes of it; and
whether commands chosen to learn find it sooner than random ones.

A simulated servo's torque follows from command, angle and velocity, without noise (`FeelingArm`): what
differs is what the training's loss makes of them, not what could be known.
"""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, check_array, choose_all, setting
from clothlab.analysis import MaterialReadout, best_per_period, bias_error, nearest_material, target_distance
from clothlab.experiments._kept import piece
from clothlab.experiments._record import Reached, load, new_trial, run_jobs, sort_out, trained
from clothlab.experiments.estimation import BETWEEN
from clothlab.experiments.practice import GRADIENT, METHODS, PRACTICE, aim
from clothlab.learning.estimation import NewtonSettings, estimate_bias
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS, cloth_name

FOLDER = Path("build/feeling")  # where each piece is kept as soon as it is done
TORQUE, FEELING = "torque", "torque-feeling"  # weights
RANDOM, CHOSEN, AS_LONG = "random", "chosen", "random, as long"  # commands while p is estimated
SHORTEST = 12  # steps from which p can be estimated at all
MATTERS = ("steps", "first_seed", "as_long_seed", "control_steps")  # the other settings only say which pieces there are
KNOWN = CLOTHS | BETWEEN


@dataclass(frozen=True)
class Settings(Checked):
    """Which weights, cloths and targets; the defaults are the full size."""

    weights: tuple[str, ...] = setting((TORQUE, FEELING))
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    cloths: tuple[str, ...] = setting(tuple(KNOWN))
    repeats: int = setting(4, at_least=1)  # other random commands for each training and cloth
    steps: int = setting(200, "step", at_least=SHORTEST)  # 40 s of them
    first_seed: int = setting(40_000, at_least=0)  # of them: this + 100 model + 20 repeat + number of the cloth
    as_long_seed: int = setting(45_000, at_least=0)  # of random commands beside chosen ones, likewise
    chosen: int = setting(2, at_least=0)  # of the recorded stretches, those that tell most of a cloth
    targets: tuple[str, ...] = setting(("target-1", "target-2"))
    held: tuple[str, ...] = setting((cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)))  # cloths to realise them with
    methods: tuple[str, ...] = setting((GRADIENT, PRACTICE))
    control_steps: int = setting(248, "step", at_least=16)  # 31 periods

    def __post_init__(self) -> None:
        """Refuse what would only be noticed hours later.

        Raises:
            KeyError: an unknown cloth or method; the message lists the choices.
        """
        super().__post_init__()
        choose_all("cloth", self.cloths, KNOWN)
        choose_all("method", self.methods, METHODS)


@dataclass(frozen=True, eq=False)
class Readout:
    """What one training's p knows.

    Attributes:
        weights: name of the weights.
        model: seed of the training.
        r2: leave-one-cloth-out R² of log C_damp and log C_mass, `[2]`.
        ratio_r2: the same of log (C_damp / C_mass).
    """

    weights: str
    model: int
    r2: np.ndarray
    ratio_r2: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """One estimation of p from 0.

    Attributes:
        weights: name of the weights.
        model: seed of the training.
        motion: which commands, `"random"`, `"chosen"` or `"random, as long"`.
        number: of the repeat, or of the chosen sequence.
        cloth: name of the cloth in the hand.
        steps: how long it took.
        nearest: the material whose trained p is nearest in the end.
        distance: final distance to the right p [spreads of the trained p]; none for a cloth that was never trained.
        error: relative errors of C_damp and C_mass read off the final p `[2]`.
    """

    weights: str
    model: int
    motion: str
    number: int
    cloth: str
    steps: int
    nearest: str
    distance: float | None
    error: np.ndarray


@dataclass(frozen=True, eq=False)
class Control(Reached):
    """One run towards a target.

    Attributes:
        weights: name of the weights.
        model: seed of the training.
        method: `"gradient"`, the paper's, or `"practice"`.
        target: its name.
        cloth: name of the cloth in the hand.
        best: smallest distance in each period but the first [s.d. of z].
    """

    weights: str
    model: int
    method: str
    target: str
    cloth: str
    best: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        readouts: one for each of the weights and trainings.
        estimates: one for each of the weights, trainings, cloths and repeats, and the same for chosen commands.
        control: one for each of the weights, trainings, methods, targets and cloths.
    """

    settings: Settings
    readouts: tuple[Readout, ...]
    estimates: tuple[Estimate, ...]
    control: tuple[Control, ...]

    def r2(self, weights: str) -> np.ndarray:
        """R² of log C_damp, of log C_mass and of their ratio, `[models, 3]`."""
        return np.array([[*each.r2, each.ratio_r2] for each in self.readouts if each.weights == weights])

    def select(self, weights: str, motion: str = RANDOM, *, between: bool) -> list[Estimate]:
        """Estimates of the cloths between the trained ones, or of those."""
        return [
            each
            for each in self.estimates
            if (each.weights, each.motion, each.cloth in BETWEEN) == (weights, motion, between)
        ]

    def nearest_rate(self, weights: str, motion: str = RANDOM) -> float:
        """How often p of a trained cloth comes nearest to the right one, 0 to 1."""
        return float(np.mean([each.nearest == each.cloth for each in self.select(weights, motion, between=False)]))

    def errors(self, weights: str, motion: str = RANDOM, *, between: bool = True) -> np.ndarray:
        """Sizes of the relative errors of C_damp and C_mass, `[runs, 2]`."""
        return np.abs([each.error for each in self.select(weights, motion, between=between)])

    def paired(self, weights: str, motion: str = RANDOM) -> np.ndarray:
        """Sizes of the relative errors of C_damp and C_mass of all cloths, `[models, runs, 2]`.

        In the same order whatever the weights, and for chosen commands and random ones as long.
        """
        found = [each for each in self.estimates if (each.weights, each.motion) == (weights, motion)]
        found.sort(key=lambda each: (each.model, each.cloth, each.number))
        return np.abs([each.error for each in found]).reshape(len(self.settings.models), -1, 2)

    def last(self, weights: str, method: str, target: str) -> np.ndarray:
        """Distance in the last ten periods, mean over cloths, `[models]` [s.d. of z]."""
        runs = [run for run in self.control if (run.weights, run.method, run.target) == (weights, method, target)]
        return np.array([np.mean([run.last for run in runs if run.model == k]) for k in self.settings.models])


def read_one(settings: Settings, weights: str, model: int) -> Readout:
    """What the trained p of one training know."""
    fitted = MaterialReadout.fit(trained(f"{weights}-{model}").biases, CLOTHS)
    return Readout(weights, model, fitted.r2, fitted.ratio_r2)


def estimate_one(
    settings: Settings, weights: str, model: int, cloth: str, motion: str, number: int, commands: Sequence | None = None
) -> Estimate:
    """Estimate p of one cloth while it is moved by random commands, or by those given `[T, D_u]`."""
    learned, held = trained(f"{weights}-{model}"), KNOWN[cloth]
    first = settings.first_seed if motion == RANDOM else settings.as_long_seed
    seed = first + 100 * model + 20 * number + list(KNOWN).index(cloth)
    steps = settings.steps if commands is None else len(commands)
    policy = ReplayPolicy(commands) if commands and motion == CHOSEN else RandomPolicy(learned.arm)
    trial = new_trial(policy, learned.arm, held, steps, seed)
    p, _ = estimate_bias(learned.model, learned.sequences(trial), settings=NewtonSettings())
    distance = bias_error(p, cloth, learned.biases) if cloth in learned.biases else None
    error = np.array(MaterialReadout.fit(learned.biases, CLOTHS)(p)) / (held.damping, held.mass) - 1
    nearest = nearest_material(p, learned.biases)
    return Estimate(weights, model, motion, number, cloth, steps, nearest, distance, error)


def control_one(settings: Settings, weights: str, model: int, method: str, target: str, cloth: str) -> Control:
    """Aim at a target with the right p."""
    learned, mask = trained(f"{weights}-{model}"), artifacts.load_target(target)
    trial = new_trial(aim(method, learned, target, cloth), learned.arm, cloth, settings.control_steps, model)
    best = best_per_period(target_distance(learned.autoencoder, trial, mask))
    return Control(weights, model, method, target, cloth, best.round(4))


_KINDS: dict[str, tuple[Callable[..., Any], type]] = {
    "read": (read_one, Readout),
    "estimate": (estimate_one, Estimate),
    "control": (control_one, Control),
}


def run_kept(folder: Path, settings: Settings, kind: str, *job: Any) -> Any:
    """One piece of the work, or what it said before."""
    function, made = _KINDS[kind]
    sent = hashlib.sha256(repr(job).encode()).hexdigest()[:8]  # of commands that were chosen too
    about = (kind, *(each for each in job if isinstance(each, str | int)))
    made_with = {"settings": {each: getattr(settings, each) for each in MATTERS}, "sent": sent}
    return piece(about, made_with, lambda: function(settings, *job), made, folder)


def jobs(settings: Settings, chosen: Iterable[ArrayLike] = ()) -> list[tuple]:
    """Every piece of the work: its kind, and what it is about.

    Raises:
        ValueError: chosen commands of another size, not finite, or too short for an estimation.
    """
    trainings = list(product(settings.weights, settings.models))
    found: list[tuple] = [("read", *each) for each in trainings]
    repeats = product(trainings, settings.cloths, range(settings.repeats))
    found += [("estimate", *each, cloth, RANDOM, number) for each, cloth, number in repeats]
    size = len(get_arm(TORQUE).command_names)
    for number, sent in enumerate(chosen):
        commands = check_array(f"chosen commands {number}", sent, ("T", size)).tolist()
        if len(commands) < SHORTEST:
            raise ValueError(f"chosen commands {number} are too short for an estimation: {len(commands)} steps")
        pairs = product(trainings, settings.cloths, (CHOSEN, AS_LONG))
        found += [("estimate", *each, cloth, motion, number, commands) for each, cloth, motion in pairs]
    runs = product(trainings, settings.methods, settings.targets, settings.held)
    return found + [("control", *each, *rest) for each, *rest in runs]


def most_informative(count: int) -> list[np.ndarray]:
    """Those of the recorded stretches that tell most of a cloth (D-optimal), by the stored record of `knowledge`.

    Raises:
        KeyError: there is no such record; the message lists those that there are.
    """
    if not count:
        return []
    known = load("knowledge")
    return [known.plans[number].commands for number in known.order("z + joints + torques")[:count]]


def run(
    settings: Settings | None = None,
    *,
    chosen: Iterable[ArrayLike] | None = None,
    workers: int = 1,
    progress: bool = False,
    folder: str | Path = FOLDER,
) -> Record:
    """Everything, with and without torques.

    Args:
        settings: what is run.
        chosen: sequences of commands `[T, D_u]` to learn from; each is sent to every cloth, beside random commands
            for the same time. When left out, `most_informative`.
        workers: processes.
        progress: show a progress bar.
        folder: where each piece is kept as soon as it is done; an interrupted experiment goes on from there.

    Raises:
        KeyError: weights that are not trained yet, or no record of what motions tell; the message lists the choices.
        ValueError: chosen commands of another size, not finite, or too short.
    """
    settings, folder = settings or Settings(), Path(folder)
    chosen = most_informative(settings.chosen) if chosen is None else chosen
    todo = [(folder, settings, *job) for job in jobs(settings, chosen)]
    found = run_jobs(run_kept, todo, workers=workers, progress=progress, what="feeling")
    return Record(settings, *sort_out(found, (made for _, made in _KINDS.values())))
