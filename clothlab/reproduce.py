"""`python -m clothlab reproduce`: from nothing to the results tables, on one machine or on many.

Recordings and targets → autoencoders → what they see → models → experiments → tables, for both arms and both amounts
of recordings, as tasks whose results are kept in a store: an interrupted run goes on where it stopped. The experiments
that take hours (`experiments.SLOW`) take part only `--with-slow`.
"""

import argparse
import inspect
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from clothlab import artifacts, experiments
from clothlab._files import reading, write_bytes
from clothlab._validation import check_number
from clothlab.datasets import (
    RECORDINGS,
    TARGET_STEPS,
    TRAINED_FOAMS,
    VIEWS,
    Job,
    Recording,
    Views,
    drawn_targets,
    find_named_targets,
    find_views,
    jobs,
    record,
)
from clothlab.experiments import PAPER, tables
from clothlab.experiments._record import converter
from clothlab.learning.autoencoder import AutoencoderTraining
from clothlab.learning.dpmpb import Sequences
from clothlab.simulation.cloth import cloth_name
from clothlab.tasks import DATA, FAILED, LEFT_OUT, Task, summary
from clothlab.training_configs import RECIPES, Recipe, seen_by, sees_with, train_eyes, train_model

STORE = Path("build") / "reproduce"
SEEDS = 5  # the paper repeats learning and control five times
MOST_SEEDS = 900  # beyond, seeds of the estimation's commands would be those of recordings that were learned from
NAMED_TARGETS = ("target-1", "target-2", "muscle")
ARMS = ("torque", "muscle")  # of the usual experiments
USUAL = tuple(name for name in experiments.EXPERIMENTS if name not in experiments.SLOW)


@dataclass(frozen=True)
class Plan:
    """How much of everything; what is not named has its full size.

    Attributes:
        name: of the size.
        recordings: sets of trials by name.
        recipes: of the trainings, by the name of the weights.
        settings: of experiments, by their names: what differs from their defaults.
        targets: arguments of `find_named_targets`.
        seeds: trainings of each model.
        slow: whether the experiments that take hours take part.
        amounts: of recordings, by what weights that learned from them are called behind the arm's name.
    """

    name: str = "full"
    recordings: Mapping[str, Recording] = field(default_factory=lambda: RECORDINGS)
    recipes: Mapping[str, Recipe] = field(default_factory=lambda: RECIPES)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    targets: tuple[int, tuple[int, ...], tuple[str, ...]] = (TARGET_STEPS, tuple(range(3000, 3004)), TRAINED_FOAMS)
    seeds: int = SEEDS
    slow: bool = False
    amounts: tuple[str, ...] = ("", PAPER)

    def weights(self) -> list[str]:
        """Names of the recipes that are trained."""
        usual = [arm + amount for arm in ARMS for amount in self.amounts]
        return [name for name in self.recipes if self.slow or name in usual]

    def sets(self) -> list[str]:
        """Names of the sets of trials that are recorded."""
        learned = {each for name in self.weights() for each in self.recipes[name].recordings}
        return [name for name in self.recordings if name in learned or name.endswith("evaluation")]


def small_plan(seeds: int = 2) -> Plan:
    """From nothing to tables in a minute: everything takes part, and nothing is learned."""
    shorter = {
        name: replace(each, steps=24, repeats=min(each.repeats, 2), policies=each.policies[-1:])
        for name, each in RECORDINGS.items()
    }
    recipes = {
        name: replace(
            each,
            autoencoder=AutoencoderTraining(epochs=1)
            if isinstance(each.autoencoder, AutoencoderTraining)
            else name[:6],
            model=replace(each.model, epochs=2, sequence_length=8),
        )
        for name, each in RECIPES.items()
        if name.removesuffix(PAPER) in ARMS
    }
    settings: dict[str, dict[str, Any]] = {
        "perception": {"steps": 16},
        "estimation": {"cloths": (cloth_name(0.03, 0.05), "between-light"), "repeats": 1, "steps": 12},
        "control": {"cloths": (cloth_name(0.03, 0.05),), "steps": 16},
        "integrated": {"steps": 16},
        "stiffness": {"estimation_steps": 12, "control_steps": 16, "speed_steps": 8},
    }
    return Plan("small", shorter, recipes, settings, (40, (3000,), ("soft-1",)), seeds)


def graph(plan: Plan) -> list[Task]:
    """All tasks of a plan."""
    found = [*_recorded(plan), *_targets(plan), *_trained(plan)]
    for name in USUAL:
        for ending in plan.amounts:
            found += _experiment(plan, name, ending)
    if plan.slow:
        everything = tuple(task.name for task in found)
        slow = [name for name in experiments.EXPERIMENTS if name in experiments.SLOW]
        found += [Task(name, run_slow, (name,), everything, (_record_of(name),)) for name in slow]
    names = tuple(task.name for task in found if task.function in (run_whole, merge, run_slow))
    return [*found, Task("tables", make_tables, (plan.amounts,), names, ("results/table.json", "tables.md"))]


