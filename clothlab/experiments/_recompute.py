"""Any number of a record can be made anew: one run of it, with fresh simulation, beside what is stored."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab._validation import choose
from clothlab.artifacts import Folder
from clothlab.experiments import (
    any_target,
    control,
    estimation,
    integrated,
    perception,
    practice,
    self_organisation,
    stiffness,
    table_setting,
)
from clothlab.experiments._record import EXPERIMENTS, PAPER, converter, load

SHOWN = 3  # numbers of an array that are printed


@dataclasses.dataclass(frozen=True)
class Part:
    """One kind of runs in a record, and how any of them is made again.

    Attributes:
        runs: record → its runs of this kind.
        names: attributes by which one run is told from the others.
        again: settings, a stored run → the same anew.
        seconds: about how long the longest of them takes on one core [s].
    """

    runs: Callable[[Any], Sequence[Any]]
    names: tuple[str, ...]
    again: Callable[[Any, Any], Any]
    seconds: float


def _estimation(settings: estimation.Settings, run: estimation.Run) -> estimation.Run:
    seeds = [estimation.seed_of(settings, run.cloth, run.model, repeat) for repeat in range(settings.repeats)]
    return estimation.run_one(settings, run.cloth, run.model, seeds.index(run.seed))


def _held_out(settings: stiffness.Settings, run: stiffness.HeldOut) -> stiffness.HeldOut:
    recorded = [(trial.cloth.name, trial.policy) for trial in artifacts.load_trials(settings.trials)]
    return stiffness.run_held_out(settings, run.model, recorded.index((run.cloth, run.policy)))


def _practice(settings: practice.Settings, run: practice.Run) -> practice.Run:
    repeat = run.seed - settings.first_seed - 100 * run.model
    return practice.run_one(settings, run.method, run.case, run.model, repeat)


def _any_target(settings: any_target.Settings, run: any_target.Run) -> any_target.Run:
    return any_target.run_one(settings, run.target, any_target.targets(settings).index(run.target))


@dataclasses.dataclass(frozen=True, eq=False)
class Share:
    """A row of `pca_share` of the record on stiffness.

    Attributes:
        model: seed of the training.
        pca_share: share of the variance of p along PC1 and PC2, `[2]`.
    """

    model: int
    pca_share: np.ndarray


PARTS: dict[str, dict[str, Part]] = {
    "perception": {"all": Part(lambda record: (record,), (), lambda settings, _: perception.run(settings), 13)},
    "self_organisation": {
        "runs": Part(
            lambda record: record.runs, ("model",), lambda s, run: self_organisation.run_one(s.weights, run.model), 1
        )
    },
    "estimation": {"runs": Part(lambda record: record.runs, ("cloth", "model", "seed"), _estimation, 7)},
    "control": {
        "runs": Part(
            lambda record: record.runs,
            ("target", "cloth", "model"),
            lambda s, run: control.run_one(s, run.target, run.cloth, run.model),
            13,
        )
    },
    "integrated": {
        "runs": Part(lambda record: record.runs, ("model",), lambda s, run: integrated.run_one(s, run.model), 10)
    },
    "stiffness": {
        "ellipses": Part(
            lambda record: record.ellipses,
            ("spring", "f_const"),
            lambda s, run: stiffness.run_ellipse(s, run.spring, run.f_const),
            2,
        ),
        "pca_share": Part(
            lambda record: [Share(*row) for row in zip(record.settings.models, record.pca_share, strict=True)],
            ("model",),
            lambda s, run: Share(run.model, stiffness.run_share(s, run.model)),
            1,
        ),
        "held_out": Part(lambda record: record.held_out, ("cloth", "policy", "model"), _held_out, 7),
        "estimation": Part(
            lambda record: record.estimation,
            ("cloth", "model"),
            lambda s, run: stiffness.run_estimation(s, run.cloth, run.model),
            4,
        ),
        "control": Part(
            lambda record: record.control,
            ("condition", "cloth", "model"),
            lambda s, run: stiffness.run_control(s, run.condition, run.cloth, run.model),
            9,
        ),
    },
    "practice": {"runs": Part(lambda record: record.runs, ("method", "case", "model", "seed"), _practice, 90)},
    "any_target": {"runs": Part(lambda record: record.runs, ("target",), _any_target, 120)},
    "table_setting": {
        "runs": Part(
            lambda record: record.runs,
            ("method", "seed"),
            lambda s, run: table_setting.run_one(s, run.method, run.model, run.seed),
            120,
        )
    },
}


@dataclasses.dataclass(frozen=True, eq=False)
class Recomputed:
    """A stored run, and the same made anew.

    Attributes:
        stored: as the record has it.
        fresh: as it came out now.
        seconds: that took [s].
    """

    stored: Any
    fresh: Any
    seconds: float

    def both(self, value: Callable[[Any], Any]) -> tuple[Any, Any]:
        """Any figure of a run, such as `lambda run: run.control.min()`: the stored one and the fresh one."""
        return value(self.stored), value(self.fresh)

    def numbers(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Every number of the run, by the name of its attribute: stored and fresh."""
        stored, fresh = (dict(_numbers(converter.unstructure(run))) for run in (self.stored, self.fresh))
        return {name: (stored[name], fresh[name]) for name in stored if name in fresh}

    def difference(self) -> float:
        """The largest difference of any number to the stored one; infinite where another count of numbers came out."""
        pairs = self.numbers().values()
        if any(len(list(_numbers(converter.unstructure(run)))) != len(pairs) for run in (self.stored, self.fresh)):
            return np.inf
        return max(
            (float(np.abs(a - b).max()) if a.shape == b.shape else np.inf for a, b in pairs if a.size), default=0
        )

    def __str__(self) -> str:
        lines = [f"{type(self.stored).__name__} of {type(self.stored).__module__}, made anew in {self.seconds:.1f} s"]
        lines += [f"{'':28}{'stored':>26}{'fresh':>26}"]
        for name, pair in self.numbers().items():
            lines.append(f"{name:28}{_shown(pair[0]):>26}{_shown(pair[1]):>26}")
        return "\n".join([*lines, f"largest difference {self.difference():.3g}"])


