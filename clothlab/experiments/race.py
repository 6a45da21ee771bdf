"""A race: who finds C_damp and C_mass of the cloth in the hand, how soon, at what cost, and knowing what beforehand?

All that take part get the same runs, what was sensed and what was sent, without the name of the cloth or its constants.
What is finished is kept in a folder, so that an interrupted race goes on from there.
"""

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.torch import save as to_bytes

from clothlab._files import read_tensors, reading, write_bytes
from clothlab._validation import Checked, choose, choose_all, setting
from clothlab.analysis import MaterialReadout
from clothlab.artifacts import filled
from clothlab.experiments import knowledge
from clothlab.experiments._kept import once, piece, version
from clothlab.experiments._record import random_trial, run_jobs, trained
from clothlab.experiments.estimation import BETWEEN
from clothlab.experiments.knowledge import QUANTITIES
from clothlab.experiments.practice import seen_runs
from clothlab.experiments.sysid import (
    UNKNOWN,
    FitSettings,
    Identify,
    Regressor,
    RegressorTraining,
    Simulator,
    fit_simulation,
    logs,
    sysid_tools,
    train_regressor,
)
from clothlab.learning.dpmpb import Sequences, train_dpmpb
from clothlab.learning.estimation import EstimationSettings, NewtonSettings, estimate_bias
from clothlab.learning.trained import Trained
from clothlab.simulation.cloth import CLOTHS, DAMPINGS, MASSES, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.training_configs import RECIPES

FOLDER = Path("build") / "race"  # where answers are kept, from the folder in which the experiment is run
BEYOND = 1.5  # outside the trained range by this factor
OUTSIDE = {
    "outside-light": Cloth("outside-light", damping=DAMPINGS[0] / BEYOND, mass=MASSES[0] / BEYOND),
    "outside-heavy": Cloth("outside-heavy", damping=DAMPINGS[-1] * BEYOND, mass=MASSES[-1] * BEYOND),
}
GROUPS = {"trained": CLOTHS, "between": BETWEEN, "outside": OUTSIDE}
ALL = CLOTHS | BETWEEN | OUTSIDE
# The simulation as somebody has it who did not measure the springs: 30 % too soft, 50 % too much of what resists folds.
ROUGH = Cloth("rough", stiffness=0.7 * Cloth.stiffness, bending=1.5 * Cloth.bending)
FIT, NETWORK = FitSettings(), RegressorTraining()


@dataclass(frozen=True)
class Settings(Checked):
    """Who takes part, with which cloths; the defaults are the full size."""

    weights: str = setting("torque")
    methods: tuple[str, ...] = setting(("p", "p by momentum", "sysid", "sysid-rough", "network"))
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings, and of other commands
    fitted_models: tuple[int, ...] = setting((0,), at_least=0)  # those of them with which a simulation is fitted,
    rough_models: tuple[int, ...] = setting((0,), at_least=0)  # and a rough one: that takes minutes a run
    cloths: tuple[str, ...] = setting(tuple(ALL))
    steps: tuple[int, ...] = setting((25, 50, 100, 200), "step", at_least=12)  # 5, 10, 20 and 40 s
    first_seed: int = setting(31000, at_least=0)  # of the commands: this + 100 model + number of the cloth
    fit: FitSettings = FIT
    network: RegressorTraining = NETWORK

    def __post_init__(self) -> None:
        """Refuse what would only be noticed hours later.

        Raises:
            KeyError: an unknown method or cloth; the message lists the choices.
            ValueError: nothing to run, or steps that do not grow.
        """
        super().__post_init__()
        choose_all("method", self.methods, METHODS)
        choose_all("cloth", self.cloths, ALL)
        for what in ("methods", "models", "cloths", "steps"):
            if not getattr(self, what):
                raise ValueError(f"Settings.{what} needs an entry at least")
        if any(b <= a for a, b in zip(self.steps, self.steps[1:], strict=False)):
            raise ValueError(f"Settings.steps grow, got {self.steps}")


