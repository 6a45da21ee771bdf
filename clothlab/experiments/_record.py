"""What all experiments share: records on disk, runs side by side, and the trials that nobody controls."""

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from types import ModuleType
from typing import Any, TypeVar

import cattrs
import joblib
import numpy as np
import torch
from tqdm.auto import tqdm

from clothlab import artifacts
from clothlab._validation import choose
from clothlab.analysis import late_median
from clothlab.artifacts import Folder
from clothlab.learning.estimation import EstimationSettings, NewtonSettings, estimate_bias
from clothlab.learning.trained import Trained
from clothlab.policies import Policy, RandomPolicy
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.training_configs import TRAINING_CONFIGS
from clothlab.trials import Trial, rollout

T = TypeVar("T")
EXPERIMENTS: dict[str, ModuleType] = {}  # by name; filled by the package
PAPER = "-paper"  # ending of records, as of weights: the same with what the paper's amount of recordings teaches
RECORDINGS = {arm: TRAINING_CONFIGS[arm + PAPER].recordings[0] for arm in ("torque", "muscle")}  # the paper's amount
SLOW: set[str] = set()  # those of them that take hours, and so run only when somebody asks for them

converter = cattrs.Converter(forbid_extra_keys=True)
# By way of text, float32 keeps the few digits that it has: 0.1, not 0.10000000149.
converter.register_unstructure_hook(
    np.ndarray, lambda array: (array.astype(str).astype(float) if array.dtype == np.float32 else array).tolist()
)
converter.register_structure_hook(np.ndarray, lambda value, _: np.asarray(value))


class Reached:
    """A run towards a target: a base of the parts of records that have `best`, its distance in each period."""

    best: np.ndarray

    @property
    def last(self) -> float:
        """Median of the last ten periods [s.d. of z]."""
        return late_median(self.best)


def save(name: str, record: Any, *, data: Folder = None) -> None:
    """Write the record of an experiment as `data/results/NAME.json`.

    Args:
        name: of the experiment; with `-paper` behind it where the weights are those of the paper's amount.
        record: what was found.
        data: folder to write to.

    Raises:
        KeyError: unknown experiment; the message lists the choices.
        ValueError: a record with numbers that are not finite.
    """
    choose("experiment", name.removesuffix(PAPER), EXPERIMENTS)
    artifacts.save_results({"experiment": name, "record": converter.unstructure(record)}, name, data=data)


def load(name: str, *, data: Folder = None) -> Any:
    """Read the stored record of an experiment, a `Record` of its module.

    Raises:
        KeyError: unknown experiment, or none stored; the message lists the choices.
        ValueError: a damaged or altered file, or a record of another shape.
    """
    module = choose("experiment", name.removesuffix(PAPER), EXPERIMENTS)
    stored = artifacts.load_results(name, data=data)
    try:
        return converter.structure(stored["record"], module.Record)
    except (cattrs.BaseValidationError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"data/results/{name}.json is damaged or of another version: {error}") from error


def load_all(*, data: Folder = None) -> dict[str, Any]:
    """Read all stored records by name; of the slow experiments, and for the paper's amount, those that there are.

    Raises:
        KeyError: an experiment that is not slow has none.
        ValueError: as `load`.
    """
    stored = {path.stem for path in (artifacts.data_folder(data) / "results").glob("*.json")}
    names = {name for name in EXPERIMENTS if name not in SLOW} | {
        name for name in stored if name.removesuffix(PAPER) in EXPERIMENTS
    }
    return {name: load(name, data=data) for name in sorted(names)}


def run_jobs(
    function: Callable[..., T], jobs: Sequence[tuple], *, workers: int, progress: bool, what: str = "runs"
) -> list[T]:
    """Call `function(*job)` for each job, several at once; the answers in the order of the jobs."""
    answers = joblib.Parallel(n_jobs=workers, return_as="generator")(
        joblib.delayed(alone)(function, job) for job in jobs
    )
    return list(tqdm(answers, total=len(jobs), desc=what, unit="run", disable=not progress))


def sort_out(found: Iterable[Any], kinds: Iterable[type]) -> list[Any]:
    """Those of each class, in the order in which they were found."""
    return [tuple(each for each in found if isinstance(each, kind)) for kind in kinds]


def interleaved(parts: Sequence[Sequence[T]], together: int = 1) -> tuple[T, ...]:
    """Runs of several trainings in the order in which one experiment with all of them finds them.

    Args:
        parts: runs of each training, as many of each.
        together: so many of a training follow one another before the next training's turn.
    """
    count = max(map(len, parts), default=0)
    return tuple(run for k in range(0, count, together) for part in parts for run in part[k : k + together])


def alone(function: Callable[..., T], job: tuple) -> T:
    """Call `function(*job)` on one core: jobs run side by side, and matrices this small gain nothing from a second."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return function(*job)
    finally:
        torch.set_num_threads(threads)


@cache
def trained(name: str) -> Trained:
    """`artifacts.load`, once in each process."""
    return artifacts.load(name)


def new_trial(policy: Policy, arm: Arm | str, cloth: Cloth | str, steps: int, seed: int) -> Trial:
    """A policy on a fresh scene."""
    env = ClothEnv(arm, cloth)
    try:
        return rollout(env, policy, steps, seed=seed)
    finally:
        env.close()


def random_trial(arm: str, cloth: Cloth | str, steps: int, seed: int) -> Trial:
    """Random commands on a fresh scene."""
    return new_trial(RandomPolicy(arm), arm, cloth, steps, seed)


def estimate_at_random(
    learned: Trained,
    cloth: Cloth | str,
    steps: int,
    seed: int,
    settings: EstimationSettings | NewtonSettings | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate p of a cloth from 0 while it is moved at random: the final p `[D_p]`, and its trace `[T, D_p]`."""
    trial = random_trial(learned.arm.name, cloth, steps, seed)
    return estimate_bias(learned.model, learned.sequences(trial), settings=settings)


def forget() -> None:
    """Drop what this process remembers of the data folder, so that it may turn to another one."""
    modules = [module for name, module in sys.modules.items() if name.startswith("clothlab.experiments.")]
    for item in [item for module in modules for item in vars(module).values()]:
        if hasattr(item, "cache_clear") and item.__name__ != "code":  # the code stays the one that was loaded
            item.cache_clear()