def recompute(experiment: str, part: str = "", /, *, data: Folder = None, **which: Any) -> Recomputed:
    """Make one run of a stored record anew, with fresh simulation: `recompute("control", target="target-1", ...)`.

    On the machine where the record was made, or one like it, all numbers are the same. Other graphics or another
    processor's arithmetic change the last digits; a closed loop then makes more of that with every step.

    Args:
        experiment: its name; with `-paper` behind it where the weights are those of the paper's amount.
        part: which kind of runs, where a record has several, such as `"ellipses"` of `"stiffness"`.
        data: folder with the record; weights and recordings are the project's own.
        which: what names the run, as the record has it, such as `cloth="hard-1", model=0`.

    Raises:
        KeyError: no such experiment, part, or value of what names a run; the message lists the choices. Recordings that
            are left to `make data`.
        TypeError: something that names no run of this kind.
        ValueError: several runs fit; the message says what else names them. An experiment whose runs are no single
            ones; the message says how all of it is made anew.
    """
    base = experiment.removesuffix(PAPER) if isinstance(experiment, str) else experiment
    choose("experiment", base, EXPERIMENTS)
    if base not in PARTS:
        raise ValueError(
            f"the runs of {base!r} need work that they share, or take minutes each: make all of it anew, in hours, "
            f"with `python scripts/make_results.py --only {base}`; one run at a time: {', '.join(PARTS)}"
        )
    parts = PARTS[base]
    what = choose(f"part of {base!r}", part or (next(iter(parts)) if len(parts) == 1 else ""), parts)
    record = load(experiment, data=data)
    stored = _find(base, what, record, which)
    start = time.perf_counter()
    fresh = converter.unstructure(what.again(record.settings, stored))  # with as many digits as a record keeps
    return Recomputed(stored, converter.structure(fresh, type(stored)), time.perf_counter() - start)


def _find(experiment: str, part: Part, record: Any, which: dict[str, Any]) -> Any:
    """The one run that is meant."""
    if strange := [name for name in which if name not in part.names]:
        raise TypeError(
            f"a run of {experiment!r} is named by {', '.join(part.names) or 'nothing'}, not by {strange[0]!r}"
        )
    runs = list(part.runs(record))
    for name, value in which.items():
        there = list(dict.fromkeys(getattr(run, name) for run in runs))
        if value not in there:
            raise KeyError(f"unknown {name} {value!r:.80} of {experiment!r}; choose from {', '.join(map(str, there))}")
        runs = [run for run in runs if getattr(run, name) == value]
    for name in part.names:
        there = list(dict.fromkeys(getattr(run, name) for run in runs))
        if len(there) > 1:
            raise ValueError(
                f"{len(runs)} runs of {experiment!r} fit: say which {name}, one of {', '.join(map(repr, there))}"
            )
    return runs[0]


def _numbers(value: Any, name: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every number in what JSON has, by the path to it; `settings` are no result."""
    if isinstance(value, dict):
        for key, each in value.items():
            if key != "settings":
                yield from _numbers(each, f"{name}.{key}" if name else key)
    elif isinstance(value, list) and any(isinstance(each, dict) for each in value):
        for k, each in enumerate(value):
            yield from _numbers(each, f"{name}[{k}]")
    elif not isinstance(value, str) and value is not None:
        yield name, np.asarray(value, dtype=float)


def _shown(value: np.ndarray) -> str:
    """A number, or the first ones of many."""
    some = " ".join(f"{each:.4g}" for each in value.ravel()[:SHOWN])
    return f"{some} …" if value.size > SHOWN else some
