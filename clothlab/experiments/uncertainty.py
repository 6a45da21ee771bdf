"""Knowing that one does not know: do regions hold the right p as often as they say, and are strange cloths noticed?

Two rules estimate p of the same runs from 0, Gauss-Newton and momentum SGD. What regions and alarms stand on
is learned from development runs; each run that is judged has commands and a seed of its own.
"""

import time
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from clothlab._validation import Checked, choose, choose_all, setting
from clothlab.analysis import nearest_material
from clothlab.experiments._kept import piece
from clothlab.experiments._record import converter, random_trial, run_jobs, trained
from clothlab.experiments.estimation import BETWEEN
from clothlab.learning.calibration import LENGTHS, SHARE, Calibration, calibrate, inside
from clothlab.learning.estimation import BiasEstimator, Estimator, NewtonEstimator
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.trials import Trial

FOLDER = Path("build") / "uncertainty"  # where runs are kept, from the folder in which the experiment is run
EVERY = 5  # steps between the estimates that are written down


# Beyond the trained values on every side that can be simulated: with half of the lowest of both, it diverges.
_BEYOND = ((0.015, 0.05), (0.015, 0.3), (0.05, 0.3), (0.12, 0.05), (0.12, 0.15), (0.12, 0.3))
_NAMES = [f"damp{damping:.3f}-mass{mass:.3f}" for damping, mass in _BEYOND]
BEYOND = {name: Cloth(name, damping=c, mass=m) for name, (c, m) in zip(_NAMES, _BEYOND, strict=True)}
OTHER_SIZES = {
    "short": Cloth("short", length=0.35),
    "long": Cloth("long", length=0.70),
    "narrow": Cloth("narrow", width=0.20),
}
KINDS = {"trained": CLOTHS, "between": BETWEEN, "beyond": BEYOND, "another size": OTHER_SIZES}
ALL = {name: cloth for cloths in KINDS.values() for name, cloth in cloths.items()}


@dataclass(frozen=True)
class Settings(Checked):
    """Which cloths and trainings; the defaults are the full size."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    repeats: int = setting(4, at_least=1, at_most=5)  # other commands for each training and trained cloth
    strange_repeats: int = setting(2, at_least=1, at_most=5)  # the same for the others
    cloths: tuple[str, ...] = setting(tuple(ALL))
    known: tuple[str, ...] = setting(tuple(CLOTHS))  # cloths of the development runs
    known_repeats: int = setting(4, at_least=2)  # development runs with each, which all trainings share
    lengths: tuple[int, ...] = setting(LENGTHS, at_least=12)  # [step] after which regions are judged; the last: all
    false_alarms: float = setting(0.05, "-", above=0, at_most=0.5)  # share of familiar runs, by the development runs
    development_seed: int = setting(46_000, at_least=0)  # of those runs: this + 30 repeat + number of the cloth
    first_seed: int = setting(56_000, at_least=0)  # of the others: this + 200 model + 30 repeat + number of the cloth


@dataclass(frozen=True, eq=False)
class Run:
    """One run that is judged.

    Attributes:
        cloth: name of the cloth in the hand.
        model: seed of the training.
        seed: of the commands.
        newton: p after each `EVERY` steps by Gauss-Newton `[T // EVERY, D_p]`.
        momentum: the same by momentum SGD.
        milliseconds: that an update took, on average, with Gauss-Newton and with momentum SGD [ms] `[2]`.
        estimate: p by Gauss-Newton after each length `[N, D_p]`.
        bare: its covariance by curvature and scatter alone `[N, D_p, D_p]`.
        covariance: with what development runs add `[N, D_p, D_p]`.
        surprise: log of the prediction error over the usual one `[N]`.
        unfamiliar: whether that is an alarm `[N]`.
        outside: whether the region lies beyond the trained p `[N]`.
    """

    cloth: str
    model: int
    seed: int
    newton: np.ndarray
    momentum: np.ndarray
    milliseconds: np.ndarray
    estimate: np.ndarray
    bare: np.ndarray
    covariance: np.ndarray
    surprise: np.ndarray
    unfamiliar: np.ndarray
    outside: np.ndarray

    @property
    def kind(self) -> str:
        """One of `KINDS`."""
        return next(kind for kind, cloths in KINDS.items() if self.cloth in cloths)


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        calibrations: one for each training.
        runs: one for each training, cloth and repeat.
    """

    settings: Settings
    calibrations: tuple[Calibration, ...]
    runs: tuple[Run, ...]

    def of(self, kind: str) -> list[Run]:
        """The runs with one kind of cloths.

        Raises:
            KeyError: unknown kind; the message lists the choices.
        """
        choose("kind of cloths", kind, KINDS)
        return [run for run in self.runs if run.kind == kind]

    def coverage(self, *, calibrated: bool = True, share: float = SHARE) -> np.ndarray:
        """Share of runs with trained cloths whose region holds the trained p, after each length `[N]`."""
        held = [
            [
                inside(self._biases(run)[run.cloth], p, covariance, share)
                for p, covariance in zip(run.estimate, run.covariance if calibrated else run.bare, strict=True)
            ]
            for run in self.of("trained")
        ]
        return np.mean(held, axis=0)

    def right(self, rule: str) -> np.ndarray:
        """Share of runs with trained cloths whose nearest trained p is the right one, over time `[T // EVERY]`.

        Args:
            rule: `newton` or `momentum`.
        """
        found = [
            [nearest_material(p, self._biases(run)) == run.cloth for p in getattr(run, rule)]
            for run in self.of("trained")
        ]
        return np.mean(found, axis=0)

    def seconds_to(self, rule: str, share: float = 0.9) -> float | None:
        """Time from which on `right` stays at this share or above [s]; None where it is below in the end."""
        (below,) = np.nonzero(self.right(rule) < share)
        first = int(below[-1]) + 1 if len(below) else 0
        return None if first == len(self.right(rule)) else (first + 1) * EVERY * CONTROL_PERIOD

    def alarms(self, kind: str, *, or_outside: bool = False) -> dict[str, np.ndarray]:
        """Share of runs of each cloth that are called unfamiliar, after each length `{name: [N]}`.

        Args:
            kind: of cloths.
            or_outside: whether a region beyond the trained p is an alarm, too.
        """
        told: dict[str, list[np.ndarray]] = {}
        for run in self.of(kind):
            told.setdefault(run.cloth, []).append(run.unfamiliar | (run.outside & or_outside))
        return {name: np.mean(each, axis=0) for name, each in told.items()}

    def _biases(self, run: Run) -> dict[str, np.ndarray]:
        return trained(f"{self.settings.weights}-{run.model}").biases