def _recorded(plan: Plan) -> Iterator[Task]:
    """A task for each repeat of a set: half a minute, and whole cloths and policies."""
    for name in plan.sets():
        recording = plan.recordings[name]
        todo, size = jobs([name], plan.recordings), len(recording.cloths) * len(recording.policies)
        for k in range(recording.repeats):
            part = tuple(todo[k * size : (k + 1) * size])
            files = f"trials/{name}/{k:02}_*.npz" if recording.repeats > 1 else f"trials/{name}/*.npz"
            yield Task(_recording(name, k), record_part, (part,), (), (files,))


def _recording(name: str, number: int) -> str:
    return f"record-{name}-{number}"


def _recordings_of(plan: Plan, name: str) -> tuple[str, ...]:
    return tuple(_recording(name, k) for k in range(plan.recordings[name].repeats))


def _targets(plan: Plan) -> Iterator[Task]:
    yield Task("targets", name_targets, plan.targets, (), tuple(f"targets/{name}.png" for name in NAMED_TARGETS))
    if plan.slow:
        yield Task("targets-drawn", draw_targets, (), (), ("targets/drawn/*.png",))
        for name, parts in VIEWS.items():
            for views in parts:
                yield Task(
                    f"targets-{name}-{views.arm}", view, (name, views), (), (f"targets/{name}/{views.arm}_*.png",)
                )


def _trained(plan: Plan) -> Iterator[Task]:
    for name in plan.weights():
        recipe, eyes = plan.recipes[name], f"autoencoder-{sees_with(name)}"
        trials = tuple(each for part in recipe.recordings for each in _recordings_of(plan, part))
        if sees_with(name) == name:
            yield Task(eyes, train_eyes, (name, recipe), trials, (f"weights/{eyes}.safetensors",))
        yield Task(f"seen-{name}", see, (name, recipe), (eyes, *trials), (f"seen/{name}.npz",))
        for seed in range(plan.seeds):
            file = f"weights/dpmpb-{name}-{seed}.safetensors"
            yield Task(f"model-{name}-{seed}", train_seen, (name, seed, recipe), (eyes, f"seen-{name}"), (file,))


def _experiment(plan: Plan, name: str, ending: str) -> Iterator[Task]:
    """An experiment: at once where it has no trainings to repeat, else one task for each, and one that merges them."""
    module, record_of = experiments.EXPERIMENTS[name], _record_of(name + ending)
    settings = module.Settings(**plan.settings.get(name, {}))
    settings = replace(settings, weights=settings.weights + ending)
    arm = "muscle" if name == "stiffness" else "torque"
    evaluation = "muscle-evaluation" if arm == "muscle" else "evaluation"
    needs = ("targets", f"autoencoder-{settings.weights}", *_recordings_of(plan, evaluation))
    needs += _recordings_of(plan, plan.recipes[arm + PAPER].recordings[0])  # from which some control begins
    if not hasattr(settings, "models"):
        yield Task(name + ending, run_whole, (name, ending, settings), needs, (record_of,))
        return
    parts = []
    for seed in range(plan.seeds):
        one = replace(settings, models=(seed,))
        part = Task(
            name=f"{name}{ending}-{seed}",
            function=run_part,
            arguments=(name, ending, one),
            after=(*needs, f"model-{settings.weights}-{seed}"),
            files=(_part_of(name + ending, seed),),
        )
        parts.append(part.name)
        yield part
    everyone = replace(settings, models=tuple(range(plan.seeds)))
    yield Task(f"merge-{name}{ending}", merge, (name, ending, everyone), tuple(parts), (record_of,))


def _record_of(name: str) -> str:
    return f"results/{name}.json"


def _part_of(name: str, seed: int) -> str:
    return f"parts/{name}-{seed}.json"


# What the tasks do, in the store's data folder.


def record_part(part: Sequence[Job]) -> None:
    """Record trials."""
    for path, recording, cloth, policy, seed in part:
        record(artifacts.data_folder() / "trials" / path, recording, cloth, policy, seed)


def name_targets(steps: int, seeds: Sequence[int], foams: Sequence[str]) -> None:
    """Find the targets that have names of their own."""
    _save_targets(find_named_targets(steps, seeds, foams))


def draw_targets() -> None:
    """Draw the drawn targets."""
    _save_targets(drawn_targets())


def view(name: str, views: Views) -> None:
    """Find targets of a set."""
    _save_targets(find_views(name, views))


def _save_targets(found: Mapping[str, np.ndarray]) -> None:
    for name, mask in found.items():
        artifacts.save_target(mask, name)


def see(name: str, recipe: Recipe) -> None:
    """Encode what a recipe's models learn from, once for all of its trainings."""
    runs = seen_by(name, recipe)
    path = artifacts.data_folder() / "seen" / f"{name}.npz"
    path.parent.mkdir(exist_ok=True)
    parts = {f"{part}{k}": getattr(run, part) for k, run in enumerate(runs) for part in ("s", "u")}
    with path.open("wb") as file:
        np.savez(file, materials=np.array([run.material for run in runs]), **parts)