@dataclass(frozen=True, eq=False)
class Run:
    """The answers of one method to one run.

    Attributes:
        method: who answers.
        cloth: name of the cloth in the hand.
        model: seed of the training.
        seed: of the commands.
        error: of log C_damp and log C_mass after each time, `[times, 2]`.
        seconds: of computation for each answer, from the first state on, of one core `[times]` [s].
    """

    method: str
    cloth: str
    model: int
    seed: int
    error: np.ndarray
    seconds: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each cloth, training and method.
        training: seconds of computation beforehand by method, of one core, without the autoencoder's, which all need
            [s].
    """

    settings: Settings
    runs: tuple[Run, ...]
    training: dict[str, float]

    @property
    def times(self) -> np.ndarray:
        """When answers are asked for, `[times]` [s]."""
        return np.array(self.settings.steps) * CONTROL_PERIOD

    def errors(self, method: str, quantity: str, group: str | None = None) -> np.ndarray:
        """Absolute errors of the logarithm of a quantity, `[runs, times]`.

        Args:
            method: who answers.
            quantity: one of `QUANTITIES`.
            group: one of `GROUPS`; all cloths when left out.

        Raises:
            KeyError: an unknown quantity or group; the message lists the choices.
        """
        share = np.array(choose("quantity", quantity, QUANTITIES))
        cloths = ALL if group is None else choose("group of cloths", group, GROUPS)
        found = [np.abs(run.error @ share) for run in self.runs if run.method == method and run.cloth in cloths]
        return np.reshape(found, (-1, len(self.settings.steps)))

    def over_bound(self, method: str, known: knowledge.Record, sensors: str, quantity: str) -> np.ndarray:
        """Errors in the end over the Cramér-Rao bounds of the same cloths under random commands, `[runs]`.

        Args:
            method: who answers.
            known: what motions tell of the trained cloths; runs with others are left out.
            sensors: whose bound, one of `knowledge.SENSOR_SETS`.
            quantity: one of `QUANTITIES`.

        Raises:
            KeyError: unknown sensors or quantity; the message lists the choices.
            ValueError: bounds for another time than the last of the race.
        """
        if known.settings.times[-1] != self.times[-1]:
            raise ValueError(f"bounds are for {known.settings.times[-1]:g} s, the race ends after {self.times[-1]:g} s")
        share = np.array(choose("quantity", quantity, QUANTITIES))
        best = {
            cloth: np.median([run.known.bound(sensors)[quantity][-1] for run in known.cases("random", cloth)])
            for cloth in known.settings.cloths
        }
        runs = [run for run in self.runs if run.method == method and run.cloth in best]
        return np.array([abs(run.error[-1] @ share) / best[run.cloth] for run in runs])

    def curves(self, group: str | None = None) -> dict[str, dict[str, np.ndarray]]:
        """`errors` of all quantities and methods, `{quantity: {method: [runs, times]}}`."""
        return {
            quantity: {method: self.errors(method, quantity, group) for method in self.settings.methods}
            for quantity in QUANTITIES
        }

    def seconds(self, method: str) -> np.ndarray:
        """Seconds of computation for an answer, median over runs, `[times]` [s]."""
        return np.median([run.seconds for run in self.runs if run.method == method], axis=0)


@dataclass(frozen=True)
class Method:
    """Who takes part.

    Attributes:
        make: from settings, weights, seed of the training and folder to who identifies.
        needs: what must be known beforehand, in words.
    """

    make: Callable[[Settings, Trained, int, Path], Identify]
    needs: str


def by_p(
    settings: Settings,
    learned: Trained,
    model: int,
    folder: Path,
    rule: EstimationSettings | NewtonSettings | None = None,
) -> Identify:
    """p, estimated online from 0, and read out by a smooth map that the trained cloths give."""
    readout = MaterialReadout.fit(learned.biases, CLOTHS)
    return lambda run: np.log(readout(estimate_bias(learned.model, run, settings=rule or NewtonSettings())[0]))


def by_fit(settings: Settings, learned: Trained, model: int, folder: Path, cloth: Cloth | None = None) -> Identify:
    """The simulation, fitted to the same states that the model sees, each in its standard deviation."""

    def identify(run: Sequences) -> np.ndarray:
        with closing(Simulator(learned.arm, learned.autoencoder, cloth)) as simulate:
            return fit_simulation(simulate, run, learned.model.s_std.numpy(), settings.fit)

    return identify


def by_network(settings: Settings, learned: Trained, model: int, folder: Path) -> Identify:
    """A network that learned from the same recordings as the model, and was told the constants of their cloths."""
    train_network(settings, model, folder)
    return load_network(folder / network_file(model)).identify


RECORDED = "recordings, and which of them are of one cloth; C_damp and C_mass of these cloths to read p, no more"
METHODS = {
    "p": Method(by_p, RECORDED),
    "p by momentum": Method(partial(by_p, rule=EstimationSettings()), RECORDED),
    "sysid": Method(by_fit, "the simulator, with all of arm, camera and cloth as they are but C_damp and C_mass"),
    "sysid-rough": Method(
        partial(by_fit, cloth=ROUGH), "the same, where stretch and bending of the cloth are off by 30 and 50 %"
    ),
    "network": Method(by_network, "recordings, and C_damp and C_mass of each of their cloths"),
}


FEWER = {"sysid": "fitted_models", "sysid-rough": "rough_models"}  # methods, and the setting that says for which runs


def network_file(model: int) -> str:
    """Where a network is kept, from the folder."""
    return f"weights/network-{model}.safetensors"


def load_network(path: Path) -> Regressor:
    """Read a network that `train_network` kept.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is damaged, or holds no such network.
    """
    with reading(path, "network"):
        _, tensors = read_tensors(path)
        hidden, inputs = tensors["head.0.weight"].shape[0], tensors["mean"].shape[0]
        return filled(lambda: Regressor(inputs, 0, hidden), tensors)


def train_network(settings: Settings, model: int, folder: Path) -> float:
    """Train a network, or leave the one that is kept; seconds of computation [s]."""

    def train() -> float:
        runs, start = seen_runs(trained(f"{settings.weights}-{model}")), time.process_time()
        told = {name: logs(cloth) for name, cloth in CLOTHS.items()}
        network, _ = train_regressor(runs, told, settings.network, seed=model)
        write_bytes(folder / network_file(model), to_bytes(network.state_dict()))
        return time.process_time() - start

    made_with = {"version": version(), "weights": settings.weights, "training": asdict(settings.network)}
    return once(f"network-{model}", made_with, train, folder=folder, files=[network_file(model)])


def train_model(settings: Settings, folder: Path) -> float:
    """Seconds of computation of the training of the model with its p: one epoch is timed, and all are as long [s]."""
    recipe = RECIPES[settings.weights].model

    def train() -> float:
        runs, start = seen_runs(trained(f"{settings.weights}-{settings.models[0]}")), time.process_time()
        train_dpmpb(runs, replace(recipe, epochs=1), seed=0, progress=False)
        return (time.process_time() - start) * recipe.epochs

    return once("model", {"version": version(), "weights": settings.weights}, train, folder=folder)


def sensed(settings: Settings, learned: Trained, name: str, seed: int) -> Sequences:
    """What those who take part are given: a run with random commands, and not a word on the cloth."""
    run = learned.sequences(random_trial(learned.arm.name, ALL[name], settings.steps[-1], seed))
    return replace(run, material=UNKNOWN)


def answers(identify: Identify, run: Sequences, steps: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Ask after each number of steps, each time from the beginning: answers `[times, 2]`, seconds `[times]` [s]."""
    said, seconds = [], []
    for count in steps:
        start = time.process_time()  # of all threads, so that no method looks cheap that keeps several cores busy
        said.append(identify(run[:count]))
        seconds.append(time.process_time() - start)
    return np.stack(said), np.array(seconds)