@cache
def development_trials(settings: Settings) -> list[Trial]:
    """Runs with known cloths, the same for all trainings."""
    arm, first = trained(f"{settings.weights}-{settings.models[0]}").arm.name, settings.development_seed
    cloths = choose_all("cloth", settings.known, CLOTHS)
    return [
        random_trial(arm, cloth, settings.lengths[-1], first + 30 * repeat + [*ALL].index(cloth.name))
        for repeat, cloth in product(range(settings.known_repeats), cloths)
    ]


def calibrate_one(settings: Settings, model: int) -> Calibration:
    """Learn from the development runs what one training does wrong."""
    learned = trained(f"{settings.weights}-{model}")
    runs = [learned.sequences(trial) for trial in development_trials(settings)]
    return calibrate(learned.model, learned.biases, runs, lengths=settings.lengths, false_alarms=settings.false_alarms)


def run_one(settings: Settings, calibration: Calibration, name: str, model: int, repeat: int = 0) -> Run:
    """Estimate p of one cloth by both rules."""
    learned, cloth = trained(f"{settings.weights}-{model}"), choose("cloth", name, ALL)
    seed = settings.first_seed + 200 * model + 30 * repeat + [*ALL].index(name)
    run = learned.sequences(random_trial(learned.arm.name, cloth, settings.lengths[-1], seed))
    newton, momentum = NewtonEstimator(learned.model), BiasEstimator(learned.model)
    traces: dict[Estimator, list[np.ndarray]] = {newton: [], momentum: []}
    seconds, looks = {newton: 0.0, momentum: 0.0}, []
    for t, step in enumerate(zip(run.s, run.u, strict=True), start=1):
        for estimator, trace in traces.items():
            start = time.perf_counter()
            trace.append(estimator.update(*step))
            seconds[estimator] += time.perf_counter() - start
        if t in settings.lengths:
            looks.append(_look(newton, calibration))
    estimate, bare, covariance, surprise, unfamiliar, outside = (np.array(each) for each in zip(*looks, strict=True))
    return Run(
        cloth=name,
        model=model,
        seed=seed,
        newton=np.array(traces[newton][EVERY - 1 :: EVERY]).round(3),
        momentum=np.array(traces[momentum][EVERY - 1 :: EVERY]).round(3),
        milliseconds=(1e3 * np.array([*seconds.values()]) / len(run)).round(2),
        estimate=estimate.round(4),
        bare=bare.round(7),
        covariance=covariance.round(7),
        surprise=surprise.round(3),
        unfamiliar=unfamiliar,
        outside=outside,
    )


def _look(estimator: Estimator, calibration: Calibration) -> tuple[Any, ...]:
    """What is known of an estimate now, in the order of `Run`."""
    doubt, bare = calibration.report(estimator), estimator.covariance
    if doubt is None or bare is None:
        raise ValueError("too little was seen to say how sure the estimate is")
    return estimator.p, bare, *doubt


def run_kept(folder: Path, settings: Settings, calibration: Calibration, *job: Any) -> Run:
    """`run_one`, kept as soon as it is done."""
    made_with = {"settings": converter.unstructure(settings)}
    return piece(("run", *job), made_with, lambda: run_one(settings, calibration, *job), Run, folder)


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Calibrate every training, then judge it by every cloth.

    Args:
        settings: what is run.
        workers: processes.
        progress: show a progress bar.
        folder: where each run is kept as soon as it is done; an interrupted experiment goes on from there.
    """
    settings, folder = settings or Settings(), Path(folder)
    models = [(settings, model) for model in settings.models]
    found = run_jobs(calibrate_one, models, workers=workers, progress=progress, what="calibration")
    calibrations = dict(zip(settings.models, found, strict=True))
    todo = [
        (folder, settings, calibrations[model], name, model, repeat)
        for name, model in product(settings.cloths, settings.models)
        for repeat in range(settings.repeats if name in CLOTHS else settings.strange_repeats)
    ]
    runs = run_jobs(run_kept, todo, workers=workers, progress=progress, what="uncertainty")
    return Record(settings, tuple(found), tuple(runs))
