"""Make recordings, trainings and results anew, or everything from nothing.

Six commands, which `make` calls under names of its own:

    reproduce.py record [SET ...]           make data: trials and targets
    reproduce.py train [WEIGHTS ...]        make train: autoencoders and DPMPBs
    reproduce.py results [EXPERIMENT ...]   make results: every figure of the tables
    reproduce.py paper [OPTIONS]            make paper: the paper's results, once
    reproduce.py everything [OPTIONS]       make reproduce: all of these from nothing
    reproduce.py worlds [OPTIONS]           make worlds: so ten times, from other seeds

The first three work in `data/` itself, and replace what is there. Names choose;
experiments that take hours run only when they are named. `everything` writes into
build/reproduce/data, laid out like `data/`: recordings → autoencoders → DPMPBs →
experiments → tables. `paper` does the same in build/paper with the paper's amount of
recordings, and only what the seven rows of the README stand on. The same command goes
on where it was interrupted, a study at its next row. More in CONTRIBUTING.md.
"""

import argparse
import contextlib
import inspect
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import joblib
import pandas as pd

import studies
from clothlab import data
from clothlab.weights import save_autoencoder
from studies import PAPER, headline, report
from studies._parallel import KEPT, side_by_side
from studies.datasets import (
    DATASETS,
    TARGET_SETS,
    Dataset,
    find_target_set,
    find_targets,
    record,
    save_targets,
)
from studies.training_configs import TRAINING_CONFIGS, TrainingConfig

ROOT = Path(__file__).resolve().parents[1]
_APART = 10_000_000  # seeds of one world from those of the next
FOLDER = Path("build") / "reproduce"
PAPERS_FOLDER = Path("build") / "paper"


@dataclass(frozen=True)
class Plan:
    """How much of everything is made."""

    # Trainings of each DPMPB: the paper repeats learning and control five times
    seeds: int = 5
    paper_only: bool = False  # only what the paper's amount of recordings teaches
    # Other recordings, autoencoders, W and p, all from seeds of their own; targets are
    # part of the task, and stay. World 0 is the one in `data/`.
    world: int = 0
    # Experiments, by default all that the amounts have
    experiments: tuple[str, ...] = tuple(studies.EXPERIMENTS)

    @property
    def offset(self) -> int:
        """How far the seeds of this world are from those of world 0."""
        return self.world * _APART

    @property
    def endings(self) -> tuple[str, ...]:
        """Amounts of recordings, by the endings of names."""
        return (PAPER,) if self.paper_only else ("", PAPER)

    def configs(self) -> list[TrainingConfig]:
        """What is trained."""
        names = [arm + end for arm in ("torque", "muscle") for end in self.endings]
        return [
            replace(TRAINING_CONFIGS[name], first_seed=self.offset) for name in names
        ]

    def datasets(self) -> list[Dataset]:
        """What is recorded."""
        names = [name for config in self.configs() for name in config.recordings]
        names += ["evaluation", "muscle-evaluation"]
        datasets = []
        for name in dict.fromkeys(names):
            dataset = DATASETS[name]
            first = dataset.first_seed + self.offset
            datasets.append(replace(dataset, first_seed=first))
        return datasets

    def tables(self) -> list[str]:
        """Names of the experiments that do not take hours, of each amount.

        World 0 has all of them, the others those that compare the two amounts.
        """
        found = []
        for name, ending in product(self.experiments, self.endings):
            each = studies.EXPERIMENTS[name]
            everywhere = each.paper or not (ending or self.world)
            if everywhere and not each.slow:
                found.append(each.name + ending)
        return found

    def cases(self, name: str) -> list[dict[str, Any]]:
        """Those of an experiment, with the trainings that there are."""
        experiment = studies.get(name)
        sizes = dict(experiment.paper) if name.endswith(PAPER) or self.world else {}
        if not name.endswith(PAPER):
            # What is left are sizes that both amounts have in common
            sizes = {
                k: v for k, v in sizes.items() if k not in ("weights", "recordings")
            }
        sizes |= {"model": range(self.seeds)} if "model" in experiment.keys else {}
        if self.seeds == 1 and "repeat" in experiment.keys:
            sizes["repeat"] = 0  # what repeats a world is another one
        return experiment.cases(**sizes)