def run_one(settings: Settings, name: str, model: int, folder: Path) -> list[Run]:
    """All methods on one run."""
    learned, cloth = trained(f"{settings.weights}-{model}"), choose("cloth", name, ALL)
    seed = settings.first_seed + 100 * model + [*ALL].index(name)
    shared: list[Sequences] = []  # recorded when the first method needs it

    def measure(method: str) -> Run:
        if not shared:
            shared.append(sensed(settings, learned, name, seed))
        said, seconds = answers(METHODS[method].make(settings, learned, model, folder), shared[0], settings.steps)
        return Run(method, name, model, seed, (said - logs(cloth)).round(5), seconds.round(6))

    made_with = {each: getattr(settings, each) for each in ("weights", "steps", "first_seed")}
    made_with |= {"fit": asdict(settings.fit), "network": asdict(settings.network)}
    takes_part = [each for each in settings.methods if model in getattr(settings, FEWER.get(each, "models"))]
    return [
        piece((method, name, model), made_with, partial(measure, method), Run, folder=folder) for method in takes_part
    ]


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Train what must be trained beforehand, and ask every method about every cloth.

    Raises:
        ImportError: `mujoco.sysid` takes part and a package that it needs is missing; the message names them.
        KeyError, ValueError: recordings are missing; the message says how to make them.
    """
    settings, folder = settings or Settings(), Path(folder)
    if {"sysid", "sysid-rough"} & set(settings.methods):
        sysid_tools()  # to be missed now rather than after the trainings
    options: dict[str, Any] = {"workers": workers, "progress": progress}
    training = dict.fromkeys(settings.methods, 0.0)
    if by_recordings := [name for name in training if METHODS[name].needs == RECORDED]:
        training |= dict.fromkeys(by_recordings, train_model(settings, folder))
    if "network" in training:
        jobs = [(settings, model, folder) for model in settings.models]
        training["network"] = float(np.mean(run_jobs(train_network, jobs, what="networks", **options)))
    pairs = product(settings.cloths, settings.models)
    found = run_jobs(run_one, [(settings, *pair, folder) for pair in pairs], what="race", **options)
    return Record(settings, tuple(run for runs in found for run in runs), training)