def train_seen(name: str, seed: int, recipe: Recipe) -> None:
    """Train a model on what was encoded."""
    path = artifacts.data_folder() / "seen" / f"{name}.npz"
    with reading(path, "encoded recordings"), np.load(path, allow_pickle=False) as file:
        runs = [Sequences(file[f"s{k}"], file[f"u{k}"], str(each)) for k, each in enumerate(file["materials"])]
    train_model(name, runs, seed, recipe)


def run_whole(name: str, ending: str, settings: Any) -> None:
    """Run an experiment and save its record."""
    experiments.save(name + ending, experiments.EXPERIMENTS[name].run(settings))


def run_part(name: str, ending: str, settings: Any) -> None:
    """Run an experiment with one training, and keep what it found."""
    found = experiments.EXPERIMENTS[name].run(settings)
    (seed,) = settings.models
    text = json.dumps(converter.unstructure(found), allow_nan=False)
    write_bytes(artifacts.data_folder() / _part_of(name + ending, seed), text.encode())


def merge(name: str, ending: str, settings: Any) -> None:
    """Make one record of those of single trainings."""
    module, parts = experiments.EXPERIMENTS[name], []
    for seed in settings.models:
        path = artifacts.data_folder() / _part_of(name + ending, seed)
        with reading(path, "part of a record"):
            parts.append(converter.structure(json.loads(path.read_bytes()), module.Record))
    experiments.save(name + ending, module.merged(settings, parts))


def run_slow(name: str) -> None:
    """Run an experiment that takes hours, whose pieces are kept beside the data, and save its record."""
    module, folder = experiments.EXPERIMENTS[name], artifacts.data_folder().parent / "pieces" / name
    options = {"folder": folder} if "folder" in inspect.signature(module.run).parameters else {}
    experiments.save(name, module.run(**options))


def make_tables(amounts: Sequence[str]) -> None:
    """Make the results tables from all records, or from those of the only amount of recordings."""
    records = experiments.load_all() if "" in amounts else {name: experiments.load(name + PAPER) for name in USUAL}
    artifacts.save_results({"tables": tables.as_json(records)}, "table")
    parts = [
        f"## {name}\n\n{tables.markdown(rows)}\n" for name in tables.TABLES if (rows := tables.table(name, records))
    ]
    write_bytes(artifacts.data_folder() / "tables.md", "\n".join(parts).encode())


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the command can be told."""
    parser.add_argument("--store", type=Path, help=f"folder of all results: {STORE}, or with --small {STORE}-small")
    parser.add_argument("--seeds", type=int, help=f"trainings of each model: {SEEDS}, or with --small 2")
    parser.add_argument("--small", action="store_true", help="tiny sizes, a minute, to see whether it works here")
    parser.add_argument(
        "--paper-only", action="store_true", help="leave out what learns from more recordings than the paper's"
    )
    parser.add_argument("--with-slow", action="store_true", help="also the experiments that take hours")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, help="processes in this machine; by default one for each core")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask scheduler, whose workers are on any machines")


def main(given: Sequence[str] | None = None) -> int:
    """Run what was asked for, and print what came of it. Returns the exit status: 0 if nothing failed."""
    parser = argparse.ArgumentParser(
        prog="python -m clothlab reproduce", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_options(parser)
    arguments = parser.parse_args(given)
    try:
        from clothlab import cluster
    except ImportError as error:
        parser.error(str(error))
    if arguments.small and arguments.with_slow:
        parser.error("--small has no slow experiments: they have no small sizes")
    if arguments.with_slow and arguments.paper_only:
        parser.error("--paper-only leaves out what the slow experiments stand on")
    if arguments.with_slow and (arguments.seeds or SEEDS) < SEEDS:
        parser.error(f"--with-slow needs {SEEDS} seeds at least, which those experiments compare")
    store = arguments.store or (STORE.with_name(f"{STORE.name}-small") if arguments.small else STORE)
    try:
        if arguments.seeds is not None:
            check_number("--seeds", arguments.seeds, int, at_least=1, at_most=MOST_SEEDS)
        if arguments.small:
            plan = small_plan(arguments.seeds or 2)
        else:
            plan = Plan(seeds=arguments.seeds or SEEDS, slow=arguments.with_slow)
        plan = replace(plan, amounts=(PAPER,)) if arguments.paper_only else plan
        cluster.open_store(store)
        address = arguments.scheduler
        with cluster.connect(address) if address else cluster.local(arguments.workers) as client:
            outcomes = cluster.run(graph(plan), store, client, progress=True)
    except KeyboardInterrupt:
        print(f"\ninterrupted: what was done lies in {store}, and the same command goes on from there")
        return 130
    except (ValueError, cluster.Unfit) as error:
        print(error)
        return 2
    print(summary(outcomes.values()))
    bad = any(each.state in (FAILED, LEFT_OUT) for each in outcomes.values())
    print("the same command tries again what failed" if bad else f"tables: {store / DATA / 'tables.md'}")
    return int(bad)