def train(
    configs: Sequence[TrainingConfig],
    seeds: Iterable[int],
    *,
    anew: bool = True,
    **options: Any,
) -> None:
    """Train the autoencoder and the DPMPBs of each configuration, and save them.

    Args:
        configs: what is trained.
        seeds: of the DPMPBs.
        anew: whether weights are trained that are there already.
        options: those of `side_by_side`.
    """
    weights = data.data_folder() / "weights"

    def path(name: str) -> Path:
        return weights / f"{name}.safetensors"

    def missing(name: str) -> bool:
        return anew or not path(name).exists()

    # Autoencoders first: DPMPBs learn from what they see
    chosen = [each for each in configs if missing(f"autoencoder-{each.name}")]
    calls: list[dict[str, Any]] = [{"self": config} for config in chosen]
    function: Callable[..., Any] = TrainingConfig.train_autoencoder
    done = side_by_side(function, calls, "autoencoders", **options)
    for config, (model, losses) in zip(chosen, done, strict=True):
        save_autoencoder(model, losses, path(f"autoencoder-{config.name}"))
    data.write_checksums()

    # And several DPMPBs on top of each
    calls = []
    for config, seed in product(configs, seeds):
        if missing(f"model-{config.name}-{seed}"):
            calls.append({"self": config, "seed": seed})
    function = TrainingConfig.train_model
    for trained in side_by_side(function, calls, "models", **options):
        # Five share an autoencoder, which is ten times as large
        trained.save(path(f"model-{trained.name}"), whole=False)
    data.write_checksums()


def reproduce(plan: Plan, **options: Any) -> None:
    """Make all that is not there yet, in the data folder that `CLOTHLAB_DATA` names.

    Options are those of `side_by_side`.
    """
    # Recordings and targets
    folder = data.data_folder()
    for dataset in plan.datasets():
        record(dataset, anew=False, **options)
    if not (folder / "targets" / "target-1.png").exists():
        save_targets(find_targets())
    data.write_checksums()

    # What learns from them, and is put to the test
    train(plan.configs(), range(plan.seeds), anew=False, **options)
    for name in plan.tables():
        if not _is_stored(name):
            table = studies.get(name).run(plan.cases(name), **options)
            studies.save(table, name)
    data.write_checksums()
    (folder.parent / "results.md").write_text(results(), "utf-8")


def results() -> str:
    """Answers in a few words and all claims, from the tables in the data folder."""
    return f"{report.of_one()}\n\n{report.claims_table()}\n"


@contextlib.contextmanager
def workers_of(address: str | None) -> Iterator[None]:
    """Inside, the workers of a Dask scheduler do all calls, also those that join later.

    Without an address, processes of this machine do them.
    """
    if address is None:
        yield
        return
    from distributed import Client

    # Workers read the same folders
    names = ("CLOTHLAB_DATA", KEPT)
    with Client(address, timeout=60) as client:
        client.wait_for_workers(1, timeout=60)
        folders = {name: os.environ[name] for name in names}
        client.register_worker_callbacks(partial(_use, folders))
        with joblib.parallel_config("dask", client=client, wait_for_workers_timeout=60):
            yield


def _use(folders: dict[str, str]) -> None:
    os.environ.update(folders)


def record_again(names: Sequence[str], **options: Any) -> None:
    """Record these sets of trials, or all trials and targets, into `data/`.

    What was there is replaced.
    """
    for name in names or DATASETS:
        record(DATASETS[name], **options)
    if not names:
        save_targets(find_targets())
        for targets in TARGET_SETS:
            save_targets(find_target_set(targets))
    data.write_checksums()


def train_again(names: Sequence[str], **options: Any) -> None:
    """Train these weights, or all, from the recordings in `data/`."""
    configs = [TRAINING_CONFIGS[name] for name in names or TRAINING_CONFIGS]
    train(configs, range(Plan.seeds), **options)


def run_again(names: Sequence[str], **options: Any) -> None:
    """Run these experiments, or all that do not take hours, and write their results.

    They go into `data/results` and the README. With the paper's amount of recordings,
    most experiments are run in worlds alone; those that are not have a table of that
    amount, which is made anew, too.
    """
    usual = [name for name, each in studies.EXPERIMENTS.items() if not each.slow]
    keep = ROOT / "build" / "experiments"
    os.environ[KEPT] = str(keep)
    for name in names or usual:
        for ending in ("", PAPER) if _is_stored(name + PAPER) else ("",):
            table = studies.run(name + ending, **options)
            studies.save(table, name + ending)
            data.write_checksums()
    shutil.rmtree(keep, ignore_errors=True)  # the next time all is computed again
    report.publish(ROOT)
    print(report.claims_table())


def _is_stored(name: str) -> bool:
    return (data.data_folder() / "results" / f"{name}.csv").exists()


def from_nothing(arguments: argparse.Namespace) -> int:
    """Everything from nothing, in a folder of its own.

    Returned is the exit status.
    """
    folder = arguments.folder.absolute()
    (folder / "data").mkdir(parents=True, exist_ok=True)
    os.environ["CLOTHLAB_DATA"] = str(folder / "data")
    os.environ[KEPT] = str(folder / "kept")
    plan = Plan(
        arguments.seeds, arguments.paper_only, arguments.world, arguments.experiments
    )
    try:
        with workers_of(arguments.scheduler):
            reproduce(plan, workers=arguments.workers, progress=True)
    except KeyboardInterrupt:
        print(f"\ninterrupted: the same command goes on from what lies in {folder}")
        return 130
    shutil.rmtree(folder / "kept", ignore_errors=True)
    print(f"\n{report.of_one()}\n\neverything lies in {folder}")
    return 0


def paper(arguments: argparse.Namespace) -> int:
    """The paper's results once, from nothing, with as many recordings as the paper has.

    Record, train, estimate and control, with both arms, and print the seven answers of
    the README with the numbers of this world. Those of worlds 1 to 10 stand in
    `data/results`. Returned is the exit status.
    """
    arguments.seeds = 1
    arguments.paper_only = True
    arguments.experiments = headline.TABLES
    arguments.scheduler = None
    return from_nothing(arguments)


def worlds(arguments: argparse.Namespace) -> int:
    """Several worlds from nothing, and their tables side by side.

    In each, recordings, autoencoders and DPMPBs are made from seeds of its own; world 0
    is the one in `data/`, on which all choices were made, and not among them. A table
    of all, with a column `world`, goes into `data/results`; what it has of other worlds
    stays. Returned is the exit status.
    """
    home = data.data_folder()
    numbers = range(arguments.first, arguments.first + arguments.count)
    folders = {k: ROOT / "build" / "worlds" / str(k) for k in numbers}
    for k, folder in folders.items():
        words = ["everything", "--world", str(k), "--seeds", "1"]
        words += ["--folder", str(folder), "--workers", str(arguments.workers)]
        words += ["--paper-only"] * arguments.paper_only
        status = subprocess.run([sys.executable, __file__, *words]).returncode
        if status:
            return status
    save_side_by_side({k: folder / "data" for k, folder in folders.items()}, home)
    return 0


def save_side_by_side(worlds: Mapping[int, Path], home: Path) -> None:
    """Save each table that the data folders of all these worlds have as one.

    It is called `worlds-NAME`, and keeps the rows that it has of other worlds.
    """
    folders = [each / "results" for each in worlds.values()]
    named = [{path.stem for path in folder.glob("*.csv")} for folder in folders]
    for name in sorted(set.intersection(*named)):
        parts = {k: studies.load(name, data=each) for k, each in worlds.items()}
        for k, part in parts.items():
            part.insert(0, "world", k)

        # Those made before
        with contextlib.suppress(KeyError):
            stored = studies.load(f"worlds-{name}", data=home)
            others = stored[~stored["world"].isin(worlds)]
            parts |= dict([*others.groupby("world")])

        in_order = [parts[k] for k in sorted(parts)]
        table = pd.concat(in_order, ignore_index=True)
        studies.save(table, f"worlds-{name}", data=home)
    data.write_checksums(home)


def command_line() -> argparse.ArgumentParser:
    """A parser with a command for each of the six programs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _again_command(commands, "record", record_again, DATASETS)
    _again_command(commands, "train", train_again, TRAINING_CONFIGS)
    _again_command(commands, "results", run_again, studies.EXPERIMENTS)

    once = _command(commands, "paper", paper)
    once.add_argument("--folder", type=Path, default=PAPERS_FOLDER)
    once.add_argument("--world", type=int, default=1, help="by default 1")

    everything = _command(commands, "everything", from_nothing)
    everything.set_defaults(experiments=tuple(studies.EXPERIMENTS))
    everything.add_argument("--folder", type=Path, default=FOLDER)
    everything.add_argument(
        "--seeds", type=int, default=Plan.seeds, help="trainings of each DPMPB"
    )
    everything.add_argument(
        "--world",
        type=int,
        default=0,
        help="another one has recordings and trainings from other seeds",
    )
    everything.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, whose workers do the work",
    )

    several = _command(commands, "worlds", worlds)
    several.add_argument("--count", type=int, default=10, help="by default 10")
    several.add_argument("--first", type=int, default=1, help="number of the first")
    for command in (everything, several):
        command.add_argument(
            "--paper-only",
            action="store_true",
            help="only what the paper's amount of recordings teaches",
        )
    return parser


def _again_command(
    commands: Any, name: str, function: Callable[..., None], choices: Collection[str]
) -> None:
    """A command that works in `data/` itself, and takes names."""

    def run(arguments: argparse.Namespace) -> int:
        for word in arguments.names:
            if word not in choices:
                sys.exit(f"unknown {word!r}; choose from {', '.join(choices)}")
        function(arguments.names, workers=arguments.workers, progress=True)
        return 0

    command = _command(commands, name, function)
    command.set_defaults(run=run)
    listed = ", ".join(choices)
    command.add_argument(
        "names", nargs="*", metavar="NAME", help=f"by default all: {listed}"
    )


def _command(
    commands: Any, name: str, function: Callable[..., Any]
) -> argparse.ArgumentParser:
    """A command that says of itself what its function's docstring says."""
    about = inspect.getdoc(function) or ""
    summary, _, _ = about.partition("\n")
    command = commands.add_parser(name, help=summary, description=about)
    command.set_defaults(run=function)
    command.add_argument(
        "--workers", type=int, default=os.cpu_count(), help="processes in this machine"
    )
    return command


def main() -> int:
    """Make what was asked for; returns the exit status."""
    arguments = command_line().parse_args()
    return arguments.run(arguments)


if __name__ == "__main__":
    sys.exit(main())
